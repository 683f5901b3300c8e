//! `gantry-tau man`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use crate::terminal::say;
use clap::{Args, Command, CommandFactory};
use gantry_tau_system::output::{Kind, Output, write_all};

use super::{Arguments, Outcome};

/// Write a manual page for each command into a folder
///
/// gantry-tau.1, gantry-tau-demo.1 and so on, of what --help says: `man -l FOLDER/gantry-tau.1`, or
/// `man gantry-tau` with FOLDER in a man1 of the manual path. The Debian package has them.
#[derive(Debug, Args)]
pub(crate) struct Man {
    /// Folder, made if it is not there
    #[arg(value_name = "FOLDER")]
    folder: PathBuf,
}

impl Man {
    pub(super) fn run(self) -> Outcome {
        let folder = self.folder.display();
        std::fs::create_dir_all(&self.folder)
            .map_err(|error| format!("{folder}: cannot be made: {error}"))?;
        let mut root = Arguments::command().disable_help_subcommand(true);
        root.build();
        let mut pages = Vec::new();
        render(&root, &self.folder, &mut pages)?;
        let texts = pages.iter().map(|(page, text)| (page, text.as_str()));
        write_all(&texts.collect::<Vec<_>>())?;
        say(format_args!("{folder}: {} pages", pages.len()));
        Ok(ExitCode::SUCCESS)
    }
}

/// Renders the pages of a command and of those below it.
fn render(
    command: &Command,
    folder: &Path,
    pages: &mut Vec<(Output, String)>,
) -> Result<(), Box<dyn std::error::Error>> {
    let page = clap_mangen::Man::new(command.clone());
    let mut text = Vec::new();
    page.render(&mut text)?;
    let output = Output::new(folder.join(page.get_filename()), Kind::Manual);
    output.check(false)?;
    pages.push((output, String::from_utf8(text)?));
    for below in command.get_subcommands() {
        render(below, folder, pages)?;
    }
    Ok(())
}
