//! `faults` between a server and a client, all three as processes, and its refusals.

use std::io::ErrorKind;
use std::net::UdpSocket;
use std::time::Duration;

use crate::process::{Folder, Running};
use crate::signals::{await_obtain, client, leave, serve};

/// Returns one entry of a script.
fn entry(at: &str, direction: &str, kind: &str) -> String {
    format!("[[fault]]\n{at}\ndirection = \"{direction}\"\nkind = \"{kind}\"\n")
}

/// Starts a relay on a free port; returns it with the address for its clients.
fn link(folder: &Folder, to: &str, further: &[&str]) -> (Running, String) {
    let mut arguments = vec!["faults", "--listen", "127.0.0.1:0", "--to", to];
    arguments.extend(further);
    let mut link = folder.start("faults", &arguments);
    link.await_words("Ctrl-C ends");
    let said = link.stderr();
    let rest = said.split_once("listening on ").unwrap().1;
    (link, rest[..rest.find(',').unwrap()].to_owned())
}

#[test]
fn a_scripted_fault_ends_the_session_and_is_counted() {
    let folder = Folder::new("faults");
    folder.write("script", &entry("at_frame = 300", "up", "corrupt"));
    let (mut server, address) = serve(&folder, &[]);
    let (link, through) = link(&folder, &address, &["--script", "script", "--json"]);
    // The server closes at once after a broken frame; its log has the reason.
    let line = (client(&folder, "client", &through).end()).failure(7);
    assert!(line.contains("the server vanished"), "{line}");
    server.await_words("broken frame boundary, checksum or tag");
    server.await_words("SafeDisconnect -> Listening");
    let said = link.stop().success();
    let said: serde_json::Value = serde_json::from_str(&said).unwrap();
    assert_eq!(said["connections"], 1);
    assert_eq!(
        said["faults"],
        serde_json::json!({"corrupt": {"up": 1, "down": 0}})
    );
    assert!(said["frames"]["up"].as_u64().unwrap() >= 300, "{said}");
    server.stop().success();
}

/// The first Hello is lost, most frames come twice, some are reordered: the client repeats the
/// Hello, answers each State once, and its Goodbye is received.
#[test]
fn a_client_tolerates_lost_doubled_and_reordered_datagrams() {
    let folder = Folder::new("faults-udp-session");
    folder.write("script", &entry("at_frame = 1", "up", "drop"));
    let (mut server, address) = serve(&folder, &["--udp"]);
    let faults = [
        "--udp",
        "--duplicate",
        "0.8:1",
        "--reorder",
        "0.1",
        "--script",
        "script",
    ];
    let (link, through) = link(&folder, &address, &faults);
    let owner = folder.start("owner", &["client", &through, "--udp"]);
    await_obtain(&mut server, 1);
    leave(owner, &mut server);
    let said = link.stop().success();
    assert!(
        said.contains("drop") && said.contains("duplicate"),
        "{said}"
    );
    server.stop().success();
}

#[test]
fn datagrams_are_forwarded_and_lost_as_told() {
    let folder = Folder::new("faults-udp");
    let server = UdpSocket::bind("127.0.0.1:0").unwrap();
    server
        .set_read_timeout(Some(Duration::from_secs(20)))
        .unwrap();
    let to = server.local_addr().unwrap().to_string();
    let (link, through) = link(&folder, &to, &["--udp", "--duplicate", "1:2"]);
    let client = UdpSocket::bind("127.0.0.1:0").unwrap();
    client.send_to(b"thrice", through).unwrap();
    for _ in 0..3 {
        let mut buffer = [0; 10];
        let count = loop {
            match server.recv(&mut buffer) {
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                received => break received.unwrap(),
            }
        };
        assert_eq!(&buffer[..count], b"thrice");
    }
    let said = link.stop().success();
    assert!(said.starts_with("1 connections\n"), "{said}");
    let words: Vec<&str> = said.split_whitespace().collect();
    assert!(
        words.ends_with(&["frames", "1", "0", "duplicate", "1", "0"]),
        "{said}"
    );
}

#[test]
fn bad_options_and_scripts_are_refused_in_one_line() {
    let folder = Folder::new("faults-errors");
    let script = ["up", "sideways"].map(|direction| entry("at_frame = 1", direction, "drop"));
    folder.write("script", &script.concat());
    folder.write("twice", &entry("at_frame = 1", "up", "drop").repeat(2));
    let to = ["faults", "--listen", "127.0.0.1:0", "--to", "127.0.0.1:1"];
    for (further, code, words) in [
        (
            ["--script", "script"],
            1,
            "script: line 7, `direction = \"sideways\"`: unknown variant `sideways`, expected one of `up`, `down`, `both`",
        ),
        (
            ["--script", "twice"],
            1,
            "twice: fault 2: `at_frame`: this frame already has a fault",
        ),
        (["--script", "nowhere"], 1, "nowhere: "),
        (
            ["--reorder", "0.1"],
            1,
            "reorder: a stream keeps its order; --udp only",
        ),
        (["--reset", "0.1:3"], 1, "reset takes no parameter"),
        (["--drop", "2"], 2, "P must be from 0 to 1"),
        (["--delay", "-1"], 2, "must be from 0 to 60000"),
        (["--direction", "left"], 2, "expected up, down or both"),
    ] {
        let arguments: Vec<&str> = to.into_iter().chain(further).collect();
        let line = folder.run(&arguments).failure(code);
        assert!(line.contains(words), "{line}");
    }
}
