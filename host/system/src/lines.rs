//! Input from files, scripts and operators, which may be anything.

use std::fs::File;
use std::io::{self, BufRead, Read};
use std::path::Path;

/// Reason why a text is not read.
#[derive(Debug, thiserror::Error)]
pub enum TextError {
    /// The file cannot be read, or is not UTF-8.
    #[error("{}", plain(.0))]
    Io(#[from] io::Error),
    /// It has more bytes than expected.
    #[error("is longer than {longest} bytes")]
    TooLong {
        /// Largest length that is read, bytes.
        longest: u64,
    },
}

/// Reads a text of at most so many bytes: a device has no end.
///
/// # Errors
/// [`TextError`].
pub fn read_text(path: &Path, longest: u64) -> Result<String, TextError> {
    let mut text = String::new();
    let read = File::open(path).and_then(|file| {
        file.take(longest.saturating_add(1))
            .read_to_string(&mut text)
    });
    match read.map(u64::try_from) {
        Err(error) => Err(error.into()),
        Ok(Ok(length)) if length <= longest => Ok(text),
        Ok(_) => Err(TextError::TooLong { longest }),
    }
}

/// Words of an error of the system, without its number.
pub fn plain(error: &io::Error) -> String {
    let text = error.to_string();
    text.split_once(" (os error ")
        .map_or(text.as_str(), |(words, _)| words)
        .to_owned()
}

/// Result of reading a line.
pub enum Line {
    /// It was read.
    Complete,
    /// It has no end within the bound.
    TooLong,
    /// The input has ended.
    End,
}

/// Reads up to the next newline, without it; keeps at most `longest` bytes, and skips the rest of a
/// line that is longer.
pub fn read_line(input: &mut impl BufRead, line: &mut Vec<u8>, longest: usize) -> io::Result<Line> {
    let read = read_beginning(input, line, longest)?;
    if matches!(read, Line::TooLong) {
        input.skip_until(b'\n')?;
    }
    Ok(read)
}

/// The same without the skip: for an input that is not read on after a line that is too long.
pub fn read_beginning(
    input: &mut impl BufRead,
    line: &mut Vec<u8>,
    longest: usize,
) -> io::Result<Line> {
    line.clear();
    input
        .by_ref()
        .take(longest as u64 + 1)
        .read_until(b'\n', line)?;
    if line.last() == Some(&b'\n') {
        line.pop();
    } else if line.len() > longest {
        return Ok(Line::TooLong);
    } else if line.is_empty() {
        return Ok(Line::End);
    }
    Ok(Line::Complete)
}
