//! Input from files, scripts and operators, which may be anything.

use std::fs::File;
use std::io::{self, BufRead, Read};
use std::path::Path;

/// Reads a text of at most so many bytes: a device has no end.
pub(crate) fn read_text(path: &Path, longest: u64) -> Result<String, String> {
    let mut text = String::new();
    let read = File::open(path).and_then(|file| file.take(longest.saturating_add(1)).read_to_string(&mut text));
    match read.map(u64::try_from) {
        Err(error) => Err(plain(&error)),
        Ok(Ok(length)) if length <= longest => Ok(text),
        Ok(_) => Err(format!("is longer than {longest} bytes")),
    }
}

/// Words of an error of the system, without its number.
pub(crate) fn plain(error: &io::Error) -> String {
    let text = error.to_string();
    text.split_once(" (os error ").map_or(text.as_str(), |(words, _)| words).to_owned()
}

/// Result of reading a line.
pub(crate) enum Line {
    /// It was read.
    Complete,
    /// It has no end within the bound.
    TooLong,
    /// The input has ended.
    End,
}

/// Reads up to the next newline, without it; keeps at most `longest` bytes, and skips the rest of a line that is longer.
pub(crate) fn read_line(input: &mut impl BufRead, line: &mut Vec<u8>, longest: usize) -> io::Result<Line> {
    let read = read_beginning(input, line, longest)?;
    if matches!(read, Line::TooLong) {
        input.skip_until(b'\n')?;
    }
    Ok(read)
}

/// The same without the skip: for an input that is not read on after a line that is too long.
pub(crate) fn read_beginning(input: &mut impl BufRead, line: &mut Vec<u8>, longest: usize) -> io::Result<Line> {
    line.clear();
    input.by_ref().take(longest as u64 + 1).read_until(b'\n', line)?;
    if line.last() == Some(&b'\n') {
        line.pop();
    } else if line.len() > longest {
        return Ok(Line::TooLong);
    } else if line.is_empty() {
        return Ok(Line::End);
    }
    Ok(Line::Complete)
}
