//! A relay for byte streams. Faults meet the frames of `wire.md`; a stream that is not of these frames is taken piece by piece, as it is read.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use gantry_tau_core::wire::{Deframer, Feed};
use socket2::SockRef;

use super::mangle::Mangle;
use super::plan::Plan;
use super::{Direction, Ended, Medium, Tally};
use crate::realtime::{now_ns, sleep_until_ns, wait_readable_until_ns};

/// How long a thread waits before it looks at its switches again.
const LOOK: Duration = Duration::from_millis(2);
/// How long a write waits for a reader that does not keep up before it tries again.
const RETRY: Duration = Duration::from_micros(200);
/// How long the server may take to accept.
const CONNECT: Duration = Duration::from_secs(2);

#[derive(Debug, Default)]
struct Switches {
    cut: AtomicBool,
    quit: AtomicBool,
}

/// A relay for any number of clients. Dropping it closes every socket.
#[derive(Debug)]
pub struct Relay {
    /// Where clients connect.
    pub address: SocketAddr,
    switches: Arc<Switches>,
    thread: Option<JoinHandle<()>>,
}

impl Relay {
    /// Listens on `listen` and forwards to `server`. The other half of the result are the connections that have ended.
    ///
    /// # Errors
    /// When there is no such address or no thread.
    pub fn spawn(
        listen: SocketAddr,
        server: SocketAddr,
        plan: Plan,
    ) -> io::Result<(Self, Receiver<Ended>)> {
        let listener = TcpListener::bind(listen)?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let switches = Arc::new(Switches::default());
        let shared = Arc::clone(&switches);
        let (ended, receiver) = channel();
        let thread = std::thread::Builder::new()
            .name("relay".to_owned())
            .spawn(move || accept(&listener, server, &plan, &shared, &ended))?;
        let relay = Self {
            address,
            switches,
            thread: Some(thread),
        };
        Ok((relay, receiver))
    }

    /// Pulls the cable: every connection, now and later, is half-open both ways.
    pub fn cut(&self) {
        self.switches.cut.store(true, Ordering::Relaxed);
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.switches.quit.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panicking relay has already said so on stderr.
            let _ = thread.join();
        }
    }
}

fn accept(
    listener: &TcpListener,
    server: SocketAddr,
    plan: &Plan,
    switches: &Arc<Switches>,
    ended: &Sender<Ended>,
) {
    let mut open: Vec<JoinHandle<()>> = Vec::new();
    let mut number = 0;
    while !switches.quit.load(Ordering::Relaxed) {
        open.retain(|connection| !connection.is_finished());
        let Ok((client, peer)) = listener.accept() else {
            std::thread::sleep(LOOK);
            continue;
        };
        let [up, down] = [Direction::Up, Direction::Down]
            .map(|direction| Mangle::new(plan, Medium::Stream, number, direction));
        number += 1;
        let (switches, ended) = (Arc::clone(switches), ended.clone());
        let connection = std::thread::Builder::new()
            .name("relay up".to_owned())
            .spawn(move || {
                let began = Instant::now();
                // A server that cannot be reached is told by closing the client's connection.
                let (up, down) = Wire::open(client, server, switches, began)
                    .map_or_else(|_| Default::default(), |wire| wire.carry(up, down));
                let age = began.elapsed();
                // Nobody may want to know.
                let _ = ended.send(Ended {
                    peer,
                    age,
                    up,
                    down,
                });
            });
        // Without a thread the connection is closed.
        open.extend(connection);
    }
    for connection in open {
        let _ = connection.join();
    }
}

/// Both sockets of a connection, and what its two directions tell each other.
struct Wire {
    client: TcpStream,
    server: TcpStream,
    began: Instant,
    switches: Arc<Switches>,
    reset: AtomicBool,
    up_silent: AtomicBool,
    down_silent: AtomicBool,
}

impl Wire {
    fn open(
        client: TcpStream,
        server: SocketAddr,
        switches: Arc<Switches>,
        began: Instant,
    ) -> io::Result<Arc<Self>> {
        let server = TcpStream::connect_timeout(&server, CONNECT)?;
        for stream in [&client, &server] {
            stream.set_nonblocking(true)?;
            stream.set_nodelay(true)?;
        }
        Ok(Arc::new(Self {
            client,
            server,
            began,
            switches,
            reset: AtomicBool::new(false),
            up_silent: AtomicBool::new(false),
            down_silent: AtomicBool::new(false),
        }))
    }

    /// Forwards both ways until both have ended.
    fn carry(self: Arc<Self>, up: Mangle, down: Mangle) -> (Tally, Tally) {
        let other = Arc::clone(&self);
        let returning = std::thread::Builder::new()
            .name("relay down".to_owned())
            .spawn(move || other.way(Direction::Down, down).carry());
        let Ok(returning) = returning else {
            return Default::default();
        };
        let up = self.way(Direction::Up, up).carry();
        let down = returning.join().unwrap_or_default();
        if self.reset.load(Ordering::Relaxed) {
            for stream in [&self.client, &self.server] {
                // With no time to linger, the close that follows is a reset.
                let _ = SockRef::from(stream).set_linger(Some(Duration::ZERO));
            }
        }
        (up, down)
    }

    fn way(&self, direction: Direction, mangle: Mangle) -> Way<'_> {
        let (from, to, silent, other_silent) = match direction {
            Direction::Up => (
                &self.client,
                &self.server,
                &self.up_silent,
                &self.down_silent,
            ),
            Direction::Down => (
                &self.server,
                &self.client,
                &self.down_silent,
                &self.up_silent,
            ),
        };
        Way {
            wire: self,
            from,
            to,
            silent,
            other_silent,
            mangle,
            frames: Frames::default(),
        }
    }
}

