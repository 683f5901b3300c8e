//! The restrictions of the unit without systemd: a user of its own, one folder to write in, limits,
//! no capabilities.

use std::collections::BTreeSet;
use std::fs::{self, File, OpenOptions, Permissions};
use std::io::Write;
use std::os::fd::AsRawFd;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use tempfile::TempDir;

use super::{gantry_tau, values};

/// A user as `DynamicUser=` takes one: of no file.
const USER: &str = "61234";
/// Longest wait for anything.
const PATIENCE: Duration = Duration::from_secs(120);
/// Folder of the sandbox that is a disk of its own, of 16 MiB: in memory, or the file `disk` of the
/// state folder, which can be frozen.
pub(super) const DISK: &str = "/tmp/disk";
/// Everything is read-only, but for the state folder, and /tmp is the service's own. `$1`: the
/// state folder; the rest: the command.
const NAMESPACE: &str = "set -e; state=$1; shift
mount --make-rprivate /
mount --bind \"$state\" /mnt
mount -t tmpfs -o mode=1777,size=16m tmpfs /media
[ ! -e /mnt/disk ] || mount -o loop /mnt/disk /media
mount -t tmpfs -o mode=1777 tmpfs /tmp
mkdir /tmp/state /tmp/disk
mount --move /media /tmp/disk
mount --move /mnt /tmp/state
mount -o remount,bind,ro /
cd /tmp/state
exec \"$@\"";

/// A place for servers that keep their state in one folder.
pub(super) struct Sandbox {
    folder: TempDir,
    /// Options of `prlimit`: the limits of the unit, where they are wanted.
    limits: Vec<String>,
}

/// Options of `prlimit` for the limits of a unit.
pub(super) fn limits(unit: &str) -> Vec<String> {
    [("rtprio", "LimitRTPRIO"), ("memlock", "LimitMEMLOCK")]
        .map(|(name, key)| {
            let limit = values(unit, key).pop().unwrap();
            let limit = limit.replace("infinity", "unlimited");
            format!("--{name}={limit}:{limit}")
        })
        .to_vec()
}

impl Sandbox {
    /// An empty state folder, but for a copy of the program: the user may not reach its own folder.
    pub(super) fn new(name: &str, limits: Vec<String>) -> Self {
        let folder = tempfile::Builder::new()
            .prefix(&format!("gantry-tau-{name}-"))
            .permissions(Permissions::from_mode(0o755))
            .tempdir()
            .unwrap();
        fs::create_dir(folder.path().join("state")).unwrap();
        fs::copy(gantry_tau(), folder.path().join("state/program")).unwrap();
        let sandbox = Self { folder, limits };
        let owner = format!("{USER}:{USER}");
        let mut chown = Command::new("chown");
        assert!(
            chown
                .arg(owner)
                .arg(sandbox.folder.path().join("state"))
                .status()
                .unwrap()
                .success()
        );
        sandbox
    }

    /// The same with a disk that can be frozen, which has a file `run.csv`.
    pub(super) fn with_disk(name: &str) -> Self {
        let sandbox = Self::new(name, Vec::new());
        let disk = sandbox.folder.path().join("state/disk");
        File::create(&disk).unwrap().set_len(16 << 20).unwrap();
        let files = sandbox.folder.path().join("files");
        fs::create_dir(&files).unwrap();
        fs::write(files.join("run.csv"), "of an earlier run\n").unwrap();
        let mut mkfs = Command::new("mkfs.ext4");
        mkfs.args(["-q", "-E", &format!("root_owner={USER}:{USER}"), "-d"])
            .args([files, disk]);
        assert!(mkfs.status().unwrap().success());
        sandbox
    }

    /// Starts `serve` under the restrictions.
    pub(super) fn start(&self, name: &str, pace: &str, further: &[&str]) -> Running {
        self.start_in(name, &[], pace, further)
    }

    /// The same, its system calls noted.
    pub(super) fn start_traced(&self, name: &str, pace: &str) -> Running {
        self.start_in(
            name,
            &["strace", "-f", "-qq", "-o", "/tmp/state/calls"],
            pace,
            &[],
        )
    }

    fn start_in(&self, name: &str, tracer: &[&str], pace: &str, further: &[&str]) -> Running {
        let mut command = Command::new("unshare");
        command
            .args(["--mount", "sh", "-c", NAMESPACE, "sh"])
            .arg(self.folder.path().join("state"));
        if !self.limits.is_empty() {
            command.arg("prlimit").args(&self.limits);
        }
        command.args([
            "setpriv",
            "--reuid",
            USER,
            "--regid",
            USER,
            "--clear-groups",
            "--no-new-privs",
        ]);
        command.args(["--bounding-set", "-all", "--inh-caps", "-all"]);
        command
            .args([
                "env",
                "-i",
                "PATH=/usr/bin:/bin",
                "STATE_DIRECTORY=/tmp/state",
            ])
            .args(tracer);
        self.serve(name, command.arg("/tmp/state/program"), pace, further)
    }

    /// Starts `serve` as uid 0 of a user namespace, under a limit on locked memory.
    pub(super) fn start_as_root_of_a_namespace(&self, name: &str) -> Running {
        let mut command = Command::new("prlimit");
        command
            .args(["--memlock=8388608:8388608", "unshare", "-r"])
            .arg(gantry_tau());
        command.env("STATE_DIRECTORY", self.folder.path());
        self.serve(name, &mut command, "lockstep", &[])
    }

