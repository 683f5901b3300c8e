//! A peer without any right cannot fill the log: a storm of Hellos costs some lines, and every one
//! is counted.

use std::io::{Read, Write};
use std::net::TcpStream;

use gantry_tau_core::control::client::{Client, Requirements};
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::Capabilities;

use super::{Bench, binary};
use crate::process::{Running, Streams};

/// Lines of a burst, and those that a storm may add while it lasts.
const BURST: usize = 20;

/// Sends a Hello, waits for the first byte of the answer, and leaves.
fn hello(bench: &Bench) {
    let requirements = Requirements {
        capabilities: Capabilities::LOCKSTEP,
        cycle_us: None,
        kinematics_checksum: None,
    };
    let frame = Client::<3>::new(Transport::Stream, requirements)
        .hello()
        .unwrap();
    let mut stream = TcpStream::connect((bench.ip, 7000)).unwrap();
    stream.write_all(&frame).unwrap();
    stream.read_exact(&mut [0]).unwrap();
}

/// Sums the numbers in front of these words.
fn sum(log: &str, words: &str) -> usize {
    log.match_indices(words)
        .map(|(at, _)| log[..at].rsplit(' ').next().unwrap())
        .map(|number| number.parse::<usize>().unwrap())
        .sum()
}

/// Number of clients that the log says were refused or granted a session.
fn counted(server: &Running) -> usize {
    let log = server.stderr();
    let singly = sum(&log, " client(s) refused") + log.matches(" session granted").count();
    singly + sum(&log, " clients refused") + sum(&log, " sessions granted")
}

#[test]
fn of_refused_clients_is_counted() {
    let bench = Bench::new("storm-refused");
    let server = bench.healthy_serve();
    let owner = bench.client(&mut binary(), Streams::default());
    let from = bench.await_an_offset();
    (0..1_000).for_each(|_| hello(&bench));
    bench.await_more(from);
    // The owner's own.
    bench.await_that("a summary", || counted(&server) == 1_000 + 1);
    let (lines, ticks) = (server.stderr().lines().count(), bench.rows().len());
    assert!(
        lines < BURST + 10 + ticks / 1_000,
        "{lines} lines in {ticks} ticks"
    );
    owner.stop().success();
    server.stop().success();
    bench.assert_ramped();
}

#[test]
fn of_sessions_without_a_command_is_counted_and_the_next_owner_is_told() {
    let bench = Bench::new("storm-sessions");
    let mut server = bench.healthy_serve();
    (0..300).for_each(|_| hello(&bench));
    bench.await_that("a summary", || counted(&server) == 300);
    let (lines, ticks) = (server.stderr().lines().count(), bench.rows().len());
    assert!(
        lines < BURST + 10 + ticks / 1_000,
        "{lines} lines in {ticks} ticks"
    );
    // There is no room for the lines of a stranger, and the owner has its own.
    (0..30).for_each(|_| hello(&bench));
    let owner = bench.client(&mut binary(), Streams::default());
    bench.await_an_offset();
    bench.await_that("the owner's own lines", || {
        let log = server.stderr();
        log.rsplit_once("session granted (epoch ")
            .is_some_and(|(_, after)| after.contains("Handshake -> Submit"))
    });
    server.signal("-INT");
    server.await_words("session ended (epoch ");
    server.end().success();
    bench.assert_ramped();
    assert_eq!(owner.end().code, Some(6));
}
