//! Runs the binary in a folder of its own, with files as its standard streams, and bounds every
//! wait.

use std::fs::File;
#[cfg(unix)]
use std::io::{Read, Write};
#[cfg(unix)]
use std::net::{Shutdown, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use tempfile::TempDir;

/// Longest wait for anything, on a busy machine.
const DEADLINE: Duration = Duration::from_secs(180);

/// The binary.
pub(crate) const BINARY: &str = env!("CARGO_BIN_EXE_gantry-tau");

/// Returns a program with the signals of a terminal: what runs behind `nohup`, or in the background of a
/// script, ignores some, and so would its children.
pub(crate) fn command(program: &str) -> Command {
    if !cfg!(target_os = "linux") {
        return Command::new(program);
    }
    let mut env = Command::new("env");
    env.args(["--default-signal=INT,HUP,QUIT", program]);
    env
}

/// Standard streams in place of empty input and of files.
pub(crate) struct Streams {
    pub(crate) input: Stdio,
    pub(crate) output: Option<Stdio>,
    pub(crate) log: Option<Stdio>,
}

impl Default for Streams {
    fn default() -> Self {
        Self {
            input: Stdio::null(),
            output: None,
            log: None,
        }
    }
}

/// A folder that is removed at the end of its test.
pub(crate) struct Folder(TempDir);

impl Folder {
    pub(crate) fn new(name: &str) -> Self {
        let folder = tempfile::Builder::new()
            .prefix(&format!("gantry-tau-{name}-"))
            .tempdir()
            .unwrap();
        // Another login reads there, too.
        #[cfg(unix)]
        std::fs::set_permissions(
            folder.path(),
            std::os::unix::fs::PermissionsExt::from_mode(0o755),
        )
        .unwrap();
        Self(folder)
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap()
    }

    pub(crate) fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).unwrap();
    }

    /// Starts the binary with empty input.
    pub(crate) fn start(&self, name: &str, arguments: &[&str]) -> Running {
        self.start_with(name, arguments, Stdio::null())
    }

    /// Starts the binary; its output goes to `name.out` and `name.err`.
    pub(crate) fn start_with(&self, name: &str, arguments: &[&str], input: Stdio) -> Running {
        let mut command = command(BINARY);
        command.args(arguments);
        self.start_command(name, command, input)
    }

    /// Starts a command in the surroundings of the binary, but for those that it sets by itself.
    pub(crate) fn start_command(&self, name: &str, mut command: Command, input: Stdio) -> Running {
        self.start_by(
            &mut command,
            name,
            &[],
            Streams {
                input,
                ..Streams::default()
            },
        )
    }

    /// Starts the binary, or a program that becomes it, on these streams.
    pub(crate) fn start_by(
        &self,
        command: &mut Command,
        name: &str,
        arguments: &[&str],
        streams: Streams,
    ) -> Running {
        let [out, err] = ["out", "err"].map(|end| self.path(&format!("{name}.{end}")));
        let [stdout, stderr] = [&out, &err].map(|path| Stdio::from(File::create(path).unwrap()));
        for (key, value) in [
            ("STATE_DIRECTORY", self.0.path().as_os_str()),
            ("RUST_BACKTRACE", "1".as_ref()),
        ] {
            if !command.get_envs().any(|(set, _)| set == key) {
                command.env(key, value);
            }
        }
        let child = command
            .args(arguments)
            .current_dir(self.0.path())
            .env_remove("RUST_LOG")
            .stdin(streams.input)
            .stdout(streams.output.unwrap_or(stdout))
            .stderr(streams.log.unwrap_or(stderr))
            .spawn()
            .unwrap();
        Running { child, out, err }
    }

    /// Runs the binary to its end.
    pub(crate) fn run(&self, arguments: &[&str]) -> Ended {
        self.start("run", arguments).end()
    }
}

/// A process; killed when the test ends before it.
pub(crate) struct Running {
    child: Child,
    out: PathBuf,
    err: PathBuf,
}

impl Running {
    pub(crate) fn stdout(&self) -> String {
        text(&self.out)
    }

    pub(crate) fn stderr(&self) -> String {
        text(&self.err)
    }

    /// True if the process has printed `words` on either stream.
    fn says(&self, words: &str) -> bool {
        self.stdout().contains(words) || self.stderr().contains(words)
    }

    /// Both streams.
    pub(crate) fn said(&self) -> String {
        format!("{}\n{}", self.stdout(), self.stderr())
    }

    /// Number of the process.
    #[cfg(unix)]
    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    /// Writes to the input, which must be a pipe.
    #[cfg(unix)]
    pub(crate) fn write(&mut self, text: &str) {
        self.child
            .stdin
            .as_mut()
            .unwrap()
            .write_all(text.as_bytes())
            .unwrap();
    }

    /// Ends the input.
    #[cfg(unix)]
    pub(crate) fn close_input(&mut self) {
        self.child.stdin = None;
    }

