//! The emulator with the firmware: its port, its log, its exit code.

use std::io::{BufRead, BufReader};
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::{Arc, Condvar, Mutex};
use std::thread::JoinHandle;
use std::time::Instant;

use super::{LOOK, PATIENCE};
use crate::firmware::emulator::Build;

/// Ports tried until one is free for the emulator as well.
const TRIES: u32 = 5;

/// Lines of the log, as they arrive.
#[derive(Default)]
struct Log {
    said: Mutex<Said>,
    more: Condvar,
}

#[derive(Default)]
struct Said {
    lines: Vec<String>,
    /// The log is complete.
    all: bool,
}

/// A running emulator, killed when the test ends before it.
pub(super) struct Target {
    /// Address of its port 7000 on this machine.
    pub(super) address: SocketAddr,
    child: Child,
    /// Turns its log into lines; ends with it.
    decoder: Child,
    log: Arc<Log>,
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
        let mut child = Command::new("qemu-system-arm")
            .args(["-machine", build.machine(), "-display", "none", "-monitor", "none", "-serial", "none"])
            .arg("-semihosting-config")
            .arg(format!("enable=on,target=native,arg=link,arg={sessions}"))
            .arg("-nic")
            // The guest can be reached, and reaches no other machine.
            .arg(format!("user,restrict=on,model=lan9118,hostfwd=tcp:{address}-:7000"))
            .arg("-kernel")
            .arg(image)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut decoder = Command::new("defmt-print")
            .arg("-e")
            .arg(image)
            .args(["--log-format", "{s}", "stdin"])
            .stdin(Stdio::from(child.stdout.take().unwrap()))
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let log = Arc::new(Log::default());
        let (shared, out) = (Arc::clone(&log), decoder.stdout.take().unwrap());
        let reader = std::thread::spawn(move || read(out, &shared));
        Self { address, child, decoder, log, reader: Some(reader) }
    }

    /// Waits for a line that contains `words`; `None` if the emulator ends without it.
    pub(super) fn await_line(&self, words: &str) -> Option<String> {
        let since = Instant::now();
        let mut said = self.log.said.lock().unwrap();
        loop {
            if let Some(line) = said.lines.iter().find(|line| line.contains(words)) {
                return Some(line.clone());
            }
            if said.all {
                return None;
            }
            let left = PATIENCE.checked_sub(since.elapsed());
            let left = left.unwrap_or_else(|| panic!("no {words:?} in\n{}", said.lines.join("\n")));
            said = self.log.more.wait_timeout(said, left).unwrap().0;
        }
    }

    /// Returns its log.
    pub(super) fn words(&self) -> String {
        self.log.said.lock().unwrap().lines.join("\n")
    }

    /// Waits for its end. Returns exit code and log.
    pub(super) fn end(mut self) -> (Option<i32>, Vec<String>) {
        let since = Instant::now();
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            assert!(since.elapsed() < PATIENCE, "it does not end:\n{}", self.words());
            std::thread::sleep(LOOK);
        };
        self.reader.take().unwrap().join().unwrap();
        let lines = std::mem::take(&mut self.log.said.lock().unwrap().lines);
        (status.code(), lines)
    }
}

impl Drop for Target {
    fn drop(&mut self) {
        for process in [&mut self.child, &mut self.decoder] {
            let _ = process.kill();
            let _ = process.wait();
        }
        // The reader ends with the pipe.
        if let Some(reader) = self.reader.take() {
            let _ = reader.join();
        }
    }
}

/// Takes in lines until there will be no more.
fn read(out: ChildStdout, log: &Log) {
    for line in BufReader::new(out).lines() {
        log.said.lock().unwrap().lines.push(line.unwrap());
        log.more.notify_all();
    }
    log.said.lock().unwrap().all = true;
    log.more.notify_all();
}
