//! `replay`, and the black boxes that `demo` and `serve` leave.

use serde_json::Value;

use crate::process::Folder;
use crate::signals::{await_obtain, client, serve};

/// A demo in lock-step whose black box of the pulled cable is `box.jsonl`.
fn pulled_cable(name: &str) -> Folder {
    let folder = Folder::new(name);
    let short = ["--step-seconds", "0.5", "--force-max", "60"];
    let mut arguments = vec!["demo", "--pace", "lockstep", "--black-box", "box.jsonl"];
    arguments.extend(short);
    let said = folder.run(&arguments).success();
    assert!(
        said.contains("black box of the pulled cable: box.jsonl"),
        "{said}"
    );
    folder
}

/// `box.jsonl` with its line of that number changed, as `name`.
fn edit(folder: &Folder, name: &str, number: usize, change: impl Fn(&str) -> String) {
    let text = folder.read("box.jsonl");
    let lines = (1..).zip(text.lines());
    let lines = lines.map(|(at, line)| {
        if at == number {
            change(line)
        } else {
            line.to_owned()
        }
    });
    folder.write(name, &lines.collect::<Vec<_>>().join("\n"));
}

#[test]
fn a_pulled_cable_replays_bit_for_bit_and_an_edited_digit_is_found() {
    let folder = pulled_cable("replay");
    let arguments = [
        "replay",
        "box.jsonl",
        "--json",
        "box.json",
        "--report",
        "box.svg",
    ];
    let said = folder.run(&arguments).success();
    let found: Value = serde_json::from_str(&folder.read("box.json")).unwrap();
    let ticks = found["ticks"].as_u64().unwrap();
    assert!((129..=192).contains(&ticks), "{ticks}");
    for words in [
        "3 axes, epoch 1",
        &format!(
            "{ticks} ticks, {} to {}",
            found["first_tick"], found["last_tick"]
        ),
        &format!("ClientLate in tick {}", found["cause_tick"]),
        &format!("all {ticks} ticks agree bit for bit"),
    ] {
        assert!(said.contains(words), "{words} is not in: {said}");
    }
    assert_eq!(
        (&found["agreeing"], &found["difference"]),
        (&found["ticks"], &Value::Null)
    );
    let drawn = folder.read("box.svg");
    for words in [
        "axis 3",
        "ClientLate",
        "SafeDisconnect",
        "deadline missed",
        "ticks after the cause",
    ] {
        assert!(drawn.contains(words), "{words} is not drawn");
    }
    assert_edited_digit(&folder);
}

fn assert_edited_digit(folder: &Folder) {
    let line = folder.read("box.jsonl").lines().nth(99).unwrap().to_owned();
    let tick: Value = serde_json::from_str(&line).unwrap();
    let recorded = tick["output"]["state"]["axes"][1]["offsets"]["position"]
        .as_i64()
        .unwrap();
    let axis = format!(
        "\"nominal\":{},\"offsets\":{{\"position\":",
        tick["input"]["tick"]["reading"]["nominal"][1]
    );
    edit(folder, "edited.jsonl", 100, |line| {
        let [true_words, edited] = [recorded, recorded ^ 1].map(|nm| format!("{axis}{nm},"));
        assert!(line.contains(&true_words), "{true_words} is not in: {line}");
        line.replace(&true_words, &edited)
    });
    let arguments = [
        "replay",
        "edited.jsonl",
        "--json",
        "edited.json",
        "--report",
        "edited.html",
    ];
    let ended = folder.run(&arguments);
    assert_eq!(ended.code, Some(3), "{}{}", ended.stdout, ended.stderr);
    let number = &tick["output"]["state"]["tick"];
    for words in [
        "97 of ",
        "DIFFERS",
        &format!(
            "tick {number}, state.axes[1].offsets.position (axis 2): recorded {}, replayed {recorded}",
            recorded ^ 1
        ),
    ] {
        assert!(
            ended.stdout.contains(words),
            "{words} is not in: {}",
            ended.stdout
        );
    }
    let found: Value = serde_json::from_str(&folder.read("edited.json")).unwrap();
    assert_eq!(
        (&found["agreeing"], &found["difference"]["tick"]),
        (&Value::from(97), number)
    );
    let page = folder.read("edited.html");
    assert!(page.contains("replay differs") && page.trim_end().ends_with("</html>"));
}

