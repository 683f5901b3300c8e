//! `monitor --web`: one page, which draws the machine live.
//!
//! HTTP/1.1 with three resources, all read only: `/` is the page, which needs nothing else; `/live`
//! sends it pictures as server-sent events; `/status` is the object of `monitor --status`. A
//! picture is encoded once for all readers. A reader gets the latest one whenever it has taken the
//! last, so that a slow reader misses pictures; one that takes none for two seconds is dropped.

mod connection;
mod drawing;
mod figure;
mod hub;
mod page;
mod request;

use std::io;
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use gantry_tau_machine::robot_file::AnyRobotFile;
use gantry_tau_server::links::Allowed;
use gantry_tau_server::links::places::{Holder, gives_way, gives_way_at_home};

use super::ServerMonitor;
use drawing::Drawing;
use hub::Hub;

/// Connections at once. When all are taken, the youngest of the address that has the most gives
/// way: that of another address, or of the newcomer's own if none has more. A browser that has lost
/// its connection comes back by itself.
const CONNECTIONS: usize = 32;
/// Threads at once: those of connections that gave way end within a second.
const THREADS: usize = 2 * CONNECTIONS;
/// New connections per visit.
const ACCEPTS: usize = 4;
/// Pause between two pictures without a server.
const WITHOUT_SERVER: Duration = Duration::from_millis(500);

/// Server of the page.
pub struct Web {
    listener: TcpListener,
    allowed: Allowed,
    drawing: Drawing,
    hub: Arc<Hub>,
    seats: Arc<Mutex<Vec<Seat>>>,
    threads: Arc<()>,
    /// Number of the next connection.
    next: u64,
    /// Time of the last picture.
    published: Instant,
    /// Tick of the last picture.
    shown: Option<i64>,
}

impl Web {
    /// Listens for browsers. The machine is drawn by this robot file, if it is the server's; without
    /// one, by that of the server.
    ///
    /// # Errors
    /// The address cannot be bound.
    pub fn bind(
        address: SocketAddr,
        allowed: Allowed,
        robot: Option<AnyRobotFile>,
    ) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        Ok(Self {
            listener,
            allowed,
            drawing: Drawing::of(robot),
            hub: Arc::new(Hub::new()),
            seats: Arc::default(),
            threads: Arc::new(()),
            next: 0,
            published: Instant::now(),
            shown: None,
        })
    }

    /// Returns the address on which it listens.
    ///
    /// # Errors
    /// The system does not tell it.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Accepts new connections, and publishes a picture if there is a new tick. It never waits for
    /// a reader.
    pub fn visit(&mut self, monitor: &ServerMonitor) {
        self.accept();
        let tick = monitor.live().map(|snapshot| snapshot.tick);
        let is_due = tick.map_or_else(
            || self.published.elapsed() >= WITHOUT_SERVER,
            |tick| Some(tick) != self.shown,
        );
        if is_due || tick.is_none() != self.shown.is_none() {
            self.shown = tick;
            self.published = Instant::now();
            self.hub.publish(monitor, &mut self.drawing);
        }
    }

    fn accept(&mut self) {
        for _ in 0..ACCEPTS {
            let Ok((stream, peer)) = self.listener.accept() else {
                return;
            };
            if !self.allowed.admits(peer.ip()) || Arc::strong_count(&self.threads) > THREADS {
                continue;
            }
            let holder = Holder {
                peer: peer.ip().to_canonical(),
                number: self.next,
            };
            self.next += 1;
            let Some(ticket) = self.seat(&stream, holder) else {
                continue;
            };
            let hub = Arc::clone(&self.hub);
            let thread = Arc::clone(&self.threads);
            let started = std::thread::Builder::new()
                .name("page".to_owned())
                .spawn(move || {
                    let _both = (ticket, thread);
                    connection::serve(stream, &hub);
                });
            if let Err(error) = started {
                tracing::warn!("a reader of the page was not served: {error}");
            }
        }
    }

    /// Gives a connection a seat, for which another one may have to go. `None` if there is none.
    fn seat(&self, stream: &TcpStream, holder: Holder) -> Option<Ticket> {
        let mut seats = lock(&self.seats);
        if seats.len() >= CONNECTIONS {
            let holders = seats.iter().map(|seat| seat.holder);
            let gone = gives_way(holders.clone(), holder.peer)
                .or_else(|| gives_way_at_home(holders, holder.peer))?;
            let index = seats.iter().position(|seat| seat.holder == gone)?;
            // Its thread finds the connection closed.
            let _ = seats.swap_remove(index).stream.shutdown(Shutdown::Both);
        }
        seats.push(Seat {
            holder,
            stream: stream.try_clone().ok()?,
        });
        Some(Ticket {
            seats: Arc::clone(&self.seats),
            holder,
        })
    }
}

impl Drop for Web {
    fn drop(&mut self) {
        self.hub.end();
    }
}

/// Seat of a connection.
struct Seat {
    holder: Holder,
    stream: TcpStream,
}

/// Gives a seat back when it is dropped.
struct Ticket {
    seats: Arc<Mutex<Vec<Seat>>>,
    holder: Holder,
}

impl Drop for Ticket {
    fn drop(&mut self) {
        lock(&self.seats).retain(|seat| seat.holder != self.holder);
    }
}

/// The seats; a thread that panicked with them in hand has not left them half written.
fn lock(seats: &Mutex<Vec<Seat>>) -> MutexGuard<'_, Vec<Seat>> {
    seats.lock().unwrap_or_else(PoisonError::into_inner)
}
