//! Signals that end a server or a client: each is a ramp and the documented exit code. Those that
//! would suspend or end it do nothing.

use std::os::unix::process::CommandExt;
use std::process::Stdio;

use super::{Bench, binary, shell, terminal};
use crate::process::{BINARY, Streams, command};

#[test]
fn that_end_a_server_are_a_ramp() {
    for signal in [
        "-INT", "-TERM", "-HUP", "-QUIT", "-USR1", "-ALRM", "-XCPU", "-PROF", "-IO", "-PWR",
    ] {
        let bench = Bench::new(&format!("server{signal}"));
        let server = bench.healthy_serve();
        let owner = bench.client(&mut binary(), Streams::default());
        bench.await_an_offset();
        server.signal(signal);
        let said = server.end().success();
        assert!(said.contains("all offsets are zero; ended"), "{said}");
        bench.assert_ramped();
        assert_eq!(owner.end().code, Some(6));
    }
}

#[test]
fn that_end_a_client_are_a_goodbye() {
    for signal in ["-INT", "-TERM", "-HUP", "-QUIT"] {
        let bench = Bench::new(&format!("client{signal}"));
        let server = bench.healthy_serve();
        let owner = bench.client(&mut binary(), Streams::default());
        bench.await_an_offset();
        owner.signal(signal);
        let said = owner.end().success();
        assert!(said.starts_with("left with Goodbye"), "{said}");
        server.stop().success();
        bench.assert_ramped();
    }
}

#[test]
fn that_suspend_or_end_other_programs_do_nothing_to_a_server() {
    let bench = Bench::new("server-unmoved");
    // The system suspends nothing in a group whose parent is of another session, as this test may
    // be.
    let mut program = binary();
    program.process_group(0);
    let server = bench.serve(&mut program, Streams::default(), &[]);
    let owner = bench.client(&mut binary(), Streams::default());
    for signal in ["-TSTP", "-TTOU", "-TTIN", "-XFSZ", "-PIPE", "-RTMIN"] {
        let from = bench.await_an_offset();
        server.signal(signal);
        bench.await_more(from);
    }
    server.stop().success();
    bench.assert_ramped();
    assert_eq!(owner.end().code, Some(6));
}

/// `nohup` means that the server outlives its terminal.
#[test]
fn a_hangup_that_the_parent_ignores_does_nothing() {
    let bench = Bench::new("server-nohup");
    let server = bench.serve(&mut shell("trap '' HUP;", ""), Streams::default(), &[]);
    let owner = bench.client(&mut binary(), Streams::default());
    let from = bench.await_an_offset();
    server.signal("-HUP");
    bench.await_more(from);
    server.stop().success();
    assert_eq!(owner.end().code, Some(6));
}

/// The ssh session is gone: the kernel sends SIGHUP, and every read and write of the terminal
/// fails.
#[test]
fn a_controlling_terminal_that_goes_away_is_a_ramp() {
    let bench = Bench::new("server-terminal");
    let (user, terminal) = terminal();
    let [input, output, log] = [(); 3].map(|()| Stdio::from(terminal.try_clone().unwrap()));
    let mut program = command("setsid");
    program.args(["--ctty", BINARY]);
    let server = bench.serve(
        &mut program,
        Streams {
            input,
            output: Some(output),
            log: Some(log),
        },
        &[],
    );
    let owner = bench.client(&mut binary(), Streams::default());
    bench.await_an_offset();
    drop(user);
    assert_eq!(server.end().code, Some(0));
    bench.assert_ramped();
    assert_eq!(owner.end().code, Some(6));
}

/// A parent that closes every descriptor: no file or socket of the server becomes a standard
/// stream, so that no line of the log lands in one.
#[test]
fn a_parent_that_closes_every_descriptor_is_no_harm() {
    let bench = Bench::new("server-bare");
    let server = bench.serve(&mut shell("", "<&- >&- 2>&-"), Streams::default(), &[]);
    let owner = bench.client(&mut binary(), Streams::default());
    bench.await_an_offset();
    for descriptor in 0..3 {
        let is = std::fs::read_link(format!("/proc/{}/fd/{descriptor}", server.id())).unwrap();
        assert_eq!(is, std::path::Path::new("/dev/null"), "{descriptor}");
    }
    assert_eq!(server.stop().code, Some(0));
    bench.assert_ramped();
    assert_eq!(owner.end().code, Some(6));
    let csv = bench.folder.read("serve.csv");
    let mut columns = csv.lines().map(|line| line.split(',').count());
    let of_header = columns.next().unwrap();
    assert!(columns.all(|count| count == of_header));
}
