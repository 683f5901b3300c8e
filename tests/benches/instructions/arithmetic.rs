//! Count of the instructions that are arithmetic on doubles: the lower bound of a call whose
//! formulas are as short as written.

use std::collections::BTreeMap;
use std::fs;
use std::process::Command;

use crate::calls;

/// Prints, for every call that computes with doubles: instructions, how many of them add, subtract,
/// multiply, divide or take a root, and how many operations these do, two where both lanes of a
/// register are used.
pub(crate) fn report() {
    let lanes = lanes_by_address();
    println!(
        "{:<22} {:>9} {:>11} {:>11}",
        "call", "counted", "arithmetic", "operations"
    );
    for call in calls::CALLS {
        let (mut counted, mut arithmetic, mut operations) = (0, 0, 0);
        for (address, times) in executed(call.name) {
            counted += times;
            if let Some(lanes) = lanes.get(&address) {
                arithmetic += times;
                operations += times * lanes;
            }
        }
        if arithmetic > 0 {
            println!(
                "{:<22} {counted:>9} {arithmetic:>11} {operations:>11}",
                call.name
            );
        }
    }
}

/// Every arithmetic instruction of this program, and how many numbers it makes.
fn lanes_by_address() -> BTreeMap<u64, u64> {
    let output = Command::new("objdump")
        .args(["-d", "--no-show-raw-insn"])
        .arg(std::env::current_exe().unwrap())
        .output()
        .unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    let lines = text.lines().filter_map(|line| line.split_once(":\t"));
    lines
        .filter_map(|(address, instruction)| {
            let name = instruction.split_whitespace().next()?;
            let lanes = match name.get(name.len().saturating_sub(2)..)? {
                "sd" => 1,
                "pd" => 2,
                _ => return None,
            };
            let operation = name.get(..name.len().saturating_sub(2))?;
            let arithmetic = ["add", "sub", "mul", "div", "sqrt"].contains(&operation);
            let address = u64::from_str_radix(address.trim(), 16).ok()?;
            arithmetic.then_some((address, lanes))
        })
        .collect()
}

/// Every instruction that the call of this name executes in this program, and how often. What it
/// executes elsewhere (libc copies and compares) has an address of its own object, and is under 0.
fn executed(name: &str) -> Vec<(u64, u64)> {
    let program = std::env::current_exe().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("callgrind");
    let status = Command::new("valgrind")
        .args(["--tool=callgrind", "--dump-instr=yes", "-q"])
        .args(["--compress-pos=no", "--compress-strings=no"])
        .arg(format!("--callgrind-out-file={}", file.display()))
        .arg("--toggle-collect=*calls*measured*")
        .arg(&program)
        .args(["--run", name])
        .status()
        .unwrap();
    assert!(status.success(), "{name}: {status}");
    let text = fs::read_to_string(&file).unwrap();
    let (mut ours, mut called) = (false, false);
    let mut found = Vec::new();
    for line in text.lines() {
        if let Some(object) = line.strip_prefix("ob=") {
            ours = program.to_str() == Some(object);
        }
        if let Some(position) = line.strip_prefix("0x") {
            // The line after `calls=` is what the callee cost.
            if !called {
                let mut numbers = position.split(' ');
                let address = u64::from_str_radix(numbers.next().unwrap(), 16).unwrap();
                let times = numbers.nth(1).unwrap().parse().unwrap();
                found.push((if ours { address } else { 0 }, times));
            }
        }
        called = line.starts_with("calls=");
    }
    found
}
