//! Lines for whoever started a command.

use std::fmt::Display;
use std::io::Write;

/// Prints a line. A reader that has gone (`gantry-tau demo | head`) is no reason to stop, as `println!` would by panicking.
pub fn say(line: impl Display) {
    let _ = writeln!(std::io::stdout(), "{line}");
}
