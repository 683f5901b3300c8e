//! UDP: one socket for all peers, by their addresses; each datagram is one frame.

use std::io;
use std::net::{IpAddr, SocketAddr, UdpSocket};

use gantry_tau_core::control::endpoint::{CONNECTIONS, Endpoint, Greeted};
use gantry_tau_core::control::message::Phase;
use gantry_tau_core::control::session::Connection;
use gantry_tau_core::control::wire::{Frame, Kind, MAX_FRAME, Suite};

use crate::links::Allowed;

/// Datagrams taken per visit: more than the budgets of all peers, and a bound on the work a flood
/// can cause.
const READS: usize = 64;

#[derive(Debug)]
struct Peer {
    connection: Connection,
    address: SocketAddr,
    /// It has shown that it receives what is sent to its address: by the cookie in its Hello, or by
    /// an accepted Command, which repeats numbers of a Welcome and a State.
    has_answered: bool,
    /// A frame has come from it since the last State was sent to it.
    was_heard: bool,
}

impl Peer {
    /// Takes note of a datagram from its address.
    fn hear(&mut self, bytes: &[u8]) {
        self.was_heard |= Frame::parse(bytes).is_ok();
    }

    /// True if a frame may be sent to it. A sender with a forged address must not turn its Hello
    /// into a stream of States to that address: one that has not answered gets at most one State
    /// for each frame that is heard from it.
    fn may_be_sent(&mut self, bytes: &[u8]) -> bool {
        let is_state =
            || Frame::parse(bytes).is_ok_and(|frame| frame.kind_code() == Kind::State.code());
        self.has_answered || !is_state() || std::mem::take(&mut self.was_heard)
    }
}

/// Socket and peers.
#[derive(Debug)]
pub(in crate::server) struct Datagrams {
    pub(super) socket: UdpSocket,
    allowed: Allowed,
    /// As many as the endpoint has opened.
    peers: Vec<Peer>,
}

impl Datagrams {
    pub(super) fn bind(address: SocketAddr, allowed: Allowed) -> io::Result<Self> {
        let socket = UdpSocket::bind(address)?;
        socket.set_nonblocking(true)?;
        Ok(Self {
            socket,
            allowed,
            peers: Vec::with_capacity(CONNECTIONS),
        })
    }

    /// Reads whole datagrams from all peers. Returns the number of frames of the owner in the
    /// coming tick.
    pub(super) fn receive<const N: usize>(&mut self, endpoint: &mut Endpoint<N>) -> u8 {
        // A datagram longer than any frame is cut, and then has the wrong length.
        let mut buffer = [0; MAX_FRAME + 1];
        for _ in 0..READS {
            let (count, from) = match self.socket.recv_from(&mut buffer) {
                Ok(received) => received,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                // An error of an earlier datagram: a peer's port is closed.
                Err(_) => continue,
            };
            let bytes = buffer.get(..count).unwrap_or_default();
            self.take(endpoint, from, bytes);
        }
        self.note_answered(endpoint);
        let owner = endpoint.session().owner();
        owner.map_or(0, |owner| endpoint.frames_of(owner))
    }

    /// Takes a datagram of a peer, or of a sender that may become one.
    fn take<const N: usize>(&mut self, endpoint: &mut Endpoint<N>, from: SocketAddr, bytes: &[u8]) {
        if let Some(peer) = self.peers.iter_mut().find(|peer| peer.address == from) {
            peer.hear(bytes);
            endpoint.feed(peer.connection, bytes);
            return;
        }
        if !self.allowed.admits(from.ip()) {
            return;
        }
        let has_answered = endpoint.suite() == Suite::Tag;
        match endpoint.greet(&octets(from), bytes) {
            Greeted::Nothing => {}
            // Best effort. The answer is at most as long as the Hello: a forged address gains nothing.
            Greeted::Answer(frame) => drop(self.socket.send_to(frame, from)),
            Greeted::Peer(connection) => self.peers.push(Peer {
                connection,
                address: from,
                has_answered,
                was_heard: true,
            }),
        }
    }

    /// Takes note of the owner's first accepted Command, which ends the handshake.
    fn note_answered<const N: usize>(&mut self, endpoint: &Endpoint<N>) {
        let session = endpoint.session();
        if !matches!(session.phase(), Phase::Submit | Phase::Obtain) {
            return;
        }
        let owner = self
            .peers
            .iter_mut()
            .find(|peer| Some(peer.connection) == session.owner());
        if let Some(owner) = owner {
            owner.has_answered = true;
        }
    }

    /// Sends a datagram, unless it is a State for a peer that has not answered the last one. One
    /// that the system does not take is lost, like any other on its way.
    pub(super) fn send(&mut self, connection: Connection, bytes: &[u8]) {
        let Some(peer) = self
            .peers
            .iter_mut()
            .find(|peer| peer.connection == connection)
        else {
            return;
        };
        if peer.may_be_sent(bytes) {
            let _ = self.socket.send_to(bytes, peer.address);
        }
    }

    pub(super) fn close(&mut self, connection: Connection) {
        self.peers.retain(|peer| peer.connection != connection);
    }
}

/// Returns address and port as [`Endpoint::greet`] takes them.
fn octets(peer: SocketAddr) -> [u8; 18] {
    let address = match peer.ip() {
        IpAddr::V4(address) => address.to_ipv6_mapped(),
        IpAddr::V6(address) => address,
    };
    let mut octets = [0; 18];
    let bytes = address
        .octets()
        .into_iter()
        .chain(peer.port().to_be_bytes());
    for (place, byte) in octets.iter_mut().zip(bytes) {
        *place = byte;
    }
    octets
}
