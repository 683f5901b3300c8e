//! Readers of a TCP port: each gets the same bytes, and what it sends is dropped.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

use socket2::SockRef;

use crate::places::{Holder, gives_way};
use crate::server::connections::Allowed;

/// Readers served at once.
pub const READERS: usize = 4;
/// Bytes that the system keeps for a reader: less than a second of all samples, so that one that has stopped reading is dropped soon
/// instead of being sent old ticks later.
const SEND_BUFFER: usize = 128 * 1024;
/// Bytes within which a reader that reads nothing is not told from one that does: the buffers of both systems take them.
const UNPROVEN: u64 = 64 * 1024;
/// Time after which a reader that was sent no more than [`UNPROVEN`] bytes is idle.
const IDLE: Duration = Duration::from_secs(10);

/// A port and its readers. Serving them allocates nothing and never blocks; a reader that cannot keep up is dropped.
///
/// When all places are taken, a newcomer waits, and gets the first of these: the place of one that has gone; that of the one that came first
/// of those that are idle; that of the youngest of an address that has two more than the newcomer's own. One waits at a time; others that
/// have no claim to a place meanwhile are closed.
#[derive(Debug)]
pub struct Readers {
    listener: TcpListener,
    allowed: Allowed,
    send_buffer: usize,
    readers: [Option<Reader>; READERS],
    waiting: Option<Reader>,
    /// Number of the next connection.
    next: u64,
}

/// One reader.
#[derive(Debug)]
struct Reader {
    stream: TcpStream,
    holder: Holder,
    since: Instant,
    /// Bytes that were sent to it.
    sent: u64,
}

impl Reader {
    /// True if it may be one that reads nothing, and has been here for long.
    fn is_idle(&self) -> bool {
        self.sent < UNPROVEN && self.since.elapsed() >= IDLE
    }

    /// True if it has taken all the bytes at once.
    fn takes(&mut self, bytes: &[u8]) -> bool {
        self.sent = self.sent.saturating_add(u64::try_from(bytes.len()).unwrap_or(u64::MAX));
        bytes.is_empty() || matches!(self.stream.write(bytes), Ok(count) if count == bytes.len())
    }

    fn has_gone(&mut self) -> bool {
        has_gone(&mut self.stream)
    }
}

impl Readers {
    /// Listens for readers.
    ///
    /// # Errors
    /// The address cannot be bound.
    pub fn bind(address: SocketAddr) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        let allowed = Allowed::all();
        let readers = [const { None }; READERS];
        Ok(Self { listener, allowed, send_buffer: SEND_BUFFER, readers, waiting: None, next: 0 })
    }

    /// Serves only these peers.
    #[must_use]
    pub fn for_peers(self, allowed: Allowed) -> Self {
        Self { allowed, ..self }
    }

    /// Has the system keep no more than this for a reader, bytes.
    #[must_use]
    pub(crate) fn with_send_buffer(self, send_buffer: usize) -> Self {
        Self { send_buffer, ..self }
    }

    /// Returns the address on which it listens.
    ///
    /// # Errors
    /// Error of the system.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Accepts at most one new reader, or the one that waits, and sends it `first`.
    pub fn accept(&mut self, first: &[u8]) {
        if let Some(waiting) = self.waiting.take().and_then(|mut reader| (!reader.has_gone()).then_some(reader)) {
            match self.place(waiting.holder.peer) {
                Some(place) => return self.seat(place, waiting, first),
                None => self.waiting = Some(waiting),
            }
        }
        let Some(newcomer) = self.newcomer() else { return };
        match self.place(newcomer.holder.peer) {
            Some(place) => self.seat(place, newcomer, first),
            None if self.waiting.is_none() => self.waiting = Some(newcomer),
            // Closed: behind one that waits it would hide others, of another address.
            None => {}
        }
    }

    /// Accepts a connection that may be served.
    fn newcomer(&mut self) -> Option<Reader> {
        let (stream, peer) = self.listener.accept().ok()?;
        let usable = self.allowed.admits(peer.ip())
            && stream.set_nonblocking(true).is_ok()
            && stream.set_nodelay(true).is_ok()
            && SockRef::from(&stream).set_send_buffer_size(self.send_buffer).is_ok();
        let holder = Holder { peer: peer.ip().to_canonical(), number: self.next };
        self.next = self.next.saturating_add(1);
        usable.then(|| Reader { stream, holder, since: Instant::now(), sent: 0 })
    }

    /// Returns the place of a newcomer, see [`Readers`].
    fn place(&mut self, newcomer: IpAddr) -> Option<usize> {
        if let Some(free) = self.readers.iter().position(Option::is_none) {
            return Some(free);
        }
        // A write finds those that have gone; a port that is seldom written asks when it needs their places.
        let is_gone = |reader: &mut Option<Reader>| reader.as_mut().is_some_and(Reader::has_gone);
        if let Some(gone) = self.readers.iter_mut().position(is_gone) {
            return Some(gone);
        }
        let seated = || self.readers.iter().flatten();
        let idle = seated().filter(|reader| reader.is_idle()).map(|reader| reader.holder);
        let idle = idle.min_by_key(|holder| holder.number);
        let given = idle.or_else(|| gives_way(seated().map(|reader| reader.holder), newcomer))?;
        self.readers.iter().position(|reader| reader.as_ref().is_some_and(|reader| reader.holder == given))
    }

    fn seat(&mut self, place: usize, mut reader: Reader, first: &[u8]) {
        if let Some(place) = self.readers.get_mut(place) {
            *place = reader.takes(first).then_some(reader);
        }
    }

    /// Sends bytes to every reader.
    pub fn send(&mut self, bytes: &[u8]) {
        for place in &mut self.readers {
            if !place.as_mut().is_some_and(|reader| reader.takes(bytes)) {
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

    fn connect(readers: &Readers) -> TcpStream {
        let stream = TcpStream::connect(readers.address().unwrap()).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    /// Accepts until this is so: the system may hand a connection, or its end, over a little later.
    fn accept_until(readers: &mut Readers, what: &str, is_so: impl Fn(&Readers) -> bool) {
        let since = Instant::now();
        while !is_so(readers) {
            assert!(since.elapsed() < PATIENCE, "{what}: {readers:?}");
            readers.accept(b"first");
            std::thread::yield_now();
        }
    }

    #[test]
    fn one_that_waited_and_has_gone_makes_room_for_the_next_that_waits() {
        let mut readers = Readers::bind(([127, 0, 0, 1], 0).into()).unwrap();
        let mut seated = Vec::new();
        for count in 1..=READERS {
            seated.push(connect(&readers));
            accept_until(&mut readers, "a place", |readers| readers.readers.iter().flatten().count() == count);
        }
        let gone = connect(&readers);
        accept_until(&mut readers, "one waits", |readers| readers.waiting.is_some());
        let number = |readers: &Readers| readers.waiting.as_ref().map(|waiting| waiting.holder.number);
        let before = number(&readers);
        drop(gone);
        let mut next = connect(&readers);
        accept_until(&mut readers, "the next waits", |readers| number(readers).is_some() && number(readers) != before);
        // A place becomes free, and is that of the one that waits.
        seated.pop();
        accept_until(&mut readers, "it is seated", |readers| readers.waiting.is_none());
        let mut bytes = [0; 5];
        next.read_exact(&mut bytes).unwrap();
        assert_eq!(&bytes, b"first");
    }
}
