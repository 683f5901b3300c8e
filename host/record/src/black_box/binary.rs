//! Windows in the binary form, as a program in C writes them (`host/capi`), by core's `serde` types
//! and `postcard`.
//!
//! | part | content |
//! |---|---|
//! | 0 | `GTBB`, version 8, number of axes (one byte each), number of ticks (`u32`, little-endian) |
//! | 1 | length of the rest of the part (`u32`, little-endian), the session before the oldest tick |
//! | 2 on | length, one tick, oldest first; as many as part 0 announces |

use gantry_tau_server::black_box::Window;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::FileError;

/// First bytes of a file.
const FORMAT: &[u8] = b"GTBB";
/// Version of the layout.
const VERSION: u8 = 8;

/// True if a file begins as one in the binary form.
pub(super) fn is_binary(bytes: &[u8]) -> bool {
    bytes.starts_with(FORMAT)
}

/// As [`super::axes`].
pub(super) fn axes(name: &str, bytes: &[u8]) -> Result<usize, FileError> {
    PartReader::of(name, bytes).head().map(|head| head.axes)
}

/// As [`super::decode`].
pub(super) fn decode<const N: usize>(name: &str, bytes: &[u8]) -> Result<Window<N>, FileError> {
    let mut parts = PartReader::of(name, bytes);
    let Head { axes, ticks } = parts.head()?;
    if axes != N {
        return Err(parts.refuse(format!("axes is {axes}, expected {N}")));
    }
    let before = parts.read()?;
    let entries: Vec<_> = (0..ticks).map(|_| parts.read()).collect::<Result<_, _>>()?;
    if parts.rest.is_empty() {
        Ok(Window {
            before,
            entries,
            loops: None,
        })
    } else {
        let more = parts.rest.len();
        let reason = format!("{more} bytes follow the {ticks} ticks that part 0 announces");
        Err(parts.refuse(reason))
    }
}

/// Part 0.
struct Head {
    axes: usize,
    ticks: usize,
}

/// A file that is read part by part.
struct PartReader<'a> {
    name: &'a str,
    rest: &'a [u8],
    /// Number of the part that is being read.
    part: usize,
}

impl<'a> PartReader<'a> {
    const fn of(name: &'a str, bytes: &'a [u8]) -> Self {
        Self {
            name,
            rest: bytes,
            part: 0,
        }
    }

    /// Reads part 0.
    fn head(&mut self) -> Result<Head, FileError> {
        let Some((head, rest)) = self.rest.split_first_chunk::<10>() else {
            return Err(self.refuse("the file ends within the first 10 bytes"));
        };
        let [_, _, _, _, version, axes, ticks @ ..] = *head;
        if version != VERSION {
            let reason = format!("version is {version}; this program reads version {VERSION}");
            return Err(self.refuse(reason));
        }
        let ticks = usize::try_from(u32::from_le_bytes(ticks)).unwrap_or(usize::MAX);
        if ticks == 0 {
            return Err(self.refuse("ticks is 0: there is nothing to replay"));
        }
        self.rest = rest;
        Ok(Head {
            axes: axes.into(),
            ticks,
        })
    }

    /// Reads the next part as one value, which must be written as `postcard` writes it: it takes
    /// longer forms of a number, and a rest.
    fn read<T: Serialize + DeserializeOwned>(&mut self) -> Result<T, FileError> {
        self.part += 1;
        if self.rest.is_empty() {
            return Err(self.refuse("the file ends before this part"));
        }
        let Some((length, rest)) = self.rest.split_first_chunk() else {
            return Err(self.refuse("the file ends within the length of this part"));
        };
        let length = usize::try_from(u32::from_le_bytes(*length)).unwrap_or(usize::MAX);
        let Some((part, rest)) = rest.split_at_checked(length) else {
            let reason = format!("the file ends after {} of {length} bytes", rest.len());
            return Err(self.refuse(reason));
        };
        let value = postcard::from_bytes(part)
            .map_err(|error| self.refuse(format!("the content is not valid: {error}")))?;
        let mut room = vec![0; length];
        if postcard::to_slice(&value, &mut room).is_ok_and(|written| written == part) {
            self.rest = rest;
            Ok(value)
        } else {
            Err(self.refuse("a number is longer than needed, or bytes follow the content"))
        }
    }

    fn refuse(&self, reason: impl Into<String>) -> FileError {
        FileError {
            place: format!("{}, part {}", self.name, self.part),
            reason: reason.into(),
        }
    }
}
