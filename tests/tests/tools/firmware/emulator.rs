//! The tools: the script that builds, the emulator, the decoder of logs.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use super::process::Process;

/// Longest run of the emulator; nothing depends on how fast it is.
const DEADLINE: Duration = Duration::from_secs(300);

/// Variant that `build.sh` builds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Build {
    /// Cortex-M7 with a double FPU.
    M7,
    /// The same, as small as it gets.
    M7Small,
    /// Cortex-M7, with keys.
    M7Keyed,
    /// The same, as small as it gets.
    M7SmallKeyed,
    /// Cortex-M4 with a single FPU; doubles are computed with integers.
    M4f,
}

impl Build {
    /// All variants.
    pub(crate) const ALL: [Self; 5] = [
        Self::M7,
        Self::M7Small,
        Self::M7Keyed,
        Self::M7SmallKeyed,
        Self::M4f,
    ];

    /// Returns the name of `build.sh`.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::M7 => "m7",
            Self::M7Small => "m7-small",
            Self::M7Keyed => "m7-keyed",
            Self::M7SmallKeyed => "m7-small-keyed",
            Self::M4f => "m4f",
        }
    }

    /// Returns the emulator's name of its board.
    pub(crate) const fn machine(self) -> &'static str {
        match self {
            Self::M7 | Self::M7Small | Self::M7Keyed | Self::M7SmallKeyed => "mps2-an500",
            Self::M4f => "mps2-an386",
        }
    }
}

/// The firmware's folder.
pub(crate) fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("firmware")
}

/// Returns an empty folder of this name.
pub(crate) fn place(name: &str) -> PathBuf {
    let place = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    // Files of an earlier run must not count.
    let _ = fs::remove_dir_all(&place);
    fs::create_dir_all(&place).unwrap();
    place
}

/// Returns the tool that is missing to build and run the firmware.
pub(crate) fn missing() -> Option<String> {
    if !runs("qemu-system-arm") {
        return Some("qemu-system-arm".to_owned());
    }
    let output = Command::new(folder().join("build.sh"))
        .arg("check")
        .output();
    let Ok(output) = output else {
        return Some("a shell to run tests/firmware/build.sh".to_owned());
    };
    let said = String::from_utf8_lossy(&output.stdout);
    let skipped = said.lines().find_map(|line| line.strip_prefix("SKIPPED: "));
    match (skipped, output.status.success()) {
        (Some(reason), _) => Some(reason.to_owned()),
        (None, true) => None,
        (None, false) => Some(format!("a toolchain: {}", text(&output.stderr))),
    }
}

/// Returns the decoder of logs, if it is missing.
pub(crate) fn decoder_missing() -> Option<String> {
    (!runs("defmt-print")).then(|| "defmt-print".to_owned())
}

fn runs(program: &str) -> bool {
    let mut command = Command::new(program);
    command
        .arg("--version")
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

/// Builds, with further arguments of cargo; returns the folder of the images.
pub(crate) fn images(build: Build, arguments: &[&str]) -> PathBuf {
    images_of(&folder(), build, arguments)
}

/// Builds the firmware in another folder.
pub(crate) fn images_of(folder: &Path, build: Build, arguments: &[&str]) -> PathBuf {
    let mut command = Command::new(folder.join("build.sh"));
    command.arg(build.name()).args(arguments);
    let output = command.output().unwrap();
    let said = text(&output.stdout);
    assert!(
        output.status.success(),
        "build.sh: {said}{}",
        text(&output.stderr)
    );
    PathBuf::from(said.lines().last().unwrap())
}

/// Runs an image in `place`. Returns the bytes of its console.
pub(crate) fn run(build: Build, image: &Path, place: &Path) -> Vec<u8> {
    let mut command = Command::new("qemu-system-arm");
    command
        .args([
            "-machine",
            build.machine(),
            "-nographic",
            "-monitor",
            "none",
            "-serial",
            "none",
        ])
        // An instruction takes 32 ns, always: what is counted is the same in every run.
        .args(["-icount", "shift=5,align=off,sleep=off"])
        .arg("-semihosting-config")
        .arg("enable=on,target=native")
        .arg("-kernel")
        .arg(image)
        .current_dir(place)
        .stdin(Stdio::null())
        // A file, because an unread pipe fills up.
        .stdout(fs::File::create(place.join("console")).unwrap());
    let status = Process::start(&mut command).end(DEADLINE, String::new);
    let console = fs::read(place.join("console")).unwrap();
    assert!(
        status.success(),
        "the firmware ends with {status}; {} bytes of log",
        console.len()
    );
    console
}

/// Decodes a log.
pub(crate) fn decode(image: &Path, log: &Path) -> String {
    let output = Command::new("defmt-print")
        .arg("-e")
        .arg(image)
        .args(["--log-format", "{s}", "stdin"])
        .stdin(fs::File::open(log).unwrap())
        .output();
    let output: Output = output.unwrap();
    assert!(
        output.status.success(),
        "defmt-print: {}",
        text(&output.stderr)
    );
    text(&output.stdout)
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}
