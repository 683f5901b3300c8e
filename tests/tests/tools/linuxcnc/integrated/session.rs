//! LinuxCNC with the server, obeying line by line (`screen.py`).

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::{OnceLock, PoisonError, RwLockReadGuard, RwLockWriteGuard};

use super::super::LATE;
use super::super::record::{FAULT, LISTENING, OBTAIN};
use super::super::run::{Machine, ONE};
use crate::firmware::program;

/// `gantry-tau`, built once.
pub(super) fn program() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(program::build)
}

/// Seconds that anything may take.
const PATIENCE: u32 = 60;

/// Exit code of a client that cannot use its robot file.
const BAD_INPUT: i32 = 1;

/// Leave to run, beside others in lock-step or alone.
enum Turn {
    Shared(#[expect(dead_code, reason = "held")] RwLockReadGuard<'static, ()>),
    Alone(#[expect(dead_code, reason = "held")] RwLockWriteGuard<'static, ()>),
}

/// LinuxCNC, running.
pub(super) struct Session {
    shell: Child,
    commands: Option<ChildStdin>,
    answers: BufReader<ChildStdout>,
    /// Everything that was said beside the answers.
    pub(super) said: String,
    /// It was loaded, and obeys.
    pub(super) is_ready: bool,
    _one: Turn,
}

impl Session {
    /// Starts LinuxCNC with a configuration whose screen is `screen.py`.
    pub(super) fn start(machine: &Machine) -> Self {
        // Nothing waits for the compiler later.
        program();
        let one = if machine.is_lockstep() {
            Turn::Shared(ONE.read().unwrap_or_else(PoisonError::into_inner))
        } else {
            Turn::Alone(ONE.write().unwrap_or_else(PoisonError::into_inner))
        };
        let mut shell = machine
            .command(&machine.linuxcnc().unwrap())
            .unwrap()
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let commands = shell.stdin.take();
        let answers = BufReader::new(shell.stdout.take().unwrap());
        let mut session = Self {
            shell,
            commands,
            answers,
            said: String::new(),
            is_ready: false,
            _one: one,
        };
        session.is_ready = session.answer().is_some();
        session
    }

    /// As [`Self::start`], of a configuration that is right.
    pub(super) fn begin(machine: &Machine) -> Self {
        let session = Self::start(machine);
        assert!(session.is_ready, "{}", session.said);
        session
    }

    /// Carries out a command of the screen. Returns its answer.
    pub(super) fn ask(&mut self, command: &str) -> String {
        writeln!(self.commands.as_mut().unwrap(), "{command}").unwrap();
        let answer = self
            .answer()
            .unwrap_or_else(|| panic!("{command}: {}", self.said));
        assert!(!self.said.contains(LATE), "{command}: {}", self.said);
        assert!(
            !answer.starts_with("failed"),
            "{command}: {answer} {}",
            self.said
        );
        answer
    }

    /// Waits until an expression of the screen is true.
    pub(super) fn wait(&mut self, expression: &str) {
        let answer = self.ask(&format!("wait {PATIENCE} {expression}"));
        if answer != "done" {
            let pins =
                self.ask("pins gantry-tau.phase gantry-tau.cause gantry-tau.permit gantry-tau.missed gantry-tau.tick");
            let errors = self.ask("errors");
            panic!(
                "waited for {expression}: phase, cause, permit, missed, tick: {pins}; {errors}; {}",
                self.said
            );
        }
    }

    /// Waits for a phase of the server.
    pub(super) fn wait_phase(&mut self, phase: u8) {
        self.wait(&format!("p('gantry-tau.phase') == {phase}"));
    }

    /// Lets periods pass.
    pub(super) fn pass(&mut self, periods: u32) {
        self.ask("try t0 = p('gantry-tau.tick')");
        self.wait(&format!("p('gantry-tau.tick') - t0 >= {periods}"));
    }

    /// Switches on, homes.
    pub(super) fn switch_on(&mut self) {
        self.wait("p('gantry-tau.permit')");
        self.ask("on");
        self.ask("home");
    }

    /// Leads out of a stop.
    pub(super) fn rearm(&mut self) {
        self.wait_phase(FAULT);
        self.wait("abs(p('gantry-tau.0.offset')) + abs(p('gantry-tau.1.offset')) + abs(p('gantry-tau.2.offset')) == 0");
        self.pass(5);
        self.ask("sets rearm 1");
        self.wait_phase(LISTENING);
        self.ask("sets rearm 0");
    }

    /// Process of LinuxCNC, the first of its namespace.
    fn process(&self) -> String {
        let mut process = self.shell.id().to_string();
        // timeout, unshare, and the shell that became LinuxCNC.
        for _ in 0..2 {
            let children =
                fs::read_to_string(format!("/proc/{process}/task/{process}/children")).unwrap();
            process = children
                .split_whitespace()
                .next()
                .unwrap_or_else(|| panic!("{process}"))
                .to_owned();
        }
        process
    }

    /// A command for the computer that LinuxCNC runs on, as root: in its network and among its
    /// processes.
    fn inside(&self, words: &[&str]) -> Command {
        let mut command = Command::new("nsenter");
        command
            .arg(format!("--target={}", self.process()))
            .args(["--net", "--pid", "--"])
            .args(words);
        command
    }

    /// Runs a command inside, to its end.
    pub(super) fn run(&self, words: &[&str]) -> ExitStatus {
        self.inside(words).status().unwrap()
    }

    /// As [`Self::run`], with the folders that LinuxCNC sees, `/proc` among them.
    pub(super) fn run_mounted(&self, words: &[&str]) -> ExitStatus {
        self.run(
            &[
                &[
                    "nsenter",
                    &format!("--mount=/proc/{}/ns/mnt", self.process()),
                ],
                words,
            ]
            .concat(),
        )
    }

    /// Kills LinuxCNC with all its processes.
    pub(super) fn kill(mut self) {
        assert!(
            Command::new("kill")
                .args(["-9", &self.process()])
                .status()
                .unwrap()
                .success()
        );
        while self.answer().is_some() {}
    }

    /// Starts the unchanged client.
    pub(super) fn client(&self, robot: &str) -> Client {
        // Not among LinuxCNC's processes: it outlives them.
        let mut command = Command::new("nsenter");
        command
            .arg(format!("--target={}", self.process()))
            .args(["--net", "--"])
            .arg(program());
        command.args(["client", "--robot", robot]);
        Client(
            command
                .stdin(Stdio::null())
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .spawn()
                .unwrap(),
        )
    }

    /// Starts a client, again and again until it is let in, and waits until its offsets may act.
    /// Taring needs an unloaded sensor. The server may not have seen yet that the session before
    /// has ended: its phase would be taken for the new client's.
    pub(super) fn obtain(&mut self, robot: &str) -> Client {
        self.wait(&format!("p('gantry-tau.phase') != {OBTAIN}"));
        self.unload();
        loop {
            let mut client = self.client(robot);
            loop {
                if self.ask(&format!("wait 0.2 p('gantry-tau.phase') == {OBTAIN}")) == "done" {
                    return client;
                }
                if let Some(status) = client.0.try_wait().unwrap() {
                    assert_ne!(status.code(), Some(BAD_INPUT), "{robot}");
                    break;
                }
            }
        }
    }

    /// Sets the raw sample of the force sensor's y: minus the platform's x.
    pub(super) fn load(&mut self, newton: f64) {
        self.ask(&format!("sets wrench-1 {}", -newton));
    }

    fn unload(&mut self) {
        self.load(0.0);
    }

    /// Ends LinuxCNC and returns what it said. No period was lost by the samplers.
    pub(super) fn end(mut self) -> String {
        assert_eq!(
            self.ask("pins sampler.0.overruns sampler.1.overruns"),
            "0.0 0.0"
        );
        self.close()
    }

    /// Waits for the end. Returns everything that was said.
    pub(super) fn close(mut self) -> String {
        self.commands = None;
        while self.answer().is_some() {}
        let _ = self.shell.wait();
        std::mem::take(&mut self.said)
    }

    /// Reads to the end of an answer; `None` if nothing more comes.
    fn answer(&mut self) -> Option<String> {
        let mut answer = String::new();
        loop {
            let mut line = String::new();
            if self.answers.read_line(&mut line).unwrap() == 0 {
                return None;
            }
            match line.strip_prefix("> ") {
                Some(".\n") => return Some(answer.trim().to_owned()),
                Some(text) => answer += text,
                None => self.said += &line,
            }
        }
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        // The end of its input ends the screen, and with it LinuxCNC; `unshare` takes everything
        // inside with it.
        self.commands = None;
        let _ = self.shell.wait();
    }
}

/// A running client; killed at the end.
pub(super) struct Client(pub(super) Child);

impl Client {
    /// Sends a signal.
    pub(super) fn signal(&self, signal: &str) {
        let process = self.0.id().to_string();
        assert!(
            Command::new("kill")
                .args([&format!("-{signal}"), &process])
                .status()
                .unwrap()
                .success()
        );
    }

    /// Waits for its end. Returns the exit code.
    pub(super) fn end(mut self) -> Option<i32> {
        self.0.wait().unwrap().code()
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        if self.0.try_wait().unwrap().is_none() {
            self.signal("KILL");
            let _ = self.0.wait();
        }
    }
}
