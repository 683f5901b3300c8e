//! Runs `cargo kani`: a process group of its own, with limits, its output in a file.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::job::Job;

/// Somebody wants it to end.
pub(crate) static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// What Kani prints when the solver's turn has come.
const SOLVING: &str = "Checking harness";

/// How often a run is looked at.
const GLANCE: Duration = Duration::from_millis(50);

/// An installed Kani, and what it may take.
pub(crate) struct Kani {
    /// As it states it, "0.68.0".
    pub(crate) version: String,
    /// The folder of `proofs/`.
    pub(crate) proofs: PathBuf,
    /// Where it builds.
    pub(crate) target: PathBuf,
    /// Where its output goes.
    pub(crate) logs: PathBuf,
    pub(crate) memory_gib: u32,
    pub(crate) build_limit: Duration,
}

/// What a run is busy with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Phase {
    Building,
    Solving,
}

/// How a run came to its end.
#[derive(Clone, Copy, Debug)]
pub(crate) enum End {
    Exited(ExitStatus),
    TimedOut(Phase),
    Interrupted,
}

/// A run.
pub(crate) struct Run {
    pub(crate) end: End,
    pub(crate) log: PathBuf,
}

/// The version of the installed Kani; or why there is none, in Cargo's words.
pub(crate) fn version() -> Result<String, String> {
    let output = cargo().args(["kani", "--version"]).output();
    let output = output.map_err(|error| format!("cargo: {error}"))?;
    let text = String::from_utf8_lossy(&output.stdout);
    match text.split_whitespace().last() {
        Some(version) if output.status.success() => Ok(version.to_owned()),
        _ => Err(String::from_utf8_lossy(&output.stderr).trim().to_owned()),
    }
}

impl Kani {
    /// One job, to its end. `glance` is told now and then how far it is.
    pub(crate) fn run(
        &self,
        job: Job<'_>,
        limit: Duration,
        mut glance: impl FnMut(Phase),
    ) -> std::io::Result<Run> {
        let log = self.logs.join(format!("{}.log", job.name()));
        let file = File::create(&log)?;
        let mut command = self.command(job)?;
        command
            .stdin(Stdio::null())
            .stdout(file.try_clone()?)
            .stderr(file);
        let mut child = command.spawn()?;
        let mut watch = Watch::new(File::open(&log)?);
        let end = loop {
            if let Some(status) = child.try_wait()? {
                return Ok(Run {
                    end: End::Exited(status),
                    log,
                });
            }
            let phase = watch.phase()?;
            glance(phase);
            let allowed = match phase {
                Phase::Building => self.build_limit,
                Phase::Solving => limit,
            };
            if INTERRUPTED.load(Ordering::Relaxed) {
                break End::Interrupted;
            }
            if watch.since.elapsed() > allowed {
                break End::TimedOut(phase);
            }
            std::thread::sleep(GLANCE);
        };
        kill(&mut child)?;
        Ok(Run { end, log })
    }

    /// Makes the folders.
    pub(crate) fn prepare(&self) -> std::io::Result<()> {
        std::fs::create_dir_all(&self.logs)?;
        std::fs::create_dir_all(self.target.join("rustc"))
    }

    fn command(&self, job: Job<'_>) -> std::io::Result<Command> {
        let mut command = limited(self.memory_gib);
        command
            .args(["kani", "--lib", "--no-default-features", "-Z", "stubbing"])
            .args(["--exact", "--harness", &job.path()])
            .arg("--manifest-path")
            .arg(self.proofs.join("Cargo.toml"))
            .arg("--target-dir")
            .arg(&self.target)
            // Kani hands these on to every build. What the user has there is not ours to prove with.
            .env_remove("RUSTFLAGS")
            .env_remove("RUSTC_WRAPPER");
        self.configure(&mut command, job)?;
        Ok(command)
    }

