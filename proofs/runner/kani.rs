//! Runs `cargo kani`: a process group of its own, with limits, its output in a file.

use std::ffi::OsString;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::prove::Job;

/// Set by Ctrl-C.
pub(crate) static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Line that Kani prints when the solver starts.
const SOLVING: &str = "Checking harness";

/// Flags of every run, beside the family, the harness and the folders. Changed, they make every
/// result stale.
pub(crate) const FLAGS: [&str; 4] = ["--lib", "--no-default-features", "-Z", "stubbing"];

/// Interval of looking at a run.
const POLL: Duration = Duration::from_millis(50);

/// Folders and limits of the runs.
pub(crate) struct Kani {
    /// Folder of its builds.
    pub(crate) target: PathBuf,
    /// Folder of its output.
    pub(crate) logs: PathBuf,
    pub(crate) memory_gib: u32,
    pub(crate) build_limit: Duration,
}

/// Phase of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Phase {
    Building,
    Solving,
}

/// End of a run: its exit status, or the phase that took too long.
pub(crate) type End = Result<ExitStatus, Phase>;

/// Version of the installed Kani, or Cargo's message.
pub(crate) fn version() -> Result<String, String> {
    let output = Command::new(cargo()).args(["kani", "--version"]).output();
    let output = output.map_err(|error| format!("cargo: {error}"))?;
    let text = String::from_utf8_lossy(&output.stdout);
    match text.split_whitespace().last() {
        Some(version) if output.status.success() => Ok(version.to_owned()),
        _ => Err(String::from_utf8_lossy(&output.stderr).trim().to_owned()),
    }
}

impl Kani {
    /// Folder of the builds of core, or of its mutants. Cargo names both alike, for their places in
    /// their workspaces are the same: in one folder it would take the build of a mutant for that of
    /// core, whose files are older.
    fn builds(&self, of_mutants: bool) -> PathBuf {
        if of_mutants {
            self.target.join("mutants")
        } else {
            self.target.clone()
        }
    }

    /// Makes Cargo build core and proofs again: it goes by the times of files, which a checkout or
    /// a copy may set back.
    pub(crate) fn forget_builds(&self) -> std::io::Result<()> {
        for folder in [self.builds(false), self.builds(true)].map(|folder| folder.join("kani")) {
            // One folder per target; there is none before the first run.
            for target in std::fs::read_dir(folder).into_iter().flatten() {
                let builds = target?.path().join("debug/.fingerprint");
                for build in std::fs::read_dir(builds).into_iter().flatten() {
                    let build = build?;
                    if build
                        .file_name()
                        .to_string_lossy()
                        .starts_with("gantry-tau-")
                    {
                        std::fs::remove_dir_all(build.path())?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Version of the compiler in Kani, which Cargo keeps beside its builds.
    pub(crate) fn rustc(&self) -> Option<String> {
        let kept = [self.builds(false), self.builds(true)]
            .map(|builds| builds.join("kani/.rustc_info.json"));
        let text = kept
            .iter()
            .find_map(|path| std::fs::read_to_string(path).ok())?;
        let info: serde_json::Value = serde_json::from_str(&text).ok()?;
        let mut outputs = info.get("outputs")?.as_object()?.values();
        outputs.find_map(|output| {
            Some(
                output
                    .get("stdout")?
                    .as_str()?
                    .strip_prefix("rustc ")?
                    .split(' ')
                    .next()?
                    .to_owned(),
            )
        })
    }

    /// Runs one job on a folder of proofs to its end, and reports its phase now and then. Returns
    /// the end and the log.
    pub(crate) fn run(
        &self,
        job: Job<'_>,
        proofs: &Path,
        limit: Duration,
        mut report: impl FnMut(Phase),
    ) -> std::io::Result<(End, PathBuf)> {
        let log = self.logs.join(format!("{}.log", job.name()));
        let file = File::create(&log)?;
        let mut child = self
            .command(job, proofs)
            .stdout(file.try_clone()?)
            .stderr(file)
            .spawn()?;
        let (mut output, mut text) = (File::open(&log)?, Vec::new());
        let (mut phase, mut since) = (Phase::Building, Instant::now());
        loop {
            if let Some(status) = child.try_wait()? {
                return Ok((Ok(status), log));
            }
            if phase == Phase::Building {
                output.read_to_end(&mut text)?;
                if String::from_utf8_lossy(&text).contains(SOLVING) {
                    (phase, since) = (Phase::Solving, Instant::now());
                }
            }
            report(phase);
            let allowed = match phase {
                Phase::Building => self.build_limit,
                Phase::Solving => limit,
            };
            let interrupted = INTERRUPTED.load(Ordering::Relaxed);
            if interrupted || since.elapsed() > allowed {
                kill(&mut child)?;
                let error = std::io::Error::other("interrupted; Kani and its solvers were ended");
                return if interrupted {
                    Err(error)
                } else {
                    Ok((Err(phase), log))
                };
            }
            std::thread::sleep(POLL);
        }
    }

    /// Kani in a process group of its own.
    fn command(&self, job: Job<'_>, proofs: &Path) -> Command {
        // Memory of each process is limited.
        let kib = u64::from(self.memory_gib).saturating_mul(1 << 20);
        let script =
            format!("ulimit -v {kib} || echo 'no memory limit on this system'; exec \"$@\"");
        let mut command = Command::new("/bin/sh");
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        command
            .args(["-c", &script, "sh"])
            .arg(cargo())
            .arg("kani")
            .args(FLAGS)
            .args(["--features", &format!("only,{}", job.harness.family())])
            .args(["--exact", "--harness", &job.harness.path()])
            .arg("--manifest-path")
            .arg(proofs.join("Cargo.toml"))
            .arg("--target-dir")
            .arg(self.builds(job.mutant.is_some()))
            // Kani reports places from here.
            .current_dir(proofs.parent().unwrap_or(proofs))
            // Kani hands these on to every build: a user's own must not change what is proved.
            .env_remove("RUSTFLAGS")
            .env_remove("RUSTC_WRAPPER")
            .env_remove("RUSTC_WORKSPACE_WRAPPER")
            .stdin(Stdio::null());
        command
    }
}

/// Path of the Cargo that runs this program, or any.
pub(crate) fn cargo() -> OsString {
    std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into())
}

/// Ends a run with everything it has started: Kani's solvers outlive it.
fn kill(child: &mut Child) -> std::io::Result<()> {
    #[cfg(unix)]
    {
        use rustix::process::{Pid, Signal, kill_process_group};
        // Fails only where nothing of the group is left.
        let _ = kill_process_group(Pid::from_child(child), Signal::KILL);
    }
    child.kill()?;
    child.wait().map(drop)
}