    /// Waits until the process has printed `words` on either stream.
    pub(crate) fn await_words(&mut self, words: &str) {
        self.await_that(words, |process| process.says(words));
    }

    /// Waits until the process has printed one of two words. Returns true if it was `this`.
    #[cfg(unix)]
    pub(crate) fn await_either(&mut self, this: &str, that: &str) -> bool {
        self.await_that(this, |process| process.says(this) || process.says(that));
        self.says(this)
    }

    /// Waits until `done`; the process must live until then.
    pub(crate) fn await_that(&mut self, what: &str, mut done: impl FnMut(&Self) -> bool) {
        let since = Instant::now();
        while !done(self) {
            let ended = self.child.try_wait().unwrap();
            assert!(
                ended.is_none() || done(self),
                "{what}: {ended:?}\n{}",
                self.said()
            );
            assert!(since.elapsed() < DEADLINE, "{what}\n{}", self.said());
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Interrupts the process, as Ctrl-C does.
    #[cfg(unix)]
    pub(crate) fn interrupt(&self) {
        self.signal("-INT");
    }

    /// Sends a signal.
    #[cfg(unix)]
    pub(crate) fn signal(&self, signal: &str) {
        let done = Command::new("kill")
            .args([signal, &self.child.id().to_string()])
            .status();
        assert!(done.unwrap().success());
    }

    /// Interrupts the process and waits for its end.
    #[cfg(unix)]
    pub(crate) fn stop(self) -> Ended {
        self.interrupt();
        self.end()
    }

    /// Kills the process, as a power failure does.
    #[cfg(unix)]
    pub(crate) fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Waits for the end.
    pub(crate) fn end(mut self) -> Ended {
        let since = Instant::now();
        let code = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status.code();
            }
            assert!(
                since.elapsed() < DEADLINE,
                "the process does not end\n{}",
                self.said()
            );
            std::thread::sleep(Duration::from_millis(5));
        };
        Ended {
            code,
            stdout: self.stdout(),
            stderr: self.stderr(),
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The address that a server prints behind these words.
#[cfg(unix)]
pub(crate) fn address_behind(said: &str, words: &str) -> String {
    let (_, rest) = said.split_once(words).unwrap();
    let end = rest.find([',', ';', ' ', '\n']).unwrap();
    rest[..end].to_owned()
}

fn text(path: &Path) -> String {
    String::from_utf8_lossy(&std::fs::read(path).unwrap()).into_owned()
}

/// A process that has ended.
pub(crate) struct Ended {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Ended {
    /// Checks that it succeeded; returns its output.
    #[track_caller]
    pub(crate) fn success(self) -> String {
        assert_eq!(self.code, Some(0), "{}{}", self.stdout, self.stderr);
        self.assert_no_panic();
        self.stdout
    }

    /// Checks that it failed with `code` and one error line; returns that line. Log lines may
    /// precede it.
    #[track_caller]
    pub(crate) fn failure(self, code: i32) -> String {
        assert_eq!(self.code, Some(code), "{}{}", self.stdout, self.stderr);
        self.assert_no_panic();
        let lines: Vec<&str> = self
            .stderr
            .lines()
            .filter(|line| line.starts_with("gantry-tau: ") || line.starts_with("error: "))
            .collect();
        assert_eq!(lines.len(), 1, "{}", self.stderr);
        if lines[0].starts_with("gantry-tau: ") {
            assert_eq!(self.stderr.lines().last(), Some(lines[0]));
        }
        lines[0].to_owned()
    }

    #[track_caller]
    fn assert_no_panic(&self) {
        for word in ["panicked", "backtrace", "RUST_BACKTRACE"] {
            assert!(!self.stderr.contains(word), "{}", self.stderr);
        }
    }
}

/// Relays one connection to a server whose frames arrive each after a pause: lock-step, as fast as
/// it can, is too fast for a monitor.
#[cfg(unix)]
pub(crate) fn relay_paced(listener: TcpListener, server: String) {
    std::thread::spawn(move || {
        let (to_client, _) = listener.accept().unwrap();
        let to_server = TcpStream::connect(server).unwrap();
        let ends = (
            to_client.try_clone().unwrap(),
            to_server.try_clone().unwrap(),
        );
        std::thread::spawn(move || copy_paced(ends.0, ends.1, Duration::ZERO));
        copy_paced(to_server, to_client, Duration::from_millis(1));
    });
}

/// Copies what arrives, each time after a pause, until one of both ends.
#[cfg(unix)]
fn copy_paced(mut from: TcpStream, mut to: TcpStream, pause: Duration) {
    to.set_nodelay(true).unwrap();
    let mut bytes = [0; 4096];
    while let Ok(count @ 1..) = from.read(&mut bytes) {
        std::thread::sleep(pause);
        if to.write_all(&bytes[..count]).is_err() {
            break;
        }
    }
    let _ = (from.shutdown(Shutdown::Both), to.shutdown(Shutdown::Both));
}
