//! The built binary, as a user meets it: what it prints, what it writes, how it ends.
#![allow(
    clippy::arithmetic_side_effects,
    clippy::indexing_slicing,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests fail by panicking"
)]

#[path = "command_line/demo.rs"]
mod demo;
#[path = "command_line/errors.rs"]
mod errors;
#[cfg(target_os = "linux")]
#[path = "command_line/exhaustion.rs"]
mod exhaustion;
#[cfg(unix)]
#[path = "command_line/faults.rs"]
mod faults;
#[path = "command_line/process.rs"]
mod process;
#[cfg(unix)]
#[path = "command_line/replay.rs"]
mod replay;
#[cfg(unix)]
#[path = "command_line/signals.rs"]
mod signals;
#[path = "command_line/solve.rs"]
mod solve;
#[path = "command_line/workspace.rs"]
mod workspace;

use process::Folder;

#[test]
fn help_mentions_every_command_and_every_commands_help_works() {
    let folder = Folder::new("help");
    let all = folder.run(&["--help"]).success();
    for command in [
        "demo",
        "serve",
        "client",
        "faults",
        "replay",
        "workspace",
        "solve",
    ] {
        assert!(all.contains(&format!("\n  {command} ")), "{all}");
        let help = folder.run(&[command, "--help"]).success();
        assert!(help.contains(&format!("gantry-tau {command}")), "{help}");
        // Found by reading: of three commands they were written down, and never shown.
        let has_codes = ["demo", "client", "faults", "replay"].contains(&command);
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
