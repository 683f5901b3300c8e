//! Sessions of HAL.

use std::fs::{self, File, Permissions};
use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::{OnceLock, PoisonError, RwLockWriteGuard};

use tempfile::TempDir;

use super::super::run::{ONE, make};
use crate::firmware::program;

/// Modules of LinuxCNC that the tests load beside ours.
const THEIRS: [&str; 7] = [
    "hal_lib", "mux2", "threads", "sampler", "streamer", "sum2", "scale",
];

/// Folder of what is built, for all sessions of this process. Everybody may read it.
fn folder() -> &'static Path {
    let folder = FOLDER.get_or_init(|| {
        tempfile::Builder::new()
            .prefix("gantry-tau-linuxcnc-")
            .permissions(Permissions::from_mode(0o755))
            .tempdir()
            .unwrap()
    });
    folder.path()
}

static FOLDER: OnceLock<TempDir> = OnceLock::new();

/// Removes what was built: nothing drops a static variable.
pub(crate) fn remove_folder() {
    if let Some(folder) = FOLDER.get() {
        let _ = fs::remove_dir_all(folder.path());
    }
}

/// `gantry-tau`, built once.
pub(in super::super) fn program() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(program::build)
}

/// Folder with our modules for the L2, built by the Makefile, and those of LinuxCNC beside them.
pub(super) fn modules() -> &'static Path {
    static MODULES: OnceLock<PathBuf> = OnceLock::new();
    MODULES.get_or_init(|| {
        let modules = folder().join("modules");
        let made = make("l2", &modules, |header| header);
        made.unwrap_or_else(|failed| panic!("{}", failed.message().unwrap_or("")));
        for module in THEIRS {
            let name = format!("{module}.so");
            fs::copy(
                Path::new("/usr/lib/linuxcnc/modules").join(&name),
                modules.join(&name),
            )
            .unwrap();
        }
        modules
    })
}

/// A port that is free, and stays so unless somebody asks for it by number.
pub(super) fn free_port() -> u16 {
    let held = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    held.local_addr().unwrap().port()
}

/// A running session; it ends with this object.
pub(super) struct Hal {
    shell: Child,
    commands: Option<ChildStdin>,
    answers: BufReader<ChildStdout>,
    place: PathBuf,
    /// The setup was carried out without an error.
    pub(super) is_ready: bool,
    _one: RwLockWriteGuard<'static, ()>,
}

impl Hal {
    /// Starts a session in a folder of this name, and carries the setup out. With `streamed`, lines
    /// for its streamer and what is added to the thread after the first one, it is recorded.
    pub(super) fn start(name: &str, setup: &str, streamed: Option<[&str; 2]>) -> Self {
        let (modules, place) = (modules(), folder().join(name));
        let one = ONE.write().unwrap_or_else(PoisonError::into_inner);
        fs::create_dir_all(&place).unwrap();
        fs::write(place.join("setup.hal"), setup).unwrap();
        if let Some([nominal, functions]) = streamed {
            fs::write(place.join("nominal.txt"), nominal).unwrap();
            fs::write(place.join("functions.hal"), functions).unwrap();
        }
        // The unprivileged user writes there.
        assert!(
            Command::new("chown")
                .args(["-R", "65534:65534"])
                .arg(&place)
                .status()
                .unwrap()
                .success()
        );
        let script = folder().join("session.sh");
        fs::write(&script, include_str!("session.sh")).unwrap();
        let mut shell = Command::new("unshare")
            .args([
                "--mount",
                "--ipc",
                "--pid",
                "--fork",
                "--kill-child",
                "--mount-proc",
                "sh",
            ])
            .args([script.as_path(), modules, &place])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(File::create(folder().join(format!("{name}.err"))).unwrap())
            .spawn()
            .unwrap();
        let commands = shell.stdin.take();
        let answers = BufReader::new(shell.stdout.take().unwrap());
        let mut hal = Self {
            shell,
            commands,
            answers,
            place,
            is_ready: false,
            _one: one,
        };
        hal.is_ready = hal.answer().contains("ready");
        hal
    }

    /// Carries out a command of halcmd, or of the shell after a `!`, and returns its answer.
    pub(super) fn ask(&mut self, command: &str) -> String {
        writeln!(self.commands.as_mut().unwrap(), "{command}").unwrap();
        self.answer().trim().to_owned()
    }

    /// Returns the value of a pin.
    pub(super) fn pin(&mut self, name: &str) -> f64 {
        self.ask(&format!("getp {name}")).parse().unwrap()
    }

    /// Everything that was said on the way.
    pub(super) fn said(&self) -> String {
        fs::read_to_string(self.place.with_extension("err")).unwrap()
    }

    /// Ends the session and returns the record of its sampler.
    pub(super) fn end(mut self) -> String {
        self.commands = None;
        let ended = self.shell.wait().unwrap();
        assert!(ended.success(), "{}", self.said());
        fs::read_to_string(self.place.join("record.txt")).unwrap()
    }

    fn answer(&mut self) -> String {
        let mut answer = String::new();
        loop {
            let mut line = String::new();
            assert!(
                self.answers.read_line(&mut line).unwrap() > 0,
                "the session is gone: {}",
                self.said()
            );
            if line == ".\n" {
                return answer;
            }
            answer += &line;
        }
    }
}

impl Drop for Hal {
    fn drop(&mut self) {
        // The end of its input ends it; `unshare` takes everything inside with it.
        self.commands = None;
        let _ = self.shell.wait();
    }
}
