//! Relay between clients and a server, over TCP or UDP. One thread serves every connection.
//!
//! On a stream, faults act on the frames of `wire.md`; a stream that does not consist of them is
//! taken piece by piece, as it is read. A datagram is one frame with any content; each UDP client
//! has its own socket towards the server.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use gantry_tau_client::connected_datagrams;
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::wire::{Deframer, Feed};
use gantry_tau_server::realtime::{Socket, now_ns, wait_any_readable_until_ns};
use gantry_tau_system::dial::{self, Addresses};
use socket2::SockRef;

use super::injector::FaultInjector;
use super::plan::FaultPlan;
use super::{Direction, FaultStats};

/// Longest wait before the relay looks for new connections and at its switches.
const POLL: Duration = Duration::from_millis(2);
/// Wait before writing again to a receiver whose buffers are full.
const RETRY: Duration = Duration::from_micros(200);
/// Time limit for the server to accept a connection.
const CONNECT: Duration = Duration::from_secs(2);
/// Silence in both directions after which a UDP client is removed: a datagram has no close.
const PATIENCE: Duration = Duration::from_secs(10);
/// Simultaneous clients. Further streams wait to be accepted, datagrams of further clients are
/// lost.
const CLIENTS: usize = 64;
/// Reads of one socket before the others have their turn.
const READS: usize = 64;
/// Size of the largest datagram, bytes.
const MAX_DATAGRAM: usize = 65_535;

/// Report of a connection that has ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LinkReport {
    /// Address of the client.
    pub peer: SocketAddr,
    /// From client to server.
    pub up: FaultStats,
    /// From server to client.
    pub down: FaultStats,
}

#[derive(Debug, Default)]
struct Switches {
    cut: AtomicBool,
    quit: AtomicBool,
}

/// A relay for at most 64 simultaneous clients. Dropping it closes every socket.
#[derive(Debug)]
pub struct Relay {
    /// Address to which clients connect.
    pub address: SocketAddr,
    switches: Arc<Switches>,
    thread: Option<JoinHandle<()>>,
}

impl Relay {
    /// Listens on `listen` and forwards to `server`: streams to the first of its addresses that
    /// takes them, datagrams to the first. The receiver yields every connection that has ended.
    ///
    /// # Errors
    /// When the address cannot be listened on, or the system gives no thread.
    pub fn spawn(
        listen: SocketAddr,
        server: impl Into<Addresses>,
        transport: Transport,
        plan: FaultPlan,
    ) -> io::Result<(Self, Receiver<LinkReport>)> {
        let (listener, address) = match transport {
            Transport::Stream => {
                let listener = TcpListener::bind(listen)?;
                listener.set_nonblocking(true)?;
                let address = listener.local_addr()?;
                (Listener::Stream(listener), address)
            }
            Transport::Datagram => {
                let socket = UdpSocket::bind(listen)?;
                socket.set_nonblocking(true)?;
                let address = socket.local_addr()?;
                (Listener::Datagram(Arc::new(socket)), address)
            }
        };
        let (ended, receiver) = channel();
        let exchange = Exchange {
            server: server.into(),
            plan,
            clients: Vec::new(),
            opened: 0,
            ended,
        };
        let switches = Arc::new(Switches::default());
        let shared = Arc::clone(&switches);
        let thread = std::thread::Builder::new()
            .name("relay".to_owned())
            .spawn(move || exchange.run(&listener, &shared))?;
        let relay = Self {
            address,
            switches,
            thread: Some(thread),
        };
        Ok((relay, receiver))
    }

    /// Makes every connection, present and future, half-open in both directions, like an unplugged
    /// cable.
    pub fn cut(&self) {
        self.switches.cut.store(true, Ordering::Relaxed);
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.switches.quit.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic of the thread was reported on stderr.
            let _ = thread.join();
        }
    }
}

enum Listener {
    Stream(TcpListener),
    Datagram(Arc<UdpSocket>),
}

struct Exchange {
    server: Addresses,
    plan: FaultPlan,
    clients: Vec<RelayedClient>,
    /// Connections so far.
    opened: u64,
    ended: Sender<LinkReport>,
}

impl Exchange {
    fn run(mut self, listener: &Listener, switches: &Switches) {
        // Without the privilege the relay is a little slower.
        let _ = gantry_tau_server::realtime::raise_priority();
        let mut buffer = vec![0; MAX_DATAGRAM];
        while !switches.quit.load(Ordering::Relaxed) {
            match listener {
                Listener::Stream(listener) => self.accept(listener, &switches.quit),
                Listener::Datagram(socket) => self.receive(socket, &mut buffer),
            }
            let cut = switches.cut.load(Ordering::Relaxed);
            for client in &mut self.clients {
                client.exchange(cut, &mut buffer);
            }
            self.remove(RelayedClient::is_over);
            self.wait(listener);
        }
        self.remove(|_| true);
    }

