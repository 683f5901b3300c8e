//! The C interface (`host/capi`): examples and tests in C are compiled without warnings by the
//! usual compilers and run; their results are compared with core's for the same input.
//!
//! A trial whose tool is missing is reported as ignored, by name; with `GANTRY_TAU_REQUIRE_CAPI=1`
//! it fails instead.
#![allow(
    clippy::arithmetic_side_effects,
    clippy::indexing_slicing,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests fail by panicking"
)]

mod compensation;
mod recipes;
mod scenario;
mod session;
mod target;
pub(crate) mod tools;

use std::collections::BTreeSet;

use libtest_mimic::{Failed, Trial};
use tools::{Program, has};

use crate::needing;

/// Flags that both compilers must accept without a warning.
pub(crate) const STRICT: [&str; 5] = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror"];
const SANITIZED: [&str; 3] = [
    "-g",
    "-fsanitize=address,undefined",
    "-fno-sanitize-recover=all",
];

/// All trials, by name.
pub(crate) fn trials() -> Vec<Trial> {
    let mut trials = vec![
        trial("unit_tests_and_header", &[], unit_tests),
        trial("no_panic_path_is_linked", &[], || no_panic_path("release")),
        trial("no_panic_path_is_linked_when_small", &[], || {
            no_panic_path("small")
        }),
        trial("only_memory_functions_are_needed", &["nm"], needs_nothing),
        trial("header_as_cpp_by_g++", &["g++"], || header_as_cpp("g++")),
        trial("header_as_cpp_by_clang++", &["clang++"], || {
            header_as_cpp("clang++")
        }),
        trial("session_in_valgrind", &["gcc", "valgrind"], || {
            in_valgrind("session")
        }),
        trial("refusals_in_valgrind", &["gcc", "valgrind"], || {
            in_valgrind("refusals")
        }),
        trial("padding_in_valgrind", &["gcc", "valgrind"], || {
            in_valgrind("padding")
        }),
        trial("copies_in_valgrind", &["gcc", "valgrind"], || {
            in_valgrind("copies")
        }),
        trial(
            "recipes_of_the_readme",
            &["gcc", "python3", "sh"],
            recipes::work,
        ),
        trial(
            "half_a_megabyte_is_not_on_the_stack",
            &["gcc", "sh"],
            session::on_a_small_stack,
        ),
    ];
    for compiler in ["gcc", "clang"] {
        for (how, flags) in [("", ["-O2"].as_slice()), ("_sanitized", &SANITIZED)] {
            let mut needed = vec![compiler];
            if has(compiler) && !tools::takes(compiler, flags) {
                needed.push("libclang-rt");
            }
            let by = format!("by_{compiler}{how}");
            trials.extend([
                trial(&format!("session_{by}"), &needed, move || {
                    session::agrees(compiler, flags)
                }),
                trial(&format!("compensation_{by}"), &needed, move || {
                    compensation::agrees(compiler, flags)
                }),
                trial(&format!("random_traffic_{by}"), &needed, move || {
                    scenario::agrees(compiler, flags)
                }),
                trial(&format!("refusals_{by}"), &needed, move || {
                    refusals(compiler, flags)
                }),
                trial(&format!("padding_{by}"), &needed, move || {
                    ends_with("padding", " results\n", compiler, flags)
                }),
                trial(&format!("copies_{by}"), &needed, move || {
                    ends_with("copies", " calls\n", compiler, flags)
                }),
                trial(&format!("environment_{by}"), &needed, move || {
                    ends_with(
                        "environment",
                        "5 environments, 0 nm, unmasked: SIGFPE\n",
                        compiler,
                        flags,
                    )
                }),
            ]);
        }
    }
    trials.extend(target::trials());
    trials
}

/// A trial with the tools that it needs.
fn trial(
    name: &str,
    needed: &[&'static str],
    run: impl FnOnce() -> Result<(), Failed> + Send + 'static,
) -> Trial {
    let missing = needed.iter().find(|tool| !has(tool));
    let missing = missing.map(|tool| format!("{tool} missing"));
    let name = format!("capi::{name}");
    needing::trial(name, missing, "GANTRY_TAU_REQUIRE_CAPI", run)
}

/// Codes, errors, parts of the black box, and that the header agrees with the sources.
fn unit_tests() -> Result<(), Failed> {
    tools::cargo(&["test", "--locked", "--quiet"]).map(drop)
}

/// The library's panic handler calls a function that does not exist.
fn no_panic_path(profile: &str) -> Result<(), Failed> {
    let bytes = std::fs::read(tools::library_of(profile))?;
    let [is_there, can_panic] = ["gt_server_tick", "gantry_tau_panic"].map(|symbol| {
        bytes
            .windows(symbol.len())
            .any(|window| window == symbol.as_bytes())
    });
    assert!(is_there, "the library is there");
    assert!(!can_panic, "some path of the library can panic");
    Ok(())
}

/// Symbols of the library that `nm` lists with this option.
fn symbols(which: &str) -> Result<BTreeSet<String>, Failed> {
    let listing = tools::run(
        std::process::Command::new("nm")
            .args(["-g", which])
            .arg(tools::library()),
    )?;
    Ok(listing
        .lines()
        .filter_map(|line| Some(line.rsplit_once(' ')?.1.to_owned()))
        .collect())
}

/// No malloc, no locks, no output: the library needs only functions that compilers presuppose.
fn needs_nothing() -> Result<(), Failed> {
    let (own, needed) = (symbols("--defined-only")?, symbols("--undefined-only")?);
    assert!(
        own.contains("gt_server_tick") && needed.contains("memcpy"),
        "{own:?} {needed:?}"
    );
    let known = ["memcpy", "memmove", "memset", "memcmp", "bcmp"];
    let foreign = needed
        .difference(&own)
        .filter(|name| !name.starts_with("__"));
    let unknown: Vec<_> = foreign
        .filter(|name| !known.contains(&name.as_str()))
        .collect();
    assert!(unknown.is_empty(), "{unknown:?}");
    Ok(())
}

fn header_as_cpp(compiler: &str) -> Result<(), Failed> {
    let header = tools::folder().join("include/gantry_tau.h");
    let mut command = std::process::Command::new(compiler);
    command.args([
        "-std=c++17",
        "-Wall",
        "-Wextra",
        "-Wpedantic",
        "-Werror",
        "-fsyntax-only",
        "-x",
        "c++",
    ]);
    tools::run(command.arg(header)).map(drop)
}

fn refusals(compiler: &'static str, flags: &[&str]) -> Result<(), Failed> {
    ends_with("refusals", " refusals\n", compiler, flags)
}

/// Compiles and runs a program of `host/capi/tests`, which says this at its end.
fn ends_with(name: &str, end: &str, compiler: &'static str, flags: &[&str]) -> Result<(), Failed> {
    let said = Program::compile(&format!("tests/{name}.c"), compiler, flags)?.run(&[])?;
    assert!(said.ends_with(end), "{said}");
    Ok(())
}

/// Finds reads of uninitialised memory, and accesses beyond the memory of an object.
fn in_valgrind(name: &str) -> Result<(), Failed> {
    let folder = if name == "session" {
        "examples"
    } else {
        "tests"
    };
    let program = Program::compile(&format!("{folder}/{name}.c"), "gcc", &["-O1", "-g"])?;
    let mut command = std::process::Command::new("valgrind");
    command.args(["--quiet", "--error-exitcode=9", "--leak-check=full"]);
    tools::run(command.arg(program.path())).map(drop)
}
