//! Set-up files: TOML beside the table that they name.

use std::path::{Path, PathBuf};

use gantry_tau_system::lines::read_text;
use serde::de::DeserializeOwned;

use super::FileError;

/// Longest set-up file that is read, bytes.
const MAX_LEN: u64 = 1 << 20;

/// Reads the text of a set-up file.
///
/// # Errors
/// [`FileError`].
pub fn text(path: &Path) -> Result<String, FileError> {
    read_text(path, MAX_LEN).map_err(|reason| FileError::whole(&path.display().to_string(), reason))
}

/// Parses the text of a set-up; `path` names it.
///
/// # Errors
/// [`FileError`], with the line that TOML or its keys are wrong in.
pub fn parse<T: DeserializeOwned>(path: &Path, text: &str) -> Result<T, FileError> {
    toml::from_str(text).map_err(|error| {
        let line = error
            .span()
            .and_then(|span| text.get(..span.start))
            .map(|before| before.matches('\n').count());
        let line = line
            .and_then(|line| u64::try_from(line).ok())
            .map_or(1, |line| line + 1);
        FileError::at(&path.display().to_string(), line, "", error.message())
    })
}

/// Returns the path of a file that a set-up names, beside the set-up.
pub(super) fn beside(setup: &Path, named: &str) -> PathBuf {
    setup
        .parent()
        .map_or_else(|| PathBuf::from(named), |folder| folder.join(named))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_names_its_line() {
        for (text, line) in [
            ("a = ", 1),
            ("a = 1\nb = \nc = 3\n", 2),
            ("a = 1\nb = 2\n\nb = 3\n", 4),
        ] {
            let error = parse::<toml::Table>(Path::new("set-up.toml"), text)
                .unwrap_err()
                .to_string();
            assert!(
                error.starts_with(&format!("set-up.toml:{line}: ")),
                "{error}"
            );
        }
    }
}