#[test]
fn another_file_is_refused_with_line_and_reason() {
    let folder = pulled_cable("refused");
    // The second half of a line is cut off where nothing is replaced.
    let edits: [(usize, [&str; 2], &str); 6] = [
        (
            1,
            ["\"version\":8", "\"version\":7"],
            "version is 7; this program reads version 8",
        ),
        (1, ["\"axes\":3", "\"axes\":5"], "axes is 5"),
        (
            2,
            ["\"ramp\":100", "\"ramp\":0"],
            "config.axes[0].limits.position: ramp is 0",
        ),
        (
            2,
            ["\"upper\":", "\"upper\":-9"],
            "config: axis 0: lower end of a travel",
        ),
        (
            2,
            ["\"velocity\":{\"value\":0", "\"velocity\":{\"value\":9999"],
            "the state of the session contradicts its configuration: axis 0 has an offset beyond its limits",
        ),
        (50, ["", ""], "EOF while parsing"),
    ];
    for (number, [from, to], words) in edits {
        edit(&folder, "bad.jsonl", number, |line| {
            assert!(line.contains(from), "{from} is not in: {line}");
            match from {
                "" => line[..line.len() / 2].to_owned(),
                _ => line.replacen(from, to, 1),
            }
        });
        let line = folder.run(&["replay", "bad.jsonl"]).failure(1);
        for words in ["bad.jsonl", &format!("line {number}: "), words] {
            assert!(line.contains(words), "{words} is not in: {line}");
        }
    }
    let text = folder.read("box.jsonl");
    folder.write(
        "cut.jsonl",
        &text.lines().take(80).collect::<Vec<_>>().join("\n"),
    );
    let line = folder.run(&["replay", "cut.jsonl"]).failure(1);
    assert!(
        line.contains("cut.jsonl, line 80: the file ends with 78 ticks"),
        "{line}"
    );
    for (name, words) in [
        ("none.jsonl", "os error"),
        (".", "is a folder"),
        ("report.html", "line 1: this is not a black box"),
    ] {
        let line = folder.run(&["replay", name]).failure(1);
        assert!(line.contains(name) && line.contains(words), "{line}");
    }
    let line = folder
        .run(&["replay", "box.jsonl", "--report", "no/such.svg"])
        .failure(1);
    assert!(
        line.contains("no/such.svg") && line.contains("os error"),
        "{line}"
    );
    let line = folder
        .run(&["replay", "box.jsonl", "--report", "plot.png"])
        .failure(2);
    assert!(line.contains(".svg or .html"), "{line}");
}

#[test]
fn serve_leaves_a_black_box_of_every_end() {
    let folder = Folder::new("boxes");
    let (mut server, addresses) = serve(&folder, &["--black-box", "new/boxes"]);
    let first = client(&folder, "first", &addresses);
    await_obtain(&mut server, 1);
    first.kill();
    server.await_words("black box: ");
    let _second = client(&folder, "second", &addresses);
    await_obtain(&mut server, 2);
    server.stop().success();
    let files = std::fs::read_dir(folder.path("new/boxes")).unwrap();
    let mut names: Vec<String> = files
        .map(|file| file.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(names.len(), 2, "{names:?}");
    assert!(names[0].starts_with("epoch-1-tick-"), "{names:?}");
    assert!(
        names[1].starts_with("epoch-2-tick-") && names[1].ends_with("-Quit.jsonl"),
        "{names:?}"
    );
    for name in names {
        let said = folder
            .run(&["replay", &format!("new/boxes/{name}")])
            .success();
        assert!(said.contains("ticks agree bit for bit"), "{said}");
    }
}

#[test]
fn a_black_box_that_cannot_be_written_is_named() {
    let folder = Folder::new("lost");
    folder.write("file", "");
    for bad in ["file", "file/boxes"] {
        let arguments = ["serve", "--listen", "127.0.0.1:0", "--black-box", bad];
        let line = folder.run(&arguments).failure(1);
        assert!(line.contains(bad) && line.contains("os error"), "{line}");
    }
    let (mut server, addresses) = serve(&folder, &["--black-box", "boxes"]);
    std::fs::remove_dir(folder.path("boxes")).unwrap();
    let only = client(&folder, "only", &addresses);
    await_obtain(&mut server, 1);
    only.kill();
    server.await_words("black box lost: boxes");
    let line = server.stop().failure(1);
    assert!(
        line.contains("boxes") && line.contains("os error"),
        "{line}"
    );
}

/// Found by attack: a device was read until the memory was full, a pipe for ever.
#[test]
fn a_black_box_that_has_no_end_is_refused() {
    let folder = Folder::new("endless");
    let pipe = std::process::Command::new("mkfifo")
        .arg(folder.path("pipe"))
        .status();
    assert!(pipe.unwrap().success());
    std::fs::File::create(folder.path("big"))
        .unwrap()
        .set_len(10_000_000_000)
        .unwrap();
    for (bad, words) in [
        ("/dev/zero", "is a device, a pipe or a socket"),
        ("pipe", "is a device, a pipe or a socket"),
        (".", "is a folder"),
        ("big", "has 10000000000 bytes"),
        ("none", "os error"),
    ] {
        let line = folder.run(&["replay", bad]).failure(1);
        assert!(line.contains(bad) && line.contains(words), "{line}");
    }
}
