//! The server's sockets: non-blocking, a fixed number, no allocation after start.

mod datagram;
mod stream;

use std::io;
use std::net::{SocketAddr, TcpStream};

use gantry_tau_core::control::endpoint::{Endpoint, Transport};
use gantry_tau_core::control::keys::Keyring;
use gantry_tau_core::control::session::Connection;

use super::ServerError;
use crate::links::Allowed;
use crate::realtime::Socket;
use datagram::Datagrams;
use stream::Streams;

/// Address, transport and allowed peers of a server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Listen {
    /// Address and port; port 0 for any free one.
    pub address: SocketAddr,
    /// TCP or UDP.
    pub transport: Transport,
    /// Peers that are answered.
    pub allowed: Allowed,
}

/// TCP, for every peer.
impl From<SocketAddr> for Listen {
    fn from(address: SocketAddr) -> Self {
        Self {
            address,
            transport: Transport::Stream,
            allowed: Allowed::all(),
        }
    }
}

/// Address of a server that owns it and does not answer yet.
#[derive(Debug)]
pub struct Listening {
    pub(super) connections: Connections,
    pub(super) keyring: Option<Keyring>,
}

impl Listening {
    /// Owns the address.
    ///
    /// # Errors
    /// [`ServerError::Listen`]: another process has it, or the system does not give it.
    pub fn bind(listen: &Listen) -> Result<Self, ServerError> {
        let bound =
            Connections::bind(listen).map_err(|error| ServerError::listen(listen.address, &error));
        Ok(Self {
            connections: bound?,
            keyring: None,
        })
    }

    /// Answers holders of these keys only. Without keys every peer that reaches the address is answered.
    #[must_use]
    pub fn with_keys(self, keyring: Option<Keyring>) -> Self {
        Self { keyring, ..self }
    }
}

/// Sockets of one transport, and their peers.
#[derive(Debug)]
pub(super) enum Connections {
    Streams(Streams),
    Datagrams(Datagrams),
}

impl Connections {
    pub(super) fn bind(listen: &Listen) -> io::Result<Self> {
        let allowed = listen.allowed.clone();
        Ok(match listen.transport {
            Transport::Stream => Self::Streams(Streams::bind(listen.address, allowed)?),
            Transport::Datagram => Self::Datagrams(Datagrams::bind(listen.address, allowed)?),
        })
    }

    pub(super) fn address(&self) -> io::Result<SocketAddr> {
        match self {
            Self::Streams(streams) => streams.listener.local_addr(),
            Self::Datagrams(datagrams) => datagrams.socket.local_addr(),
        }
    }

    /// Accepts new peers and reads from all; or reads from `only`, as far as the transport can tell
    /// it apart. Returns the number of frames of the owner in the coming tick.
    pub(super) fn receive<const N: usize>(
        &mut self,
        endpoint: &mut Endpoint<N>,
        only: Option<Connection>,
    ) -> u8 {
        match self {
            Self::Streams(streams) => {
                if only.is_none() {
                    streams.accept(endpoint);
                }
                streams.receive(endpoint, only)
            }
            Self::Datagrams(datagrams) => datagrams.receive(endpoint),
        }
    }

    /// Writes a frame. It never waits: a frame that a slow reader does not take is lost.
    pub(super) fn send(&mut self, connection: Connection, bytes: &[u8]) {
        match self {
            Self::Streams(streams) => streams.send(connection, bytes),
            Self::Datagrams(datagrams) => datagrams.send(connection, bytes),
        }
    }

    /// Closes a connection. Its last frame is already with the system.
    pub(super) fn close(&mut self, connection: Connection) {
        match self {
            Self::Streams(streams) => streams.close(connection),
            Self::Datagrams(datagrams) => datagrams.close(connection),
        }
    }

    /// Returns the stream of a connection; `None` over UDP.
    pub(super) fn stream(&mut self, connection: Connection) -> Option<&TcpStream> {
        match self {
            Self::Streams(streams) => streams.stream(connection),
            Self::Datagrams(_) => None,
        }
    }

    /// Returns the socket to wait on for bytes of a connection.
    pub(super) fn socket(&mut self, connection: Connection) -> Option<Socket<'_>> {
        match self {
            Self::Streams(streams) => streams.stream(connection).map(Socket::Stream),
            Self::Datagrams(datagrams) => Some(Socket::Datagram(&datagrams.socket)),
        }
    }
}
