use std::io::{self, Write as _};

use super::*;

/// A folder that is removed at the end of its test.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn put(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, text).unwrap();
        path
    }

    fn names(&self) -> Vec<String> {
        let names = fs::read_dir(self.0.path())
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let mut names: Vec<String> = names.collect();
        names.sort();
        names
    }
}

/// A text of each kind of which a file is replaced.
const TEXTS: [(Kind, &str); 11] = [
    (
        Kind::Fmu,
        "PK\u{3}\u{4}modelDescription.xml binaries/linux64/gantry_tau_server.so",
    ),
    (
        Kind::Page,
        "<!doctype html><html lang=\"en\"><body>x</body></html>\n",
    ),
    (
        Kind::Sheet,
        "<!doctype html><html lang=\"en\"><body>y</body></html>\n",
    ),
    (
        Kind::Picture,
        "<svg xmlns=\"http://www.w3.org/2000/svg\"></svg>\n",
    ),
    (Kind::Answer, "{\n  \"layout\": 1\n}"),
    (
        Kind::Header,
        "/* A machine. Written by `gantry-tau header`. Do not edit. */\n",
    ),
    (Kind::Model, "<mujoco model=\"l2\"/>\n"),
    (
        Kind::Map,
        "x_m,y_m,z_m,code,condition,compliance_um_per_n\n",
    ),
    (
        Kind::Plan,
        "# planned\nformat = \"gantry-tau springs 1\"\nmodel = \"l2\"\n",
    ),
    (Kind::Table, "series,mounting,pose,window,stroke\n"),
    (Kind::Robot, "# a machine\nmodel = \"l2\"\n"),
];

/// Found from outside: rows that end with a carriage return were rows to the reader, and none to
/// the writer.
#[test]
fn a_table_has_rows_where_its_reader_sees_some() {
    let folder = Folder::new();
    for (text, count) in [
        ("series,pose\n", 0),
        ("series,pose\r\n \r\n", 0),
        ("series,pose\rs1,p1\r", 1),
        ("series,pose\r\ns1,p1\r\n", 1),
        ("", 0),
    ] {
        assert_eq!(rows(text), count, "{text:?}");
        let table = folder.put("table.csv", text);
        assert_eq!(
            Output::new(&table, Kind::Table).check(true).is_ok(),
            count == 0,
            "{text:?}"
        );
    }
}

/// Found from outside: a set-up without spaces was taken for a robot file.
#[test]
fn kinds_of_toml_are_known_by_keys_and_not_by_spaces() {
    let folder = Folder::new();
    for (text, kind) in [
        (
            "format=\"gantry-tau springs 1\"\nmodel=\"l2\"\n",
            Kind::Plan,
        ),
        (
            "format  =  'gantry-tau springs 1'\nmodel = 'l2'\n",
            Kind::Plan,
        ),
        ("model=\"l2\"\n", Kind::Robot),
        ("\tmodel = 'l2'\n", Kind::Robot),
    ] {
        let file = folder.put("file.toml", text);
        for output in [Kind::Plan, Kind::Robot] {
            assert_eq!(
                Output::new(&file, output).check(true).is_ok(),
                output == kind,
                "{text:?} by {output}"
            );
        }
    }
}

#[test]
fn two_spellings_of_one_name_are_one_file_before_it_exists() {
    let folder = Folder::new();
    let [plain, dotted, other] = ["k.csv", "./k.csv", "l.csv"].map(|name| folder.path(name));
    assert!(matches!(
        check_apart(&[&plain, &dotted], &[]),
        Err(WriteError::Twice(_))
    ));
    check_apart(&[&plain, &other], &[]).unwrap();
}

