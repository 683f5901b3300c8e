//! Outputs that fail: every command that runs for long, with each of its standard streams closed,
//! full, blocked, without a reader, or a terminal that is gone; and disks that are full. The ramp,
//! the session and the exit code are those of an undisturbed run.

mod disks;
mod signals;
mod storms;
mod streams;

use std::fs::File;
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::os::fd::OwnedFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, Instant};

use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

use crate::process::{BINARY, Folder, Running, Streams, command, relay_paced};
use crate::signals::{Recorded, rows};

/// Longest wait for anything.
const DEADLINE: Duration = Duration::from_secs(180);
/// `O_NOCTTY`.
const NO_CONTROLLING_TERMINAL: i32 = 0o400;
/// Offset, nm, from which a ramp to zero takes a while.
const SOME_NM: i64 = 10_000;

/// A folder, and addresses that are not used elsewhere: a command whose output fails cannot say
/// which port it has taken.
struct Bench {
    folder: Folder,
    ip: Ipv4Addr,
}

impl Bench {
    fn new(name: &str) -> Self {
        static COUNT: AtomicU8 = AtomicU8::new(1);
        let [_, _, a, b] = std::process::id().to_be_bytes();
        let ip = Ipv4Addr::new(
            127,
            COUNT.fetch_add(1, Ordering::Relaxed).max(1),
            a,
            b.max(1),
        );
        Self {
            folder: Folder::new(name),
            ip,
        }
    }

    fn at(&self, port: u16) -> String {
        format!("{}:{port}", self.ip)
    }

    /// Starts a server in lock-step that records and pulls.
    fn serve(
        &self,
        program: &mut std::process::Command,
        streams: Streams,
        further: &[&str],
    ) -> Running {
        self.serve_to(
            program,
            streams,
            &[&["--record", "serve.csv"], further].concat(),
        )
    }

    /// The same without a recording.
    fn serve_to(
        &self,
        program: &mut std::process::Command,
        streams: Streams,
        further: &[&str],
    ) -> Running {
        let (listen, labcomm) = (self.at(7000), self.at(7003));
        let ports = format!("{labcomm}=state,axes,tool,session_event,drives,machine");
        let mut arguments = vec!["serve", "--pace", "lockstep", "--listen", &listen];
        arguments.extend([
            "--force-max",
            "120",
            "--step-seconds",
            "1",
            "--labcomm",
            &ports,
        ]);
        arguments.extend(further);
        let server = self.folder.start_by(program, "serve", &arguments, streams);
        self.await_port(7000);
        server
    }

    fn healthy_serve(&self) -> Running {
        self.serve(&mut binary(), Streams::default(), &[])
    }

    fn client(&self, program: &mut std::process::Command, streams: Streams) -> Running {
        let server = self.at(7000);
        self.folder
            .start_by(program, "client", &["client", &server], streams)
    }

    /// The client of a server that a monitor reads, some hundred ticks per second: as fast as it
    /// can, lock-step is too fast for a monitor.
    fn paced_client(&self) -> Running {
        relay_paced(TcpListener::bind((self.ip, 7010)).unwrap(), self.at(7000));
        let relay = self.at(7010);
        self.folder.start("client", &["client", &relay])
    }

    /// Waits until a port is listened on.
    fn await_port(&self, port: u16) {
        self.await_that("a port", || TcpStream::connect((self.ip, port)).is_ok());
    }

    /// Waits until a recording grows.
    fn await_growth(&self, file: &str) {
        let path = self.folder.path(file);
        let before = size_of(&path);
        self.await_that("rows of a monitor", || size_of(&path) > before);
    }

    fn await_that(&self, what: &str, mut done: impl FnMut() -> bool) {
        let since = Instant::now();
        while !done() {
            assert!(since.elapsed() < DEADLINE, "{what}: {}", self.said());
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Everything that was said on files.
    fn said(&self) -> String {
        let mut said = String::new();
        for entry in std::fs::read_dir(self.folder.path(".")).unwrap().flatten() {
            let path = entry.path();
            if path
                .extension()
                .is_some_and(|end| end == "out" || end == "err")
            {
                said += &format!(
                    "\n{}:\n{}",
                    path.display(),
                    std::fs::read_to_string(&path).unwrap_or_default()
                );
            }
        }
        said
    }

    /// Waits until an offset is in force in the server's recording, and returns the number of its
    /// rows.
    fn await_an_offset(&self) -> usize {
        let mut count = 0;
        self.await_that("an offset in force", || {
            let rows = self.rows();
            count = rows.len();
            rows.iter().any(|row| {
                row.state == "Obtain" && row.offsets_nm.iter().any(|nm| nm.abs() > SOME_NM)
            })
        });
        count
    }

    /// Waits until the session has gone on for some more rows in Obtain.
    fn await_more(&self, from: usize) {
        self.await_that("a session that goes on", || {
            self.rows()
                .iter()
                .skip(from)
                .filter(|row| row.state == "Obtain")
                .count()
                > 300
        });
    }

    /// True if `monitor --status` shows that the server has lost rows.
    fn has_lost_rows(&self) -> bool {
        let line = self
            .folder
            .run(&["monitor", &self.at(7003), "--status"])
            .stdout;
        let line: serde_json::Value = serde_json::from_str(&line).unwrap();
        line["rows_lost"].as_bool().unwrap()
    }

    fn rows(&self) -> Vec<Recorded> {
        if self.folder.path("serve.csv").exists() {
            rows(&self.folder)
        } else {
            Vec::new()
        }
    }

    /// Checks that the recording ends at zero, and that no offset has jumped on the way.
    fn assert_ramped(&self) {
        let rows = self.rows();
        crate::signals::assert_no_jump(&rows);
        assert_eq!(rows.last().unwrap().offsets_nm, [0; 3], "{}", self.said());
        let last = rows.iter().rposition(|row| row.state == "Obtain").unwrap();
        let left = rows[last]
            .offsets_nm
            .iter()
            .map(|nm| nm.unsigned_abs())
            .max()
            .unwrap();
        let zero = rows[last..]
            .iter()
            .find(|row| row.offsets_nm == [0; 3])
            .unwrap();
        assert_eq!(
            u64::try_from(zero.tick - rows[last].tick).unwrap(),
            left.div_ceil(100)
        );
    }
}

/// Size of a file, bytes; 0 if it is not there.
fn size_of(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |file| file.len())
}

/// Lines of a file; 0 if it is not there.
fn lines_of(path: &Path) -> usize {
    std::fs::read_to_string(path).map_or(0, |text| text.lines().count())
}

fn binary() -> std::process::Command {
    command(BINARY)
}

/// A shell that becomes the binary, after these words: limits, or redirections behind `exec`.
fn shell(before: &str, behind: &str) -> std::process::Command {
    let mut shell = command("sh");
    shell.args([
        "-c",
        &format!("{before} exec \"$0\" \"$@\" {behind}"),
        BINARY,
    ]);
    shell
}

/// A terminal: the end of its user, and that of programs.
pub(crate) fn terminal() -> (OwnedFd, OwnedFd) {
    // Other tests start programs meanwhile, which must not inherit it.
    let user = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&user).unwrap();
    unlockpt(&user).unwrap();
    let name = ptsname(&user, Vec::new()).unwrap().into_string().unwrap();
    let program = File::options()
        .read(true)
        .write(true)
        .custom_flags(NO_CONTROLLING_TERMINAL)
        .open(name)
        .unwrap();
    (user, program.into())
}

/// Waits for the end of a command; returns its exit code.
fn code(running: Running) -> Option<i32> {
    running.end().code
}
