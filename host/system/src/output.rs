//! Files that commands write: one policy for all of them.
//!
//! - An output is never written onto an input of the same command, through links neither
//!   ([`check_apart`]).
//! - A whole file is written beside its target, flushed to the disk and renamed
//!   ([`Output::write`]): an interrupted command leaves the old file, or none.
//! - It replaces a file of its own [`Kind`] only, which its first bytes show. Robot files and plans
//!   need `--overwrite` in addition ([`Output::check`]).
//! - Measured data are never replaced: a recording gets a name that is free, a table of windows is
//!   continued ([`GrowingFile`]).
//! - Devices and pipes take their bytes directly.
//!
//! | module | contents |
//! |---|---|
//! | `kind` | contents of whole files, and how they are recognised |
//! | `place` | target of a path: a file, a free name, a device |
//! | `growing` | files that grow row by row |
//! | `name` | names that may stand in tables, on terminals and in file names |

mod growing;
mod kind;
mod name;
mod place;
mod stream;

use std::borrow::Cow;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

pub use growing::GrowingFile;
pub use kind::{Kind, rows};
pub use name::escaped;
pub use name::{MAX_NAME, Name, NameError, NameInFileError, printable};
use place::Destination;

/// Reason why a file is not written.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WriteError {
    /// The system refuses.
    #[error("cannot write {path}: {reason}")]
    System {
        /// The file.
        path: String,
        /// Reason of the system, and a remedy.
        reason: String,
    },
    /// A file that is replaced on demand only.
    #[error("{0} exists; --overwrite replaces it")]
    Exists(String),
    /// A file of another kind.
    #[error(
        "cannot write {path}: it exists, and is not {kind} of gantry-tau; name another file, or move this one away"
    )]
    Foreign {
        /// The file.
        path: String,
        /// Kind of the output.
        kind: Kind,
    },
    /// A name that ends as those of files of another kind.
    #[error("cannot write {path}: the output is {kind}, whose name does not end in .{extension}")]
    Extension {
        /// The file.
        path: String,
        /// Kind of the output.
        kind: Kind,
        /// Extension of the name, in lower case.
        extension: String,
    },
    /// A file that the command reads.
    #[error("cannot write {path}: the same command reads this file ({input}); name another file")]
    Input {
        /// The output.
        path: String,
        /// The input, as it was named.
        input: String,
    },
    /// A file that two options name.
    #[error("cannot write {0}: two outputs have this name; name another file for one of them")]
    Twice(String),
}

impl WriteError {
    fn system(path: &Path, error: &std::io::Error) -> Self {
        Self::refused(path, format_args!("{error}"))
    }

    fn refused(path: &Path, reason: impl std::fmt::Display) -> Self {
        Self::System {
            path: shown(path),
            reason: reason.to_string(),
        }
    }
}

/// A path for messages.
fn shown(path: &Path) -> String {
    printable(&path.display().to_string())
}

/// A whole file that a command writes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Output {
    path: PathBuf,
    kind: Kind,
}

impl Output {
    /// Output of a kind.
    #[must_use]
    pub fn new(path: impl Into<PathBuf>, kind: Kind) -> Self {
        Self {
            path: path.into(),
            kind,
        }
    }

    /// Path as it was named.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Contents.
    #[must_use]
    pub const fn kind(&self) -> Kind {
        self.kind
    }

    /// Checks, before the work, that the file can be written. `is_overwriting`: robot files and
    /// plans may be replaced. Nothing changes.
    ///
    /// # Errors
    /// [`WriteError`].
    pub fn check(&self, is_overwriting: bool) -> Result<(), WriteError> {
        if self.kind.needs_overwrite()
            && !is_overwriting
            && fs::metadata(&self.path).is_ok_and(|old| old.is_file())
        {
            return Err(WriteError::Exists(shown(&self.path)));
        }
        match self.place()? {
            Destination::Stream(_) => return Ok(()),
            Destination::Free(target) | Destination::File(target) => {
                place::probe(&target, &self.path)?;
            }
        }
        match self.kind.foreign_extension(&self.path) {
            None => Ok(()),
            Some(extension) => Err(WriteError::Extension {
                path: shown(&self.path),
                kind: self.kind,
                extension,
            }),
        }
    }

    /// Target of the output.
    fn place(&self) -> Result<Destination, WriteError> {
        let place = Destination::of(&self.path)?;
        match &place {
            Destination::File(target)
                if self.kind != Kind::BlackBox && !self.kind.replaces(target) =>
            {
                Err(WriteError::Foreign {
                    path: shown(&self.path),
                    kind: self.kind,
                })
            }
            _ => Ok(place),
        }
    }

