//! JSON lines as a stream.

use std::io::{self, BufRead, Write};

use gantry_tau_labcomm::{Encoder, ErrorKind, Registry, Type, Version};
use gantry_tau_system::lines::{Line, read_beginning};
use serde_json::Value;

use super::from_json::{self, Bytes};
use super::line_error::{LineError, short};
use super::{StreamRegistry, to_json};

/// Longest line, bytes: a device has no end.
const MAX_LINE: usize = 1 << 24;

/// Bytes around a name and a type, or around a value: at most five numbers.
const OVERHEAD: usize = 32;

/// Reason why lines are not encoded.
#[derive(Debug, thiserror::Error)]
pub enum EncodeError {
    /// Error of input or output.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// A line that cannot be encoded.
    #[error("line {line}: {reason}")]
    Line {
        /// Number of the line, from 1.
        line: usize,
        /// The reason.
        #[source]
        reason: LineError,
    },
}

/// Writes the stream that [`decode`](super::decode()) would print as these lines. Keys `define`,
/// `sample`, `type`, `value` and `index` count (the last is optional: encoders number from 0x80 in
/// 2006, and from 0x40 in 2014); lines with `version`, `skip` or `reference` are passed over, and a
/// line with `error` ends it.
///
/// # Errors
/// Error of input or output, or the first line that cannot be encoded; what stands before it is
/// written.
pub fn encode(
    version: Version,
    mut input: impl BufRead,
    mut output: impl Write,
) -> Result<(), EncodeError> {
    let mut lines = LineEncoder {
        version,
        registry: Box::new(Registry::new(version)),
        next_index: version.first_index(),
    };
    let mut start = [0; OVERHEAD];
    let mut encoder = Encoder::new(version, &mut start);
    encoder.version().map_err(|error| EncodeError::Line {
        line: 0,
        reason: error.into(),
    })?;
    output.write_all(encoder.bytes())?;
    let mut bytes = Vec::new();
    for line in 1.. {
        let packet = match read_beginning(&mut input, &mut bytes, MAX_LINE)? {
            Line::End => break,
            Line::TooLong => Err(LineError::TooLong { longest: MAX_LINE }),
            Line::Complete => lines.packet(&bytes),
        };
        output.write_all(&packet.map_err(|reason| EncodeError::Line { line, reason })?)?;
    }
    output.flush()?;
    Ok(())
}

struct LineEncoder {
    version: Version,
    registry: StreamRegistry,
    next_index: u32,
}

impl LineEncoder {
    /// Bytes of one line; none of a blank one.
    fn packet(&mut self, line: &[u8]) -> Result<Vec<u8>, LineError> {
        let line = std::str::from_utf8(line).map_err(|_| LineError::NotUtf8)?;
        if line.trim().is_empty() {
            return Ok(Vec::new());
        }
        let json: Value = serde_json::from_str(line).map_err(|error| LineError::NotJson {
            reason: error.to_string(),
        })?;
        let index = match json.get("index") {
            None => None,
            Some(index) => {
                let number = index.as_u64().and_then(|index| u32::try_from(index).ok());
                Some(number.ok_or_else(|| LineError::NotAnIndex { json: short(index) })?)
            }
        };
        if let Some(error) = json.get("error") {
            Err(LineError::EndsWithError { json: short(error) })
        } else if let Some(name) = json.get("define") {
            let ty = json.get("type").ok_or(LineError::NoType)?;
            self.definition(&from_json::text(name)?, index, ty)
        } else if let Some(name) = json.get("sample") {
            let value = json.get("value").ok_or(LineError::NoValue)?;
            self.data(&from_json::text(name)?, index, value)
        } else if ["version", "skip", "reference"]
            .iter()
            .any(|key| json.get(*key).is_some())
        {
            Ok(Vec::new())
        } else {
            Err(LineError::UnknownKind)
        }
    }

    fn definition(
        &mut self,
        name: &[u8],
        index: Option<u32>,
        ty: &Value,
    ) -> Result<Vec<u8>, LineError> {
        let mut bytes = Bytes::new(self.version);
        from_json::ty(&mut bytes, ty)?;
        let ty = Type::whole(self.version, &bytes.bytes)?;
        let index = index.unwrap_or(self.next_index);
        let room = name
            .len()
            .saturating_add(bytes.bytes.len())
            .saturating_add(OVERHEAD);
        let packet = self.written(room, |encoder| encoder.define_type(index, name, &ty))?;
        self.registry.define(index, name, &ty)?;
        self.next_index = self.next_index.max(index.saturating_add(1));
        Ok(packet)
    }

    fn data(&self, name: &[u8], index: Option<u32>, value: &Value) -> Result<Vec<u8>, LineError> {
        let definition = match index {
            Some(index) => self
                .registry
                .get(index)
                .filter(|definition| definition.name == name),
            None => self
                .registry
                .iter()
                .find(|definition| definition.name == name),
        };
        let definition = definition.ok_or_else(|| {
            let mut sample = String::new();
            to_json::text(&mut sample, name);
            LineError::Undefined { sample }
        })?;
        let mut bytes = Bytes::new(self.version);
        from_json::value(&mut bytes, &definition.ty, value)?;
        let room = bytes.bytes.len().saturating_add(OVERHEAD);
        self.written(room, |encoder| {
            encoder.data_bytes(definition.index, &definition.ty, &bytes.bytes)
        })
    }

    /// Output of an encoder.
    fn written(
        &self,
        room: usize,
        write: impl FnOnce(&mut Encoder<'_>) -> Result<(), ErrorKind>,
    ) -> Result<Vec<u8>, LineError> {
        let mut buffer = vec![0; room];
        let mut encoder = Encoder::new(self.version, &mut buffer);
        write(&mut encoder)?;
        let length = encoder.len();
        buffer.truncate(length);
        Ok(buffer)
    }
}
