//! `gantry-tau completions`.

use std::io::{self, Write};
use std::process::ExitCode;

use clap::{Args, CommandFactory};
use clap_complete::Shell;

use super::labcomm::until_the_reader_ends;
use super::{Arguments, Outcome};

/// Print the completions of a shell: commands and options, with Tab
///
/// Bash, for one user:
/// gantry-tau completions bash > ~/.local/share/bash-completion/completions/gantry-tau. Zsh: into a
/// file _gantry-tau in a folder of $fpath. Fish: into ~/.config/fish/completions/gantry-tau.fish.
/// The Debian package has them.
#[derive(Debug, Args)]
pub(crate) struct Completions {
    /// The shell
    shell: Shell,
}

impl Completions {
    pub(super) fn run(self) -> Outcome {
        let mut script = Vec::new();
        let mut command = Arguments::command();
        let name = command.get_name().to_owned();
        clap_complete::generate(self.shell, &mut command, name, &mut script);
        let mut script = String::from_utf8_lossy(&script).into_owned();
        if self.shell == Shell::Bash {
            // clap-rs/clap#6421: with a hyphen in the program's name the script sets states that
            // none of its cases has, and completes nothing behind a command.
            script = script.replace("gantry__subcmd__tau", "gantry__tau");
        }
        let written = io::stdout().write_all(script.as_bytes());
        until_the_reader_ends(written.map(|()| ExitCode::SUCCESS))
    }
}
