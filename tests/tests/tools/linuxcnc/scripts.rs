//! The scripts of host/linuxcnc: the demonstration, and the comparison with LinuxCNC's own external
//! offsets.

use std::path::{Path, PathBuf};

use libtest_mimic::Failed;
use serde_json::Value;

use super::run::{Machine, copy, folder};
use super::server::hal;

/// Copies the scripts as they stand in the repository, with robot files, and returns their folder.
fn scripts(machine: &Machine) -> Result<PathBuf, Failed> {
    // Without the sampler of the other tests: these have their own.
    let place = machine.file("scripts");
    let scripts = place.join("host/linuxcnc");
    copy(&folder().join("config"), &scripts.join("config"))?;
    for name in ["trial.py", "demo.py", "eoffset.py"] {
        std::fs::copy(folder().join(name), scripts.join(name))?;
    }
    copy(
        &Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots"),
        &place.join("robots"),
    )?;
    Ok(scripts)
}

/// README.md has the table that the script prints.
pub(super) fn does_what_the_readme_says() -> Result<(), Failed> {
    let machine = Machine::new("l2", "eoffset", |header| header)?;
    let script = scripts(&machine)?.join("eoffset.py");
    let said = machine.unprivileged(&format!(
        "{} {}",
        script.display(),
        machine.file("out").display()
    ))?;
    assert!(said.starts_with("| event |"), "{said}");
    let readme = std::fs::read_to_string(folder().join("README.md"))?;
    assert!(
        readme.contains(said.trim_end()),
        "README.md has another table than this one:\n{said}"
    );
    Ok(())
}

/// The demonstration as `make demo` runs it: what it judges is as it should be, and the report is
/// written.
pub(super) fn demonstration() -> Result<(), Failed> {
    let machine = Machine::new("l2", "demo", |header| header)?;
    let scripts = scripts(&machine)?;
    // Where the unprivileged user may read them.
    let built = hal::program();
    let [program, report] =
        ["gantry-tau", "gantry-tau-linuxcnc-report"].map(|name| scripts.join(name));
    for program in [&program, &report] {
        std::fs::copy(built.with_file_name(program.file_name().unwrap()), program)?;
    }
    let out = machine.file("out");
    let script = scripts.join("demo.py");
    let said = machine.unprivileged(&format!(
        "{} --gantry-tau {} --report {} {}",
        script.display(),
        program.display(),
        report.display(),
        out.display()
    ))?;
    assert!(said.contains("All as it should be."), "{said}");
    assert!(
        said.contains(
            "a newcomer meanwhile: gantry-tau: refused: offsets are still ramping to zero"
        ),
        "{said}"
    );
    let report = std::fs::read_to_string(out.join("report.html"))?;
    // Two paths, displacement, offsets, ramp, force, position, state.
    assert_eq!(report.matches("<svg").count(), 8);
    let results: Value =
        serde_json::from_str(&std::fs::read_to_string(out.join("report.json"))?).unwrap();
    for session in results["sessions"].as_array().unwrap() {
        assert_eq!(session["missed"], 0, "{session}");
        assert!(
            (session["force_n"].as_f64().unwrap() - 300.0).abs() < 1e-3,
            "{session}"
        );
        assert!(
            session["remaining_share"].as_f64().unwrap() < 0.05,
            "{session}"
        );
    }
    let [ramp] = results["ramps"].as_array().unwrap().as_slice() else {
        panic!("{results}")
    };
    assert_eq!(ramp["ticks"], ramp["expected_ticks"]);
    assert!(
        ramp["moving"].as_u64().unwrap() > 1_000,
        "the program goes on: {ramp}"
    );
    Ok(())
}