    fn accept(&mut self, listener: &TcpListener, quit: &AtomicBool) {
        while self.clients.len() < CLIENTS {
            let Ok((near, peer)) = listener.accept() else {
                return;
            };
            let began = Instant::now();
            // A server that does not answer delays the other connections, which lead to the same
            // server.
            let far = dial::connect(&self.server, CONNECT, quit).and_then(|far| {
                for stream in [&near, &far] {
                    stream.set_nonblocking(true)?;
                    stream.set_nodelay(true)?;
                }
                Ok(far)
            });
            match far {
                Ok(far) => self.open(peer, began, End::Stream(near), End::Stream(far)),
                // The client's stream is closed. The next one waits for a round, so that quitting
                // never waits for many.
                Err(_) => return self.report(peer, Default::default()),
            }
        }
    }

    fn open(&mut self, peer: SocketAddr, began: Instant, near: End, far: End) {
        let transport = match near {
            End::Stream(_) => Transport::Stream,
            _ => Transport::Datagram,
        };
        let [up, down] = [Direction::Up, Direction::Down].map(|direction| {
            let connection = self.opened;
            Way::of(FaultInjector::new(
                &self.plan, transport, connection, direction,
            ))
        });
        self.opened += 1;
        self.clients.push(RelayedClient {
            peer,
            began,
            last_heard: began,
            up,
            down,
            near,
            far,
        });
    }

    /// Receives the datagrams of clients.
    fn receive(&mut self, socket: &Arc<UdpSocket>, buffer: &mut [u8]) {
        for _ in 0..READS {
            let (count, peer) = match socket.recv_from(buffer) {
                Ok(received) => received,
                // Some systems report here that an earlier datagram did not arrive.
                Err(error) if error.kind() == ErrorKind::ConnectionReset => continue,
                Err(_) => break,
            };
            let mut open = self.clients.iter().position(|client| client.peer == peer);
            // Without room or a socket the datagram is lost.
            if open.is_none() && self.clients.len() < CLIENTS {
                let far = connected_datagrams(self.server.first())
                    .and_then(|far| far.set_nonblocking(true).map(|()| far));
                if let Ok(far) = far {
                    let near = End::Client(Arc::clone(socket), peer);
                    self.open(peer, Instant::now(), near, End::Datagram(far));
                    open = Some(self.clients.len() - 1);
                }
            }
            if let Some(client) = open.and_then(|index| self.clients.get_mut(index)) {
                client.last_heard = Instant::now();
                let frame = buffer.get(..count).unwrap_or_default();
                client.up.injector.push(client.began.elapsed(), frame);
            }
        }
    }

    fn remove(&mut self, over: impl Fn(&RelayedClient) -> bool) {
        let (over, open): (Vec<_>, _) = (self.clients.drain(..)).partition(over);
        self.clients = open;
        for client in over {
            for end in [&client.near, &client.far] {
                if let (End::Stream(stream), true) = (end, client.is_reset()) {
                    // With no time to linger, the close that follows is a reset.
                    let _ = SockRef::from(stream).set_linger(Some(Duration::ZERO));
                }
            }
            let stats = [&client.up, &client.down].map(|way| way.injector.stats().clone());
            let peer = client.peer;
            drop(client);
            self.report(peer, stats);
        }
    }

    fn report(&self, peer: SocketAddr, [up, down]: [FaultStats; 2]) {
        // The receiver may be gone.
        let _ = self.ended.send(LinkReport { peer, up, down });
    }

    /// Waits until a socket is readable or a piece is due, at most [`POLL`].
    fn wait(&self, listener: &Listener) {
        let mut wait = POLL;
        let mut sockets = Vec::new();
        if let Listener::Datagram(socket) = listener {
            sockets.push(Socket::Datagram(socket));
        }
        for client in &self.clients {
            let now = client.began.elapsed();
            for (way, from) in [(&client.up, &client.near), (&client.down, &client.far)] {
                wait = wait.min(way.wait(now));
                match from {
                    End::Stream(stream) if way.can_read(now) => {
                        sockets.push(Socket::Stream(stream))
                    }
                    End::Datagram(socket) => sockets.push(Socket::Datagram(socket)),
                    _ => {}
                }
            }
        }
        let deadline = now_ns().saturating_add(wait.as_nanos() as u64);
        wait_any_readable_until_ns(&sockets, deadline);
    }
}

/// One end of a connection.
enum End {
    Stream(TcpStream),
    /// Connected to the server.
    Datagram(UdpSocket),
    /// A client, through the socket that all clients share.
    Client(Arc<UdpSocket>, SocketAddr),
}

struct RelayedClient {
    peer: SocketAddr,
    began: Instant,
    last_heard: Instant,
    up: Way,
    down: Way,
    near: End,
    far: End,
}

impl RelayedClient {
    /// Reads what both ends have sent, and writes what is due.
    fn exchange(&mut self, cut: bool, buffer: &mut [u8]) {
        for direction in [Direction::Up, Direction::Down] {
            let (way, back, from, to) = match direction {
                Direction::Up => (&mut self.up, &self.down, &self.near, &self.far),
                Direction::Down => (&mut self.down, &self.up, &self.far, &self.near),
            };
            let now = self.began.elapsed();
            if cut {
                way.lose_everything();
            }
            if way.read(from, now, buffer) {
                self.last_heard = Instant::now();
            }
            if way.write(to, now).is_err() {
                way.lose_everything();
                // The sender is told, unless the way back is half-open.
                if let (End::Stream(from), false) = (from, back.injector.is_silent()) {
                    let _ = from.shutdown(Shutdown::Both);
                }
            }
            way.pass_close(to);
        }
    }

