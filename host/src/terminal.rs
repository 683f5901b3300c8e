//! Output on the terminal.

use std::fmt::Display;
use std::io::Write;

use indicatif::{ProgressBar, ProgressStyle};

/// Prints a line. Continues after the reader has ended (`gantry-tau demo | head`), where `println!` would panic.
pub fn say(line: impl Display) {
    let _ = writeln!(std::io::stdout(), "{line}");
}

/// Creates a progress bar of `count` times `unit`.
pub(crate) fn progress_bar(count: u64, unit: &str) -> ProgressBar {
    let bar = ProgressBar::new(count);
    match ProgressStyle::with_template(&format!("[{{elapsed}}] {{bar:40}} {{pos}}/{{len}} {unit}")) {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}
