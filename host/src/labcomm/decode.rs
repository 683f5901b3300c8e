//! A stream as JSON lines.

use std::fmt::Write as _;
use std::io::{self, Read, Write};

use gantry_tau_labcomm::{Decoded, Decoder, Definition, Error, ErrorKind, Event, MAX_VALUE};

use super::{Floats, StreamDecoder, to_json};

/// Smallest number of bytes to read at once.
const CHUNK: usize = 1 << 16;

/// Writes one JSON line per event, and one for the error that ends the stream, if any. With `bits` floats are the hex of their bits.
/// True if the stream has no error and ends between two events.
///
/// # Errors
/// Error of input or output.
pub fn decode(mut input: impl Read, mut output: impl Write, bits: bool) -> io::Result<bool> {
    let mut decoder: StreamDecoder = Box::new(Decoder::new(MAX_VALUE));
    let (mut bytes, mut start) = (Vec::new(), 0);
    let mut lines = String::new();
    loop {
        let outcome = events(&mut decoder, &bytes, &mut start, bits, &mut lines);
        if let Err(error) = outcome {
            error_line(&mut lines, error.at, kind(error.kind), &error.kind.to_string());
        }
        output.write_all(lines.as_bytes())?;
        output.flush()?;
        lines.clear();
        let Ok(least) = outcome else { return Ok(false) };
        bytes.drain(..start);
        start = 0;
        if !read_until(&mut input, &mut bytes, least)? {
            let is_whole = bytes.is_empty();
            if !is_whole {
                let held = bytes.len();
                let message = format!("the stream ends after {held} bytes of an event of at least {least}");
                error_line(&mut lines, decoder.offset(), "incomplete", &message);
                output.write_all(lines.as_bytes())?;
                output.flush()?;
            }
            return Ok(is_whole);
        }
    }
}

/// Decodes the events that are there, from `start` on. Returns how many bytes the next event needs at least.
fn events(
    decoder: &mut StreamDecoder,
    bytes: &[u8],
    start: &mut usize,
    bits: bool,
    lines: &mut String,
) -> Result<usize, Error> {
    loop {
        let at = decoder.offset();
        match decoder.decode(bytes.get(*start..).unwrap_or_default())? {
            Decoded::Need(least) => return Ok(least),
            Decoded::Event { event, used } => {
                *start = start.saturating_add(used);
                line(lines, at, &event, bits).map_err(|kind| Error { at, kind })?;
            }
        }
    }
}

/// Reads until `least` bytes are held; false if the input ends before.
fn read_until(input: &mut impl Read, bytes: &mut Vec<u8>, least: usize) -> io::Result<bool> {
    while bytes.len() < least {
        let held = bytes.len();
        // As much as is held, so that a long value is not walked over and over.
        bytes.resize(held.saturating_add(held.max(CHUNK)), 0);
        let read = match input.read(bytes.get_mut(held..).unwrap_or_default()) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {
                bytes.truncate(held);
                continue;
            }
            other => other?,
        };
        bytes.truncate(held.saturating_add(read));
        if read == 0 {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Line of an event.
fn line(lines: &mut String, at: u64, event: &Event<'_, '_>, bits: bool) -> Result<(), ErrorKind> {
    let _ = write!(lines, "{{\"at\":{at},");
    match event {
        Event::Version(version) => {
            lines.push_str("\"version\":");
            to_json::string(lines, version.text().unwrap_or_default());
        }
        Event::Define(of) => definition(lines, "define", of),
        Event::Reference(of) => definition(lines, "reference", of),
        Event::Data { definition, value } => {
            lines.push_str("\"sample\":");
            to_json::text(lines, definition.name);
            let _ = write!(lines, ",\"index\":{},\"value\":", definition.index);
            to_json::value(lines, value, if bits { Floats::Bits } else { Floats::Numbers })?;
        }
        Event::Skipped(tag) => {
            let _ = write!(lines, "\"skip\":{tag}");
        }
    }
    lines.push_str("}\n");
    Ok(())
}

fn definition(lines: &mut String, key: &str, of: &Definition<'_>) {
    let _ = write!(lines, "\"{key}\":");
    to_json::text(lines, of.name);
    let _ = write!(lines, ",\"index\":{},\"type\":", of.index);
    to_json::ty(lines, &of.ty);
}

fn error_line(lines: &mut String, at: u64, kind: &str, message: &str) {
    let _ = write!(lines, "{{\"at\":{at},\"error\":{{\"kind\":\"{kind}\",\"message\":");
    to_json::string(lines, message);
    lines.push_str("}}\n");
}

/// Class of an error, for scripts.
const fn kind(of: ErrorKind) -> &'static str {
    match of {
        ErrorKind::Incomplete => "incomplete",
        ErrorKind::Malformed(_) => "malformed",
        ErrorKind::Version(_) => "version",
        ErrorKind::UnknownIndex(_) => "unknown_index",
        ErrorKind::Conflict(_) => "conflict",
        ErrorKind::Limit(_) => "limit",
    }
}
