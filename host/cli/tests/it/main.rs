//! The built binary as a user runs it: output, files and exit codes.
#![allow(
    clippy::arithmetic_side_effects,
    clippy::indexing_slicing,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::disallowed_methods,
    reason = "tests fail by panicking"
)]

#[cfg(unix)]
mod bus;
mod chain;
mod demo;
#[cfg(target_os = "linux")]
mod docs;
mod draw;
mod drives;
mod errors;
#[cfg(unix)]
mod ethercat;
#[cfg(target_os = "linux")]
mod exhaustion;
#[cfg(unix)]
mod experiment;
mod export;
#[cfg(unix)]
mod faults;
mod follow;
mod gauges;
mod golden;
mod header;
mod identification;
mod installed;
#[cfg(unix)]
mod keyboard;
mod keys;
mod labcomm;
#[cfg(unix)]
mod masses;
mod monitor;
#[cfg(unix)]
mod operator;
mod outputs;
#[cfg(target_os = "linux")]
mod outputs_fail;
#[cfg(unix)]
mod ownership;
#[cfg(unix)]
mod pace;
mod plan;
#[cfg(target_os = "linux")]
mod privileges;
mod process;
#[cfg(unix)]
mod publication;
#[cfg(unix)]
mod recording;
#[cfg(unix)]
mod replay;
mod robot;
#[cfg(unix)]
mod signals;
mod simulator;
mod solve;
mod stability;
mod tool;
mod verify;
mod workspace;
mod wrist;

use process::Folder;

#[test]
fn help_mentions_every_command_and_every_commands_help_works() {
    let folder = Folder::new("help");
    let all = folder.run(&["--help"]).success();
    const COMMANDS: [&str; 25] = [
        "demo",
        "serve",
        "client",
        "monitor",
        "recover",
        "plan",
        "experiment",
        "identify",
        "calibrate",
        "verify",
        "faults",
        "follow",
        "replay",
        "robot",
        "bus",
        "gauges",
        "workspace",
        "draw",
        "header",
        "export",
        "fmu",
        "labcomm",
        "solve",
        "completions",
        "man",
    ];
    for command in COMMANDS {
        assert!(all.contains(&format!("\n  {command} ")), "{all}");
        let help = folder.run(&[command, "--help"]).success();
        assert!(help.contains(&format!("gantry-tau {command}")), "{help}");
        // Found by reading: of three commands they were written down, and never shown.
        let has_codes = ![
            "serve",
            "follow",
            "plan",
            "robot",
            "bus",
            "workspace",
            "draw",
            "header",
            "export",
            "fmu",
            "labcomm",
            "solve",
            "completions",
            "man",
        ]
        .contains(&command);
        assert_eq!(help.contains("Exit codes: 0 "), has_codes, "{help}");
        let help = folder.run(&["help", command]).success();
        assert!(help.contains("Usage:"), "{help}");
    }
    let version = folder.run(&["--version"]).success();
    assert_eq!(
        version.trim(),
        concat!("gantry-tau ", env!("CARGO_PKG_VERSION"))
    );
}
