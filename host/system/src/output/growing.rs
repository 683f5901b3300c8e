//! Files that grow row by row: recordings and tables of windows.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::place::{self, Destination};
use super::{Kind, WriteError, shown, stream};

/// Largest number behind the name of a recording.
const MAX_NUMBER: u32 = 99_999;

/// A file that is made with its first bytes: a run that has none leaves none, and costs no other
/// file. A pipe or device that takes nothing for five seconds fails, but that of a recording, whose
/// thread may wait.
#[derive(Debug)]
pub struct GrowingFile {
    path: PathBuf,
    state: FileState,
}

#[derive(Debug)]
enum FileState {
    /// To be made under the first free name. A companion has the same name with this ending behind
    /// it.
    Fresh {
        companion: Option<&'static str>,
    },
    /// To be made in the place of a table without rows, or of none.
    Replacing,
    Open(File),
}

impl GrowingFile {
    /// File under a name that is free: `FILE.csv`, or else `FILE-2.csv`, `FILE-3.csv` and so on;
    /// free means that it has no `companion` either, a file with this ending behind the whole name.
    /// A device or a pipe is opened at once.
    ///
    /// # Errors
    /// [`WriteError`]: no file can be made there.
    pub fn fresh(path: &Path, companion: Option<&'static str>) -> Result<Self, WriteError> {
        let place = match fs::metadata(path) {
            // The file stays; its folder is what counts.
            Ok(old) if old.is_file() => Destination::Free(path.to_owned()),
            _ => Destination::of(path)?,
        };
        Self::at(path, place, FileState::Fresh { companion })
    }

    /// File in the place of one that has no rows, or of none.
    ///
    /// # Errors
    /// [`WriteError`]: no file can be made there.
    pub fn replacing(path: &Path) -> Result<Self, WriteError> {
        Self::at(path, Destination::of(path)?, FileState::Replacing)
    }

    /// The end of a file that exists.
    ///
    /// # Errors
    /// [`WriteError`]: it cannot be opened.
    pub fn continuing(path: &Path) -> Result<Self, WriteError> {
        let file = place::append(path)
            .and_then(place::owned)
            .map_err(|error| WriteError::system(path, &error))?;
        Ok(Self {
            path: path.to_owned(),
            state: FileState::Open(file),
        })
    }

    /// Lets writes to a pipe or device wait as long as nothing is taken: for a thread of its own.
    ///
    /// # Errors
    /// Error of the system.
    pub fn that_waits(self) -> io::Result<Self> {
        if let FileState::Open(file) = &self.state {
            stream::let_wait(file)?;
        }
        Ok(self)
    }

    fn at(path: &Path, place: Destination, state: FileState) -> Result<Self, WriteError> {
        let path = path.to_owned();
        match place {
            Destination::Stream(target) => {
                let file =
                    stream::open(&target).map_err(|error| WriteError::system(&path, &error))?;
                Ok(Self {
                    path,
                    state: FileState::Open(file),
                })
            }
            Destination::Free(target) | Destination::File(target) => {
                place::probe(&target, &path)?;
                Ok(Self { path, state })
            }
        }
    }

    /// Path of the file, once it is there; until then the one that was asked for.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// True once the file is there.
    #[must_use]
    pub const fn is_open(&self) -> bool {
        matches!(self.state, FileState::Open(_))
    }

    /// Makes the file, unless it is there.
    ///
    /// # Errors
    /// Error of the system.
    pub fn open(&mut self) -> io::Result<&mut File> {
        let file = match std::mem::replace(&mut self.state, FileState::Replacing) {
            FileState::Open(file) => file,
            FileState::Fresh { companion } => match fresh(&self.path, companion) {
                Ok((path, file)) => {
                    self.path = path;
                    file
                }
                Err(error) => {
                    self.state = FileState::Fresh { companion };
                    return Err(error);
                }
            },
            FileState::Replacing => replace_table(&self.path)?,
        };
        self.state = FileState::Open(file);
        match &mut self.state {
            FileState::Open(file) => Ok(file),
            // It was set above.
            _ => Err(io::Error::other("the file is not open")),
        }
    }

