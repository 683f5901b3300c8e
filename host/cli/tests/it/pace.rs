//! `pace --stdio`: a program that has started its pacer.

use std::process::Stdio;

use crate::process::{Folder, Running, address_behind};

/// A server in lock-step, and a pacer on pipes.
fn started(folder: &Folder) -> (Running, Running) {
    let serve = ["serve", "--pace", "lockstep", "--listen", "127.0.0.1:0"];
    let mut server = folder.start("serve", &serve);
    server.await_words("listening on");
    let address = address_behind(&server.stdout(), "listening on ");
    let pacer = folder.start_with("pace", &["pace", &address, "--stdio"], Stdio::piped());
    (server, pacer)
}

#[test]
fn on_its_streams_ends_with_its_program() {
    let folder = Folder::new("stdio");
    let (mut server, mut pacer) = started(&folder);
    pacer.await_words(r#""phase":"submit""#);
    pacer.write("half a line\n");
    pacer.await_words("expected value");
    pacer.write("{\"mode\":\"obtain\",\"t\":1e6,\"offset_um\":[0,0,0]}\n");
    pacer.await_words("too far in the future");
    assert!(
        !pacer.stdout().contains("obtain\""),
        "a refused line changes nothing"
    );
    pacer.write("{\"mode\":\"obtain\",\"t\":9,\"offset_um\":[0,0,0]}\n");
    pacer.await_words(r#""phase":"obtain""#);
    pacer.close_input();
    pacer.end().success();
    server.await_words("the client said goodbye");
    server.stop().success();
}

#[test]
fn on_its_streams_says_why_there_is_no_session() {
    let folder = Folder::new("stdio-alone");
    let ended = folder.run(&["pace", "127.0.0.1:1", "--stdio"]);
    assert!(
        ended.stdout.contains("cannot be reached"),
        "{}",
        ended.stdout
    );
    assert!(ended.stdout.starts_with(r#"{"error":"#), "{}", ended.stdout);
    let ended = folder.run(&["pace", "--stdio", "--allow", "127.0.0.1"]);
    assert_eq!(ended.code, Some(2), "{}", ended.stderr);
}
