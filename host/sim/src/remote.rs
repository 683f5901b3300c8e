//! A machine in another process, behind a socket: any simulator, in any language. The server asks, one
//! JSON line per call of [`Plant`]; the other side answers each with one line. docs/simulators.md
//! has the lines.
//!
//! Calls wait for their answers, so a server of such a machine goes in lock-step only.
//!
//! A simulator that answers late, twice, with something else or not at all is a machine that cannot be
//! read: its connection is closed, and every call fails with that reason until
//! [`reset`](Plant::reset) connects again and the drives are read back. One that answers that a call
//! failed keeps its connection.

mod line;

use std::io::{self, BufRead, BufReader, Write};
use std::net::TcpStream;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use gantry_tau_core::control::axis::{InForce, Reference};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{CYCLE_US, RobotFile, RobotFileError};
use gantry_tau_server::plant::{DriveState, Plant, Reading};
use gantry_tau_system::dial::{self, Addresses};
use gantry_tau_system::lines::plain;

use line::{Answer, Call, MachineDescription};

/// Time for the connection, and for an answer.
pub const PATIENCE: Duration = Duration::from_secs(1);
/// Time for the answer to `start`: a simulator may load its model first.
pub const START_PATIENCE: Duration = Duration::from_secs(30);

/// A machine in another process.
#[derive(Debug)]
pub struct RemoteMachine<const N: usize, const M: usize> {
    address: Addresses,
    start: MachineDescription,
    link: Result<Link, String>,
    /// Number of the last call.
    calls: u64,
    drives: Option<[DriveState; N]>,
}

/// Failure of a call to a [`RemoteMachine`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the machine at {address} could not {operation}: {reason}")]
pub struct RemoteError {
    /// Address of the machine.
    pub address: String,
    /// The failed operation: "be read", say.
    pub operation: &'static str,
    /// The reason.
    pub reason: String,
}

