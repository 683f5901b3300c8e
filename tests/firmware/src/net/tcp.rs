//! TCP: sockets that listen on one port, and what arrives on them handed to an endpoint.

use gantry_tau_core::control::endpoint::{Endpoint, Transport};
use gantry_tau_core::control::session::fsm::Connection;
use smoltcp::iface::{
    Config, Interface, PollIngressSingleResult, SocketHandle, SocketSet, SocketStorage,
};
use smoltcp::socket::tcp::{Socket, SocketBuffer};
use smoltcp::time::Instant;
use smoltcp::wire::{EthernetAddress, IpCidr, Ipv4Address};

use super::lan9118::Lan9118;
use crate::reading::Reading;

/// Connections at once: an owner, two who are refused meanwhile, and one whose peer has gone without a word.
const SOCKETS: usize = 4;
/// Bytes received and not yet fed; the window that each peer is offered.
const RECEIVE: usize = 1_024;
/// Bytes sent and not yet acknowledged: about a dozen States. Who has not taken so many is too slow.
const SEND: usize = 4_096;
/// Frames taken from the controller per visit; the rest waits for the next.
const FRAMES: usize = 16;
/// Segments sent per connection and visit.
const SEGMENTS: usize = 4;
/// How long the handshakes at the beginning and at the end of a connection may take before it is reset, ms.
const LINGER_MS: i64 = 500;

/// Address and port of the server, and the router of its network.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    /// Hardware address.
    pub(crate) hardware: [u8; 6],
    /// Address.
    pub(crate) address: [u8; 4],
    /// Bits of the address that are the network's.
    pub(crate) network_bits: u8,
    /// Router.
    pub(crate) router: [u8; 4],
    /// Port.
    pub(crate) port: u16,
}

/// Memory of the sockets.
pub(crate) struct Storage {
    sockets: [SocketStorage<'static>; SOCKETS],
    receive: [[u8; RECEIVE]; SOCKETS],
    send: [[u8; SEND]; SOCKETS],
}

impl Storage {
    pub(crate) const fn new() -> Self {
        Self {
            sockets: [SocketStorage::EMPTY; SOCKETS],
            receive: [[0; RECEIVE]; SOCKETS],
            send: [[0; SEND]; SOCKETS],
        }
    }
}

/// What a socket is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Use {
    /// Nobody has connected.
    Free,
    /// Somebody began to connect; reset unless that is done by then, ms.
    Arriving { until: i64 },
    /// A peer of the endpoint. `gone`: a write failed; told to the endpoint in its next turn.
    Peer { connection: Connection, gone: bool },
    /// The endpoint has no further use for it; reset unless it closes by then, ms.
    Closing { until: i64 },
}

impl Use {
    /// Whether a visit looks at it: always at the owner.
    fn is_due<const N: usize, const M: usize, const H: usize>(
        self,
        has_turn: bool,
        endpoint: &Endpoint<N, M, H>,
    ) -> bool {
        let owner = endpoint.session().owner();
        has_turn || matches!(self, Self::Peer { connection, .. } if owner == Some(connection))
    }
}

struct Peer {
    socket: SocketHandle,
    used: Use,
}

/// A listening server and its peers.
pub(crate) struct Server {
    lan: Lan9118,
    interface: Interface,
    sockets: SocketSet<'static>,
    peers: [Option<Peer>; SOCKETS],
    port: u16,
    now_ms: i64,
    /// Which socket has its turn: one stranger is taken in, or read, per visit.
    turn: usize,
    reading: Reading,
}

impl Server {
    /// Listens. `seed` makes the numbers that TCP begins with.
    pub(crate) fn new(
        mut lan: Lan9118,
        place: &Place,
        storage: &'static mut Storage,
        seed: u64,
    ) -> Self {
        let hardware = EthernetAddress(place.hardware);
        let mut config = Config::new(hardware.into());
        config.random_seed = seed;
        let mut interface = Interface::new(config, &mut lan, Instant::ZERO);
        let [a, b, c, d] = place.address;
        let address = Ipv4Address::new(a, b, c, d).into();
        let [a, b, c, d] = place.router;
        let router = Ipv4Address::new(a, b, c, d);
        // There is room for one of each.
        interface.update_ip_addrs(|addresses| {
            addresses
                .push(IpCidr::new(address, place.network_bits))
                .unwrap_or(());
        });
        let _ = interface.routes_mut().add_default_ipv4_route(router);
        let mut sockets = SocketSet::new(&mut storage.sockets[..]);
        let mut peers = [const { None }; SOCKETS];
        let buffers = storage.receive.iter_mut().zip(&mut storage.send);
        for (peer, (receive, send)) in peers.iter_mut().zip(buffers) {
            let mut socket = Socket::new(
                SocketBuffer::new(&mut receive[..]),
                SocketBuffer::new(&mut send[..]),
            );
            // A State must leave at once, and a Command is its acknowledgement.
            socket.set_nagle_enabled(false);
            *peer = Some(Peer {
                socket: sockets.add(socket),
                used: Use::Free,
            });
        }
        let mut server = Self {
            lan,
            interface,
            sockets,
            peers,
            port: place.port,
            now_ms: 0,
            turn: 0,
            reading: Reading::default(),
        };
        server.listen();
        server
    }

