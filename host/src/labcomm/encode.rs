//! JSON lines as a stream.

use std::io::{self, BufRead, Write};

use gantry_tau_labcomm::{Encoder, ErrorKind, Registry, Type, Version};
use serde_json::Value;

use super::from_json::{self, Bytes};
use super::{StreamRegistry, to_json};
use crate::lines::{Line, read_beginning};

/// Longest line, bytes: a device has no end.
const LONGEST_LINE: usize = 1 << 24;

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
        /// The reason, in words.
        reason: String,
    },
}

/// Writes the stream that [`decode`](super::decode()) would print as these lines. Keys `define`, `sample`, `type`, `value` and `index` count
/// (the last is optional: encoders number from 0x80 in 2006, and from 0x40 in 2014); lines with `version`, `skip` or `reference` are passed
/// over, and a line with `error` ends it.
///
/// # Errors
/// Error of input or output, or the first line that cannot be encoded; what stands before it is written.
pub fn encode(version: Version, mut input: impl BufRead, mut output: impl Write) -> Result<(), EncodeError> {
    let mut lines = Lines { version, registry: Box::new(Registry::new(version)), next_index: version.first_index() };
    let mut start = [0; OVERHEAD];
    let mut encoder = Encoder::new(version, &mut start);
    encoder.version().map_err(|error| EncodeError::Line { line: 0, reason: error.to_string() })?;
    output.write_all(encoder.bytes())?;
    let mut bytes = Vec::new();
    for line in 1.. {
        let refused = |reason| EncodeError::Line { line, reason };
        match read_beginning(&mut input, &mut bytes, LONGEST_LINE)? {
            Line::End => break,
            Line::TooLong => return Err(refused(format!("is longer than {LONGEST_LINE} bytes"))),
            Line::Complete => {}
        }
        let text = std::str::from_utf8(&bytes).map_err(|_| refused("is not UTF-8".to_owned()))?;
        if !text.trim().is_empty() {
            output.write_all(&lines.packet(text).map_err(refused)?)?;
        }
    }
    output.flush()?;
    Ok(())
}

struct Lines {
    version: Version,
    registry: StreamRegistry,
    next_index: u32,
}

impl Lines {
    /// Bytes of one line.
    fn packet(&mut self, line: &str) -> Result<Vec<u8>, String> {
        let json: Value = serde_json::from_str(line).map_err(|error| format!("not JSON: {error}"))?;
        let index = match json.get("index") {
            None => None,
            Some(index) => {
                let number = index.as_u64().and_then(|index| u32::try_from(index).ok());
                Some(number.ok_or_else(|| format!("{} is not an index", from_json::short(index)))?)
            }
        };
        if let Some(error) = json.get("error") {
            Err(format!("the recording ends with an error: {}", from_json::short(error)))
        } else if let Some(name) = json.get("define") {
            let ty = json.get("type").ok_or("a definition without \"type\"")?;
            self.definition(&from_json::text(name)?, index, ty)
        } else if let Some(name) = json.get("sample") {
            let value = json.get("value").ok_or("a sample without \"value\"")?;
            self.data(&from_json::text(name)?, index, value)
        } else if ["version", "skip", "reference"].iter().any(|key| json.get(*key).is_some()) {
            Ok(Vec::new())
        } else {
            Err("expected \"define\" or \"sample\"".to_owned())
        }
    }

    fn definition(&mut self, name: &[u8], index: Option<u32>, ty: &Value) -> Result<Vec<u8>, String> {
        let mut bytes = Bytes::new(self.version);
        from_json::ty(&mut bytes, ty)?;
        let ty = Type::whole(self.version, &bytes.bytes).map_err(words)?;
        let index = index.unwrap_or(self.next_index);
        let room = name.len().saturating_add(bytes.bytes.len()).saturating_add(OVERHEAD);
        let packet = self.written(room, |encoder| encoder.define_type(index, name, &ty))?;
        self.registry.define(index, name, &ty).map_err(words)?;
        self.next_index = self.next_index.max(index.saturating_add(1));
        Ok(packet)
    }

    fn data(&self, name: &[u8], index: Option<u32>, value: &Value) -> Result<Vec<u8>, String> {
        let definition = match index {
            Some(index) => self.registry.get(index).filter(|definition| definition.name == name),
            None => self.registry.iter().find(|definition| definition.name == name),
        };
        let definition = definition.ok_or_else(|| {
            let mut text = "no definition of ".to_owned();
            to_json::text(&mut text, name);
            text
        })?;
        let mut bytes = Bytes::new(self.version);
        from_json::value(&mut bytes, &definition.ty, value)?;
        let room = bytes.bytes.len().saturating_add(OVERHEAD);
        self.written(room, |encoder| encoder.data_bytes(definition.index, &definition.ty, &bytes.bytes))
    }

    /// What an encoder writes.
    fn written(
        &self,
        room: usize,
        write: impl FnOnce(&mut Encoder<'_>) -> Result<(), ErrorKind>,
    ) -> Result<Vec<u8>, String> {
        let mut buffer = vec![0; room];
        let mut encoder = Encoder::new(self.version, &mut buffer);
        write(&mut encoder).map_err(words)?;
        let length = encoder.len();
        buffer.truncate(length);
        Ok(buffer)
    }
}

fn words(error: ErrorKind) -> String {
    error.to_string()
}