    /// Compiles only the harness's family, with the mutant's cfg.
    ///
    /// `RUSTFLAGS` would do, and does where a script does not. But Cargo then builds every dependency anew for every mutant, half a
    /// minute each; a wrapper around the compiler of the workspace's members touches core and proofs alone. Cargo keeps the builds
    /// of different wrappers apart by their paths.
    #[cfg(unix)]
    fn configure(&self, command: &mut Command, job: Job<'_>) -> std::io::Result<()> {
        use std::os::unix::fs::PermissionsExt;

        let wrapper = self.target.join("rustc").join(match job.mutant {
            Some(mutant) => format!("{}-{}", job.family, mutant.name),
            None => job.family.to_owned(),
        });
        let flags: Vec<String> = flags(job).iter().map(|flag| format!(" '{flag}'")).collect();
        std::fs::write(
            &wrapper,
            format!("#!/bin/sh\nexec \"$@\"{}\n", flags.concat()),
        )?;
        std::fs::set_permissions(&wrapper, PermissionsExt::from_mode(0o755))?;
        command.env("RUSTC_WORKSPACE_WRAPPER", wrapper);
        Ok(())
    }

    #[cfg(not(unix))]
    fn configure(&self, command: &mut Command, job: Job<'_>) -> std::io::Result<()> {
        // Split at spaces by Kani; no flag holds one.
        command.env("RUSTFLAGS", flags(job).join(" "));
        Ok(())
    }
}

/// What core and proofs are compiled with for this job.
fn flags(job: Job<'_>) -> Vec<String> {
    let mutant = job
        .mutant
        .map(|mutant| format!("--cfg=mutant=\"{}\"", mutant.name));
    let family = [
        "--cfg=only".to_owned(),
        format!("--cfg=only=\"{}\"", job.family),
    ];
    family.into_iter().chain(mutant).collect()
}

/// The output of a run, read as it grows until the solver's turn has come.
struct Watch {
    log: File,
    text: Vec<u8>,
    phase: Phase,
    /// When this phase began.
    since: Instant,
}

impl Watch {
    fn new(log: File) -> Self {
        Self {
            log,
            text: Vec::new(),
            phase: Phase::Building,
            since: Instant::now(),
        }
    }

    fn phase(&mut self) -> std::io::Result<Phase> {
        if self.phase == Phase::Building {
            self.log.read_to_end(&mut self.text)?;
            if String::from_utf8_lossy(&self.text).contains(SOLVING) {
                self.phase = Phase::Solving;
                self.since = Instant::now();
            }
        }
        Ok(self.phase)
    }
}

/// The Cargo that runs us, or any.
fn cargo() -> Command {
    Command::new(cargo_path())
}

fn cargo_path() -> std::ffi::OsString {
    std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into())
}

/// Cargo, in a process group of its own, each process of it with limited memory.
#[cfg(unix)]
fn limited(memory_gib: u32) -> Command {
    use std::os::unix::process::CommandExt;

    let kib = u64::from(memory_gib).saturating_mul(1 << 20);
    let script = format!("ulimit -v {kib} || echo 'no memory limit on this system'; exec \"$@\"");
    let mut command = Command::new("/bin/sh");
    command
        .args(["-c", &script, "sh"])
        .arg(cargo_path())
        .process_group(0);
    command
}

#[cfg(not(unix))]
fn limited(_memory_gib: u32) -> Command {
    cargo()
}

/// Ends a run with everything it has started.
#[cfg(unix)]
fn kill(child: &mut Child) -> std::io::Result<()> {
    use rustix::process::{Pid, Signal, kill_process_group};

    // Fails only where nothing of it is left.
    let _ = kill_process_group(Pid::from_child(child), Signal::KILL);
    child.wait().map(drop)
}

#[cfg(not(unix))]
fn kill(child: &mut Child) -> std::io::Result<()> {
    child.kill()?;
    child.wait().map(drop)
}

/// The text of a log. What is not UTF-8 is replaced, not refused.
pub(crate) fn read(log: &Path) -> std::io::Result<String> {
    std::fs::read(log).map(|bytes| String::from_utf8_lossy(&bytes).into_owned())
}
