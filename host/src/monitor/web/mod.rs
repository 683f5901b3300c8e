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
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use super::Monitor;
use crate::model::MachineKind;
use crate::robot_file::{RobotFile, RobotFileError};
use crate::server::connections::Allowed;
pub use figure::Figures;
use hub::Hub;

/// Connections at once; further ones are closed.
const CONNECTIONS: usize = 32;
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
    connections: Arc<AtomicUsize>,
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
        let connections = Arc::default();
        Ok(Self { listener, allowed, figures, hub, connections, published: Instant::now(), shown: None })
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

    fn accept(&self) {
        for _ in 0..ACCEPTS {
            let Ok((stream, peer)) = self.listener.accept() else { return };
            if !self.allowed.admits(peer.ip()) || self.connections.load(Ordering::Relaxed) >= CONNECTIONS {
                continue;
            }
            let place = Place::take(&self.connections);
            let hub = Arc::clone(&self.hub);
            let serve = move || {
                let _place = place;
                connection::serve(stream, &hub);
            };
            if let Err(error) = std::thread::Builder::new().name("page".to_owned()).spawn(serve) {
                tracing::warn!("a reader of the page was not served: {error}");
            }
        }
    }
}

impl Drop for Web {
    fn drop(&mut self) {
        self.hub.end();
    }
}

/// One of the connections, until it is dropped.
struct Place(Arc<AtomicUsize>);

impl Place {
    fn take(places: &Arc<AtomicUsize>) -> Self {
        places.fetch_add(1, Ordering::Relaxed);
        Self(Arc::clone(places))
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}
