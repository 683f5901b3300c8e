//! Functional mock-up units, judged by FMPy: validated, simulated, compared with a server in lock-step,
//! and used wrongly.
//!
//! Its Python is that of `target/fmpy`, where `.ci/run` installs the package `fmpy` of PyPI, or else
//! `python3`. Without it trials are reported as ignored; with `GANTRY_TAU_REQUIRE_FMI=1` they fail
//! instead.
#![allow(
    clippy::arithmetic_side_effects,
    clippy::unwrap_used,
    clippy::panic,
    reason = "tests fail by panicking"
)]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use libtest_mimic::{Failed, Trial};

use crate::capi::tools::has;
use crate::firmware::program;
use crate::needing;
use crate::python_packages::python_with;

/// Name of a trial, and its script.
const JUDGED: [(&str, &str); 5] = [
    ("units_are_valid_and_can_be_simulated", "of_validity.py"),
    ("coupled_units_equal_serve_in_lock_step", "of_lockstep.py"),
    (
        "states_are_restored_and_instances_are_apart",
        "of_states.py",
    ),
    ("wrong_calls_are_errors_with_a_text", "of_refusals.py"),
    ("the_program_of_the_page_does_what_it_says", "of_page.py"),
];

/// All trials, by name.
pub(crate) fn trials() -> Vec<Trial> {
    let judged = JUDGED.iter().map(|&(name, script)| {
        let python = python_with("fmpy", "fmpy").ok_or("fmpy of PyPI missing".to_owned());
        let missing = python.as_ref().err().cloned();
        trial(name, missing, move || judge(&python?, script))
    });
    let missing = (!has("nm")).then(|| "nm missing".to_owned());
    let exports = trial("the_library_exports_the_interface_alone", missing, exports);
    judged.chain([exports]).collect()
}

fn trial(
    name: &str,
    missing: Option<String>,
    body: impl FnOnce() -> Result<(), Failed> + Send + 'static,
) -> Trial {
    needing::trial(
        format!("fmi::{name}"),
        missing,
        "GANTRY_TAU_REQUIRE_FMI",
        body,
    )
}

/// Builds the program and, beside it, the library of the units. Returns their paths.
fn built() -> &'static (PathBuf, PathBuf) {
    static BUILT: OnceLock<(PathBuf, PathBuf)> = OnceLock::new();
    BUILT.get_or_init(|| {
        let program = program::build();
        let profile = program::cargo(&["build", "-p", "gantry-tau-fmi-library"], "dev");
        let library = profile.join(format!(
            "{}gantry_tau_fmu{}",
            std::env::consts::DLL_PREFIX,
            std::env::consts::DLL_SUFFIX
        ));
        (program, library)
    })
}

fn judge(python: &Path, script: &str) -> Result<(), Failed> {
    let (program, _) = built();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let judged = Command::new(python)
        .arg("-B")
        .arg(folder.join("tests/tools/fmi").join(script))
        .arg(program)
        .output()?;
    let said = [&judged.stdout, &judged.stderr].map(|text| String::from_utf8_lossy(text));
    println!("{}", said.concat());
    if judged.status.success() {
        Ok(())
    } else {
        Err(said.concat().into())
    }
}

/// Calls of FMI 2.0 for co-simulation, with those that model exchange shares.
const CALLS: &str = "fmi2CancelStep fmi2DeSerializeFMUstate fmi2DoStep fmi2EnterInitializationMode fmi2ExitInitializationMode
    fmi2FreeFMUstate fmi2FreeInstance fmi2GetBoolean fmi2GetBooleanStatus fmi2GetDirectionalDerivative fmi2GetFMUstate fmi2GetInteger
    fmi2GetIntegerStatus fmi2GetReal fmi2GetRealOutputDerivatives fmi2GetRealStatus fmi2GetStatus fmi2GetString fmi2GetStringStatus
    fmi2GetTypesPlatform fmi2GetVersion fmi2Instantiate fmi2Reset fmi2SerializeFMUstate fmi2SerializedFMUstateSize fmi2SetBoolean
    fmi2SetDebugLogging fmi2SetFMUstate fmi2SetInteger fmi2SetReal fmi2SetRealInputDerivatives fmi2SetString fmi2SetupExperiment
    fmi2Terminate";

fn exports() -> Result<(), Failed> {
    let (_, library) = built();
    let listed = Command::new("nm")
        .args(["-D", "--defined-only", "--format=posix"])
        .arg(library)
        .output()?;
    let listed = String::from_utf8(listed.stdout)?;
    let mut found: Vec<&str> = listed
        .lines()
        .filter_map(|line| line.split_whitespace().next())
        .collect();
    found.sort_unstable();
    let expected: Vec<&str> = CALLS.split_whitespace().collect();
    if found == expected {
        Ok(())
    } else {
        Err(format!("exported: {found:?}").into())
    }
}
