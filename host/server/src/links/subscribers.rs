//! Subscribers of a TCP port: each gets the same bytes, and what it sends is dropped.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

use socket2::SockRef;

use crate::links::Allowed;
use crate::links::places::{Holder, gives_way};
use crate::realtime::is_acceptable;

/// Subscribers served at once.
pub const MAX_SUBSCRIBERS: usize = 4;
/// Bytes that the system keeps for a subscriber: less than a second of all samples, so that one
/// that has stopped reading is dropped soon instead of being sent old ticks later.
const SEND_BUFFER: usize = 128 * 1024;
/// Bytes within which a subscriber that reads nothing does not differ from one that does: the
/// buffers of both systems take them.
const UNPROVEN: u64 = 64 * 1024;
/// Time after which a subscriber that was sent no more than [`UNPROVEN`] bytes is idle.
const IDLE: Duration = Duration::from_secs(10);

/// A port and its subscribers. Serving them allocates nothing and never blocks; a subscriber that
/// cannot keep up is dropped.
///
/// When all places are taken, a newcomer waits, and gets the first of these: the place of one that
/// has gone; that of the one that came first of those that are idle; that of the youngest of an
/// address that has two more than the newcomer's own. One waits at a time; others that have no
/// claim to a place meanwhile are closed.
#[derive(Debug)]
pub struct Subscribers {
    listener: TcpListener,
    allowed: Allowed,
    send_buffer: usize,
    subscribers: [Option<Subscriber>; MAX_SUBSCRIBERS],
    waiting: Option<Subscriber>,
    /// Number of the next connection.
    next: u64,
}

/// One subscriber.
#[derive(Debug)]
struct Subscriber {
    stream: TcpStream,
    holder: Holder,
    since: Instant,
    /// Bytes that were sent to it.
    sent: u64,
}

impl Subscriber {
    /// True if it may be one that reads nothing, and has been here for long.
    fn is_idle(&self) -> bool {
        self.sent < UNPROVEN && self.since.elapsed() >= IDLE
    }

    /// True if it has taken all the bytes at once.
    fn takes(&mut self, bytes: &[u8]) -> bool {
        self.sent = self
            .sent
            .saturating_add(u64::try_from(bytes.len()).unwrap_or(u64::MAX));
        bytes.is_empty() || matches!(self.stream.write(bytes), Ok(count) if count == bytes.len())
    }

    fn has_gone(&mut self) -> bool {
        has_gone(&mut self.stream)
    }
}

