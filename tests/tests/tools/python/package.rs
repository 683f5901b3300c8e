//! The package for Python (`host/python/gantry_tau`): its functions beside the program, and its
//! notebook. `.ci/run` builds its wheel, and runs `of_wheel.py` in a fresh environment.
//!
//! Their Python is that of `target/wheel`, where `.ci/run` installs what they need of PyPI.

use std::path::{Path, PathBuf};
use std::process::Command;

use libtest_mimic::{Failed, Trial};

use super::folder;
use crate::firmware::program;
use crate::needing;
use crate::python_packages::python_with;

/// Returns all trials.
pub(super) fn trials() -> Vec<Trial> {
    [
        trial(
            "package_says_what_the_program_says",
            "numpy, pandas, mcap, mypy",
            package,
        ),
        trial(
            "notebook_finds_springs",
            "nbclient, ipykernel, pandas, matplotlib",
            notebook,
        ),
    ]
    .into()
}

fn trial(name: &str, packages: &'static str, judge: fn(&Path) -> Result<(), Failed>) -> Trial {
    let python = python_with("wheel", packages);
    let missing = python
        .is_none()
        .then(|| format!("{packages} of PyPI missing"));
    needing::trial(
        format!("python::{name}"),
        missing,
        "GANTRY_TAU_REQUIRE_WHEEL",
        move || judge(&python.unwrap_or_default()),
    )
}

fn package(python: &Path) -> Result<(), Failed> {
    run(python, "of_package.py", &[program::build(), folder()])
}

fn notebook(python: &Path) -> Result<(), Failed> {
    run(python, "of_notebook.py", &[program::build(), folder()])
}

/// Runs a script of this folder to its end.
fn run(python: &Path, script: &str, arguments: &[PathBuf]) -> Result<(), Failed> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/tools/python");
    let ended = Command::new(python)
        .arg("-B")
        .arg(here.join(script))
        .args(arguments)
        .output()?;
    let said = [&ended.stdout, &ended.stderr].map(|text| String::from_utf8_lossy(text));
    println!("{}", said.concat());
    if !ended.status.success() {
        return Err(said.concat().into());
    }
    Ok(())
}