    /// Writes the whole file. Returns its path, which is another one for a kind that replaces
    /// nothing.
    ///
    /// # Errors
    /// [`WriteError`]; an old file is as it was.
    pub fn write(&self, text: &str) -> Result<PathBuf, WriteError> {
        if self.kind == Kind::BlackBox {
            let mut file = GrowingFile::fresh(&self.path, None)?;
            if let Err(error) = file.write_all(text.as_bytes()) {
                // Not a device or a pipe.
                if file.is_open() && file.path().is_file() {
                    let _empty = fs::remove_file(file.path());
                }
                return Err(WriteError::system(&self.path, &error));
            }
            return Ok(file.path().to_owned());
        }
        write_all(&[(self, text)])?;
        Ok(self.path.clone())
    }

    /// Writes the whole file, of a kind that is no text.
    ///
    /// # Errors
    /// [`WriteError`]; an old file is as it was.
    pub fn write_bytes(&self, bytes: &[u8]) -> Result<(), WriteError> {
        write_each(&[(self, bytes.into())])
    }
}

/// Writes several whole files: all of them, or, if one of them cannot be written, none.
///
/// # Errors
/// [`WriteError`]; old files are as they were.
pub fn write_all(files: &[(&Output, &str)]) -> Result<(), WriteError> {
    let stamped = files.iter().map(|(output, text)| {
        let text = output.kind.stamped(text);
        (*output, Cow::from(text.into_bytes()))
    });
    write_each(&stamped.collect::<Vec<_>>())
}

fn write_each(files: &[(&Output, Cow<'_, [u8]>)]) -> Result<(), WriteError> {
    let mut prepared = Vec::new();
    for (number, (output, bytes)) in files.iter().enumerate() {
        prepared.push(match output.place()? {
            Destination::Stream(target) => Prepared::Stream { target, bytes },
            Destination::Free(target) | Destination::File(target) => {
                Prepared::Beside(Beside::write(target, &output.path, number, bytes)?)
            }
        });
    }
    for (file, (output, _)) in prepared.into_iter().zip(files) {
        let finished = match file {
            Prepared::Stream { target, bytes } => place::write_stream(&target, bytes),
            Prepared::Beside(beside) => beside.rename(),
        };
        finished.map_err(|error| WriteError::system(&output.path, &error))?;
    }
    Ok(())
}

/// A file on its way to its target.
enum Prepared<'a> {
    Stream { target: PathBuf, bytes: &'a [u8] },
    Beside(Beside),
}

/// A file beside its target, which is removed unless it takes the target's place.
struct Beside {
    target: PathBuf,
    path: PathBuf,
}

impl Beside {
    /// Writes a file beside `target`, with the permissions of the file that it replaces.
    fn write(
        target: PathBuf,
        named: &Path,
        number: usize,
        bytes: &[u8],
    ) -> Result<Self, WriteError> {
        Self::create(target, number, bytes).map_err(|error| WriteError::system(named, &error))
    }

    fn create(target: PathBuf, number: usize, bytes: &[u8]) -> std::io::Result<Self> {
        let path = place::beside(&target, number);
        let mut file = place::create_new(&path)?;
        let beside = Self { target, path };
        file.write_all(bytes)?;
        file.sync_all()?;
        if let Ok(old) = fs::metadata(&beside.target) {
            fs::set_permissions(&beside.path, old.permissions())?;
        }
        Ok(beside)
    }

    fn rename(self) -> std::io::Result<()> {
        fs::rename(&self.path, &self.target)
    }
}

impl Drop for Beside {
    fn drop(&mut self) {
        // After the renaming it is not there any more.
        let _ = fs::remove_file(&self.path);
    }
}

/// Checks that no output is an input of the same command, or another output; links count as the
/// file that they name.
///
/// # Errors
/// [`WriteError::Input`], [`WriteError::Twice`].
pub fn check_apart(outputs: &[&Path], inputs: &[&Path]) -> Result<(), WriteError> {
    let names: Vec<PathBuf> = outputs
        .iter()
        .map(|output| place::resolved(output))
        .collect();
    for (index, (output, name)) in outputs.iter().zip(&names).enumerate() {
        // Terminals and pipes may be read and written.
        if fs::metadata(output).is_ok_and(|old| !old.is_file() && !old.is_dir()) {
            continue;
        }
        if let Some(input) = inputs
            .iter()
            .find(|input| place::is_same_file(output, input))
        {
            return Err(WriteError::Input {
                path: shown(output),
                input: shown(input),
            });
        }
        let mut before = names.iter().zip(outputs).take(index);
        if before
            .any(|(other_name, other)| other_name == name || place::is_same_file(output, other))
        {
            return Err(WriteError::Twice(shown(output)));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
