//! TCP: sockets that listen on one port, and pass what they receive to an endpoint.

use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::session::Connection;
use smoltcp::iface::{
    Config, Interface, PollIngressSingleResult, SocketHandle, SocketSet, SocketStorage,
};
use smoltcp::socket::tcp::{Socket, SocketBuffer};
use smoltcp::time::Instant;
use smoltcp::wire::{EthernetAddress, IpCidr, Ipv4Address};

use super::lan9118::Lan9118;
use crate::ingress_budget::IngressBudget;
use crate::machine::Server as Endpoint;

/// Connections at once: an owner, two that are refused meanwhile, and one whose peer vanished.
const SOCKETS: usize = 4;
/// Receive buffer, bytes: the window that each peer is offered.
const RECEIVE: usize = 1_024;
/// Send buffer, bytes: about a dozen States that are not acknowledged yet. A slower peer is closed.
const SEND: usize = 4_096;
/// Frames taken from the controller per visit.
const FRAMES: usize = 16;
/// Segments sent per connection and visit.
const SEGMENTS: usize = 4;
/// Longest handshake at the beginning and at the end of a connection before it is reset, ms.
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

/// Use of a socket.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Use {
    /// No peer is connected.
    Free,
    /// A peer began to connect; reset unless connected by then, ms.
    Arriving { until: i64 },
    /// A peer of the endpoint. `gone`: a write failed; reported to the endpoint in its next turn.
    Peer { connection: Connection, gone: bool },
    /// The endpoint has no further use for it; reset unless it closes by then, ms.
    Closing { until: i64 },
}

impl Use {
    /// True if a visit looks at it: the owner at every visit.
    fn is_due(self, has_turn: bool, endpoint: &Endpoint) -> bool {
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
    /// Socket that has its turn: one non-owner is accepted, or read, per visit.
    turn: usize,
    budget: IngressBudget,
}

impl Server {
    /// Listens. `seed` makes TCP's initial sequence numbers.
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
            budget: IngressBudget::default(),
        };
        server.listen();
        server
    }

    /// Receives, opens and closes connections of the endpoint, feeds it, and sends.
    pub(crate) fn visit(&mut self, now_ms: i64, endpoint: &mut Endpoint) {
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
                peer.used = next_use(peer.used, socket, now_ms, endpoint, &mut self.budget);
            }
        }
        self.listen();
        self.flush();
    }

    /// Restores the budget after a tick.
    pub(crate) fn ticked(&mut self) {
        self.budget = IngressBudget::default();
    }

    /// Sends as much as the controller and the peers' windows have room for.
    pub(crate) fn flush(&mut self) {
        let now = Instant::from_millis(self.now_ms);
        for _ in 0..SEGMENTS {
            let _ = (self.interface).poll_egress(now, &mut self.lan, &mut self.sockets);
        }
    }

    /// Writes a whole frame, or gives the peer up: a slow reader is never waited for.
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

    /// True if no peer is connected.
    pub(crate) fn is_idle(&self) -> bool {
        (self.peers.iter().flatten()).all(|peer| peer.used == Use::Free)
    }

    /// Lets every free socket listen.
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

/// Returns the use of a socket after everything that was received.
fn next_use(
    used: Use,
    socket: &mut Socket<'_>,
    now_ms: i64,
    endpoint: &mut Endpoint,
    budget: &mut IngressBudget,
) -> Use {
    match used {
        Use::Free if socket.is_active() => {
            let until = now_ms.saturating_add(LINGER_MS);
            next_use(Use::Arriving { until }, socket, now_ms, endpoint, budget)
        }
        Use::Free => Use::Free,
        Use::Arriving { .. } if socket.may_send() && budget.accept() => {
            let Ok(connection) = endpoint.open(Transport::Stream) else {
                // Best effort: the peer is about to be closed anyway.
                let _ = socket.send_slice(&Endpoint::full_refusal(Transport::Stream));
                return closing(socket, now_ms);
            };
            let gone = false;
            next_use(
                Use::Peer { connection, gone },
                socket,
                now_ms,
                endpoint,
                budget,
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
                    let left = budget.left(connection, owner);
                    let bytes = bytes.get(..left).unwrap_or(bytes);
                    budget.count(connection, owner, bytes.len());
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