    fn is_reset(&self) -> bool {
        self.up.injector.is_reset() || self.down.injector.is_reset()
    }

    fn is_over(&self) -> bool {
        match self.near {
            End::Stream(_) => self.is_reset() || (self.up.finished && self.down.finished),
            _ => self.last_heard.elapsed() >= PATIENCE,
        }
    }
}

/// One direction of a connection.
struct Way {
    injector: FaultInjector,
    frames: Frames,
    /// Rest of a piece for which the receiver had no room.
    unsent: Option<Vec<u8>>,
    /// The sender has closed.
    closed: bool,
    /// The sender has closed, and everything was written.
    finished: bool,
}

impl Way {
    fn of(injector: FaultInjector) -> Self {
        Self {
            injector,
            frames: Frames::default(),
            unsent: None,
            closed: false,
            finished: false,
        }
    }

    fn can_read(&self, now: Duration) -> bool {
        !self.closed && !self.injector.is_deaf(now)
    }

    /// Time until there is something to write.
    fn wait(&self, now: Duration) -> Duration {
        match (&self.unsent, self.injector.next_due()) {
            (Some(_), _) => RETRY,
            (None, Some(due)) => due.saturating_sub(now),
            (None, None) => POLL,
        }
    }

    /// Reads from the sender. Returns true if anything came.
    fn read(&mut self, from: &End, now: Duration, buffer: &mut [u8]) -> bool {
        for turn in 0..READS {
            let (received, is_stream) = match from {
                End::Stream(_) if !self.can_read(now) => return turn > 0,
                End::Stream(stream) => ((&*stream).read(buffer), true),
                End::Datagram(socket) => (socket.recv(buffer), false),
                // Read from the shared socket.
                End::Client(..) => return false,
            };
            match received.map(|count| buffer.get(..count).unwrap_or_default()) {
                Ok([]) if is_stream => self.closed = true,
                Ok(bytes) if is_stream => {
                    let injector = &mut self.injector;
                    self.frames.feed(bytes, |frame| injector.push(now, frame));
                }
                Ok(datagram) => self.injector.push(now, datagram),
                Err(error) if error.kind() == ErrorKind::WouldBlock => return turn > 0,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) if is_stream => self.closed = true,
                // No server is listening; the datagram is lost.
                Err(error) if error.kind() == ErrorKind::ConnectionRefused => {}
                Err(_) => return turn > 0,
            }
            if self.closed {
                // An incomplete frame is forwarded as it is.
                let rest = std::mem::take(&mut self.frames.held);
                if !rest.is_empty() {
                    self.injector.push(now, &rest);
                }
            }
        }
        true
    }

    /// Writes what is due.
    fn write(&mut self, to: &End, now: Duration) -> io::Result<()> {
        while let Some(mut piece) = self.unsent.take().or_else(|| self.injector.pop(now)) {
            match to {
                End::Stream(stream) => {
                    while !piece.is_empty() {
                        match (&*stream).write(&piece) {
                            Ok(count) => drop(piece.drain(..count)),
                            Err(error) if error.kind() == ErrorKind::WouldBlock => {
                                self.unsent = Some(piece);
                                return Ok(());
                            }
                            Err(error) if error.kind() == ErrorKind::Interrupted => {}
                            Err(error) => return Err(error),
                        }
                    }
                }
                // A datagram that cannot be sent is lost.
                End::Datagram(socket) => drop(socket.send(&piece)),
                End::Client(socket, peer) => drop(socket.send_to(&piece, peer)),
            }
        }
        Ok(())
    }

    /// Drops everything in transit and everything that still comes.
    fn lose_everything(&mut self) {
        self.unsent = None;
        self.injector.silence(Duration::ZERO);
    }

    /// Once everything was written, closes the receiver's side of a stream whose sender has closed,
    /// unless this way is half-open.
    fn pass_close(&mut self, to: &End) {
        let drained = self.unsent.is_none() && self.injector.next_due().is_none();
        if self.closed && drained && !self.finished {
            self.finished = true;
            if let (End::Stream(stream), false) = (to, self.injector.is_silent()) {
                let _ = stream.shutdown(Shutdown::Write);
            }
        }
    }
}

/// Splits a stream into its frames, or into the pieces that were read once the frame boundary is
/// lost. Keeps every byte.
#[derive(Default)]
struct Frames {
    deframer: Deframer,
    /// Beginning of an incomplete frame.
    held: Vec<u8>,
}

impl Frames {
    /// Calls `each` with every complete frame.
    fn feed(&mut self, bytes: &[u8], mut each: impl FnMut(&[u8])) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let (taken, whole) = match self.deframer.feed(rest) {
                Feed::Incomplete => (rest.len(), false),
                Feed::Frame { consumed, .. } => (consumed, true),
                Feed::Broken(_) => (rest.len(), true),
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
}

#[cfg(test)]
mod tests;