/// One direction of a connection.
struct Way<'a> {
    wire: &'a Wire,
    from: &'a TcpStream,
    to: &'a TcpStream,
    silent: &'a AtomicBool,
    other_silent: &'a AtomicBool,
    mangle: Mangle,
    frames: Frames,
}

impl Way<'_> {
    /// Forwards until the sender has closed and everything has come, or the connection is over.
    fn carry(mut self) -> Tally {
        // Without the privilege the link is a little slower.
        let _ = crate::realtime::raise_priority();
        let mut closed = false;
        while !self.is_over() && (!closed || self.mangle.next_due().is_some()) {
            if self.deliver().is_err() {
                self.lose_receiver();
            }
            let wake = self.wake();
            if closed || self.mangle.is_deaf(self.now()) {
                sleep_until_ns(wake);
            } else if wait_readable_until_ns(self.from, wake) {
                closed = self.read();
            }
        }
        // A half-open link does not say that its sender has gone.
        if closed && !self.mangle.is_silent() {
            let _ = self.to.shutdown(Shutdown::Write);
        }
        self.mangle.tally().clone()
    }

    fn now(&self) -> Duration {
        self.wire.began.elapsed()
    }

    /// When to look again, on the clock of [`now_ns`].
    fn wake(&self) -> u64 {
        let due = self.mangle.next_due();
        let wait = due.map_or(LOOK, |due| due.saturating_sub(self.now()).min(LOOK));
        now_ns().saturating_add(u64::try_from(wait.as_nanos()).unwrap_or(0))
    }

    fn is_over(&self) -> bool {
        self.wire.reset.load(Ordering::Relaxed) || self.wire.switches.quit.load(Ordering::Relaxed)
    }

    fn is_cut(&self) -> bool {
        self.wire.switches.cut.load(Ordering::Relaxed)
    }

    /// Takes what is there; returns whether the sender has closed.
    fn read(&mut self) -> bool {
        let mut buffer = [0; 4_096];
        let mut from = self.from;
        let closed = match from.read(&mut buffer) {
            Ok(0) => true,
            Ok(count) => {
                self.take(buffer.get(..count).unwrap_or_default());
                false
            }
            Err(error) => !matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted),
        };
        self.heed_cut();
        if closed {
            // What was left of a frame goes with its sender.
            let now = self.now();
            if let Some(rest) = self.frames.rest() {
                self.mangle.push(now, &rest);
            }
        }
        closed
    }

    fn heed_cut(&mut self) {
        if self.is_cut() && !self.mangle.is_silent() {
            self.mangle.silence(self.now());
        }
    }

    fn take(&mut self, bytes: &[u8]) {
        let now = self.now();
        self.heed_cut();
        let mangle = &mut self.mangle;
        self.frames.feed(bytes, |frame| mangle.push(now, frame));
        if self.mangle.is_silent() {
            self.silent.store(true, Ordering::Relaxed);
        }
        if self.mangle.is_reset() {
            self.wire.reset.store(true, Ordering::Relaxed);
        }
    }

    /// Writes what is due.
    fn deliver(&mut self) -> io::Result<()> {
        while let Some(piece) = self.mangle.pop(self.now()) {
            let mut rest = piece.as_slice();
            while !rest.is_empty() && !self.is_over() && !self.is_cut() {
                match self.to.write(rest) {
                    Ok(count) => rest = rest.get(count..).unwrap_or_default(),
                    Err(error) if error.kind() == ErrorKind::WouldBlock => {
                        std::thread::sleep(RETRY);
                    }
                    Err(error) if error.kind() == ErrorKind::Interrupted => {}
                    Err(error) => return Err(error),
                }
            }
        }
        Ok(())
    }

    /// The receiver is gone: the sender is told, unless nothing is told in that direction.
    fn lose_receiver(&mut self) {
        self.mangle.silence(self.now());
        if !self.other_silent.load(Ordering::Relaxed) {
            let _ = self.from.shutdown(Shutdown::Both);
        }
    }
}

/// Cuts a stream into its frames; once the boundary is lost, into the pieces that were read.
#[derive(Default)]
struct Frames {
    deframer: Deframer,
    held: Vec<u8>,
    lost: bool,
}

impl Frames {
    fn feed(&mut self, bytes: &[u8], mut each: impl FnMut(&[u8])) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let (taken, whole) = match self.deframer.feed(rest) {
                Feed::Incomplete => (rest.len(), false),
                Feed::Frame { consumed, .. } => (consumed, true),
                Feed::Broken(_) => {
                    self.lost = true;
                    (rest.len(), true)
                }
            };
            let (frame, behind) = rest.split_at_checked(taken).unwrap_or((rest, &[]));
            self.held.extend_from_slice(frame);
            rest = behind;
            if whole {
                each(&self.held);
                self.held.clear();
            }
        }
    }

    /// The beginning of a frame that will not be completed.
    fn rest(&mut self) -> Option<Vec<u8>> {
        (!self.held.is_empty()).then(|| std::mem::take(&mut self.held))
    }
}

#[cfg(test)]
mod tests {
    use gantry_tau_core::message::ClientMessage;
    use gantry_tau_core::units::Epoch;
    use gantry_tau_core::wire::encode_client;

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
}
