//! The port for programs: one is served at a time; what it sends is bounded, and what it does not
//! read is lost.

use std::fmt::Display;
use std::io::{self, ErrorKind, Read, Write};
use std::mem;
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

use gantry_tau_server::links::Allowed;
use serde::Serialize;

use super::line::Refused;

/// Longest line of a program, bytes.
const MAX_LINE: usize = 4_096;
/// Lines that are taken in a tick: a program that sends more is heard later, and costs no deadline.
const LINES_PER_TICK: usize = 16;
/// Bytes that wait for a program that does not read; more are lost, by whole lines.
const WAITING: usize = 65_536;
/// Time in which a program may be found to have left.
const FAREWELL: Duration = Duration::from_millis(100);

/// Port for programs.
#[derive(Debug)]
pub struct Programs {
    /// `None` for a program that is connected already, and the only one.
    listener: Option<TcpListener>,
    allowed: Allowed,
    /// One that came while another was served, and when.
    next: Option<(Program, Instant)>,
}

impl Programs {
    /// Listens for programs of these peers.
    ///
    /// # Errors
    /// The address cannot be bound.
    pub fn bind(address: SocketAddr, allowed: Allowed) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        Ok(Self {
            listener: Some(listener),
            allowed,
            next: None,
        })
    }

    /// Returns one program, and its end of the connection, which no other program can have.
    ///
    /// # Errors
    /// Error of the system.
    pub fn one() -> io::Result<(Self, TcpStream)> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
        let end = TcpStream::connect(listener.local_addr()?)?;
        let own = end.local_addr()?;
        // Another program of this computer may have been quicker.
        let (stream, peer) = loop {
            let (stream, peer) = listener.accept()?;
            if peer == own {
                break (stream, peer);
            }
        };
        let programs = Self {
            listener: None,
            allowed: Allowed::all(),
            next: Some((Program::new(stream, peer)?, Instant::now())),
        };
        Ok((programs, end))
    }

    /// Returns the address on which it listens.
    ///
    /// # Errors
    /// Error of the system, and for [one](Self::one) program, which has no port.
    pub fn address(&self) -> io::Result<SocketAddr> {
        match &self.listener {
            Some(listener) => listener.local_addr(),
            None => Err(ErrorKind::AddrNotAvailable.into()),
        }
    }

    /// True if no program can come.
    pub(super) const fn is_over(&self) -> bool {
        self.listener.is_none() && self.next.is_none()
    }

    /// Returns the next program, if one has connected.
    pub(super) fn accept(&mut self) -> Option<Program> {
        self.next
            .take()
            .map(|(program, _)| program)
            .or_else(|| self.newcomer())
    }

    /// Accepts a connection. Others than the allowed are closed.
    fn newcomer(&self) -> Option<Program> {
        let (stream, peer) = self.listener.as_ref()?.accept().ok()?;
        if !self.allowed.admits(peer.ip()) {
            return None;
        }
        Program::new(stream, peer).ok()
    }

    /// Sends those away that come while another program is served; after a while, for the other may
    /// have left unseen.
    pub(super) fn send_away(&mut self) {
        let Some((_, since)) = &self.next else {
            self.next = self.newcomer().map(|program| (program, Instant::now()));
            return;
        };
        if since.elapsed() < FAREWELL {
            return;
        }
        if let Some((mut program, _)) = self.next.take() {
            program.refuse(&"another program is served");
            program.close();
        }
    }
}

/// Connection of a program.
#[derive(Debug)]
pub(super) struct Program {
    stream: TcpStream,
    peer: SocketAddr,
    /// Lines that were not taken yet.
    received: Vec<u8>,
    /// The rest of a line that was too long is skipped.
    skips: bool,
    has_ended: bool,
    unwritten: Vec<u8>,
}

impl Program {
    fn new(stream: TcpStream, peer: SocketAddr) -> io::Result<Self> {
        stream.set_nonblocking(true)?;
        stream.set_nodelay(true)?;
        Ok(Self {
            stream,
            peer,
            received: Vec::new(),
            skips: false,
            has_ended: false,
            unwritten: Vec::with_capacity(WAITING),
        })
    }

    pub(super) const fn peer(&self) -> SocketAddr {
        self.peer
    }

    /// True if no line can follow.
    pub(super) const fn has_ended(&self) -> bool {
        self.has_ended
    }

