//! Output on the terminal.

use std::fmt::Display;
use std::io::Write;

/// Prints a line. Continues after the reader has ended (`gantry-tau demo | head`), where `println!` would panic.
pub fn say(line: impl Display) {
    let _ = writeln!(std::io::stdout(), "{line}");
}