    /// Takes in what has come, tells the endpoint of peers that come and go, feeds it, and sends what is to be sent.
    pub(crate) fn visit<const N: usize, const M: usize, const H: usize>(
        &mut self,
        now_ms: i64,
        endpoint: &mut Endpoint<N, M, H>,
    ) {
        self.now_ms = now_ms;
        let now = Instant::from_millis(now_ms);
        for _ in 0..FRAMES {
            let taken = (self.interface).poll_ingress_single(now, &mut self.lan, &mut self.sockets);
            if taken == PollIngressSingleResult::None {
                break;
            }
        }
        self.turn = self.turn.wrapping_add(1).checked_rem(SOCKETS).unwrap_or(0);
        for (index, peer) in self.peers.iter_mut().flatten().enumerate() {
            let socket = self.sockets.get_mut::<Socket>(peer.socket);
            if peer.used.is_due(index == self.turn, endpoint) {
                peer.used = next_use(peer.used, socket, now_ms, endpoint, &mut self.reading);
            }
        }
        self.listen();
        self.flush();
    }

    /// A tick has been taken: as much may be taken in again.
    pub(crate) fn ticked(&mut self) {
        self.reading = Reading::default();
    }

    /// Sends what waits, as far as the controller and the peers' windows have room.
    pub(crate) fn flush(&mut self) {
        let now = Instant::from_millis(self.now_ms);
        for _ in 0..SEGMENTS {
            let _ = (self.interface).poll_egress(now, &mut self.lan, &mut self.sockets);
        }
    }

    /// Writes a whole frame or gives the peer up: a slow reader is a loss, never waited for.
    pub(crate) fn send(&mut self, to: Connection, bytes: &[u8]) {
        for peer in self.peers.iter_mut().flatten() {
            if let Use::Peer { connection, gone } = &mut peer.used {
                if *connection == to {
                    let socket = self.sockets.get_mut::<Socket>(peer.socket);
                    *gone |= socket.send_slice(bytes) != Ok(bytes.len());
                }
            }
        }
    }

    /// Closes a connection that the endpoint has no further use for; its last bytes still leave.
    pub(crate) fn close(&mut self, which: Connection) {
        for peer in self.peers.iter_mut().flatten() {
            if matches!(peer.used, Use::Peer { connection, .. } if connection == which) {
                let socket = self.sockets.get_mut::<Socket>(peer.socket);
                peer.used = closing(socket, self.now_ms);
            }
        }
    }

    /// Whether nobody is connected.
    pub(crate) fn is_idle(&self) -> bool {
        (self.peers.iter().flatten()).all(|peer| peer.used == Use::Free)
    }

    /// Every free socket listens.
    fn listen(&mut self) {
        for peer in self.peers.iter().flatten() {
            let socket = self.sockets.get_mut::<Socket>(peer.socket);
            if peer.used == Use::Free && !socket.is_open() {
                // It is not open and the port is not zero: it cannot fail.
                socket.listen(self.port).unwrap_or(());
            }
        }
    }
}

/// What becomes of a socket after everything that has come.
fn next_use<const N: usize, const M: usize, const H: usize>(
    used: Use,
    socket: &mut Socket<'_>,
    now_ms: i64,
    endpoint: &mut Endpoint<N, M, H>,
    reading: &mut Reading,
) -> Use {
    match used {
        Use::Free if socket.is_active() => {
            let until = now_ms.saturating_add(LINGER_MS);
            next_use(Use::Arriving { until }, socket, now_ms, endpoint, reading)
        }
        Use::Free => Use::Free,
        Use::Arriving { .. } if socket.may_send() && reading.accept() => {
            let Ok(connection) = endpoint.open(Transport::Stream) else {
                // Best effort: the peer is about to be closed anyway.
                let _ = socket.send_slice(&Endpoint::<N, M, H>::full_refusal());
                return closing(socket, now_ms);
            };
            let gone = false;
            next_use(
                Use::Peer { connection, gone },
                socket,
                now_ms,
                endpoint,
                reading,
            )
        }
        Use::Arriving { until } | Use::Closing { until } => {
            if !socket.is_open() {
                return Use::Free;
            }
            if now_ms >= until {
                // The reset leaves with the next flush; the socket is free in its next turn.
                socket.abort();
            }
            used
        }
        Use::Peer { connection, gone } => {
            let owner = endpoint.session().owner();
            // The buffer is a ring: what it holds comes in two pieces at most.
            for _ in 0..2 {
                let read = socket.recv(|bytes| {
                    let left = reading.left(connection, owner);
                    let bytes = bytes.get(..left).unwrap_or(bytes);
                    reading.note(connection, owner, bytes.len());
                    endpoint.feed(connection, bytes);
                    (bytes.len(), ())
                });
                if read.is_err() {
                    break;
                }
            }
            if gone || !socket.may_recv() {
                endpoint.close(connection);
                return closing(socket, now_ms);
            }
            used
        }
    }
}

fn closing(socket: &mut Socket<'_>, now_ms: i64) -> Use {
    socket.close();
    let until = now_ms.saturating_add(LINGER_MS);
    Use::Closing { until }
}
