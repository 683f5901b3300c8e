//! A relay for datagrams: each is one frame, whatever it holds. Every client has a socket of its own towards the server.

use std::io::{self, ErrorKind};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::mangle::Mangle;
use super::plan::Plan;
use super::{Direction, Ended, Medium};

/// How long the relay rests when there is nothing to do: what it adds to every datagram's way at most, beside what the plan says.
const REST: Duration = Duration::from_micros(100);
/// The same while it has no client.
const IDLE_REST: Duration = Duration::from_millis(2);
/// A client from which, and for which, nothing has come for so long is forgotten: a datagram has no close.
const PATIENCE: Duration = Duration::from_secs(10);
/// Clients at a time; datagrams of others are lost.
const CLIENTS: usize = 64;
/// Largest datagram there is.
const LARGEST: usize = 65_535;

/// A relay for datagrams. Dropping it closes every socket.
#[derive(Debug)]
pub struct Relay {
    /// Where clients send to.
    pub address: SocketAddr,
    quit: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Relay {
    /// Listens on `listen` and forwards to `server`. The other half of the result are the clients that were forgotten.
    ///
    /// # Errors
    /// When there is no such address or no thread.
    pub fn spawn(
        listen: SocketAddr,
        server: SocketAddr,
        plan: Plan,
    ) -> io::Result<(Self, Receiver<Ended>)> {
        let socket = UdpSocket::bind(listen)?;
        socket.set_nonblocking(true)?;
        let address = socket.local_addr()?;
        let (ended, receiver) = channel();
        let exchange = Exchange {
            socket,
            server,
            plan,
            clients: Vec::new(),
            opened: 0,
            ended,
        };
        let quit = Arc::new(AtomicBool::new(false));
        let shared = Arc::clone(&quit);
        let thread = std::thread::Builder::new()
            .name("relay".to_owned())
            .spawn(move || exchange.run(&shared))?;
        let relay = Self {
            address,
            quit,
            thread: Some(thread),
        };
        Ok((relay, receiver))
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.quit.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panicking relay has already said so on stderr.
            let _ = thread.join();
        }
    }
}

struct Client {
    peer: SocketAddr,
    /// Connected to the server.
    socket: UdpSocket,
    up: Mangle,
    down: Mangle,
    began: Instant,
    last_heard: Instant,
}

struct Exchange {
    socket: UdpSocket,
    server: SocketAddr,
    plan: Plan,
    clients: Vec<Client>,
    opened: u64,
    ended: Sender<Ended>,
}

impl Exchange {
    fn run(mut self, quit: &AtomicBool) {
        // Without the privilege the link is a little slower.
        let _ = crate::realtime::raise_priority();
        let mut buffer = vec![0; LARGEST];
        while !quit.load(Ordering::Relaxed) {
            let mut busy = self.take_from_clients(&mut buffer);
            for client in &mut self.clients {
                busy |= client.exchange(&self.socket, &mut buffer);
            }
            self.forget(|client| client.last_heard.elapsed() >= PATIENCE);
            if !busy {
                std::thread::sleep(if self.clients.is_empty() {
                    IDLE_REST
                } else {
                    REST
                });
            }
        }
        self.forget(|_| true);
    }

    /// Takes what clients have sent; returns whether there was anything.
    fn take_from_clients(&mut self, buffer: &mut [u8]) -> bool {
        let mut any = false;
        // As many as a burst may have; the rest waits for the next round.
        for _ in 0..CLIENTS {
            let (count, peer) = match self.socket.recv_from(buffer) {
                Ok(received) => received,
                // Some systems report here that an earlier datagram found nobody.
                Err(error) if error.kind() == ErrorKind::ConnectionReset => continue,
                Err(_) => break,
            };
            any = true;
            if let Some(client) = self.client(peer) {
                client.last_heard = Instant::now();
                let now = client.began.elapsed();
                client.up.push(now, buffer.get(..count).unwrap_or_default());
            }
        }
        any
    }

    /// The client of this address, known or new. `None` when there is no room or no socket.
    fn client(&mut self, peer: SocketAddr) -> Option<&mut Client> {
        let known = self.clients.iter().position(|client| client.peer == peer);
        if let Some(index) = known {
            return self.clients.get_mut(index);
        }
        if self.clients.len() >= CLIENTS {
            return None;
        }
        let any = match self.server {
            SocketAddr::V4(_) => IpAddr::V4(Ipv4Addr::UNSPECIFIED),
            SocketAddr::V6(_) => IpAddr::V6(Ipv6Addr::UNSPECIFIED),
        };
        let socket = UdpSocket::bind((any, 0)).ok()?;
        socket.connect(self.server).ok()?;
        socket.set_nonblocking(true).ok()?;
        let mangle = |direction| Mangle::new(&self.plan, Medium::Datagrams, self.opened, direction);
        let now = Instant::now();
        self.clients.push(Client {
            peer,
            socket,
            up: mangle(Direction::Up),
            down: mangle(Direction::Down),
            began: now,
            last_heard: now,
        });
        self.opened += 1;
        self.clients.last_mut()
    }

