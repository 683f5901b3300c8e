//! Options of every command: detail of the log.

use clap::{ArgAction, Args};
use tracing_subscriber::EnvFilter;

/// Detail of the log, which goes to the standard error.
#[derive(Debug, Args)]
pub(super) struct Verbosity {
    /// Log more: -v steps, -vv everything. Without -v and -q the variable RUST_LOG counts, or info
    #[arg(short, long, global = true, action = ArgAction::Count)]
    verbose: u8,
    /// Log less: -q warnings and errors, -qq errors
    #[arg(short, long, global = true, action = ArgAction::Count)]
    quiet: u8,
}

impl Verbosity {
    /// Lines of the log that are written.
    pub(super) fn filter(&self) -> EnvFilter {
        let level = match i16::from(self.verbose).saturating_sub(self.quiet.into()) {
            ..-1 => "error",
            -1 => "warn",
            0 if self.verbose > 0 => "info",
            0 => {
                return EnvFilter::try_from_default_env()
                    .unwrap_or_else(|_| EnvFilter::new("info"));
            }
            1 => "debug",
            2.. => "trace",
        };
        EnvFilter::new(level)
    }
}