impl Subscribers {
    /// Listens for subscribers.
    ///
    /// # Errors
    /// The address cannot be bound.
    pub fn bind(address: SocketAddr) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        let allowed = Allowed::all();
        let subscribers = [const { None }; MAX_SUBSCRIBERS];
        Ok(Self {
            listener,
            allowed,
            send_buffer: SEND_BUFFER,
            subscribers,
            waiting: None,
            next: 0,
        })
    }

    /// Serves only these peers.
    #[must_use]
    pub fn for_peers(self, allowed: Allowed) -> Self {
        Self { allowed, ..self }
    }

    /// Has the system keep no more than this for a subscriber, bytes.
    #[must_use]
    pub(crate) fn with_send_buffer(self, send_buffer: usize) -> Self {
        Self {
            send_buffer,
            ..self
        }
    }

    /// Returns the address on which it listens.
    ///
    /// # Errors
    /// Error of the system.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Accepts at most one new subscriber, or the one that waits, and sends it `first`.
    pub fn accept(&mut self, first: &[u8]) {
        if let Some(waiting) = self
            .waiting
            .take()
            .and_then(|mut subscriber| (!subscriber.has_gone()).then_some(subscriber))
        {
            match self.place(waiting.holder.peer) {
                Some(place) => return self.seat(place, waiting, first),
                None => self.waiting = Some(waiting),
            }
        }
        let Some(newcomer) = self.newcomer() else {
            return;
        };
        match self.place(newcomer.holder.peer) {
            Some(place) => self.seat(place, newcomer, first),
            None if self.waiting.is_none() => self.waiting = Some(newcomer),
            // Closed: behind one that waits it would hide others, of another address.
            None => {}
        }
    }

    /// Accepts a connection that may be served.
    fn newcomer(&mut self) -> Option<Subscriber> {
        if !is_acceptable(&self.listener) {
            return None;
        }
        let (stream, peer) = self.listener.accept().ok()?;
        let usable = self.allowed.admits(peer.ip())
            && stream.set_nonblocking(true).is_ok()
            && stream.set_nodelay(true).is_ok()
            && SockRef::from(&stream)
                .set_send_buffer_size(self.send_buffer)
                .is_ok();
        let holder = Holder {
            peer: peer.ip().to_canonical(),
            number: self.next,
        };
        self.next = self.next.saturating_add(1);
        usable.then(|| Subscriber {
            stream,
            holder,
            since: Instant::now(),
            sent: 0,
        })
    }

    /// Returns the place of a newcomer, see [`Subscribers`].
    fn place(&mut self, newcomer: IpAddr) -> Option<usize> {
        if let Some(free) = self.subscribers.iter().position(Option::is_none) {
            return Some(free);
        }
        // A write finds those that have gone; a port that is seldom written asks when it needs
        // their places.
        let gone = self.subscribers.iter_mut().position(|place| {
            place
                .as_mut()
                .is_some_and(|subscriber| subscriber.has_gone())
        });
        if gone.is_some() {
            return gone;
        }
        let seated = self.subscribers.iter().flatten();
        let idle = seated
            .clone()
            .filter(|subscriber| subscriber.is_idle())
            .map(|subscriber| subscriber.holder)
            .min_by_key(|holder| holder.number);
        let given =
            idle.or_else(|| gives_way(seated.map(|subscriber| subscriber.holder), newcomer))?;
        self.subscribers.iter().position(|subscriber| {
            subscriber
                .as_ref()
                .is_some_and(|subscriber| subscriber.holder == given)
        })
    }

    fn seat(&mut self, place: usize, mut subscriber: Subscriber, first: &[u8]) {
        if let Some(place) = self.subscribers.get_mut(place) {
            *place = subscriber.takes(first).then_some(subscriber);
        }
    }

    /// Sends bytes to every subscriber.
    pub fn send(&mut self, bytes: &[u8]) {
        for place in &mut self.subscribers {
            if !place
                .as_mut()
                .is_some_and(|subscriber| subscriber.takes(bytes))
            {
                *place = None;
            }
        }
    }
}

/// True if the peer of a stream has closed it. What it has sent is dropped, a part at a time.
fn has_gone(stream: &mut TcpStream) -> bool {
    match stream.read(&mut [0; 1024]) {
        Ok(count) => count == 0,
        Err(error) => !matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PATIENCE: Duration = Duration::from_secs(30);

    fn connect(subscribers: &Subscribers) -> TcpStream {
        let stream = TcpStream::connect(subscribers.address().unwrap()).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    /// Accepts until this is so: the system may hand a connection, or its end, over a little later.
    fn accept_until(
        subscribers: &mut Subscribers,
        what: &str,
        is_so: impl Fn(&Subscribers) -> bool,
    ) {
        let since = Instant::now();
        while !is_so(subscribers) {
            assert!(since.elapsed() < PATIENCE, "{what}: {subscribers:?}");
            subscribers.accept(b"first");
            std::thread::yield_now();
        }
    }

    /// Number of the one that waits.
    fn waiting(subscribers: &Subscribers) -> Option<u64> {
        let waiting = subscribers.waiting.as_ref();
        waiting.map(|waiting| waiting.holder.number)
    }

    #[test]
    fn one_that_waited_and_has_gone_makes_room_for_the_next_that_waits() {
        let mut subscribers = Subscribers::bind(([127, 0, 0, 1], 0).into()).unwrap();
        let mut seated = Vec::new();
        for count in 1..=MAX_SUBSCRIBERS {
            seated.push(connect(&subscribers));
            accept_until(&mut subscribers, "a place", |subscribers| {
                subscribers.subscribers.iter().flatten().count() == count
            });
        }
        let gone = connect(&subscribers);
        accept_until(&mut subscribers, "one waits", |subscribers| {
            subscribers.waiting.is_some()
        });
        let before = waiting(&subscribers);
        drop(gone);
        let mut next = connect(&subscribers);
        accept_until(&mut subscribers, "the next waits", |subscribers| {
            waiting(subscribers).is_some_and(|number| Some(number) != before)
        });
        // A place becomes free, and is that of the one that waits.
        seated.pop();
        accept_until(&mut subscribers, "it is seated", |subscribers| {
            subscribers.waiting.is_none()
        });
        let mut bytes = [0; 5];
        next.read_exact(&mut bytes).unwrap();
        assert_eq!(&bytes, b"first");
    }
}
