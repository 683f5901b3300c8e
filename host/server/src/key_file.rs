//! Key files: the shared secret of a server and its clients, as [`Secret`] has its text.
//!
//! A file that others may read is refused. Nothing here prints a secret.
#![allow(
    clippy::disallowed_methods,
    reason = "a file of its own: created once, never replaced"
)]

use std::fmt::Write as _;
use std::fs::{File, Metadata};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use gantry_tau_core::control::keys::{KeyTextError, Keyring, KeyringError, Role, Secret};

use crate::state::regular_file::{self, Access};

/// Error of a key file.
#[derive(Debug, thiserror::Error)]
pub enum KeyFileError {
    /// The file cannot be opened, read or created.
    #[error("key file {}: {error}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        error: io::Error,
    },
    /// Others than its owner may read or write the file.
    #[error(
        "key file {}: others may read or write it (mode {mode:04o}); run: chmod 600 {}",
        path.display(), path.display()
    )]
    Mode {
        /// The file.
        path: PathBuf,
        /// Its permissions.
        mode: u32,
    },
    /// The file belongs to another user.
    #[error(
        "key file {}: belongs to user {owner}, who could read and exchange it; run: chown {user} {}",
        path.display(), path.display()
    )]
    Owner {
        /// The file.
        path: PathBuf,
        /// Its owner.
        owner: u32,
        /// User of this process.
        user: u32,
    },
    /// The text is not that of a key file.
    #[error("key file {}, {error}", path.display())]
    Text {
        /// The file.
        path: PathBuf,
        /// The first wrong line.
        error: KeyTextError,
    },
    /// The key cannot be added to those before it.
    #[error("key file {}: {error}", path.display())]
    Keyring {
        /// The file.
        path: PathBuf,
        /// The reason.
        error: KeyringError,
    },
    /// The system gives no random numbers.
    #[error("the system gives no random numbers: {0}")]
    Random(String),
}

/// Reads a key file.
///
/// # Errors
/// [`KeyFileError`]: it cannot be read, others may read it, or its text is not that of a key.
pub fn read(path: &Path) -> Result<Secret, KeyFileError> {
    let failed = |error| KeyFileError::Io {
        path: path.to_owned(),
        error,
    };
    let mut file = regular_file::open(path, Access::Read).map_err(failed)?;
    let credentials = std::env::var_os("CREDENTIALS_DIRECTORY").map(PathBuf::from);
    let metadata = file.metadata().map_err(failed)?;
    check_access(path, &metadata, credentials.as_deref())?;
    let text = regular_file::read(&mut file).map_err(failed)?;
    Secret::parse(&text).map_err(|error| KeyFileError::Text {
        path: path.to_owned(),
        error,
    })
}

/// Creates a file with a new secret, which only its owner may read. A file that is there is not
/// replaced.
///
/// # Errors
/// [`KeyFileError`]: the file is there, or cannot be written; there are no random numbers.
pub fn create(path: &Path, role: Role) -> Result<Secret, KeyFileError> {
    let failed = |error| KeyFileError::Io {
        path: path.to_owned(),
        error,
    };
    let bytes = random()?;
    let secret = Secret { role, bytes };
    let mut file = create_for_its_owner(path).map_err(failed)?;
    let written = file
        .write_all(text_of(&secret).as_bytes())
        .and_then(|()| file.sync_all());
    if let Err(error) = written {
        // Half a file would be in the way of the next try.
        drop(std::fs::remove_file(path));
        return Err(failed(error));
    }
    Ok(secret)
}

/// Returns the three lines.
fn text_of(secret: &Secret) -> String {
    let mut digits = String::new();
    for byte in secret.bytes {
        // Writing to a text does not fail.
        let _ = write!(digits, "{byte:02x}");
    }
    let role = role_name(secret.role);
    format!("gantry-tau-key 1\nrole {role}\nsecret {digits}\n")
}

/// Reads the keys of a server, and draws the secret of its cookies; `None` without files.
///
/// # Errors
/// [`KeyFileError`]: a file cannot be used, is given twice, or is one too many.
pub fn keyring(files: &[PathBuf]) -> Result<Option<Keyring>, KeyFileError> {
    if files.is_empty() {
        return Ok(None);
    }
    let mut keyring = Keyring::new(&random()?);
    for path in files {
        let added = keyring.add(read(path)?.key());
        added.map_err(|error| KeyFileError::Keyring {
            path: path.clone(),
            error,
        })?;
    }
    Ok(Some(keyring))
}

/// Returns random bytes of the system.
///
/// # Errors
/// [`KeyFileError::Random`].
pub fn random<const N: usize>() -> Result<[u8; N], KeyFileError> {
    let mut bytes = [0; N];
    getrandom::fill(&mut bytes).map_err(|error| KeyFileError::Random(error.to_string()))?;
    Ok(bytes)
}

/// Returns the word for a role in a key file.
#[must_use]
pub const fn role_name(role: Role) -> &'static str {
    match role {
        Role::Control => "control",
        Role::Read => "read",
    }
}

/// Checks that others cannot read or write a file. Among a service's `credentials` of systemd it may be
/// an access list that lets the service read, which shows as the group's right.
#[cfg(unix)]
fn check_access(
    path: &Path,
    metadata: &Metadata,
    credentials: Option<&Path>,
) -> Result<(), KeyFileError> {
    use std::os::unix::fs::MetadataExt;
    let is_credential = credentials.is_some_and(|folder| path.starts_with(folder));
    let others = if is_credential { 0o037 } else { 0o077 };
    let path = path.to_owned();
    let mode = metadata.mode() & 0o7777;
    if mode & others != 0 {
        return Err(KeyFileError::Mode { path, mode });
    }
    let (owner, user) = (metadata.uid(), rustix::process::geteuid().as_raw());
    if owner != user && owner != 0 {
        return Err(KeyFileError::Owner { path, owner, user });
    }
    Ok(())
}

/// Says once that the access is not checked.
#[cfg(not(unix))]
fn check_access(path: &Path, _: &Metadata, _: Option<&Path>) -> Result<(), KeyFileError> {
    static SAID: std::sync::Once = std::sync::Once::new();
    SAID.call_once(|| {
        tracing::warn!(
            "who may read {} is not checked on this system",
            path.display()
        );
    });
    Ok(())
}

fn create_for_its_owner(path: &Path) -> io::Result<File> {
    let mut options = File::options();
    options.write(true).create_new(true);
    #[cfg(unix)]
    {
        use std::os::unix::fs::OpenOptionsExt;
        options.mode(0o600);
    }
    options.open(path)
}

#[cfg(test)]
mod tests;