    /// Flushes to the disk.
    ///
    /// # Errors
    /// Error of the system.
    pub fn sync(&mut self) -> io::Result<()> {
        match &self.state {
            FileState::Open(file) if file.metadata().is_ok_and(|file| file.is_file()) => {
                file.sync_all()
            }
            _ => Ok(()),
        }
    }
}

impl Drop for GrowingFile {
    fn drop(&mut self) {
        if let FileState::Open(file) = &self.state {
            place::disown(file);
        }
    }
}

/// A write is in the file as a whole, or not at all: on a disk that fills up a table ends with a
/// whole row. A stream may have taken a part.
impl Write for GrowingFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let file = self.open()?;
        let mut written = 0;
        while let Some(rest) = bytes.get(written..).filter(|rest| !rest.is_empty()) {
            match stream::Bounded(file).write(rest) {
                Ok(0) => return Err(take_back(file, written, io::ErrorKind::WriteZero.into())),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Ok(count) => written = written.saturating_add(count),
                Err(error) => return Err(take_back(file, written, error)),
            }
        }
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Takes the last bytes off the end of a file. Returns the error for which they are taken back.
fn take_back(file: &mut File, bytes: usize, error: io::Error) -> io::Error {
    let length = file
        .metadata()
        .ok()
        .filter(fs::Metadata::is_file)
        .map(|file| file.len());
    let before = length
        .zip(u64::try_from(bytes).ok())
        .and_then(|(length, bytes)| length.checked_sub(bytes));
    if let Some(before) = before.filter(|_| bytes > 0) {
        // A disk that does not take bytes lets go of them.
        let _shorter = file
            .set_len(before)
            .and_then(|()| file.seek(SeekFrom::Start(before)));
    }
    error
}

/// Makes a table, in the place of one without rows or of none. Another program may have made it, or
/// written to it, since that was looked at.
fn replace_table(path: &Path) -> io::Result<File> {
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    match File::open(&target) {
        Ok(old) => {
            place::owned(old)?;
            if !Kind::Table.replaces(&target) {
                return Err(io::Error::other(
                    "another program has written rows to it meanwhile",
                ));
            }
        }
        // Not a link whose file is missing, which is replaced.
        Err(_) if path.symlink_metadata().is_err() => {
            return place::create_new(path).and_then(place::owned);
        }
        Err(_) => {}
    }
    let beside = place::beside(&target, 0);
    let file = place::create_new(&beside).and_then(place::owned)?;
    fs::rename(&beside, &target)?;
    Ok(file)
}

/// Makes a file under the first free name. Two programs that ask at the same time get two.
fn fresh(path: &Path, companion: Option<&str>) -> io::Result<(PathBuf, File)> {
    for number in 1..=MAX_NUMBER {
        let numbered = numbered(path, number);
        let companion = companion.map(|ending| with_ending(&numbered, ending));
        if companion.is_some_and(|companion| companion.symlink_metadata().is_ok()) {
            continue;
        }
        match place::create_new(&numbered) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            file => return Ok((numbered, file?)),
        }
    }
    Err(io::Error::other(format!(
        "{} and {MAX_NUMBER} names with a number behind it are taken",
        shown(path)
    )))
}

/// `FILE.csv`, `FILE-2.csv`, ...
fn numbered(path: &Path, number: u32) -> PathBuf {
    if number == 1 {
        return path.to_owned();
    }
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push(format!("-{number}"));
    if let Some(extension) = path.extension() {
        name.push(".");
        name.push(extension);
    }
    path.with_file_name(name)
}

/// A path with an ending behind it.
pub(super) fn with_ending(path: &Path, ending: &str) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(ending);
    PathBuf::from(name)
}
