//! The port for programs: one is served at a time; what it sends is bounded, and what it does not
//! read is lost.

use std::fmt::Display;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

use gantry_tau_server::links::Allowed;
use serde::Serialize;

use super::line::Refused;

/// Longest line of a program, bytes.
const LONGEST: usize = 4_096;
/// Bytes that are read in a tick: a program that sends more is heard later.
const BYTES_PER_TICK: usize = 8_192;
/// Bytes that wait for a program that does not read; more are lost, by whole lines.
const WAITING: usize = 65_536;
/// Time for the last lines, and in which a program may be found to have left.
const FAREWELL: Duration = Duration::from_millis(100);

/// Port for programs.
#[derive(Debug)]
pub struct Programs {
    listener: TcpListener,
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
            listener,
            allowed,
            next: None,
        })
    }

    /// Returns the address on which it listens.
    ///
    /// # Errors
    /// Error of the system.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
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
        let (stream, peer) = self.listener.accept().ok()?;
        let admitted = self.allowed.admits(peer.ip());
        let usable = stream.set_nonblocking(true).and(stream.set_nodelay(true));
        (admitted && usable.is_ok()).then(|| Program {
            stream,
            peer,
            read: Vec::with_capacity(LONGEST),
            skips: false,
            has_ended: false,
            unwritten: Vec::with_capacity(WAITING),
        })
    }

    /// Sends those away that come while another program is served; after a while, for the other may
    /// have left, and nobody has seen it yet.
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
    /// Beginning of a line.
    read: Vec<u8>,
    /// The rest of a line that was too long is skipped.
    skips: bool,
    has_ended: bool,
    unwritten: Vec<u8>,
}

impl Program {
    pub(super) const fn peer(&self) -> SocketAddr {
        self.peer
    }

    /// True if no line can follow.
    pub(super) const fn has_ended(&self) -> bool {
        self.has_ended
    }

    /// Reads what has come, and hands on every line; an error for one that is too long.
    pub(super) fn lines(&mut self, mut take: impl FnMut(Result<&[u8], &str>)) {
        let mut bytes = [0; BYTES_PER_TICK];
        let read = match self.stream.read(&mut bytes) {
            Ok(0) => {
                self.has_ended = true;
                return;
            }
            Ok(read) => read,
            Err(error) if is_later(&error) => return,
            Err(_) => {
                self.has_ended = true;
                return;
            }
        };
        for byte in bytes.iter().take(read) {
            if *byte != b'\n' {
                if self.read.len() < LONGEST {
                    self.read.push(*byte);
                } else if !self.skips {
                    self.skips = true;
                    take(Err("a line of more than 4096 bytes"));
                }
                continue;
            }
            if !self.skips && !self.read.trim_ascii().is_empty() {
                take(Ok(&self.read));
            }
            self.skips = false;
            self.read.clear();
        }
    }

    /// Sends a line, or loses it if the program does not read.
    pub(super) fn send(&mut self, line: &impl Serialize) {
        let Ok(text) = serde_json::to_vec(line) else {
            return;
        };
        if self.unwritten.len() + text.len() < WAITING {
            self.unwritten.extend_from_slice(&text);
            self.unwritten.push(b'\n');
        }
        self.flush();
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

    /// Closes the connection behind the last line, which the program may still read.
    pub(super) fn close(mut self) {
        let blocking = self.stream.set_nonblocking(false);
        let patient = self.stream.set_write_timeout(Some(FAREWELL));
        if blocking.and(patient).is_ok() {
            let _ = self.stream.write_all(&self.unwritten);
        }
        let _ = self.stream.shutdown(Shutdown::Write);
    }
}

fn is_later(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}
