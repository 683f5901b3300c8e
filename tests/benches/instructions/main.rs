//! Instructions per call, counted by Valgrind's callgrind: repeatable to the instruction, under
//! any load of the machine.
//!
//! ```sh
//! cargo bench -p gantry-tau-tests --bench instructions              # counts, and compares with counts.toml
//! cargo bench -p gantry-tau-tests --bench instructions -- --write   # writes counts.toml again
//! cargo bench -p gantry-tau-tests --bench instructions -- --arithmetic   # how many of them compute (needs objdump, too)
//! cargo bench -p gantry-tau-tests --bench instructions -- --growth  # how they grow; draws docs/cost-*.svg
//! ```
//!
//! The committed counts are those of rustc 1.95; another compiler may differ by more than 5 %. Exit
//! codes: 0 every count is within 5 % of the committed one and below its limit, and those that must
//! be are the same; 1 one is not; 3 Valgrind is missing.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::arithmetic_side_effects,
    reason = "a measurement that cannot be made must stop"
)]

mod arithmetic;
mod calls;
mod growth;
#[path = "../setup/mod.rs"]
mod setup;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, ExitCode};

/// The committed counts.
const COUNTS: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/benches/instructions/counts.toml"
);
/// A count may differ by so much from the committed one before somebody has to look.
const TOLERANCE_PERCENT: u64 = 5;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [run, name] = arguments.as_slice() {
        if run == "--run" {
            match name.split_once(':') {
                Some((series, parameter)) => growth::run(series, parameter),
                None => calls::run(name),
            }
            return ExitCode::SUCCESS;
        }
    }
    if Command::new("valgrind").arg("--version").output().is_err() {
        eprintln!("instructions: valgrind is not installed (apt-get install valgrind)");
        return ExitCode::from(3);
    }
    if arguments.iter().any(|argument| argument == "--arithmetic") {
        arithmetic::report();
        return ExitCode::SUCCESS;
    }
    if arguments.iter().any(|argument| argument == "--growth") {
        growth::draw();
        return ExitCode::SUCCESS;
    }
    let counts: BTreeMap<&str, u64> = calls::CALLS
        .iter()
        .map(|call| (call.name, count(call.name)))
        .collect();
    if arguments.iter().any(|argument| argument == "--write") {
        std::fs::write(COUNTS, written(&counts)).unwrap();
    }
    report(&counts)
}

/// Instructions of the call of this name.
fn count(name: &str) -> u64 {
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
        .arg("--toggle-collect=*calls*measured*")
        .arg(std::env::current_exe().unwrap())
        .args(["--run", name])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    let collected = text
        .lines()
        .find_map(|line| line.split_once("Collected : "));
    let (_, number) = collected.unwrap_or_else(|| panic!("{name}: callgrind says\n{text}"));
    let number = number.trim().parse().unwrap();
    assert!(number > 0, "{name}: the call was not found");
    number
}

fn written(counts: &BTreeMap<&str, u64>) -> String {
    let lines = counts
        .iter()
        .map(|(name, count)| format!("{name} = {count}\n"));
    let head = "# Instructions per call, x86-64 baseline, bench profile; written by `cargo bench -p gantry-tau-tests --bench instructions -- --write`.\n";
    head.to_owned() + &lines.collect::<String>()
}

/// Prints the table; whether every count is near the committed one and below its limit.
fn report(counts: &BTreeMap<&str, u64>) -> ExitCode {
    let committed = committed(Path::new(COUNTS));
    let mut good = true;
    println!(
        "{:<24} {:>9} {:>9} {:>9}",
        "call", "counted", "committed", "limit"
    );
    for call in calls::CALLS {
        let counted = counts.get(call.name).copied().unwrap_or(u64::MAX);
        let before = committed.get(call.name).copied().unwrap_or(0);
        let near = counted.abs_diff(before) * 100 <= before * TOLERANCE_PERCENT;
        let below = call.limit.is_none_or(|limit| counted <= limit);
        let limit = call
            .limit
            .map_or_else(|| "-".to_owned(), |limit| limit.to_string());
        let remark = match (near, below) {
            (true, true) => "",
            (_, false) => "  ABOVE ITS LIMIT",
            (false, true) => "  differs by more than 5 %: look, then --write",
        };
        println!(
            "{:<24} {counted:>9} {before:>9} {limit:>9}{remark}",
            call.name
        );
        good &= near && below;
    }
    for (one, other) in calls::ALIKE {
        if counts.get(one) != counts.get(other) {
            println!("{one} and {other} DIFFER: the time says where a tag is wrong");
            good = false;
        }
    }
    ExitCode::from(u8::from(!good))
}

/// `name = number`, line by line.
fn committed(path: &Path) -> BTreeMap<String, u64> {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let entries = text.lines().filter_map(|line| line.split_once(" = "));
    entries
        .map(|(name, number)| (name.to_owned(), number.parse().unwrap()))
        .collect()
}