    fn serve(&self, name: &str, command: &mut Command, pace: &str, further: &[&str]) -> Running {
        let log = self.folder.path().join(format!("{name}.log"));
        let file = File::create(&log).unwrap();
        command.args(["serve", "--pace", pace, "--listen", "127.0.0.1:0"]);
        let child = command.args(further).stdin(Stdio::piped());
        let child = child
            .stdout(file.try_clone().unwrap())
            .stderr(file)
            .spawn()
            .unwrap();
        Running { child, log }
    }

    /// Names of the system calls that were noted.
    pub(super) fn calls(&self) -> BTreeSet<String> {
        let noted = fs::read_to_string(self.folder.path().join("state/calls")).unwrap();
        // "PID name(arguments) = result", or "PID <... name resumed>".
        let names = noted.lines().filter_map(|line| {
            let (_, call) = line.split_once(' ')?;
            let (name, _) = call.trim_start().split_once('(')?;
            name.chars()
                .all(|c| c.is_ascii_alphanumeric() || c == '_')
                .then(|| name.to_owned())
        });
        // The tracer's own start of the program comes before any filter of a service.
        names.filter(|name| name != "execve").collect()
    }
}

/// A server; killed when the trial ends before it.
pub(super) struct Running {
    child: Child,
    log: PathBuf,
}

impl Running {
    /// Everything that it has printed.
    pub(super) fn log(&self) -> String {
        String::from_utf8_lossy(&fs::read(&self.log).unwrap()).into_owned()
    }

    pub(super) fn await_words(&mut self, words: &str) {
        self.await_any(&[words]);
    }

    pub(super) fn await_any(&mut self, words: &[&str]) {
        let since = Instant::now();
        while !words.iter().any(|words| self.log().contains(words)) {
            let ended = self.child.try_wait().unwrap();
            assert!(
                ended.is_none() && since.elapsed() < PATIENCE,
                "{words:?}: {ended:?}\n{}",
                self.log()
            );
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Types a command.
    pub(super) fn say(&mut self, text: &str) {
        self.child
            .stdin
            .as_mut()
            .unwrap()
            .write_all(text.as_bytes())
            .unwrap();
    }

    /// Starts a client of it, outside the sandbox.
    pub(super) fn client(&self) -> Client {
        let log = self.log();
        let rest = log.split_once("listening on ").unwrap().1;
        let server = &rest[..rest.find([',', ';', ' ']).unwrap()];
        let mut command = Command::new(gantry_tau());
        command.args(["client", server]);
        let file = OpenOptions::new()
            .create(true)
            .append(true)
            .open(self.log.with_extension("client"))
            .unwrap();
        Client(
            command
                .stdin(Stdio::null())
                .stdout(file.try_clone().unwrap())
                .stderr(file)
                .spawn()
                .unwrap(),
        )
    }

    /// A file of its sandbox, from outside.
    pub(super) fn file(&self, path: &str) -> PathBuf {
        Path::new("/proc")
            .join(self.child.id().to_string())
            .join("root")
            .join(path.trim_start_matches('/'))
    }

    /// Freezes the disk.
    pub(super) fn freeze(&self) -> Frozen {
        let frozen = Frozen(File::open(self.file(DISK)).unwrap());
        assert!(frozen.fsfreeze("--freeze"));
        frozen
    }

    /// Ends it as systemd does, by SIGTERM to the server itself; returns its exit code.
    pub(super) fn terminate(&mut self) -> Option<i32> {
        self.tell_to_end();
        self.end()
    }

    /// SIGTERM to the server itself.
    pub(super) fn tell_to_end(&self) {
        let own = self.child.id().to_string();
        // A tracer stands between; the server is its only child.
        let children = fs::read_to_string(
            Path::new("/proc")
                .join(&own)
                .join("task")
                .join(&own)
                .join("children"),
        );
        let server = children
            .ok()
            .and_then(|children| children.split_whitespace().next().map(str::to_owned));
        let status = Command::new("kill")
            .args(["-TERM", server.as_ref().unwrap_or(&own)])
            .status();
        assert!(status.unwrap().success());
    }

    /// Waits for its end; returns its exit code.
    pub(super) fn end(&mut self) -> Option<i32> {
        let since = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                return status.code();
            }
            assert!(
                since.elapsed() < PATIENCE,
                "the server does not end\n{}",
                self.log()
            );
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A disk on which every write hangs, until this is dropped.
pub(super) struct Frozen(File);

impl Frozen {
    /// By the open folder: a server whose main thread has ended has none.
    fn fsfreeze(&self, option: &str) -> bool {
        let folder = format!("/proc/{}/fd/{}", std::process::id(), self.0.as_raw_fd());
        Command::new("fsfreeze")
            .args([option, &folder])
            .status()
            .unwrap()
            .success()
    }
}

impl Drop for Frozen {
    fn drop(&mut self) {
        let _ = self.fsfreeze("--unfreeze");
    }
}

/// A client, killed at the end.
pub(super) struct Client(Child);

impl Drop for Client {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
