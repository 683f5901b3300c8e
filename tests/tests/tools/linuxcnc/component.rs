//! The component outside of LinuxCNC (`component/bench.c`): its clock, pins and client are the
//! test's, so that every call is decided.

use std::process::Command;

use libtest_mimic::Failed;

use super::run::{folder, make};
use crate::capi::tools::{self, library, run, target};

/// Runs every case of the bench, each in a process of its own. Fails with all that are wrong.
pub(super) fn cases() -> Result<(), Failed> {
    let build = target().join("linuxcnc-component");
    make("l2", &build, |header| header)?;
    let (bench, own) = (
        build.join("bench"),
        folder().join("../../tests/tests/tools/linuxcnc/component"),
    );
    let mut compiler = Command::new("gcc");
    compiler.args([
        "-std=gnu11",
        "-g",
        "-O1",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-Wno-unused-parameter",
    ]);
    compiler.args([
        "-DRTAPI",
        "-D_GNU_SOURCE",
        "-Drealtime",
        "-DSIM",
        "-DUSPACE",
        "-I/usr/include/linuxcnc",
    ]);
    for place in [
        build.clone(),
        folder(),
        tools::folder().join("include"),
        tools::folder().join("examples"),
    ] {
        compiler.arg("-I").arg(place);
    }
    compiler.arg(own.join("bench.c"));
    compiler.args(
        ["configuration", "drives", "epochs", "files", "keys", "pins"]
            .map(|name| folder().join(name).with_extension("c")),
    );
    run(compiler
        .arg(library())
        .args(["-lm", "-Wl,--gc-sections", "-o"])
        .arg(&bench))?;
    let number: u32 = run(&mut Command::new(&bench))?.trim().parse().unwrap();
    assert!(number > 20, "{number} cases");
    let failed: Vec<String> = (0..number)
        .filter_map(|case| {
            let epochs = build.join(format!("epochs-{case}"));
            let mut bench = Command::new(&bench);
            let failed = run(bench.arg(case.to_string()).arg(epochs)).err()?;
            failed.message().map(str::to_owned)
        })
        .collect();
    if failed.is_empty() {
        Ok(())
    } else {
        Err(failed.join("\n").into())
    }
}

/// `make` finds the archive where `CARGO_TARGET_DIR` puts it. (That of the tests, so that nothing
/// is built twice.)
pub(super) fn makes_elsewhere() -> Result<(), Failed> {
    let build = target().join("linuxcnc-elsewhere");
    make("l2", &build, |header| header)?;
    for module in ["gantrytaukins.so", "gantry_tau.so"] {
        std::fs::remove_file(build.join(module))?;
    }
    let mut make = Command::new("make");
    make.current_dir(folder())
        .env_remove("MAKEFLAGS")
        .env("CARGO_TARGET_DIR", target())
        .arg("ROBOT=l2");
    run(make
        .arg(format!("BUILD={}", build.display()))
        .arg("GANTRY_TAU=true"))?;
    assert!(build.join("gantry_tau.so").exists());
    Ok(())
}
