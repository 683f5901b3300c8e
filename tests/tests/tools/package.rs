//! The Debian package: built by `.ci/package`, judged by lintian, installed into a root of its own,
//! run from there, and removed.
//!
//! A trial whose tool is missing is reported as ignored, with its name; with
//! `GANTRY_TAU_REQUIRE_PACKAGE=1` it fails instead.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests fail by panicking"
)]

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use libtest_mimic::{Failed, Trial};

use crate::capi::tools::{has, run};
use crate::firmware::program;
use crate::needing;

/// Files of a part each: program, manual, completions, robot files, documentation, units.
const FILES: [&str; 10] = [
    "usr/bin/gantry-tau",
    "usr/share/man/man1/gantry-tau-serve.1.gz",
    "usr/share/bash-completion/completions/gantry-tau",
    "usr/share/zsh/vendor-completions/_gantry-tau",
    "usr/share/fish/vendor_completions.d/gantry-tau.fish",
    "usr/share/gantry-tau/robots/l2.toml",
    "usr/share/doc/gantry-tau/copyright",
    "usr/share/doc/gantry-tau/docs/cli.md",
    "usr/lib/systemd/system/gantry-tau.service",
    "usr/lib/systemd/system/gantry-tau.socket",
];

/// All trials, by name.
pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial(
            "lintian_finds_no_error",
            missing(&["cargo-deb", "dpkg", "lintian"]),
            is_sound,
        ),
        trial(
            "it_is_installed_runs_the_demo_and_is_removed",
            missing(&["cargo-deb", "dpkg"]),
            is_installed,
        ),
    ]
}

fn missing(tools: &[&str]) -> Option<String> {
    let tool = tools.iter().find(|tool| !has(tool));
    tool.map(|tool| format!("{tool} missing"))
}

fn trial(name: &str, missing: Option<String>, body: fn() -> Result<(), Failed>) -> Trial {
    needing::trial(
        format!("package::{name}"),
        missing,
        "GANTRY_TAU_REQUIRE_PACKAGE",
        body,
    )
}

/// Folder of this test.
fn folder() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join("package")
}

/// The package, built once.
fn package() -> &'static Path {
    static PACKAGE: OnceLock<PathBuf> = OnceLock::new();
    PACKAGE.get_or_init(|| {
        let place = folder();
        let _ = fs::remove_dir_all(&place);
        fs::create_dir_all(&place).unwrap();
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../.ci/package");
        let built = run(Command::new(script).arg(&place).arg(program::build())).unwrap();
        PathBuf::from(built.trim())
    })
}

fn is_sound() -> Result<(), Failed> {
    run(Command::new("lintian")
        .args(["--fail-on", "error"])
        .arg(package()))
    .map(drop)
}

/// As the superuser by dpkg, with a database of its own; otherwise unpacked.
fn is_installed() -> Result<(), Failed> {
    let root = folder().join("root");
    let database = root.join("var/lib/dpkg");
    fs::create_dir_all(database.join("info"))?;
    fs::create_dir_all(database.join("updates"))?;
    fs::write(database.join("status"), "")?;
    let is_superuser = fs::metadata(&database)?.uid() == 0;
    if is_superuser {
        // The system's libraries are not in this root.
        run(dpkg(&root).arg("--force-depends").arg("-i").arg(package()))?;
    } else {
        run(Command::new("dpkg-deb").arg("-x").arg(package()).arg(&root))?;
    }
    for file in FILES {
        assert!(root.join(file).is_file(), "{file}");
    }
    starts_the_program_of_the_package(&root);
    runs_the_demo(&root.join("usr/bin/gantry-tau"))?;
    if is_superuser {
        run(dpkg(&root).args(["--purge", "gantry-tau"]))?;
        assert!(!root.join("usr").exists(), "something is left");
    }
    Ok(())
}

/// dpkg in a root of its own.
fn dpkg(root: &Path) -> Command {
    let mut command = Command::new("dpkg");
    command
        .arg(format!("--root={}", root.display()))
        .arg("--force-not-root");
    command
}

fn starts_the_program_of_the_package(root: &Path) {
    let unit = root.join("usr/lib/systemd/system/gantry-tau.service");
    let text = fs::read_to_string(unit).unwrap();
    let started = text
        .lines()
        .find_map(|line| line.strip_prefix("ExecStart=/"));
    let program = started.unwrap().split(' ').next().unwrap();
    assert!(root.join(program).is_file(), "{program}");
}

fn runs_the_demo(program: &Path) -> Result<(), Failed> {
    let place = tempfile::tempdir()?;
    let demo = [
        "demo",
        "--pace",
        "lockstep",
        "--step-seconds",
        "0.5",
        "--force-max",
        "60",
    ];
    let said = run(Command::new(program).args(demo).current_dir(place.path()))?;
    assert!(said.contains("All as it should be."), "{said}");
    assert!(place.path().join("report.html").is_file());
    Ok(())
}
