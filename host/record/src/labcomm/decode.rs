//! A stream as JSON lines.

use std::fmt::Write as _;
use std::io::{self, ErrorKind::Interrupted, Read, Write};

use gantry_tau_labcomm::{Definition, ErrorKind, Event, MAX_VALUE};

use super::to_json::{self, TextError};
use super::{Floats, Stream};

/// Bytes to read at once.
const CHUNK: usize = 1 << 16;

/// Writes one JSON line per event, and one for the error that ends the stream, if any. With `bits`
/// floats are the hex of their bits. True if the stream has no error and ends between two events.
///
/// A value whose line would be longer than 128 MiB is an error of the kind `limit`. Beside a line,
/// the value is held: 16 MiB at most.
///
/// # Errors
/// Error of input or output.
pub fn decode(mut input: impl Read, mut output: impl Write, bits: bool) -> io::Result<bool> {
    let mut stream = Stream::new(MAX_VALUE);
    let mut chunk = vec![0; CHUNK];
    loop {
        if !events(&mut stream, &mut output, bits)? {
            return Ok(false);
        }
        output.flush()?;
        let read = match input.read(&mut chunk) {
            Err(error) if error.kind() == Interrupted => continue,
            other => other?,
        };
        if read > 0 {
            stream.push(chunk.get(..read).unwrap_or_default());
            continue;
        }
        stream.end();
        if !events(&mut stream, &mut output, bits)? {
            return Ok(false);
        }
        let held = stream.held();
        if held > 0 {
            let least = stream.least();
            let message =
                format!("the stream ends after {held} bytes of an event of at least {least}");
            output.write_all(
                error_line(stream.decoder().offset(), "incomplete", &message).as_bytes(),
            )?;
        }
        output.flush()?;
        return Ok(held == 0);
    }
}

/// Writes the lines of the events that are there; false after an error of the stream, and its line.
fn events(stream: &mut Stream, output: &mut impl Write, bits: bool) -> io::Result<bool> {
    loop {
        let at = stream.decoder().offset();
        let line = match stream.next_event() {
            Ok(None) => return Ok(true),
            Ok(Some(event)) => line(at, &event, bits),
            Err(error) => Err(TextError::Stream(error.kind)),
        };
        match line {
            Ok(line) => output.write_all(line.as_bytes())?,
            Err(error) => {
                output.write_all(error_line(at, kind(error), &error.to_string()).as_bytes())?;
                output.flush()?;
                return Ok(false);
            }
        }
    }
}

/// Line of an event.
fn line(at: u64, event: &Event<'_, '_>, bits: bool) -> Result<String, TextError> {
    let mut line = format!("{{\"at\":{at},");
    match event {
        Event::Version(version) => {
            line.push_str("\"version\":");
            to_json::string(&mut line, version.text().unwrap_or_default());
        }
        Event::Define(of) => definition(&mut line, "define", of),
        Event::Reference(of) => definition(&mut line, "reference", of),
        Event::Data { definition, value } => {
            line.push_str("\"sample\":");
            to_json::text(&mut line, definition.name);
            let _ = write!(line, ",\"index\":{},\"value\":", definition.index);
            to_json::value(
                &mut line,
                value,
                if bits { Floats::Bits } else { Floats::Numbers },
            )?;
        }
        Event::Skipped(tag) => {
            let _ = write!(line, "\"skip\":{tag}");
        }
    }
    line.push_str("}\n");
    Ok(line)
}

fn definition(line: &mut String, key: &str, of: &Definition<'_>) {
    let _ = write!(line, "\"{key}\":");
    to_json::text(line, of.name);
    let _ = write!(line, ",\"index\":{},\"type\":", of.index);
    to_json::ty(line, &of.ty);
}

fn error_line(at: u64, kind: &str, message: &str) -> String {
    let mut line = format!("{{\"at\":{at},\"error\":{{\"kind\":\"{kind}\",\"message\":");
    to_json::string(&mut line, message);
    line.push_str("}}\n");
    line
}

/// Class of an error, for scripts.
const fn kind(of: TextError) -> &'static str {
    match of {
        TextError::Stream(ErrorKind::Incomplete) => "incomplete",
        TextError::Stream(ErrorKind::Malformed(_)) => "malformed",
        TextError::Stream(ErrorKind::Version(_)) => "version",
        TextError::Stream(ErrorKind::UnknownIndex(_)) => "unknown_index",
        TextError::Stream(ErrorKind::Conflict(_)) => "conflict",
        TextError::Stream(ErrorKind::Limit(_)) | TextError::TooLong => "limit",
    }
}
