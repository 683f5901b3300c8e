//! Motion, modes and loops by other engines: Pinocchio, MuJoCo and SciPy judge what `gantry-tau
//! solve` says of random states of each machine.
//!
//! Their Python is that of `target/engines`, where `.ci/run` installs the packages `pin`, `mujoco`
//! and `scipy` of PyPI, or else `python3`. Without them trials are reported as ignored; with
//! `GANTRY_TAU_REQUIRE_ENGINES=1` they fail instead.
#![allow(clippy::unwrap_used, clippy::panic, reason = "tests fail by panicking")]

use std::path::Path;
use std::process::Command;

use libtest_mimic::{Failed, Trial};

use crate::firmware::program;
use crate::python_packages::python_with;

/// Name of the trials, script, and what it imports.
const ENGINES: [(&str, &str, &str); 3] = [
    ("pinocchio", "of_pinocchio.py", "pinocchio, numpy"),
    ("mujoco", "of_mujoco.py", "mujoco, numpy"),
    ("scipy", "of_scipy.py", "scipy, numpy"),
];
const ROBOTS: [&str; 3] = ["l2", "f1", "l2-stiff"];

/// All trials, by name.
pub(crate) fn trials() -> Vec<Trial> {
    ENGINES
        .iter()
        .map(|&(engine, script, packages)| {
            let name = format!("engines::{engine}_moves_the_machines_alike");
            if let Some(python) = python_with("engines", packages) {
                return Trial::test(name, move || judge(&python, script));
            }
            let missing = format!("{packages} of PyPI missing");
            if std::env::var_os("GANTRY_TAU_REQUIRE_ENGINES").is_some_and(|value| value == "1") {
                let said = Failed::from(&missing);
                return Trial::test(name, || Err(said)).with_kind(missing);
            }
            Trial::test(name, || Ok(()))
                .with_kind(missing)
                .with_ignored_flag(true)
        })
        .collect()
}

fn judge(python: &Path, script: &str) -> Result<(), Failed> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let program = program::build();
    for robot in ROBOTS {
        let judged = Command::new(python)
            .arg("-B")
            .arg(folder.join("tests/tools/engines").join(script))
            .arg(&program)
            .arg(folder.join(format!("../robots/{robot}.toml")))
            .output()?;
        let said = [&judged.stdout, &judged.stderr].map(|text| String::from_utf8_lossy(text));
        println!("{}", said.concat());
        if !judged.status.success() {
            return Err(said.concat().into());
        }
    }
    Ok(())
}