/// Found from outside: of two campaigns onto one new table the first one's rows were lost.
#[test]
fn a_table_that_another_program_writes_is_left_to_it() {
    let folder = Folder::new();
    for old in [None, Some("series,pose\n")] {
        let path = folder.path("table.csv");
        let _ = fs::remove_file(&path);
        old.iter().for_each(|text| fs::write(&path, text).unwrap());
        let [mut first, mut second] = [(); 2].map(|()| GrowingFile::replacing(&path).unwrap());
        first.write_all(b"series,pose\ns1,p1\n").unwrap();
        let error = second.write_all(b"series,pose\n").unwrap_err().to_string();
        assert!(
            error.contains("exists") || error.contains("another program"),
            "{error}"
        );
        assert_eq!(fs::read_to_string(&path).unwrap(), "series,pose\ns1,p1\n");
        let continued = GrowingFile::continuing(&path).unwrap_err().to_string();
        assert!(
            continued.contains("another program writes it"),
            "{continued}"
        );
        // As a child process has it, between its fork and its program.
        let of_child = first.open().unwrap().try_clone().unwrap();
        drop(first);
        GrowingFile::continuing(&path).unwrap();
        drop(of_child);
    }
    // One that was removed meanwhile is made.
    let path = folder.put("removed.csv", "series,pose\n");
    let mut third = GrowingFile::replacing(&path).unwrap();
    fs::remove_file(&path).unwrap();
    third.write_all(b"series,pose\ns1,p1\n").unwrap();
    assert_eq!(folder.names(), ["removed.csv", "table.csv"]);
}

