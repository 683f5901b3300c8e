//! The relay between plain sockets.

use gantry_tau_core::control::message::ClientMessage;
use gantry_tau_core::control::wire::encode_client;
use gantry_tau_core::units::Epoch;

use super::*;
use crate::faults::Fault;
use crate::faults::plan::{Directions, ScriptedFault, When};

const LOOPBACK: &str = "127.0.0.1:0";
/// Longest wait; the tests do not depend on speed.
const DEADLINE: Duration = Duration::from_secs(20);

/// Faults of frames going up: frame, fault, parameter.
fn plan(script: &[(u64, Fault, Option<u32>)]) -> FaultPlan {
    let script = script
        .iter()
        .map(|&(frame, fault, parameter)| ScriptedFault {
            when: When::Frame(frame),
            direction: Directions::Up,
            fault,
            parameter,
        });
    FaultPlan {
        script: script.collect(),
        ..FaultPlan::default()
    }
}

fn relay(
    server: impl Into<Addresses>,
    transport: Transport,
    plan: FaultPlan,
) -> (Relay, Receiver<LinkReport>) {
    Relay::spawn(LOOPBACK.parse().unwrap(), server, transport, plan).unwrap()
}

struct Streams {
    relay: Relay,
    ended: Receiver<LinkReport>,
    client: TcpStream,
    server: TcpStream,
}

fn streams(script: &[(u64, Fault, Option<u32>)]) -> Streams {
    let listener = TcpListener::bind(LOOPBACK).unwrap();
    let server = listener.local_addr().unwrap();
    let (relay, ended) = relay(server, Transport::Stream, plan(script));
    let client = TcpStream::connect(relay.address).unwrap();
    let (server, _) = listener.accept().unwrap();
    for stream in [&client, &server] {
        stream.set_read_timeout(Some(DEADLINE)).unwrap();
    }
    Streams {
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

/// As many bytes as a frame of these tests has.
fn first_frame(mut stream: &TcpStream) -> Vec<u8> {
    let mut bytes = vec![0; frame(0).len()];
    stream.read_exact(&mut bytes).unwrap();
    bytes
}

/// Every byte up to the close.
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
    // Interrupted: this process was stopped, and goes on.
    matches!(seen, Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted))
}

#[test]
fn frames_are_found_however_they_are_cut() {
    let Streams {
        relay: _relay,
        mut client,
        server,
        ended,
        ..
    } = streams(&[(2, Fault::Drop, None), (4, Fault::Duplicate, None)]);
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
    for fault in [Fault::Drop, Fault::Duplicate] {
        assert_eq!(ended.up.faults[&fault].times, 1, "{fault}");
    }
    assert!(ended.down.faults.is_empty());
}

#[test]
fn what_is_delayed_comes_later_and_before_the_close() {
    let Streams {
        relay: _relay,
        mut client,
        server,
        ..
    } = streams(&[(2, Fault::Burst, Some(150))]);
    let since = Instant::now();
    client.write_all(&frames(1..=3)).unwrap();
    drop(client);
    first_frame(&server);
    assert_eq!(all(&server), frames([2, 3]));
    assert!(since.elapsed() >= Duration::from_millis(150));
}

#[test]
fn a_reset_is_a_reset_at_both_ends() {
    let Streams {
        relay: _relay,
        mut client,
        server,
        ..
    } = streams(&[(2, Fault::Reset, None)]);
    client.write_all(&frames(1..=3)).unwrap();
    for stream in [&server, &client] {
        let mut stream = stream;
        let error = stream.read_to_end(&mut Vec::new()).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::ConnectionReset);
    }
}

#[test]
fn a_half_open_link_says_nothing_not_even_that_it_is_closed() {
    let Streams {
        relay: _relay,
        mut client,
        server,
        ended,
        ..
    } = streams(&[(2, Fault::HalfOpen, None)]);
    client.write_all(&frames(1..=3)).unwrap();
    assert_eq!(first_frame(&server), frame(1));
    drop(client);
    assert!(is_quiet(&server));
    // It ends when both ends have closed.
    drop(server);
    ended.recv_timeout(DEADLINE).unwrap();
}

#[test]
fn a_cut_cable_is_silent_both_ways_and_closes_with_the_relay() {
    let Streams {
        relay,
        mut client,
        mut server,
        ..
    } = streams(&[]);
    client.write_all(&frame(1)).unwrap();
    first_frame(&server);
    relay.cut();
    client.write_all(&frame(2)).unwrap();
    server.write_all(&frame(3)).unwrap();
    assert!(is_quiet(&server) && is_quiet(&client));
    drop(relay);
    for stream in [&server, &client] {
        stream.set_read_timeout(Some(DEADLINE)).unwrap();
        let mut stream = stream;
        // The system may reset what was never read.
        assert!(matches!(
            stream.read_to_end(&mut Vec::new()),
            Ok(0) | Err(_)
        ));
    }
}