    fn forget(&mut self, mut which: impl FnMut(&Client) -> bool) {
        let ended = &self.ended;
        self.clients.retain(|client| {
            let forgotten = which(client);
            if forgotten {
                // Nobody may want to know.
                let _ = ended.send(Ended {
                    peer: client.peer,
                    age: client.began.elapsed(),
                    up: client.up.tally().clone(),
                    down: client.down.tally().clone(),
                });
            }
            !forgotten
        });
    }
}

impl Client {
    /// Takes what the server has sent, and sends what is due either way; returns whether there was anything.
    fn exchange(&mut self, socket: &UdpSocket, buffer: &mut [u8]) -> bool {
        let mut any = false;
        for _ in 0..CLIENTS {
            match self.socket.recv(buffer) {
                Ok(count) => {
                    any = true;
                    self.last_heard = Instant::now();
                    let now = self.began.elapsed();
                    self.down.push(now, buffer.get(..count).unwrap_or_default());
                }
                // Nobody listens there: what was sent is lost, as datagrams are.
                Err(error) if error.kind() == ErrorKind::ConnectionRefused => {}
                Err(_) => break,
            }
        }
        let now = self.began.elapsed();
        while let Some(datagram) = self.up.pop(now) {
            any = true;
            let _ = self.socket.send(&datagram);
        }
        while let Some(datagram) = self.down.pop(now) {
            any = true;
            let _ = socket.send_to(&datagram, self.peer);
        }
        any
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::Fault;
    use crate::faults::plan::parse_script;

    const LOOPBACK: &str = "127.0.0.1:0";
    /// Nothing depends on how fast it is.
    const DEADLINE: Duration = Duration::from_secs(20);

    fn socket() -> UdpSocket {
        let socket = UdpSocket::bind(LOOPBACK).unwrap();
        socket.set_read_timeout(Some(DEADLINE)).unwrap();
        socket
    }

    fn relay(server: &UdpSocket, script: &str) -> (Relay, Receiver<Ended>) {
        let plan = Plan {
            script: parse_script(script).unwrap(),
            ..Plan::default()
        };
        let listen = LOOPBACK.parse().unwrap();
        Relay::spawn(listen, server.local_addr().unwrap(), plan).unwrap()
    }

    fn next(socket: &UdpSocket) -> (Vec<u8>, SocketAddr) {
        let mut buffer = [0; 100];
        let (count, from) = socket.recv_from(&mut buffer).unwrap();
        (buffer[..count].to_vec(), from)
    }

    #[test]
    fn every_client_has_its_own_way_and_its_own_faults() {
        let server = socket();
        let (relay, ended) = relay(&server, "frame 2 up drop\nframe 1 down duplicate");
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
        let ended: Vec<Ended> = ended.iter().collect();
        let peers: Vec<SocketAddr> = ended.iter().map(|ended| ended.peer).collect();
        assert_eq!(peers, clients.map(|client| client.local_addr().unwrap()));
        for ended in ended {
            assert_eq!((ended.up.frames, ended.down.frames), (3, 1));
            assert_eq!(ended.up.acted[&Fault::Drop].times, 1);
            assert_eq!(ended.down.acted[&Fault::Duplicate].times, 1);
        }
    }

    #[test]
    fn a_datagram_held_back_comes_after_those_behind_it() {
        let server = socket();
        let (relay, _ended) = relay(&server, "frame 1 up reorder 200\nframe 3 up truncate 0");
        let client = socket();
        for bytes in ["one", "two", "three"] {
            client.send_to(bytes.as_bytes(), relay.address).unwrap();
        }
        let came = [(); 3].map(|()| next(&server).0);
        assert_eq!(came, [b"two".to_vec(), b"".to_vec(), b"one".to_vec()]);
    }

    #[test]
    fn a_server_that_is_not_there_costs_datagrams_and_nothing_else() {
        let server = socket();
        let address = server.local_addr().unwrap();
        let (relay, _ended) = relay(&server, "");
        drop(server);
        let client = socket();
        client.send_to(b"lost", relay.address).unwrap();
        std::thread::sleep(Duration::from_millis(50));
        let server = UdpSocket::bind(address).unwrap();
        server.set_read_timeout(Some(DEADLINE)).unwrap();
        client.send_to(b"heard", relay.address).unwrap();
        assert_eq!(next(&server).0, b"heard");
    }
}
