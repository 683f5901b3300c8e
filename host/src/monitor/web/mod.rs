//! `monitor --web`: one page, which draws the machine live.
//!
//! HTTP/1.1 with three resources, all read only: `/` is the page, which needs nothing else; `/live` sends it pictures as server-sent events;
//! `/status` is the object of `monitor --status`. A picture is encoded once for all readers. A reader gets the latest one whenever it has
//! taken the last, so that a slow reader misses pictures; one that takes none for two seconds is dropped.

mod connection;
mod figure;
mod hub;
mod page;
mod request;

use std::io;
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::Monitor;
use crate::model::MachineKind;
use crate::places::{Holder, gives_way, gives_way_at_home};
use crate::robot_file::{RobotFile, RobotFileError};
use crate::server::connections::Allowed;
pub use figure::Figures;
use hub::Hub;

/// Connections at once. When all are taken, the youngest of the address that has the most gives way: that of another address, or of the
/// newcomer's own if none has more. A browser that has lost its connection comes back by itself.
const CONNECTIONS: usize = 32;
/// Threads at once: those of connections that gave way end within a second.
const THREADS: usize = 2 * CONNECTIONS;
/// New connections per visit.
const ACCEPTS: usize = 4;
/// Pause between two pictures without a server.
const WITHOUT_SERVER: Duration = Duration::from_millis(500);

/// Returns the machine of a robot file, for a page.
///
/// # Errors
/// [`RobotFileError`] if home cannot be reached.
pub fn figures<K: MachineKind<N>, const N: usize>(robot: RobotFile<K, N>) -> Result<Box<dyn Figures>, RobotFileError> {
    Ok(Box::new(figure::Drawn::new(robot)?))
}

/// Server of the page.
pub struct Web {
    listener: TcpListener,
    allowed: Allowed,
    figures: Box<dyn Figures>,
    hub: Arc<Hub>,
    places: Arc<Mutex<Vec<Place>>>,
    threads: Arc<()>,
    /// Number of the next connection.
    next: u64,
    /// Time of the last picture.
    published: Instant,
    /// Tick of the last picture.
    shown: Option<i64>,
}

impl Web {
    /// Listens for browsers.
    ///
    /// # Errors
    /// The address cannot be bound.
    pub fn bind(address: SocketAddr, allowed: Allowed, figures: Box<dyn Figures>) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        let hub = Arc::new(Hub::new(figures.machine()));
        let (places, threads) = (Arc::default(), Arc::new(()));
        Ok(Self { listener, allowed, figures, hub, places, threads, next: 0, published: Instant::now(), shown: None })
    }

    /// Returns the address on which it listens.
    ///
    /// # Errors
    /// The system does not tell it.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Accepts new connections, and publishes a picture if there is a new tick. It never waits for a reader.
    pub fn visit(&mut self, monitor: &Monitor) {
        self.accept();
        let tick = monitor.live().map(|snapshot| snapshot.tick);
        let is_due = tick.map_or_else(|| self.published.elapsed() >= WITHOUT_SERVER, |tick| Some(tick) != self.shown);
        if is_due || tick.is_none() != self.shown.is_none() {
            self.shown = tick;
            self.published = Instant::now();
            self.hub.publish(monitor, self.figures.as_mut());
        }
    }

    fn accept(&mut self) {
        for _ in 0..ACCEPTS {
            let Ok((stream, peer)) = self.listener.accept() else { return };
            if !self.allowed.admits(peer.ip()) || Arc::strong_count(&self.threads) > THREADS {
                continue;
            }
            let holder = Holder { peer: peer.ip().to_canonical(), number: self.next };
            self.next += 1;
            let Some(ticket) = self.take_place(&stream, holder) else { continue };
            let (hub, thread) = (Arc::clone(&self.hub), Arc::clone(&self.threads));
            let serve = move || {
                let _both = (ticket, thread);
                connection::serve(stream, &hub);
            };
            if let Err(error) = std::thread::Builder::new().name("page".to_owned()).spawn(serve) {
                tracing::warn!("a reader of the page was not served: {error}");
            }
        }
    }

    /// Takes a place, which another connection may have to give. `None` if there is none.
    fn take_place(&self, stream: &TcpStream, holder: Holder) -> Option<Ticket> {
        let mut places = lock(&self.places);
        if places.len() >= CONNECTIONS {
            let holders = || places.iter().map(|place| place.holder);
            let given = gives_way(holders(), holder.peer).or_else(|| gives_way_at_home(holders(), holder.peer))?;
            let index = places.iter().position(|place| place.holder == given)?;
            // Its thread finds the connection closed.
            let _ = places.swap_remove(index).stream.shutdown(Shutdown::Both);
        }
        places.push(Place { holder, stream: stream.try_clone().ok()? });
        Some(Ticket { places: Arc::clone(&self.places), holder })
    }
}

impl Drop for Web {
    fn drop(&mut self) {
        self.hub.end();
    }
}

/// Place of a connection.
struct Place {
    holder: Holder,
    stream: TcpStream,
}

/// Gives a place back when it is dropped.
struct Ticket {
    places: Arc<Mutex<Vec<Place>>>,
    holder: Holder,
}

impl Drop for Ticket {
    fn drop(&mut self) {
        lock(&self.places).retain(|place| place.holder != self.holder);
    }
}

/// The places; whoever panicked with them in hand has not left them half written.
fn lock(places: &Mutex<Vec<Place>>) -> MutexGuard<'_, Vec<Place>> {
    places.lock().unwrap_or_else(PoisonError::into_inner)
}
