//! The shared library of the units: where it is, and for which platform.

use std::fmt;
use std::path::{Path, PathBuf};

use gantry_tau_fmi::kind::MARK;

/// Largest library that is read, bytes.
const MAX_LEN: u64 = 256 << 20;

/// Platform of FMI 2.0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Platform {
    /// Linux on x86-64.
    Linux64,
    /// Windows on x86-64.
    Windows64,
    /// macOS.
    Darwin64,
}

impl Platform {
    /// Name of its folder in a unit.
    #[must_use]
    pub const fn folder(self) -> &'static str {
        match self {
            Self::Linux64 => "linux64",
            Self::Windows64 => "win64",
            Self::Darwin64 => "darwin64",
        }
    }

    /// Extension of its libraries.
    #[must_use]
    pub const fn extension(self) -> &'static str {
        match self {
            Self::Linux64 => "so",
            Self::Windows64 => "dll",
            Self::Darwin64 => "dylib",
        }
    }

    /// Returns the platform of a library, as its first bytes show it.
    fn of(bytes: &[u8]) -> Option<Self> {
        match bytes {
            // ELF of 64 bits, little-endian, for x86-64.
            [0x7f, b'E', b'L', b'F', 2, 1, rest @ ..] => {
                (rest.get(12..14) == Some(&[62, 0])).then_some(Self::Linux64)
            }
            [b'M', b'Z', ..] => {
                let header = u32::from_le_bytes(*bytes.get(0x3c..)?.first_chunk()?);
                let header = bytes.get(usize::try_from(header).ok()?..)?;
                header
                    .starts_with(&[b'P', b'E', 0, 0, 0x64, 0x86])
                    .then_some(Self::Windows64)
            }
            // Mach-O of 64 bits, or several of them.
            [0xcf, 0xfa, 0xed, 0xfe, ..] | [0xca, 0xfe, 0xba, 0xbe, ..] => Some(Self::Darwin64),
            _ => None,
        }
    }
}

/// Reason against a library.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LibraryError {
    /// None is beside the program.
    #[error(
        "the library of the units, {name}, is not in {}; `cargo build --release -p gantry-tau-fmi-library` in the sources makes target/release/{name}: name it with --library",
        searched.iter().map(|folder| folder.display().to_string()).collect::<Vec<_>>().join(" or ")
    )]
    Missing {
        /// Its name.
        name: String,
        /// Folders that were searched.
        searched: Vec<PathBuf>,
    },
    /// The file cannot be read.
    #[error("{path}: {reason}")]
    Unreadable {
        /// The file.
        path: String,
        /// The reason.
        reason: String,
    },
    /// The file is another one.
    #[error(
        "{0}: is not the library of {MARK} for a platform that FMI 2.0 names (Linux and Windows on x86-64, macOS)"
    )]
    Other(String),
    /// Two libraries are for one platform.
    #[error("{path}: is the second library for {platform}")]
    Twice {
        /// The second one.
        path: String,
        /// Their platform.
        platform: Platform,
    },
}

impl fmt::Display for Platform {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.folder())
    }
}

/// A library for a platform.
#[derive(Clone, Debug)]
pub struct Library {
    /// Its platform.
    pub platform: Platform,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

impl Library {
    /// Reads a library.
    ///
    /// # Errors
    /// [`LibraryError`].
    pub fn read(path: &Path) -> Result<Self, LibraryError> {
        let shown = path.display().to_string();
        let unreadable = |error: std::io::Error| LibraryError::Unreadable {
            path: path.display().to_string(),
            reason: error.to_string(),
        };
        let length = std::fs::metadata(path).map_err(unreadable)?;
        if !length.is_file() || length.len() > MAX_LEN {
            return Err(LibraryError::Other(shown));
        }
        let bytes = std::fs::read(path).map_err(unreadable)?;
        let platform = Platform::of(&bytes).filter(|_| contains(&bytes, MARK.as_bytes()));
        match platform {
            Some(platform) => Ok(Self { platform, bytes }),
            None => Err(LibraryError::Other(shown)),
        }
    }

    /// Reads the named libraries, one per platform; without a name, that of this computer, which lies
    /// beside the program or in `../lib/gantry-tau` from there.
    ///
    /// # Errors
    /// [`LibraryError`].
    pub fn find(named: &[PathBuf]) -> Result<Vec<Self>, LibraryError> {
        if named.is_empty() {
            return Ok(vec![Self::read(&beside_the_program()?)?]);
        }
        let mut libraries: Vec<Self> = Vec::new();
        for path in named {
            let library = Self::read(path)?;
            let platform = library.platform;
            if libraries.iter().any(|other| other.platform == platform) {
                return Err(LibraryError::Twice {
                    path: path.display().to_string(),
                    platform,
                });
            }
            libraries.push(library);
        }
        Ok(libraries)
    }
}

fn beside_the_program() -> Result<PathBuf, LibraryError> {
    let name = format!(
        "{}gantry_tau_fmu{}",
        std::env::consts::DLL_PREFIX,
        std::env::consts::DLL_SUFFIX
    );
    let program = std::env::current_exe().and_then(std::fs::canonicalize);
    let folder = program
        .ok()
        .and_then(|path| path.parent().map(PathBuf::from));
    let searched: Vec<PathBuf> = match &folder {
        Some(folder) => vec![folder.clone(), folder.join("../lib/gantry-tau")],
        None => Vec::new(),
    };
    let mut paths = searched.iter().map(|folder| folder.join(&name));
    paths
        .find(|path| path.is_file())
        .ok_or(LibraryError::Missing { name, searched })
}

fn contains(bytes: &[u8], part: &[u8]) -> bool {
    bytes.windows(part.len()).any(|window| window == part)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn platforms_are_told_by_the_first_bytes() {
        let mut elf = vec![0x7f, b'E', b'L', b'F', 2, 1];
        elf.resize(18, 0);
        elf.extend([62, 0]);
        assert_eq!(Platform::of(&elf), Some(Platform::Linux64));
        // Of another processor, and cut.
        elf[18] = 183;
        assert_eq!(Platform::of(&elf), None);
        elf.truncate(19);
        assert_eq!(Platform::of(&elf), None);
        let mut pe = vec![0; 0x80];
        pe[..2].copy_from_slice(b"MZ");
        pe[0x3c] = 0x70;
        pe[0x70..0x76].copy_from_slice(&[b'P', b'E', 0, 0, 0x64, 0x86]);
        assert_eq!(Platform::of(&pe), Some(Platform::Windows64));
        pe[0x3c..0x40].fill(0xff);
        assert_eq!(Platform::of(&pe), None);
        assert_eq!(
            Platform::of(&[0xcf, 0xfa, 0xed, 0xfe, 7]),
            Some(Platform::Darwin64)
        );
        for other in [&b""[..], b"\x7fELF", b"MZ", b"#!/bin/sh\n"] {
            assert_eq!(Platform::of(other), None);
        }
    }
}
