//! The program `gantry-tau` as a process.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Instant;

use super::{LOOK, PATIENCE};

/// Builds the program as cargo builds it for tests, unless that is done already. Returns its path.
pub(super) fn build() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    let profile = test.ancestors().nth(2).unwrap();
    let is_debug = profile.ends_with("debug");
    let status = Command::new(env!("CARGO"))
        .args(["build", "--quiet", "--locked", "--package", "gantry-tau", "--bin", "gantry-tau"])
        .args(["--profile", if is_debug { "test" } else { "release" }])
        .arg("--target-dir")
        .arg(profile.parent().unwrap())
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .status()
        .unwrap();
    assert!(status.success());
    profile.join("gantry-tau")
}

/// A folder that is removed with the test.
pub(super) struct Folder(PathBuf);

impl Folder {
    pub(super) fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("gantry-tau-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A running program, killed when the test ends before it.
pub(super) struct Running {
    child: Child,
    errors: PathBuf,
}

impl Running {
    /// Starts it with `arguments`; its output goes to files called `name`.
    pub(super) fn start(program: &Path, folder: &Folder, name: &str, arguments: &[&str]) -> Self {
        let [out, errors] = ["out", "err"].map(|end| folder.path(&format!("{name}.{end}")));
        let child = Command::new(program)
            .args(arguments)
            .env("XDG_STATE_HOME", folder.path(""))
            .env_remove("RUST_LOG")
            .stdin(Stdio::null())
            .stdout(File::create(out).unwrap())
            .stderr(File::create(&errors).unwrap())
            .spawn()
            .unwrap();
        Self { child, errors }
    }

    /// Interrupts it, as Ctrl-C does.
    pub(super) fn interrupt(&self) {
        let kill = Command::new("kill").args(["-INT", &self.child.id().to_string()]).status();
        assert!(kill.unwrap().success());
    }

    /// True if it still runs.
    pub(super) fn is_running(&mut self) -> bool {
        self.child.try_wait().unwrap().is_none()
    }

    /// Waits for its end. Returns exit code and stderr.
    pub(super) fn end(mut self) -> (Option<i32>, String) {
        let since = Instant::now();
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            assert!(since.elapsed() < PATIENCE, "it does not end: {}", self.words());
            std::thread::sleep(LOOK);
        };
        (status.code(), self.words())
    }

    fn words(&self) -> String {
        std::fs::read_to_string(&self.errors).unwrap()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
