//! The relay between two plain sockets.

use gantry_tau_core::control::message::ClientMessage;
use gantry_tau_core::control::wire::encode_client;
use gantry_tau_core::units::Epoch;

use super::*;
use crate::faults::Fault;
use crate::faults::plan::parse_script;

const LOOPBACK: &str = "127.0.0.1:0";
/// Nothing depends on how fast it is.
const DEADLINE: Duration = Duration::from_secs(20);

struct Link {
    relay: Relay,
    ended: Receiver<Ended>,
    client: TcpStream,
    server: TcpStream,
}

fn link(script: &str) -> Link {
    let plan = Plan {
        script: parse_script(script).unwrap(),
        ..Plan::default()
    };
    let listener = TcpListener::bind(LOOPBACK).unwrap();
    let to = listener.local_addr().unwrap();
    let (relay, ended) = Relay::spawn(LOOPBACK.parse().unwrap(), to, plan).unwrap();
    let client = TcpStream::connect(relay.address).unwrap();
    let (server, _) = listener.accept().unwrap();
    for stream in [&client, &server] {
        stream.set_read_timeout(Some(DEADLINE)).unwrap();
    }
    Link {
        relay,
        ended,
        client,
        server,
    }
}

fn frame(epoch: u64) -> Vec<u8> {
    encode_client(&ClientMessage::<3>::Goodbye(Epoch(epoch))).to_vec()
}

fn frames(epochs: impl IntoIterator<Item = u64>) -> Vec<u8> {
    epochs.into_iter().flat_map(frame).collect()
}

/// Everything up to the close.
fn all(mut stream: &TcpStream) -> Vec<u8> {
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).unwrap();
    bytes
}

fn is_quiet(stream: &TcpStream) -> bool {
    stream
        .set_read_timeout(Some(Duration::from_millis(100)))
        .unwrap();
    let seen = stream.peek(&mut [0]);
    matches!(seen, Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut))
}

#[test]
fn frames_are_found_however_they_are_cut() {
    let Link {
        relay: _relay,
        mut client,
        server,
        ended,
        ..
    } = link("frame 2 up drop\nframe 4 up duplicate");
    for piece in frames(1..=5).chunks(7) {
        client.write_all(piece).unwrap();
    }
    client.shutdown(Shutdown::Write).unwrap();
    assert_eq!(all(&server), frames([1, 3, 4, 4, 5]));
    // The other direction is still open.
    (&server).write_all(b"not a frame").unwrap();
    let here = client.local_addr().unwrap();
    drop(server);
    assert_eq!(all(&client), b"not a frame");
    let ended = ended.recv_timeout(DEADLINE).unwrap();
    assert_eq!(
        (ended.peer, ended.up.frames, ended.down.frames),
        (here, 5, 1)
    );
    let times = |fault| ended.up.acted[&fault].times;
    assert_eq!((times(Fault::Drop), times(Fault::Duplicate)), (1, 1));
    assert!(ended.down.acted.is_empty());
}

#[test]
fn what_is_delayed_comes_later_and_before_the_close() {
    let Link {
        relay: _relay,
        mut client,
        server,
        ..
    } = link("frame 2 up burst 150");
    let since = Instant::now();
    client.write_all(&frames(1..=3)).unwrap();
    drop(client);
    let mut first = [0; 18];
    (&server).read_exact(&mut first).unwrap();
    assert_eq!(all(&server), frames([2, 3]));
    assert!(since.elapsed() >= Duration::from_millis(150));
}

#[test]
fn a_reset_is_a_reset_at_both_ends() {
    let Link {
        relay: _relay,
        mut client,
        server,
        ..
    } = link("frame 2 up reset");
    client.write_all(&frames(1..=3)).unwrap();
    for stream in [&server, &client] {
        let mut stream = stream;
        let error = stream.read_to_end(&mut Vec::new()).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::ConnectionReset);
    }
}

#[test]
fn a_half_open_link_says_nothing_not_even_that_it_is_closed() {
    let Link {
        relay: _relay,
        mut client,
        server,
        ended,
        ..
    } = link("frame 2 up half-open");
    client.write_all(&frames(1..=3)).unwrap();
    let mut first = [0; 18];
    (&server).read_exact(&mut first).unwrap();
    assert_eq!(first[..], frame(1));
    drop(client);
    assert!(is_quiet(&server));
    // It ends when both ends have closed.
    drop(server);
    ended.recv_timeout(DEADLINE).unwrap();
}

#[test]
fn a_cut_cable_is_silent_both_ways_and_closes_with_the_relay() {
    let Link {
        relay,
        mut client,
        mut server,
        ..
    } = link("");
    client.write_all(&frame(1)).unwrap();
    let mut first = [0; 18];
    server.read_exact(&mut first).unwrap();
    relay.cut();
    client.write_all(&frame(2)).unwrap();
    server.write_all(&frame(3)).unwrap();
    assert!(is_quiet(&server) && is_quiet(&client));
    drop(relay);
    for stream in [&server, &client] {
        stream.set_read_timeout(Some(DEADLINE)).unwrap();
        let mut stream = stream;
        // The system may reset what was never read.
        assert!(matches!(stream.read(&mut [0]), Ok(0) | Err(_)));
    }
}

#[test]
fn a_stalled_link_fills_its_senders_buffers() {
    let Link {
        relay: _relay,
        client,
        server,
        ..
    } = link("frame 1 up stall 60000");
    client
        .set_write_timeout(Some(Duration::from_millis(300)))
        .unwrap();
    let megabyte = vec![0; 1 << 20];
    let mut written = 0;
    let full = loop {
        match (&client).write(&megabyte) {
            Ok(count) => written += count,
            Err(error) => break error,
        }
        assert!(written < 1 << 28, "the relay reads on");
    };
    assert!(matches!(
        full.kind(),
        ErrorKind::WouldBlock | ErrorKind::TimedOut
    ));
    assert!(is_quiet(&server));
}

#[test]
fn a_server_that_is_not_there_is_a_closed_connection() {
    let nobody = TcpListener::bind(LOOPBACK).unwrap().local_addr().unwrap();
    let (relay, _) = Relay::spawn(LOOPBACK.parse().unwrap(), nobody, Plan::harmless()).unwrap();
    let client = TcpStream::connect(relay.address).unwrap();
    client.set_read_timeout(Some(DEADLINE)).unwrap();
    assert_eq!(all(&client), b"");
}
