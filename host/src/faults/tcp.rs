//! A relay for byte streams. Faults meet the frames of `wire.md`; a stream that is not of these frames is taken piece by piece, as it is read.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use socket2::SockRef;

use super::frames::Frames;
use super::mangle::Mangle;
use super::plan::Plan;
use super::{Direction, Ended, Medium, Tally};
use crate::realtime::{Socket, now_ns, sleep_until_ns, wait_readable_until_ns};

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
            } else if wait_readable_until_ns(Socket::Stream(self.from), wake) {
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

#[cfg(test)]
mod tests;
