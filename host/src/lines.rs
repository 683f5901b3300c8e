//! Lines of input from scripts and operators, which may be anything.

use std::io::{self, BufRead, Read};

/// Result of reading a line.
pub(crate) enum Line {
    /// It was read.
    Complete,
    /// It was skipped to its end.
    TooLong,
    /// The input has ended.
    End,
}

/// Reads up to the next newline, without it; keeps at most `longest` bytes.
pub(crate) fn read_line(input: &mut impl BufRead, line: &mut Vec<u8>, longest: usize) -> io::Result<Line> {
    line.clear();
    input.by_ref().take(longest as u64 + 1).read_until(b'\n', line)?;
    if line.last() == Some(&b'\n') {
        line.pop();
    } else if line.len() > longest {
        input.skip_until(b'\n')?;
        return Ok(Line::TooLong);
    } else if line.is_empty() {
        return Ok(Line::End);
    }
    Ok(Line::Complete)
}
