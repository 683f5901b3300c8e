//! The library, compilers, and their programs.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, OnceLock, PoisonError};

use gantry_tau_core::control::axis::Reference;
use libtest_mimic::Failed;

/// True if a program can be started.
pub(crate) fn has(tool: &str) -> bool {
    Command::new(tool).arg("--version").output().is_ok()
}

/// True if a compiler takes these flags: its sanitizers are a package of their own.
pub(crate) fn takes(compiler: &str, flags: &[&str]) -> bool {
    let empty = target().join("empty.c");
    let written = std::fs::create_dir_all(target())
        .and_then(|()| std::fs::write(&empty, "int main(void) { return 0; }\n"));
    let mut command = Command::new(compiler);
    command.args(flags).arg(&empty).args(["-o", "/dev/null"]);
    written.is_ok() && run(&mut command).is_ok()
}

/// `host/capi`.
pub(crate) fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../host/capi")
}

/// Folder of everything that is built: that of the panic probe, which has the same dependencies and
/// profile.
pub(crate) fn target() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join("linked")
}

/// Runs a command and returns its output.
pub(crate) fn run(command: &mut Command) -> Result<String, Failed> {
    let output = command
        .output()
        .map_err(|error| format!("{command:?}: {error}"))?;
    let [said, complained] =
        [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
    if output.status.success() {
        Ok(said)
    } else {
        Err(format!("{command:?}: {}\n{said}{complained}", output.status).into())
    }
}

/// Runs cargo in the crate of the C interface.
pub(crate) fn cargo(arguments: &[&str]) -> Result<String, Failed> {
    let mut command = Command::new(env!("CARGO"));
    command.current_dir(folder()).args(arguments);
    run(command.arg("--target-dir").arg(target()))
}

/// The static library, built once.
pub(crate) fn library() -> &'static Path {
    static LIBRARY: OnceLock<PathBuf> = OnceLock::new();
    LIBRARY.get_or_init(|| library_of("release"))
}

/// The static library of a profile of its manifest.
pub(crate) fn library_of(profile: &str) -> PathBuf {
    let built = cargo(&["build", "--profile", profile, "--locked", "--quiet"]);
    built.unwrap_or_else(|failed| panic!("{}", failed.message().unwrap_or("")));
    target().join(profile).join("libgantry_tau.a")
}

/// A C program linked with the library.
pub(crate) struct Program(PathBuf);

/// Programs that are compiled. Several trials run the same one: compiled again, it would be written
/// to while another trial runs it.
static COMPILED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

impl Program {
    /// Compiles a source of `host/capi`, once.
    pub(crate) fn compile(source: &str, compiler: &str, flags: &[&str]) -> Result<Self, Failed> {
        let name = Path::new(source).file_stem().unwrap().to_string_lossy();
        let how = flags.concat().replace(['=', ',', '/'], "-");
        let path = target().join(format!("{name}-{compiler}{how}"));
        let mut command = Command::new(compiler);
        command
            .current_dir(folder())
            .args(super::STRICT)
            .args(flags);
        command.args(["-Iinclude", source]).arg(library());
        // Without functions that are not called, as in firmware.
        command.args(["-lm", "-Wl,--gc-sections", "-o"]).arg(&path);
        let mut compiled = COMPILED.lock().unwrap_or_else(PoisonError::into_inner);
        if !compiled.contains(&path) {
            run(&mut command)?;
            compiled.insert(path.clone());
        }
        Ok(Self(path))
    }

    pub(crate) fn path(&self) -> &Path {
        &self.0
    }

    /// Runs it and returns its output.
    pub(crate) fn run(&self, arguments: &[&Path]) -> Result<String, Failed> {
        run(Command::new(&self.0).args(arguments))
    }

    /// Path of a file beside it.
    pub(crate) fn file(&self, ending: &str) -> PathBuf {
        self.0.with_extension(ending)
    }
}

/// Requires that two texts have the same lines.
pub(crate) fn assert_lines(there: &str, here: &str) {
    for (number, (there, here)) in there.lines().zip(here.lines()).enumerate() {
        assert_eq!(there, here, "line {}", number + 1);
    }
    assert_eq!(there.lines().count(), here.lines().count());
}

/// References of a motor, as the C programs print them.
pub(crate) fn motor_line(reference: &Reference) -> String {
    let Reference {
        position,
        velocity_offset,
        torque_offset,
    } = reference;
    format!(
        "motor {} {} {}\n",
        position.0, velocity_offset.0, torque_offset.0
    )
}

pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

pub(crate) fn from_hex(digits: &str) -> Vec<u8> {
    let pairs = digits.as_bytes().chunks(2);
    pairs
        .map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap())
        .collect()
}
