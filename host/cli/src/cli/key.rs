//! `gantry-tau key`, and the option that names a key file.

use std::path::Path;
use std::process::ExitCode;

use clap::{Args, Subcommand, ValueEnum};
use gantry_tau_core::control::keys::{Key, Role, Secret};
use gantry_tau_server::key_file::{self, KeyFileError, role_name};

use super::Outcome;
use super::outputs::InputFile;
use crate::terminal::say;

/// Key of a server, for its clients.
#[derive(Clone, Debug, Args)]
pub(super) struct KeyOption {
    /// Key file of the server, for one that was started with --key
    #[arg(long, value_name = "FILE")]
    key: Option<InputFile>,
}

impl KeyOption {
    /// Reads the file.
    pub(super) fn read(&self) -> Result<Option<Key>, KeyFileError> {
        let read = |path: &InputFile| key_file::read(path).map(|secret| secret.key());
        self.key.as_ref().map(read).transpose()
    }
}

/// Make and show the key files of `serve --key` and `client --key`
///
/// The holder of a file with the role control can move the machine. Give it to the client by a way
/// that others cannot read, for instance scp. No command but `export` prints a secret.
#[derive(Debug, Args)]
pub(crate) struct KeyCommand {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Write a new key to a file that only its owner may read, and print its id
    New {
        /// The file; one that is there is not replaced
        #[arg(value_name = "FILE")]
        file: std::path::PathBuf,
        /// Rights of its holder: hold a session, or only read
        #[arg(long, default_value = "control")]
        role: RoleChoice,
    },
    /// Print id and role of a key: what the log of the server calls it
    ShowId {
        /// The key file
        #[arg(value_name = "FILE")]
        file: InputFile,
    },
    /// Print the secret as an initializer, for a target without files
    #[command(group(clap::ArgGroup::new("language").required(true)))]
    Export {
        /// The key file
        #[arg(value_name = "FILE")]
        file: InputFile,
        /// In C
        #[arg(long, group = "language")]
        c: bool,
        /// In Rust
        #[arg(long, group = "language")]
        rust: bool,
    },
}

/// Role of a new key.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum RoleChoice {
    /// Hold a session, and read
    Control,
    /// Read
    Read,
}

impl KeyCommand {
    pub(super) fn run(self) -> Outcome {
        match self.action {
            Action::New { file, role } => {
                let role = match role {
                    RoleChoice::Control => Role::Control,
                    RoleChoice::Read => Role::Read,
                };
                let key = key_file::create(&file, role)?;
                say(describe(&key));
            }
            Action::ShowId { file } => say(describe(&key_file::read(&file)?)),
            Action::Export { file, c, rust: _ } => say(export(&file, c)?),
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// Name and role.
fn describe(secret: &Secret) -> String {
    format!("{} {}", secret.key().id(), role_name(secret.role))
}

/// Initializer of a secret, with a comment that names the key.
fn export(path: &Path, in_c: bool) -> Result<String, KeyFileError> {
    let secret = key_file::read(path)?;
    let rows: Vec<String> = (secret.bytes.chunks(8))
        .map(|row| row.iter().map(|byte| format!("0x{byte:02x}, ")).collect())
        .map(|row: String| format!("    {}", row.trim_end()))
        .collect();
    let (name, rows) = (describe(&secret), rows.join("\n"));
    Ok(if in_c {
        format!("/* Key {name}. */\nstatic const uint8_t gantry_tau_key[32] = {{\n{rows}\n}};")
    } else {
        format!("/// Key {name}.\nconst KEY: [u8; 32] = [\n{rows}\n];")
    })
}
