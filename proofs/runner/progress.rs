//! Progress of the runs: a moving line on a terminal, plain lines elsewhere.

use std::io::{IsTerminal, Write};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use crate::kani::Phase;

/// Progress of all runs.
pub(crate) struct Progress {
    /// Hidden where there is no terminal.
    bar: ProgressBar,
    total: usize,
    plain: bool,
}

impl Progress {
    pub(crate) fn new(total: usize) -> Self {
        Self {
            bar: ProgressBar::no_length(),
            total,
            plain: !std::io::stderr().is_terminal(),
        }
    }

    /// Begins a run.
    pub(crate) fn begin(&mut self, index: usize, name: &str) {
        let line = format!("[{index}/{}] {name}", self.total);
        if self.plain {
            print!("{line} ... ");
            // A reader that has gone is no reason to stop.
            let _ = std::io::stdout().flush();
        } else {
            let style = ProgressStyle::with_template("{spinner} {prefix}  {msg}  {elapsed}");
            self.bar = ProgressBar::new_spinner().with_prefix(line);
            self.bar
                .set_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()));
            self.bar.enable_steady_tick(Duration::from_millis(200));
        }
    }

    /// Shows the phase of the run.
    pub(crate) fn show(&self, phase: Phase) {
        self.bar.set_message(match phase {
            Phase::Building => "building",
            Phase::Solving => "proving",
        });
    }

    /// Ends the run with its result.
    pub(crate) fn end(&self, result: &str) {
        if self.plain {
            println!("{result}");
        } else {
            self.bar.finish_and_clear();
            println!("{}  {result}", self.bar.prefix());
        }
    }
}
