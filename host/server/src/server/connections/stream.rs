//! TCP: a listener and a stream per peer.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};

use gantry_tau_core::control::endpoint::{CONNECTIONS, Endpoint, Full, Transport};
use gantry_tau_core::control::session::Connection;

use crate::links::Allowed;
use crate::realtime::is_acceptable;

/// Bytes taken from one connection at a time.
const CHUNK: usize = 4_096;
/// Reads from one connection per visit: more than the owner's frames of a tick, and a bound on the
/// work a flood can cause.
const READS: usize = 2;
/// New connections accepted per visit.
const ACCEPTS: usize = 2;

#[derive(Debug)]
struct Peer {
    connection: Connection,
    stream: TcpStream,
    /// A write failed or the peer closed; the endpoint learns of it in the next visit.
    gone: bool,
}

/// Listener and peers.
#[derive(Debug)]
pub(in crate::server) struct Streams {
    pub(super) listener: TcpListener,
    allowed: Allowed,
    /// As many as the endpoint has opened.
    peers: Vec<Peer>,
}

impl Streams {
    pub(super) fn bind(address: SocketAddr, allowed: Allowed) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        Ok(Self {
            listener,
            allowed,
            peers: Vec::with_capacity(CONNECTIONS),
        })
    }

    /// Accepts new peers. When all places are taken, one makes room ([`Endpoint::longest_idle`]): one
    /// that is refused is closed, so that those that stay are idle.
    pub(super) fn accept<const N: usize>(&mut self, endpoint: &mut Endpoint<N>) {
        for _ in 0..ACCEPTS {
            if !is_acceptable(&self.listener) {
                return;
            }
            let Ok((mut stream, peer)) = self.listener.accept() else {
                return;
            };
            // Others are closed silently.
            if !self.allowed.admits(peer.ip())
                || stream.set_nonblocking(true).is_err()
                || stream.set_nodelay(true).is_err()
            {
                continue;
            }
            let opened = endpoint.open(Transport::Stream).or_else(|full| {
                self.close_longest_idle(endpoint).ok_or(full)?;
                endpoint.open(Transport::Stream)
            });
            match opened {
                Ok(connection) => self.peers.push(Peer {
                    connection,
                    stream,
                    gone: false,
                }),
                // Best effort: the peer is about to be closed anyway.
                Err(Full) => drop(stream.write(&Endpoint::<N>::full_refusal(Transport::Stream))),
            }
        }
    }

    /// Refuses and closes the connection that is to make room; `None` without one.
    fn close_longest_idle<const N: usize>(&mut self, endpoint: &mut Endpoint<N>) -> Option<()> {
        let connection = endpoint.longest_idle()?;
        let index = (self.peers.iter()).position(|peer| peer.connection == connection)?;
        let mut idle = self.peers.remove(index);
        endpoint.close(idle.connection);
        // Best effort, as for a peer without room.
        let _ = idle
            .stream
            .write(&Endpoint::<N>::full_refusal(Transport::Stream));
        Some(())
    }

    /// Reads from all peers, or from `only`. Returns the number of frames of the owner in the
    /// coming tick.
    pub(super) fn receive<const N: usize>(
        &mut self,
        endpoint: &mut Endpoint<N>,
        only: Option<Connection>,
    ) -> u8 {
        let owner = endpoint.session().owner();
        let mut owner_frames = 0;
        self.peers.retain_mut(|peer| {
            if only.is_some_and(|only| only != peer.connection) {
                return true;
            }
            let frames = peer.read(endpoint);
            if owner == Some(peer.connection) {
                owner_frames = frames;
            }
            if peer.gone {
                endpoint.close(peer.connection);
            }
            !peer.gone
        });
        owner_frames
    }

    /// Writes a whole frame or gives the peer up. It never waits for a slow reader.
    pub(super) fn send(&mut self, connection: Connection, bytes: &[u8]) {
        if let Some(peer) = self.find(connection) {
            let whole = matches!(peer.stream.write(bytes), Ok(count) if count == bytes.len());
            peer.gone |= !whole;
        }
    }

    /// Closes a connection. Its last frame is already with the system.
    pub(super) fn close(&mut self, connection: Connection) {
        self.peers.retain(|peer| peer.connection != connection);
    }

    /// Returns the stream of a connection, to wait on.
    pub(super) fn stream(&mut self, connection: Connection) -> Option<&TcpStream> {
        self.find(connection).map(|peer| &peer.stream)
    }

    fn find(&mut self, connection: Connection) -> Option<&mut Peer> {
        self.peers
            .iter_mut()
            .find(|peer| peer.connection == connection)
    }
}

impl Peer {
    fn read<const N: usize>(&mut self, endpoint: &mut Endpoint<N>) -> u8 {
        let mut buffer = [0; CHUNK];
        let mut frames = endpoint.frames_of(self.connection);
        for _ in 0..READS {
            match self.stream.read(&mut buffer) {
                Ok(0) => self.gone = true,
                Ok(count) => {
                    let bytes = buffer.get(..count).unwrap_or_default();
                    frames = endpoint.feed(self.connection, bytes);
                    continue;
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                Err(_) => self.gone = true,
            }
            break;
        }
        frames
    }
}
