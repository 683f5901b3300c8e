//! Place of a machine's state: of the machine where it is real, of a login where it is simulated.

use std::ffi::OsString;
use std::fmt;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Longest name of a machine, characters.
const MAX_NAME: usize = 64;
/// Folder of all states.
const FOLDER: &str = "gantry-tau";
/// State of a computer's services, by the Filesystem Hierarchy Standard.
const VAR_LIB: &str = "/var/lib";

/// Name of a machine among those of a computer: the name of its folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MachineName(String);

impl MachineName {
    /// Name of a machine that the user has not named: its model, the checksum of its kinematics and
    /// its address.
    #[must_use]
    pub fn of(model: &str, checksum: u32, address: SocketAddr) -> Self {
        let address = address
            .to_string()
            .replace(|sign: char| !is_plain(sign), "-");
        Self(format!("{model}-{checksum:08x}-{address}"))
    }
}

const fn is_plain(sign: char) -> bool {
    sign.is_ascii_alphanumeric() || matches!(sign, '.' | '_' | '-')
}

/// A text that is not the name of a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "expected 1 to {MAX_NAME} of A-Z, a-z, 0-9, `.`, `_`, `-`, beginning with a letter or digit"
)]
pub struct ParseMachineNameError;

impl FromStr for MachineName {
    type Err = ParseMachineNameError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let is_name = text.chars().all(is_plain)
            && text.len() <= MAX_NAME
            && text.starts_with(|sign: char| sign.is_ascii_alphanumeric());
        if !is_name {
            return Err(ParseMachineNameError);
        }
        Ok(Self(text.to_owned()))
    }
}

impl fmt::Display for MachineName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Place of a state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StatePlace {
    /// The epoch file; latch and lock lie beside it.
    pub epoch_file: PathBuf,
    /// Remedy if the place cannot be used.
    pub remedy: &'static str,
}

impl StatePlace {
    /// A file that the user has named.
    #[must_use]
    pub fn named(epoch_file: &Path) -> Self {
        let remedy = "name a file that this user can write with --epoch-file";
        Self {
            epoch_file: epoch_file.to_owned(),
            remedy,
        }
    }
}

/// A login without a folder for states.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "no folder for the machine's state: neither XDG_STATE_HOME nor HOME is an absolute path; name a file with --epoch-file"
)]
pub struct PlaceError;

/// Facts that decide where states lie.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Environment {
    /// `STATE_DIRECTORY`, which systemd gives a service.
    pub state_directory: Option<OsString>,
    /// `XDG_STATE_HOME`; on Windows `LOCALAPPDATA`.
    pub state_home: Option<OsString>,
    /// `HOME`.
    pub home: Option<OsString>,
    /// The user is root.
    pub is_root: bool,
}

impl Environment {
    /// Environment of this process.
    #[must_use]
    pub fn of_process() -> Self {
        let state_home = if cfg!(windows) {
            "LOCALAPPDATA"
        } else {
            "XDG_STATE_HOME"
        };
        let [state_directory, state_home, home] =
            ["STATE_DIRECTORY", state_home, "HOME"].map(std::env::var_os);
        Self {
            state_directory,
            state_home,
            home,
            is_root: is_root(),
        }
    }

    /// Returns the place of a machine's state.
    ///
    /// A service has the folder that systemd gives it. Root, and everybody who moves a machine that
    /// is not simulated, has that of the computer, so that no login forgets the stop of another.
    /// Otherwise it is the user's state folder.
    ///
    /// # Errors
    /// [`PlaceError`]: the user has no such folder.
    pub fn place(
        &self,
        machine: &MachineName,
        is_simulated: bool,
    ) -> Result<StatePlace, PlaceError> {
        let (folder, remedy) = if let Some(given) =
            self.state_directory.as_ref().and_then(first_absolute)
        {
            (
                given,
                "it is the service's StateDirectory; or name a file with --epoch-file",
            )
        } else if cfg!(unix) && (self.is_root || !is_simulated) {
            let remedy = "give /var/lib/gantry-tau to the user of this server (`sudo install -d -o USER /var/lib/gantry-tau`), \
                          or name a file with --epoch-file";
            (Path::new(VAR_LIB).join(FOLDER), remedy)
        } else {
            (
                self.users_folder().ok_or(PlaceError)?,
                "name a file that this user can write with --epoch-file",
            )
        };
        Ok(StatePlace {
            epoch_file: folder.join(&machine.0).join("epoch"),
            remedy,
        })
    }

    /// The user's folder of states. The XDG Base Directory Specification asks to ignore paths that
    /// are empty or relative.
    fn users_folder(&self) -> Option<PathBuf> {
        let base = absolute(self.state_home.as_ref())
            .or_else(|| absolute(self.home.as_ref()).map(|home| home.join(".local/state")));
        base.map(|base| base.join(FOLDER))
    }
}

fn absolute(path: Option<&OsString>) -> Option<PathBuf> {
    path.map(PathBuf::from).filter(|path| path.is_absolute())
}

/// The first of the folders that systemd lists.
fn first_absolute(folders: &OsString) -> Option<PathBuf> {
    std::env::split_paths(folders)
        .next()
        .filter(|path| path.is_absolute())
}

#[cfg(unix)]
fn is_root() -> bool {
    rustix::process::geteuid().is_root()
}

#[cfg(not(unix))]
const fn is_root() -> bool {
    false
}
