//! UDP: one socket for all peers, told apart by their addresses; each datagram is one frame.

use std::io;
use std::net::{SocketAddr, UdpSocket};

use gantry_tau_core::control::endpoint::{CONNECTIONS, Endpoint, Transport};
use gantry_tau_core::control::message::ClientMessage;
use gantry_tau_core::control::session::Connection;
use gantry_tau_core::control::wire::{Frame, MAX_FRAME, decode_client};

use super::Allowed;

/// Datagrams taken per visit: more than the budgets of all peers, and a bound on the work a flood can cause.
const READS: usize = 64;

#[derive(Debug)]
struct Peer {
    connection: Connection,
    address: SocketAddr,
}

/// Socket and peers.
#[derive(Debug)]
pub(in crate::server) struct Datagrams {
    socket: UdpSocket,
    allowed: Allowed,
    peers: [Option<Peer>; CONNECTIONS],
}

impl Datagrams {
    pub(super) fn bind(address: SocketAddr, allowed: Allowed) -> io::Result<Self> {
        let socket = UdpSocket::bind(address)?;
        socket.set_nonblocking(true)?;
        Ok(Self { socket, allowed, peers: [const { None }; CONNECTIONS] })
    }

    pub(super) fn address(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    pub(super) fn socket(&self) -> &UdpSocket {
        &self.socket
    }

    /// Reads whole datagrams from all peers. Returns the number of frames of the owner in the coming tick.
    pub(super) fn receive<const N: usize, const M: usize>(&mut self, endpoint: &mut Endpoint<N, M>) -> u8 {
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
            if let Some(connection) = self.connection(endpoint, from, bytes) {
                endpoint.feed(connection, bytes);
            }
        }
        let owner = endpoint.session().owner();
        owner.map_or(0, |owner| endpoint.frames_of(owner))
    }

    /// Returns the connection of a datagram's sender. Only a Hello makes a new peer; anything else is not answered.
    fn connection<const N: usize, const M: usize>(
        &mut self,
        endpoint: &mut Endpoint<N, M>,
        from: SocketAddr,
        bytes: &[u8],
    ) -> Option<Connection> {
        let known = self.peers.iter().flatten().find(|peer| peer.address == from);
        if let Some(peer) = known {
            return Some(peer.connection);
        }
        if !self.allowed.admits(from.ip()) || !is_hello::<N>(bytes) {
            return None;
        }
        let free = self.peers.iter_mut().find(|peer| peer.is_none());
        match (free, endpoint.open(Transport::Datagram)) {
            (Some(free), Ok(connection)) => {
                *free = Some(Peer { connection, address: from });
                Some(connection)
            }
            (None, Ok(connection)) => {
                endpoint.close(connection);
                None
            }
            (_, Err(_)) => {
                let refusal = Endpoint::<N, M>::full_refusal();
                // Best effort. The answer is at most as long as the Hello: a forged address gains nothing.
                let _ = self.socket.send_to(&refusal, from);
                None
            }
        }
    }

    /// Sends a datagram. One that the system does not take is lost, like any other on its way.
    pub(super) fn send(&mut self, connection: Connection, bytes: &[u8]) {
        let peer = (self.peers.iter().flatten()).find(|peer| peer.connection == connection);
        if let Some(peer) = peer {
            let _ = self.socket.send_to(bytes, peer.address);
        }
    }

    pub(super) fn close(&mut self, connection: Connection) {
        for place in &mut self.peers {
            place.take_if(|peer| peer.connection == connection);
        }
    }
}

/// True if a datagram asks for a session.
fn is_hello<const N: usize>(bytes: &[u8]) -> bool {
    let hello = |frame: Frame<'_>| matches!(decode_client::<N>(&frame), Ok(ClientMessage::Hello(_)));
    Frame::parse(bytes).is_ok_and(hello)
}