/// Reason why a [`RemoteMachine`] is not there.
#[derive(Debug, thiserror::Error)]
pub enum ConnectError {
    /// Nothing listens at its address.
    #[error(transparent)]
    Unreachable(#[from] RemoteError),
    /// The robot file has no such machine.
    #[error(transparent)]
    Robot(#[from] RobotFileError),
}

/// Connection to a simulator that has answered everything so far.
#[derive(Debug)]
struct Link {
    stream: BufReader<TcpStream>,
    line: Vec<u8>,
}

impl<const N: usize, const M: usize> RemoteMachine<N, M> {
    /// Connects to a simulator of the machine of a robot file.
    ///
    /// # Errors
    /// Nothing listens there, the wait was ended by `quit`, or the file has no home or motors.
    pub fn connect<K: MachineKind<N>>(
        address: Addresses,
        robot: &RobotFile<K, N>,
        quit: &AtomicBool,
    ) -> Result<Self, ConnectError> {
        let motors = robot.motor_map::<M>()?;
        let home_q = robot.home_q()?;
        let start = MachineDescription {
            model: K::MODEL,
            axes: N,
            motors: M,
            axis_of_motor: motors.axis_of_motor().to_vec(),
            cycle_us: CYCLE_US,
            home_mm: (home_q.iter().zip(&robot.metres_per_q))
                .map(|(place, metres)| place * metres * 1e3)
                .collect(),
        };
        let mut machine = Self {
            address,
            start,
            link: Err("it was never reached".to_owned()),
            calls: 0,
            drives: None,
        };
        machine.open(quit)?;
        Ok(machine)
    }

    /// Connects, and tells the simulator what it starts as.
    fn open(&mut self, quit: &AtomicBool) -> Result<(), RemoteError> {
        match Link::open(&self.address, quit) {
            Ok(link) => self.link = Ok(link),
            Err(error) => {
                let reason = plain(&error);
                self.link = Err(reason.clone());
                return Err(failed(&self.address, "be reached", reason));
            }
        }
        self.call(&Call::Start(self.start.clone()), line::nothing)
    }

    /// Makes a call, and reads its answer; one that cannot be used closes the connection.
    fn call<T>(
        &mut self,
        call: &Call,
        read: impl FnOnce(line::Fields) -> Result<T, String>,
    ) -> Result<T, RemoteError> {
        self.calls += 1;
        let answered = match &mut self.link {
            Ok(link) => link.ask(self.calls, call),
            Err(reason) => Err(reason.clone()),
        };
        let used = answered.and_then(|answer| match answer {
            Answer::Done(fields) => read(fields)
                .map(Ok)
                .map_err(|reason| format!("its answer: {reason}")),
            Answer::Failed(reason) => Ok(Err(reason)),
        });
        let outcome = used.unwrap_or_else(|reason| {
            self.link = Err(reason.clone());
            Err(reason)
        });
        outcome.map_err(|reason| failed(&self.address, call.operation(), reason))
    }
}

fn failed(address: &Addresses, operation: &'static str, reason: String) -> RemoteError {
    RemoteError {
        address: address.to_string(),
        operation,
        reason,
    }
}

impl<const N: usize, const M: usize> Plant<N, M> for RemoteMachine<N, M> {
    type Error = RemoteError;

    fn in_force(&mut self) -> Result<[InForce; N], RemoteError> {
        self.call(&Call::InForce, line::in_force)
    }

    fn read(&mut self, elapsed: u64) -> Result<Reading<N>, RemoteError> {
        let (reading, drives) = self.call(&Call::Read { elapsed }, line::reading)?;
        self.drives = drives;
        Ok(reading)
    }

    fn write(
        &mut self,
        references: &[Reference; M],
        parts: &[InForce; N],
    ) -> Result<(), RemoteError> {
        self.call(&Call::write(references, parts), line::nothing)
    }

    fn drives(&self) -> Option<[DriveState; N]> {
        self.drives
    }

    /// Connects again if the connection was closed, and otherwise hands the reset on.
    fn reset(&mut self) {
        // A failure is told by the next `read`.
        let _ = if self.link.is_ok() {
            self.call(&Call::Reset, line::nothing)
        } else {
            self.open(&dial::NEVER)
        };
    }
}

impl Link {
    fn open(address: &Addresses, quit: &AtomicBool) -> io::Result<Self> {
        let stream = dial::connect(address, PATIENCE, quit)?;
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(PATIENCE))?;
        Ok(Self {
            stream: BufReader::new(stream),
            line: Vec::new(),
        })
    }

    /// Sends a call and returns its answer, or what is wrong with it.
    fn ask(&mut self, number: u64, call: &Call) -> Result<Answer, String> {
        if !self.stream.buffer().is_empty() {
            return Err("it has answered twice".to_owned());
        }
        let mut question = line::question(number, call)?;
        question.push(b'\n');
        let sent = self.stream.get_mut().write_all(&question);
        sent.map_err(|error| plain(&error))?;
        let patience = match call {
            Call::Start(_) => START_PATIENCE,
            _ => PATIENCE,
        };
        self.receive(Instant::now() + patience)?;
        line::answer(&self.line, number)
    }

    /// Reads a line until a time, however slowly its bytes come.
    fn receive(&mut self, until: Instant) -> Result<(), String> {
        self.line.clear();
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err("it has not answered in time".to_owned());
            }
            let limited = self.stream.get_ref().set_read_timeout(Some(left));
            limited.map_err(|error| plain(&error))?;
            let bytes = match self.stream.fill_buf() {
                Ok([]) => return Err("it has closed the connection".to_owned()),
                Ok(bytes) => bytes,
                Err(error) if is_wait(&error) => continue,
                Err(error) => return Err(plain(&error)),
            };
            let end = bytes.iter().position(|byte| *byte == b'\n');
            let taken = end.map_or(bytes.len(), |end| end + 1);
            self.line.extend(bytes.iter().take(taken));
            self.stream.consume(taken);
            if self.line.len() > line::MAX_ANSWER {
                return Err(format!(
                    "its answer has more than {} bytes",
                    line::MAX_ANSWER
                ));
            }
            if end.is_some() {
                return Ok(());
            }
        }
    }
}

fn is_wait(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), Interrupted | TimedOut | WouldBlock)
}
