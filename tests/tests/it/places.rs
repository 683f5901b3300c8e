//! Ports whose places are all taken: readers that read nothing lose theirs, those of one address
//! share with others, and who comes again and again displaces none that reads.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::atomic::AtomicBool;

use gantry_tau::monitor::ServerMonitor;
use gantry_tau::monitor::web::Web;
use gantry_tau_server::links::Allowed;
use gantry_tau_server::links::accelerometer::{
    Acceleration, AccelerometerPublisher, AccelerometerReader,
};
use gantry_tau_server::links::subscribers::MAX_SUBSCRIBERS;
use gantry_tau_tests::server_fixture::LOOPBACK;
use gantry_tau_tests::{DEADLINE, wait_for};
use socket2::{Domain, Socket, Type};

static NEVER: AtomicBool = AtomicBool::new(false);

/// An accelerometer's port, and the ticks that it has published.
struct Port {
    publisher: AccelerometerPublisher,
    tick: u64,
}

impl Port {
    fn new() -> Self {
        Self {
            publisher: AccelerometerPublisher::bind(LOOPBACK).unwrap(),
            tick: 0,
        }
    }

    fn address(&self) -> SocketAddr {
        self.publisher.address().unwrap()
    }

    fn tick(&mut self) {
        self.tick += 1;
        self.publisher.publish(&Acceleration {
            tick: self.tick,
            components: [0.0; 6],
        });
    }

    /// A reader that has its first sample.
    fn reader(&mut self) -> AccelerometerReader {
        let mut reader = AccelerometerReader::connect(self.address(), &NEVER).unwrap();
        wait_for("the first sample", || {
            self.tick();
            reader.latest().unwrap().is_some()
        });
        reader
    }
}

/// A connection from another loopback address.
fn from(host: u8, port: SocketAddr) -> TcpStream {
    let socket = Socket::new(Domain::IPV4, Type::STREAM, None).unwrap();
    socket
        .bind(&SocketAddr::from(([127, 0, 0, host], 0)).into())
        .unwrap();
    socket.connect_timeout(&port.into(), DEADLINE).unwrap();
    socket.into()
}

/// Found from outside: four connections that read nothing kept the client from its sensor, which had a
/// port then.
#[test]
fn readers_that_read_nothing_lose_their_places() {
    let mut port = Port::new();
    let _idle: Vec<_> = (0..2 * MAX_SUBSCRIBERS)
        .map(|_| TcpStream::connect(port.address()).unwrap())
        .collect();
    for _ in 0..MAX_SUBSCRIBERS {
        port.tick();
    }
    // It waits until one of them is behind.
    let mut reader = AccelerometerReader::connect(port.address(), &NEVER).unwrap();
    let mut served = false;
    for _ in 0..200_000 {
        port.tick();
        match reader.latest() {
            Ok(latest) => served |= latest.is_some(),
            // Closed behind another one that waits: it comes again.
            Err(_) => reader = AccelerometerReader::connect(port.address(), &NEVER).unwrap(),
        }
        if served {
            return;
        }
    }
    panic!("the reader was never served");
}

#[test]
fn a_reader_that_reads_is_not_displaced_by_others_that_come_again_and_again() {
    let mut port = Port::new();
    let mut readers: Vec<_> = (0..MAX_SUBSCRIBERS).map(|_| port.reader()).collect();
    let mut strangers = Vec::new();
    for round in 0..300 {
        strangers.push(TcpStream::connect(port.address()).unwrap());
        if round % 50 == 49 {
            strangers.clear();
        }
        port.tick();
        for reader in &mut readers {
            wait_for("the sample", || {
                reader.latest().unwrap().unwrap().tick == port.tick
            });
        }
    }
}

/// Only Linux has more than one loopback address without being asked.
#[cfg(target_os = "linux")]
#[test]
fn an_address_with_all_places_shares_them_and_no_more() {
    let mut port = Port::new();
    let mut readers: Vec<_> = (0..MAX_SUBSCRIBERS).map(|_| port.reader()).collect();
    let mut strangers = Vec::new();
    for _ in 0..50 {
        strangers.push(from(2, port.address()));
        for _ in 0..3 {
            port.tick();
        }
    }
    wait_for("a place for the other address", || {
        port.tick();
        strangers.iter_mut().any(|stream| {
            stream.set_nonblocking(true).unwrap();
            matches!(stream.read(&mut [0; 56]), Ok(count) if count > 0)
        })
    });
    // The first two of the four have kept theirs.
    for reader in &mut readers[..MAX_SUBSCRIBERS / 2] {
        wait_for("the sample", || {
            reader.latest().unwrap().unwrap().tick == port.tick
        });
    }
}

/// A page without a server.
struct Page {
    web: Web,
    monitor: ServerMonitor,
}

impl Page {
    fn new() -> Self {
        Self {
            web: Web::bind(LOOPBACK, Allowed::all(), None).unwrap(),
            monitor: ServerMonitor::of(LOOPBACK),
        }
    }

    fn address(&self) -> SocketAddr {
        self.web.address().unwrap()
    }

    /// Asks for a resource, and reads the status of the answer; empty if there is none.
    fn ask(&mut self, mut stream: TcpStream, resource: &str) -> (TcpStream, String) {
        let asked = format!(
            "GET {resource} HTTP/1.1\r\nHost: {}\r\n\r\n",
            self.address()
        );
        stream.write_all(asked.as_bytes()).unwrap();
        stream.set_nonblocking(true).unwrap();
        let mut answer = Vec::new();
        wait_for("an answer", || {
            self.web.visit(&self.monitor);
            let mut bytes = [0; 1_024];
            match stream.read(&mut bytes) {
                Ok(0) => return true,
                Ok(count) => answer.extend_from_slice(&bytes[..count]),
                Err(error) => return error.kind() != ErrorKind::WouldBlock,
            }
            answer.contains(&b'\n')
        });
        (
            stream,
            String::from_utf8_lossy(&answer)
                .lines()
                .next()
                .unwrap_or_default()
                .to_owned(),
        )
    }
}

/// Found from outside: 32 connections that read kept everybody else from the page, for ever.
#[test]
fn thirty_two_readers_keep_nobody_from_the_page() {
    let mut page = Page::new();
    let address = page.address();
    let readers: Vec<_> = (0..32)
        .map(|_| page.ask(TcpStream::connect(address).unwrap(), "/live"))
        .collect();
    assert!(
        readers
            .iter()
            .all(|(_, status)| status == "HTTP/1.1 200 OK"),
        "{readers:?}"
    );
    for _ in 0..3 {
        let (_, status) = page.ask(TcpStream::connect(address).unwrap(), "/");
        assert_eq!(status, "HTTP/1.1 200 OK");
    }
}