    /// Reads what has come, and hands on some lines; an error for one that is too long.
    pub(super) fn lines(&mut self, mut take: impl FnMut(Result<&[u8], String>)) {
        self.receive();
        for _ in 0..LINES_PER_TICK {
            let Some(end) = self.received.iter().position(|byte| *byte == b'\n') else {
                if self.received.len() > MAX_LINE {
                    self.received.clear();
                    if !mem::replace(&mut self.skips, true) {
                        take(Err(too_long()));
                    }
                }
                return;
            };
            let line: Vec<u8> = self.received.drain(..=end).collect();
            if mem::take(&mut self.skips) {
                continue;
            }
            match line.trim_ascii() {
                [] => {}
                line if line.len() > MAX_LINE => take(Err(too_long())),
                line => take(Ok(line)),
            }
        }
    }

    /// Reads once, unless a line or more wait already.
    fn receive(&mut self) {
        if self.received.len() > MAX_LINE {
            return;
        }
        let mut bytes = [0; MAX_LINE];
        match self.stream.read(&mut bytes) {
            Err(error) if is_later(&error) => {}
            Ok(0) | Err(_) => self.has_ended = true,
            Ok(read) => self.received.extend(bytes.iter().take(read)),
        }
    }

    /// Queues a line for [`Self::flush`], or loses it if the program does not read.
    pub(super) fn send(&mut self, line: &impl Serialize) {
        let Ok(text) = serde_json::to_vec(line) else {
            return;
        };
        if self.unwritten.len() + text.len() < WAITING {
            self.unwritten.extend_from_slice(&text);
            self.unwritten.push(b'\n');
        }
    }

    /// Says why a line, or the program, is not served.
    pub(super) fn refuse(&mut self, error: &impl Display) {
        self.send(&Refused {
            error: &error.to_string(),
        });
    }

    /// Writes what the program takes now.
    pub(super) fn flush(&mut self) {
        while !self.unwritten.is_empty() {
            match self.stream.write(&self.unwritten) {
                Ok(0) => break,
                Ok(written) => drop(self.unwritten.drain(..written)),
                Err(error) if is_later(&error) => break,
                Err(_) => {
                    self.has_ended = true;
                    self.unwritten.clear();
                }
            }
        }
    }

    /// Closes the connection behind the last line, which the program may still read. Never blocks.
    pub(super) fn close(mut self) {
        self.flush();
        // With unread bytes the system would reset the connection, and lose that line.
        self.receive();
        let _ = self.stream.shutdown(Shutdown::Write);
    }
}

fn too_long() -> String {
    format!("a line of more than {MAX_LINE} bytes")
}

fn is_later(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A program, and its connection as it is served.
    fn connected() -> (TcpStream, Program) {
        let mut port = Programs::bind("127.0.0.1:0".parse().unwrap(), Allowed::all()).unwrap();
        let stream = TcpStream::connect(port.address().unwrap()).unwrap();
        let program = loop {
            if let Some(program) = port.accept() {
                break program;
            }
        };
        (stream, program)
    }

    /// Lines of the next ticks, until there are so many, and the most of one tick.
    fn heard(program: &mut Program, count: usize) -> (Vec<Result<String, String>>, usize) {
        let (mut all, mut most) = (Vec::new(), 0);
        while all.len() < count {
            let before = all.len();
            program.lines(|line| {
                all.push(line.map(|line| String::from_utf8_lossy(line).into_owned()));
            });
            most = most.max(all.len() - before);
        }
        (all, most)
    }

    #[test]
    fn a_flood_is_heard_some_lines_at_a_time_and_in_order() {
        let (mut stream, mut program) = connected();
        let text: String = (0..500).map(|number| format!("{number}\n")).collect();
        stream.write_all(text.as_bytes()).unwrap();
        let (lines, most) = heard(&mut program, 500);
        let numbers: Vec<_> = (0..500).map(|number| Ok(number.to_string())).collect();
        assert_eq!(lines, numbers);
        assert!(most <= LINES_PER_TICK, "{most}");
    }

    #[test]
    fn a_line_that_is_too_long_is_one_error() {
        let (mut stream, mut program) = connected();
        let mut send = |text: &str| stream.write_all(text.as_bytes()).unwrap();
        send(&"x".repeat(MAX_LINE + 1));
        send("\n");
        send(&"x".repeat(10 * MAX_LINE));
        send("\nhalf");
        send(" a line \n\n\nnext\n");
        let (lines, _) = heard(&mut program, 4);
        let error = Err(too_long());
        let [half, next] = ["half a line", "next"].map(|line| Ok(line.to_owned()));
        assert_eq!(lines, [error.clone(), error, half, next]);
        assert!(!program.has_ended());
    }
}
