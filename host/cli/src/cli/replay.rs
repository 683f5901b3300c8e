//! `gantry-tau replay`.

use std::path::PathBuf;
use std::process::ExitCode;

use crate::replay::ReplayOptions;
use clap::Args;
use gantry_tau_system::output::{Kind, Output};

use super::Outcome;
use super::outputs::{InputFile, file};

/// Run a black box through the core again and compare every output bit for bit
///
/// Black boxes are written by `serve --black-box`, `demo --black-box` and programs in C. Those of
/// the server's position loops (`*.loops.jsonl`, beside that of the session) are run again through
/// the loops.
///
/// Exit codes: 0 all outputs agree; 1 the file is not a black box, or page or JSON cannot be
/// written; 2 usage; 3 an output differs.
#[derive(Debug, Args)]
pub(crate) struct Replay {
    /// Path of the black box
    #[arg(value_name = "FILE")]
    file: InputFile,
    /// Draw offsets, phases, misses and events over the ticks relative to the cause
    #[arg(long, alias = "plot", value_name = "FILE.svg|FILE.html", value_parser = page_or_picture)]
    report: Option<Output>,
    /// Write the findings as JSON as well
    #[arg(long, value_name = "FILE", value_parser = file(Kind::Answer))]
    json: Option<Output>,
}

impl Replay {
    pub(crate) fn run(self) -> Outcome {
        let options = ReplayOptions {
            file: self.file.into(),
            report: self.report,
            json: self.json,
        };
        Ok(ExitCode::from(if crate::replay::run(&options)? {
            0
        } else {
            3
        }))
    }
}

fn page_or_picture(text: &str) -> Result<Output, &'static str> {
    let path = PathBuf::from(text);
    let ending = path.extension().and_then(|ending| ending.to_str());
    match ending {
        Some("svg") => Ok(Output::new(path, Kind::Picture)),
        Some("html") => Ok(Output::new(path, Kind::Page)),
        _ => Err("the name must end in .svg or .html"),
    }
}