/// A box that was cut would be taken for one that is whole; a device or a link stays.
#[cfg(target_os = "linux")]
#[test]
fn a_black_box_that_cannot_be_written_costs_no_device() {
    let folder = Folder::new();
    let link = folder.path("box.jsonl");
    std::os::unix::fs::symlink("/dev/full", &link).unwrap();
    let error = Output::new(&link, Kind::BlackBox)
        .write("{}\n")
        .unwrap_err()
        .to_string();
    assert!(error.contains("No space left"), "{error}");
    assert_eq!(folder.names(), ["box.jsonl"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_stream_that_is_full_is_an_error() {
    let output = Output::new("/dev/full", Kind::Picture);
    let error = output
        .write("<svg xmlns=\"http://www.w3.org/2000/svg\"></svg>\n")
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("/dev/full") && error.contains("No space left"),
        "{error}"
    );
}

/// Found by review: `experiment -o` and `--raw` hung in a pipe that is not read.
#[cfg(unix)]
#[test]
fn a_table_into_a_pipe_that_is_not_read_is_an_error() {
    let folder = Folder::new();
    let path = folder.path("rows.csv");
    assert!(
        std::process::Command::new("mkfifo")
            .arg(&path)
            .status()
            .unwrap()
            .success()
    );
    let error = GrowingFile::replacing(&path).unwrap_err().to_string();
    assert!(
        error.contains("rows.csv: no program reads the pipe"),
        "{error}"
    );
    let reader = std::thread::spawn({
        let path = path.clone();
        move || fs::File::open(path).unwrap()
    });
    let mut table = GrowingFile::replacing(&path).unwrap();
    let mut reader = reader.join().unwrap();
    let rows = [b'1'; 1 << 17];
    // More than the pipe holds, for a reader that is slow.
    let taken = std::thread::spawn(move || {
        io::Read::read_exact(&mut reader, &mut [0; 1 << 17]).unwrap();
        reader
    });
    table.write_all(&rows).unwrap();
    let reader = taken.join().unwrap();
    let error = table.write_all(&rows).unwrap_err();
    assert_eq!(
        (error.kind(), error.to_string().as_str()),
        (io::ErrorKind::TimedOut, "its reader takes nothing")
    );
    drop(reader);
    assert_eq!(
        table.write_all(&rows).unwrap_err().kind(),
        io::ErrorKind::BrokenPipe
    );
}

/// Measured and foreign files, which no output replaces.
const OTHERS: [(&str, &str); 9] = [
    (
        "rows.csv",
        "series,mounting,pose,window,stroke\nx,1,home,1,1\n",
    ),
    ("run.csv", "tick,state\n1,obtain\n"),
    (
        "box.jsonl",
        "{\"format\":\"gantry-tau black box\",\"version\":4}\n",
    ),
    (
        "loops.jsonl",
        "{\"format\":\"gantry-tau position loops\",\"version\":1}\n",
    ),
    (
        "run.csv.json",
        "{\n  \"written_by\": \"gantry-tau 0.1.0\",\n  \"started_ns\": \"1\"\n}\n",
    ),
    (
        "page.html",
        "<!doctype html><html><body>the user's own</body></html>",
    ),
    ("package.json", "{\n  \"name\": \"x\"\n}"),
    (
        "controller.fmu",
        "PK\u{3}\u{4}modelDescription.xml binaries/linux64/controller.so",
    ),
    ("notes.txt", "kept"),
];

#[test]
fn an_output_replaces_its_own_kind_and_nothing_else() {
    let folder = Folder::new();
    for (kind, text) in TEXTS {
        let target = folder.path("target");
        let output = Output::new(&*target, kind);
        output.write(text).unwrap();
        // Its own kind, written by itself, and an empty file.
        output.check(true).unwrap();
        output.write(text).unwrap();
        fs::write(&target, "").unwrap();
        output.write(text).unwrap();
        let written = fs::read_to_string(&target).unwrap();
        for (other, text) in TEXTS.into_iter().filter(|(other, _)| *other != kind) {
            let error = Output::new(&*target, other).write(text).unwrap_err();
            assert!(
                matches!(error, WriteError::Foreign { .. }),
                "{other:?} over {kind:?}: {error}"
            );
            assert_eq!(
                fs::read_to_string(&target).unwrap(),
                written,
                "{other:?} over {kind:?}"
            );
        }
        fs::remove_file(&target).unwrap();
        for (name, old) in OTHERS {
            let target = folder.put(name, old);
            let output = Output::new(&*target, kind);
            assert!(
                output.check(true).is_err() && output.write(text).is_err(),
                "{kind:?} over {name}"
            );
            assert_eq!(
                fs::read_to_string(&target).unwrap(),
                old,
                "{kind:?} over {name}"
            );
        }
        OTHERS
            .into_iter()
            .for_each(|(name, _)| fs::remove_file(folder.path(name)).unwrap_or_default());
        assert!(folder.names().is_empty(), "{:?}", folder.names());
    }
}

#[test]
fn plans_and_robot_files_need_force() {
    let folder = Folder::new();
    for (kind, text) in TEXTS {
        let output = Output::new(folder.path("target"), kind);
        output.check(false).unwrap();
        output.write(text).unwrap();
        let is_kept = matches!(kind, Kind::Plan | Kind::Robot);
        assert_eq!(output.check(false).is_err(), is_kept, "{kind:?}");
        fs::remove_file(output.path()).unwrap();
    }
}

#[test]
fn all_files_are_written_or_none() {
    let folder = Folder::new();
    let json = Output::new(folder.put("answer.json", ""), Kind::Answer);
    let robot = Output::new(folder.path("robot.toml"), Kind::Robot);
    let missing = Output::new(folder.path("no").join("page.html"), Kind::Page);
    let error = write_all(&[
        (&json, "{}"),
        (&missing, "page"),
        (&robot, "model = \"l2\""),
    ])
    .unwrap_err()
    .to_string();
    assert!(error.contains("page.html"), "{error}");
    assert_eq!(fs::read_to_string(json.path()).unwrap(), "");
    assert_eq!(folder.names(), ["answer.json"]);
    write_all(&[(&json, "{\"a\":1}"), (&robot, "model = \"l2\"")]).unwrap();
    assert_eq!(folder.names(), ["answer.json", "robot.toml"]);
}

#[test]
fn a_recording_gets_a_free_name_with_its_first_bytes() {
    let folder = Folder::new();
    let path = folder.put("run.csv", "tick\n1\n");
    folder.put("run-2.csv.json", "{}");
    let mut file = GrowingFile::fresh(&path, Some(".json")).unwrap();
    assert_eq!((folder.names().len(), file.path()), (2, &*path));
    file.write_all(b"tick\n").unwrap();
    assert_eq!(file.path(), folder.path("run-3.csv"));
    assert_eq!(fs::read_to_string(&path).unwrap(), "tick\n1\n");
    assert_eq!(folder.names(), ["run-2.csv.json", "run-3.csv", "run.csv"]);
    // A link that leads nowhere is taken as well.
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("/nowhere/at/all", folder.path("link.csv")).unwrap();
        let mut file = GrowingFile::fresh(&folder.path("link.csv"), None).unwrap();
        file.write_all(b"x").unwrap();
        assert_eq!(file.path(), folder.path("link-2.csv"));
    }
}

#[cfg(unix)]
#[test]
fn an_input_is_known_through_links() {
    let folder = Folder::new();
    let input = folder.put("in.toml", "x");
    let other = folder.put("other.toml", "y");
    fs::hard_link(&input, folder.path("hard.toml")).unwrap();
    std::os::unix::fs::symlink("in.toml", folder.path("soft.toml")).unwrap();
    for name in [
        "in.toml",
        "hard.toml",
        "soft.toml",
        "../".to_owned().as_str(),
    ] {
        let output = if name == "../" {
            folder.path(".").join("in.toml")
        } else {
            folder.path(name)
        };
        let error = check_apart(&[&output], &[&other, &input]).unwrap_err();
        assert!(matches!(error, WriteError::Input { .. }), "{name}: {error}");
    }
    check_apart(&[&folder.path("new.toml")], &[&input]).unwrap();
    assert!(matches!(
        check_apart(&[&input, &folder.path("hard.toml")], &[]),
        Err(WriteError::Twice(_))
    ));
    assert!(matches!(
        check_apart(&[&folder.path("a"), &folder.path("a")], &[]),
        Err(WriteError::Twice(_))
    ));
    // A terminal may be read and written.
    check_apart(
        &[Path::new("/dev/null"), Path::new("/dev/null")],
        &[Path::new("/dev/null")],
    )
    .unwrap();
}

#[test]
fn names_are_printable_short_and_no_formula() {
    for name in [
        "x",
        "pz1",
        "my L2",
        "Grün",
        "a=b",
        "a-1",
        "hook 1, x",
        "a;\"b\"",
        &"x".repeat(MAX_NAME),
    ] {
        let read: Name = name.parse().unwrap();
        assert_eq!((read.as_str(), &Name::made(name)), (name, &read));
    }
    let too_long = "x".repeat(MAX_NAME + 1);
    let wrong = [
        ("", NameError::Empty, "_"),
        (
            "=cmd|' /C calc'!A0",
            NameError::Formula('='),
            "_cmd|' /C calc'!A0",
        ),
        ("+1", NameError::Formula('+'), "_1"),
        ("-1", NameError::Formula('-'), "_1"),
        ("@sum", NameError::Formula('@'), "_sum"),
        ("a\0", NameError::Unprintable('\0'), "a_"),
        ("a\nb", NameError::Unprintable('\n'), "a_b"),
        ("\u{1b}[2J", NameError::Unprintable('\u{1b}'), "_[2J"),
        ("a\tb", NameError::Unprintable('\t'), "a_b"),
        ("a\u{202e}b", NameError::Unprintable('\u{202e}'), "a_b"),
        ("\u{85}", NameError::Unprintable('\u{85}'), "_"),
        (&too_long, NameError::Long(MAX_NAME + 1), &too_long[1..]),
    ];
    for (text, error, made) in wrong {
        assert_eq!(text.parse::<Name>().unwrap_err(), error, "{text:?}");
        // What the program makes of it is a name.
        assert_eq!(made.parse(), Ok(Name::made(text)), "{text:?}");
    }
    assert_eq!(printable("a\u{1b}[2Jb\n"), "a\\u{1b}[2Jb\\n");
}
