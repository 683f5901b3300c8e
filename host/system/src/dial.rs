//! Connecting to a peer: each address of its name in turn, within one deadline, and not a moment
//! longer than is wanted.

use std::fmt;
use std::io::{self, ErrorKind};
use std::net::{SocketAddr, TcpStream, ToSocketAddrs};
use std::str::FromStr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};

/// Time between two looks at the switch that ends a wait.
pub const LOOK: Duration = Duration::from_millis(100);
/// Switch of a wait that nothing ends early.
pub static NEVER: AtomicBool = AtomicBool::new(false);

/// Addresses of a peer, at least one; IPv4 first, on which the server listens by default.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Addresses {
    first: SocketAddr,
    others: Vec<SocketAddr>,
}

impl Addresses {
    /// Returns the addresses, in the order in which they are tried.
    pub fn iter(&self) -> impl Iterator<Item = SocketAddr> {
        std::iter::once(self.first).chain(self.others.iter().copied())
    }

    /// Returns the address that is tried first.
    #[must_use]
    pub const fn first(&self) -> SocketAddr {
        self.first
    }

    /// A name with these addresses.
    #[must_use]
    pub fn of(first: SocketAddr, others: &[SocketAddr]) -> Self {
        Self {
            first,
            others: others.to_vec(),
        }
    }

    /// Makes the first address the last one.
    pub fn rotate(&mut self) {
        if let Some(next) = self.others.first_mut() {
            std::mem::swap(next, &mut self.first);
            self.others.rotate_left(1);
        }
    }
}

impl From<SocketAddr> for Addresses {
    fn from(first: SocketAddr) -> Self {
        Self {
            first,
            others: Vec::new(),
        }
    }
}

/// Reason why a text gives no address.
#[derive(Debug, thiserror::Error)]
pub enum AddressError {
    /// The system cannot resolve it.
    #[error(transparent)]
    Resolve(#[from] io::Error),
    /// The host has no address.
    #[error("unknown host")]
    UnknownHost,
}

/// Resolves `HOST:PORT`.
impl FromStr for Addresses {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let mut all: Vec<SocketAddr> = text.to_socket_addrs()?.collect();
        all.sort_by_key(SocketAddr::is_ipv6);
        let mut all = all.into_iter();
        let first = all.next().ok_or(AddressError::UnknownHost)?;
        Ok(Self {
            first,
            others: all.filter(|other| *other != first).collect(),
        })
    }
}

impl fmt::Display for Addresses {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.first.fmt(f)?;
        self.others
            .iter()
            .try_for_each(|other| write!(f, " or {other}"))
    }
}

/// Connects to the first address that takes the connection.
///
/// # Errors
/// [`ErrorKind::Interrupted`]: `quit` was set. [`ErrorKind::TimedOut`]: no answer within
/// `patience`. Others: that of the first address.
pub fn connect(to: &Addresses, patience: Duration, quit: &AtomicBool) -> io::Result<TcpStream> {
    let until = Instant::now() + patience;
    let (answer, answered) = mpsc::channel();
    let tried = to.clone();
    // The system's connect cannot be interrupted: a thread of its own waits for it, and is left
    // behind if the wait ends.
    std::thread::Builder::new()
        .name("connect".to_owned())
        .spawn(move || answer.send(connect_to_one(&tried, until)))?;
    loop {
        match answered.recv_timeout(LOOK) {
            Ok(outcome) => return outcome,
            Err(RecvTimeoutError::Timeout) if quit.load(Ordering::Relaxed) => {
                return Err(ErrorKind::Interrupted.into());
            }
            Err(RecvTimeoutError::Timeout) if Instant::now() < until + LOOK => {}
            Err(_) => return Err(ErrorKind::TimedOut.into()),
        }
    }
}

/// Tries each address for its share of the time that is left, so that one that is silent leaves
/// time for the others.
fn connect_to_one(to: &Addresses, until: Instant) -> io::Result<TcpStream> {
    let mut first_failure = None;
    let mut left = u32::try_from(to.iter().count()).unwrap_or(u32::MAX);
    for address in to.iter() {
        let share = until
            .saturating_duration_since(Instant::now())
            .checked_div(left)
            .unwrap_or_default();
        left = left.saturating_sub(1);
        if share.is_zero() {
            break;
        }
        match TcpStream::connect_timeout(&address, share) {
            Ok(stream) => return Ok(stream),
            Err(error) => first_failure = first_failure.or(Some(error)),
        }
    }
    Err(first_failure.unwrap_or_else(|| ErrorKind::TimedOut.into()))
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    /// A port of this machine on which nothing listens.
    fn closed_port() -> SocketAddr {
        TcpListener::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap()
    }

    /// Found from outside: a client of `localhost` tried one of its addresses only.
    #[test]
    fn every_address_of_a_name_is_tried() {
        let server = TcpListener::bind("127.0.0.1:0").unwrap();
        let open = server.local_addr().unwrap();
        let to = Addresses::of(closed_port(), &[closed_port(), open]);
        let stream = connect(&to, Duration::from_secs(60), &NEVER).unwrap();
        assert_eq!(stream.peer_addr().unwrap(), open);
        let none = Addresses::of(closed_port(), &[closed_port()]);
        let error = connect(&none, Duration::from_secs(60), &NEVER).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::ConnectionRefused);
    }

    /// A full queue of connections answers no further one (on Linux; elsewhere it may refuse).
    #[cfg(target_os = "linux")]
    #[test]
    fn a_wait_for_an_address_ends_with_the_switch() {
        let server =
            socket2::Socket::new(socket2::Domain::IPV4, socket2::Type::STREAM, None).unwrap();
        server
            .bind(&SocketAddr::from(([127, 0, 0, 1], 0)).into())
            .unwrap();
        server.listen(0).unwrap();
        let full = server.local_addr().unwrap().as_socket().unwrap();
        let mut queued = Vec::new();
        while let Ok(stream) = TcpStream::connect_timeout(&full, Duration::from_millis(200)) {
            queued.push(stream);
        }
        let quit = AtomicBool::new(true);
        let error =
            connect(&Addresses::of(full, &[]), Duration::from_secs(3_600), &quit).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Interrupted, "{error}");
    }

    #[test]
    fn ipv4_is_tried_first_and_each_address_has_its_turn() {
        let all: Addresses = "localhost:7000".parse().unwrap();
        assert_eq!(all.first(), "127.0.0.1:7000".parse().unwrap());
        let [one, two, three] = [1, 2, 3].map(|port| SocketAddr::from(([127, 0, 0, 1], port)));
        let mut some = Addresses::of(one, &[two, three]);
        let mut turns = Vec::new();
        for _ in 0..4 {
            turns.push(some.first());
            some.rotate();
        }
        assert_eq!(turns, [one, two, three, one]);
        assert_eq!(
            Addresses::of(one, &[two]).to_string(),
            "127.0.0.1:1 or 127.0.0.1:2"
        );
        assert!("nowhere.invalid:7000".parse::<Addresses>().is_err());
        assert!("127.0.0.1".parse::<Addresses>().is_err());
    }
}
