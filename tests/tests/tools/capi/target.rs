//! The examples on the target: built for a Cortex-M7, run in QEMU, and compared to the bit with
//! core on this machine.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use libtest_mimic::{Failed, Trial};

use super::tools::{folder, run, target};
use super::{STRICT, compensation, session, trial};

const COMPILER: &str = "arm-none-eabi-gcc";
const PROCESSOR: [&str; 4] = [
    "-mcpu=cortex-m7",
    "-mthumb",
    "-mfloat-abi=hard",
    "-mfpu=fpv5-d16",
];

pub(crate) fn trials() -> Vec<Trial> {
    let mut needed = vec!["bash", "timeout", "qemu-system-arm", COMPILER];
    if !has_newlib() {
        needed.push("newlib");
    }
    if !has_toolchain() {
        needed.push("thumbv7em-none-eabihf");
    }
    vec![
        trial("session_on_the_target", &needed, session_agrees),
        trial("compensation_on_the_target", &needed, compensation_agrees),
    ]
}

/// True if C's standard library for the target is installed, with output through the emulator.
fn has_newlib() -> bool {
    let asked = run(Command::new(COMPILER).arg("-print-file-name=rdimon.specs"));
    asked.is_ok_and(|path| path.contains('/'))
}

/// Command of the build script for the target.
fn build_script() -> Command {
    let mut command = Command::new("bash");
    command.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("firmware/build.sh"));
    command
}

/// True if Rust can build for the target.
fn has_toolchain() -> bool {
    run(build_script().arg("check")).is_ok()
}

/// The static library for the target, built once.
fn library() -> &'static Path {
    static LIBRARY: OnceLock<PathBuf> = OnceLock::new();
    LIBRARY.get_or_init(|| {
        let mut build = build_script();
        build
            .args(["m7", "--manifest-path"])
            .arg(folder().join("Cargo.toml"));
        // Beside the firmware and at its level, so that most dependencies are the same.
        let built = run(build.args(["--config", "profile.release.opt-level=2"]));
        let said = built.unwrap_or_else(|failed| panic!("{}", failed.message().unwrap_or("")));
        // The last line is the folder.
        Path::new(said.trim_end().lines().last().unwrap()).join("libgantry_tau.a")
    })
}

/// Compiles an example for the target.
fn compile(name: &str) -> Result<PathBuf, Failed> {
    let image = target().join(format!("{name}-m7.elf"));
    let mut command = Command::new(COMPILER);
    command.current_dir(folder()).args(STRICT).args(PROCESSOR);
    command.args([
        "-O2",
        "--specs=rdimon.specs",
        "-Iinclude",
        "-T",
        "examples/target/mps2-an500.ld",
    ]);
    command
        .arg(format!("examples/{name}.c"))
        .arg("examples/target/start.c")
        .arg(library());
    run(command
        .args(["-lm", "-Wl,--gc-sections,-z,noexecstack", "-o"])
        .arg(&image))?;
    Ok(image)
}

/// Runs an image in the emulator, which shuts down with the program's exit code.
fn emulate(image: &Path, arguments: &[&Path]) -> Result<String, Failed> {
    let mut options = "enable=on,target=native,arg=example".to_owned();
    for argument in arguments {
        options += &format!(",arg={}", argument.display());
    }
    let mut command = Command::new("timeout");
    command.args([
        "300",
        "qemu-system-arm",
        "-M",
        "mps2-an500",
        "-display",
        "none",
        "-serial",
        "null",
    ]);
    command.args([
        "-monitor",
        "none",
        "-semihosting-config",
        &options,
        "-kernel",
    ]);
    run(command.arg(image))
}

fn session_agrees() -> Result<(), Failed> {
    let image = compile("session")?;
    let (trace, black_box) = (
        target().join("session-m7.trace"),
        target().join("session-m7.gtbb"),
    );
    let said = emulate(&image, &[&trace, &black_box])?;
    assert!(said.contains("all bounds held over 700 ticks"), "{said}");
    session::compare(&std::fs::read_to_string(trace)?, &std::fs::read(black_box)?);
    Ok(())
}

fn compensation_agrees() -> Result<(), Failed> {
    let image = compile("compensation")?;
    compensation::compare(&emulate(&image, &[])?);
    Ok(())
}