#[test]
fn a_stalled_link_fills_its_senders_buffers() {
    let Streams {
        relay: _relay,
        client,
        server,
        ..
    } = streams(&[(1, Fault::Stall, Some(60_000))]);
    client
        .set_write_timeout(Some(Duration::from_millis(300)))
        .unwrap();
    let megabyte = vec![0; 1 << 20];
    let mut written = 0;
    let full = loop {
        match (&client).write(&megabyte) {
            Ok(count) => written += count,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
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
    let absent = TcpListener::bind(LOOPBACK).unwrap().local_addr().unwrap();
    let (relay, ended) = relay(absent, Transport::Stream, FaultPlan::default());
    let client = TcpStream::connect(relay.address).unwrap();
    client.set_read_timeout(Some(DEADLINE)).unwrap();
    assert_eq!(all(&client), b"");
    let ended = ended.recv_timeout(DEADLINE).unwrap();
    assert_eq!(
        (ended.peer, ended.up.frames),
        (client.local_addr().unwrap(), 0)
    );
}

fn socket() -> UdpSocket {
    let socket = UdpSocket::bind(LOOPBACK).unwrap();
    socket.set_read_timeout(Some(DEADLINE)).unwrap();
    socket
}

fn next(socket: &UdpSocket) -> (Vec<u8>, SocketAddr) {
    let mut buffer = [0; 100];
    let (count, from) = loop {
        match socket.recv_from(&mut buffer) {
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            received => break received.unwrap(),
        }
    };
    (buffer[..count].to_vec(), from)
}

#[test]
fn every_datagram_client_has_its_own_socket_and_its_own_faults() {
    let server = socket();
    let mut plan = plan(&[(2, Fault::Drop, None), (1, Fault::Duplicate, None)]);
    plan.script[1].direction = Directions::Down;
    let (relay, ended) = relay(server.local_addr().unwrap(), Transport::Datagram, plan);
    let clients = [socket(), socket()];
    for (client, name) in clients.iter().zip([b"a", b"b"]) {
        for _ in 0..3 {
            client.send_to(name, relay.address).unwrap();
        }
        let (first, way) = next(&server);
        assert_eq!(
            (first, next(&server)),
            (name.to_vec(), (name.to_vec(), way))
        );
        server.send_to(name, way).unwrap();
        assert_eq!(next(client), (name.to_vec(), relay.address));
        assert_eq!(next(client), (name.to_vec(), relay.address));
    }
    drop(relay);
    let ended: Vec<LinkReport> = ended.iter().collect();
    let peers: Vec<SocketAddr> = ended.iter().map(|ended| ended.peer).collect();
    assert_eq!(peers, clients.map(|client| client.local_addr().unwrap()));
    for ended in ended {
        assert_eq!((ended.up.frames, ended.down.frames), (3, 1));
        assert_eq!(ended.up.faults[&Fault::Drop].times, 1);
        assert_eq!(ended.down.faults[&Fault::Duplicate].times, 1);
    }
}

#[test]
fn a_reordered_datagram_comes_after_its_successors() {
    let server = socket();
    let plan = plan(&[
        (1, Fault::Reorder, Some(200)),
        (3, Fault::Truncate, Some(0)),
    ]);
    let (relay, _ended) = relay(server.local_addr().unwrap(), Transport::Datagram, plan);
    let client = socket();
    for bytes in ["one", "two", "three"] {
        client.send_to(bytes.as_bytes(), relay.address).unwrap();
    }
    let came = [(); 3].map(|()| next(&server).0);
    assert_eq!(came, [b"two".to_vec(), b"".to_vec(), b"one".to_vec()]);
}

#[test]
fn datagrams_to_an_absent_server_are_lost_and_later_ones_arrive() {
    let server = socket();
    let address = server.local_addr().unwrap();
    let (relay, _ended) = relay(address, Transport::Datagram, FaultPlan::default());
    drop(server);
    let client = socket();
    client.send_to(b"lost", relay.address).unwrap();
    std::thread::sleep(Duration::from_millis(50));
    let server = UdpSocket::bind(address).unwrap();
    server.set_read_timeout(Some(DEADLINE)).unwrap();
    client.send_to(b"heard", relay.address).unwrap();
    assert_eq!(next(&server).0, b"heard");
}

#[test]
fn every_address_of_a_server_is_tried() {
    let listener = TcpListener::bind(LOOPBACK).unwrap();
    let closed = TcpListener::bind(LOOPBACK).unwrap().local_addr().unwrap();
    let to = Addresses::of(closed, &[listener.local_addr().unwrap()]);
    let (relay, _ended) = relay(to, Transport::Stream, FaultPlan::default());
    let client = TcpStream::connect(relay.address).unwrap();
    let (server, _) = listener.accept().unwrap();
    server.set_read_timeout(Some(DEADLINE)).unwrap();
    (&client).write_all(&frame(1)).unwrap();
    assert_eq!(first_frame(&server), frame(1));
}

/// One client more than there is room for; it is served once another has left.
#[test]
fn clients_are_bounded() {
    let listener = TcpListener::bind(LOOPBACK).unwrap();
    let server = listener.local_addr().unwrap();
    let (relay, _ended) = relay(server, Transport::Stream, FaultPlan::default());
    let mut open: Vec<_> = (0..CLIENTS)
        .map(|_| {
            let client = TcpStream::connect(relay.address).unwrap();
            (client, listener.accept().unwrap().0)
        })
        .collect();
    let last = TcpStream::connect(relay.address).unwrap();
    (&last).write_all(&frame(1)).unwrap();
    listener.set_nonblocking(true).unwrap();
    std::thread::sleep(Duration::from_millis(50));
    assert!(listener.accept().is_err());
    open.clear();
    listener.set_nonblocking(false).unwrap();
    let (server, _) = listener.accept().unwrap();
    server.set_read_timeout(Some(DEADLINE)).unwrap();
    assert_eq!(first_frame(&server), frame(1));
}
