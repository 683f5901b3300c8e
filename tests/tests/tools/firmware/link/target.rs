//! The emulator with the firmware: its port, its log, its exit code.

use std::io::{BufRead, BufReader};
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::thread::JoinHandle;

use super::PATIENCE;
use super::journal::Journal;
use crate::firmware::emulator::Build;
use crate::firmware::process::Process;

/// Ports tried until one is free for the emulator as well.
const TRIES: u32 = 5;

/// A running emulator, killed when the test ends before it.
pub(super) struct Target {
    /// Address of its port 7000 on this machine.
    pub(super) address: SocketAddr,
    emulator: Process,
    /// Turns its log into lines; ends with it.
    _decoder: Process,
    log: Arc<Journal<String>>,
    reader: Option<JoinHandle<()>>,
}

impl Target {
    /// Starts an image for `sessions` sessions, and waits until it listens.
    pub(super) fn serve(build: Build, image: &Path, sessions: u32) -> Self {
        for _ in 0..TRIES {
            // Until the emulator binds it, another program may take the port.
            let free = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
            let address = free.local_addr().unwrap();
            drop(free);
            let target = Self::start(build, image, sessions, address);
            if target.await_line("listening=7000").is_some() {
                return target;
            }
            let said = target.words();
            assert!(said.is_empty(), "the firmware does not listen:\n{said}");
        }
        panic!("the emulator gets no port");
    }

    fn start(build: Build, image: &Path, sessions: u32, address: SocketAddr) -> Self {
        let mut emulator = Process::start(
            Command::new("qemu-system-arm")
                .args([
                    "-machine",
                    build.machine(),
                    "-display",
                    "none",
                    "-monitor",
                    "none",
                    "-serial",
                    "none",
                ])
                .arg("-semihosting-config")
                .arg(format!("enable=on,target=native,arg=link,arg={sessions}"))
                .arg("-nic")
                // The guest can be reached, and reaches no other machine.
                .arg(format!(
                    "user,restrict=on,model=lan9118,hostfwd=tcp:{address}-:7000"
                ))
                .arg("-kernel")
                .arg(image)
                .stdin(Stdio::null())
                .stdout(Stdio::piped()),
        );
        let mut decoder = Process::start(
            Command::new("defmt-print")
                .arg("-e")
                .arg(image)
                .args(["--log-format", "{s}", "stdin"])
                .stdin(Stdio::from(emulator.stdout()))
                .stdout(Stdio::piped()),
        );
        let log = Arc::new(Journal::default());
        let (shared, out) = (Arc::clone(&log), decoder.stdout());
        let reader = std::thread::spawn(move || {
            BufReader::new(out)
                .lines()
                .for_each(|line| shared.push(line.unwrap()));
            shared.complete();
        });
        Self {
            address,
            emulator,
            _decoder: decoder,
            log,
            reader: Some(reader),
        }
    }

    /// Waits for a line that contains `words`; `None` if the emulator ends without it.
    pub(super) fn await_line(&self, words: &str) -> Option<String> {
        self.log.find(words, |line| line.contains(words))
    }

    /// Returns its log.
    pub(super) fn words(&self) -> String {
        self.log.entries().join("\n")
    }

    /// Waits for its end. Returns exit code and log.
    pub(super) fn end(mut self) -> (Option<i32>, Vec<String>) {
        let log = Arc::clone(&self.log);
        let status = self.emulator.end(PATIENCE, || log.entries().join("\n"));
        // The log ends with the pipe.
        self.reader.take().unwrap().join().unwrap();
        (status.code(), log.entries())
    }
}
