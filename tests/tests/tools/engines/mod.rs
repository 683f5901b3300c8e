//! Motion, modes and loops by other engines: Pinocchio, MuJoCo and SciPy judge what `gantry-tau
//! solve` says of random states of each machine. Tags by other implementations of HMAC: Python's,
//! `cryptography`'s and openssl's.
//!
//! Their Python is that of `target/engines`, where `.ci/run` installs the packages `pin`, `mujoco`,
//! `scipy` and `cryptography` of PyPI, or else `python3`. Without them trials are reported as
//! ignored; with `GANTRY_TAU_REQUIRE_ENGINES=1` they fail instead.
#![allow(
    clippy::arithmetic_side_effects,
    clippy::unwrap_used,
    clippy::panic,
    reason = "tests fail by panicking"
)]

mod tags;

use std::path::{Path, PathBuf};
use std::process::Command;

use libtest_mimic::{Failed, Trial};

use crate::capi::tools::has;
use crate::firmware::program;
use crate::needing;
use crate::python_packages::python_with;

/// Name of a trial, its script, and what that imports.
const ENGINES: [(&str, &str, &str); 7] = [
    (
        "pinocchio_moves_the_machines_alike",
        "of_pinocchio.py",
        "pinocchio, numpy",
    ),
    (
        "pinocchio_reads_descriptions",
        "of_urdf.py",
        "pinocchio, numpy",
    ),
    (
        "mujoco_moves_the_machines_alike",
        "of_mujoco.py",
        "mujoco, numpy",
    ),
    (
        "mujoco_moves_exported_machines_alike",
        "of_mjcf.py",
        "mujoco, scipy, numpy",
    ),
    (
        "mujoco_is_the_machine_of_a_server",
        "mujoco_as_machine.py",
        "mujoco, numpy",
    ),
    (
        "scipy_interpolates_what_the_pacer_asks_for",
        "of_pacer.py",
        "scipy, numpy",
    ),
    (
        "scipy_moves_the_machines_alike",
        "of_scipy.py",
        "scipy, numpy",
    ),
];
/// Implementations of HMAC.
const TAGS: [&str; 3] = ["hmac", "cryptography", "openssl"];
const ROBOTS: [&str; 3] = ["l2", "f1", "l2-stiff"];

/// All trials, by name.
pub(crate) fn trials() -> Vec<Trial> {
    let motion = ENGINES.iter().map(|&(judged, script, packages)| {
        let name = format!("engines::{judged}");
        let python = python_with("engines", packages).ok_or(format!("{packages} of PyPI missing"));
        trial(name, python, move |python| judge(python, script))
    });
    let tags = TAGS.iter().map(|&implementation| {
        let name = format!("engines::{implementation}_computes_the_same_tags");
        trial(name, python_of(implementation), move |python| {
            tags::judge(python, implementation)
        })
    });
    motion.chain(tags).collect()
}

/// Returns the Python that has an implementation of HMAC, or what is missing.
fn python_of(implementation: &str) -> Result<PathBuf, String> {
    let package = match implementation {
        "openssl" if !has("openssl") => return Err("openssl missing".to_owned()),
        "openssl" => "hmac",
        package => package,
    };
    python_with("engines", package).ok_or(format!("{package} of Python missing"))
}

fn trial(
    name: String,
    python: Result<PathBuf, String>,
    judge: impl FnOnce(&Path) -> Result<(), Failed> + Send + 'static,
) -> Trial {
    let missing = python.as_ref().err().cloned();
    needing::trial(name, missing, "GANTRY_TAU_REQUIRE_ENGINES", move || {
        judge(&python?)
    })
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
