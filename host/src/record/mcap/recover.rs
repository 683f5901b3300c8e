//! Recovery of a recording whose program was killed: its whole messages, in a file with summary and end.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use crc32fast::hash;

use super::writer::{ChannelId, MAGIC, Opcode, Writer};
use crate::output::{GrowingFile, WriteError};

/// Longest record, bytes; a chunk of ours is little more than 1 MiB.
const LONGEST: u64 = 64 << 20;
/// Bytes of the head of a record: opcode and length.
const HEAD: usize = 9;

/// Reason why a file is not recovered.
#[derive(Debug, thiserror::Error)]
pub enum RecoverError {
    /// It cannot be read, or the new one not be written.
    #[error("{path}: {reason}")]
    Io {
        /// The file.
        path: String,
        /// Reason of the system.
        reason: io::Error,
    },
    /// It is not a recording of this program.
    #[error("{0}: is not an MCAP recording of gantry-tau; other files are read by `mcap recover`")]
    NotOurs(String),
    /// It has an end.
    #[error("{0}: is complete; nothing is to be recovered")]
    Complete(String),
    /// The new file cannot be made.
    #[error(transparent)]
    Write(#[from] WriteError),
}

/// A file that was recovered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recovered {
    /// The new file, beside the old one.
    pub path: PathBuf,
    /// Messages in it.
    pub messages: u64,
}

/// Writes the whole messages of `FILE.mcap`, which has no end, to `FILE-recovered.mcap` beside it. The old file stays.
///
/// # Errors
/// [`RecoverError`].
pub fn recover(path: &Path) -> Result<Recovered, RecoverError> {
    let name = path.display().to_string();
    let failed = |reason: io::Error| RecoverError::Io { path: name.clone(), reason };
    let mut records = Records::open(path).map_err(failed)?.ok_or_else(|| RecoverError::NotOurs(name.clone()))?;
    let mut stem = path.file_stem().unwrap_or_default().to_owned();
    stem.push("-recovered.mcap");
    let mut file = GrowingFile::fresh(&path.with_file_name(stem), None)?;
    if records.is_complete().map_err(failed)? {
        return Err(RecoverError::Complete(name));
    }
    let mut target: Option<Target> = None;
    while let Some(record) = records.next().map_err(failed)? {
        if record.opcode == Opcode::Header.code() {
            let mut fields = Fields(&record.body);
            let library = fields.text().and_then(|_| fields.text()).unwrap_or_default();
            if !library.starts_with("gantry-tau ") {
                return Err(RecoverError::NotOurs(name));
            }
            file.open().map_err(failed)?;
            let path = file.path().to_owned();
            let next = GrowingFile::continuing(&path)?;
            let writer = Writer::new(next, library).map_err(failed)?;
            target = Some(Target { path, writer, schemas: Vec::new(), channels: Vec::new(), messages: 0 });
        } else if let Some(target) = &mut target {
            if !target.take(&record).map_err(failed)? {
                break;
            }
        }
    }
    let mut target = target.ok_or(RecoverError::NotOurs(name.clone()))?;
    target.writer.finish().and_then(|()| target.writer.out_mut().sync()).map_err(failed)?;
    Ok(Recovered { path: target.path, messages: target.messages })
}

/// The new file.
struct Target {
    path: PathBuf,
    writer: Writer<GrowingFile>,
    /// Number, name and text of each schema.
    schemas: Vec<(u16, String, String)>,
    /// Channels by their old numbers.
    channels: Vec<(u16, ChannelId)>,
    messages: u64,
}

impl Target {
    /// Takes a record. False: what follows is damaged.
    fn take(&mut self, record: &Record) -> io::Result<bool> {
        let mut fields = Fields(&record.body);
        let code = record.opcode;
        if code == Opcode::Chunk.code() {
            return self.chunk(&mut fields, record.is_whole);
        }
        if !record.is_whole {
            return Ok(false);
        }
        if code == Opcode::Schema.code() {
            if let Some((id, (name, (_, text)))) = fields.u16().zip(fields.text().zip(fields.text().zip(fields.text())))
            {
                self.schemas.push((id, name.to_owned(), text.to_owned()));
            }
        } else if code == Opcode::Channel.code() {
            let Some((id, (schema, topic))) = fields.u16().zip(fields.u16().zip(fields.text())) else {
                return Ok(false);
            };
            if let Some((_, name, text)) = self.schemas.iter().find(|(number, ..)| *number == schema) {
                self.channels.push((id, self.writer.channel(topic, name, text)?));
            }
        } else if code == Opcode::Metadata.code() {
            let name = fields.text().unwrap_or_default();
            let mut map = Fields(fields.sized().unwrap_or_default());
            let entries = std::iter::from_fn(|| map.text().zip(map.text())).collect::<Vec<_>>();
            self.writer.metadata(name, &entries)?;
        }
        Ok(true)
    }

    /// Takes the whole messages of a chunk. False: it is cut off or damaged.
    fn chunk(&mut self, fields: &mut Fields<'_>, is_whole: bool) -> io::Result<bool> {
        let head = (fields.u64(), fields.u64(), fields.u64());
        let ((Some(_), Some(_), Some(_)), Some(checksum)) = (head, fields.u32()) else { return Ok(false) };
        let (Some(""), Some(_)) = (fields.text(), fields.u64()) else { return Ok(false) };
        let bytes = fields.0;
        if is_whole && hash(bytes) != checksum {
            return Ok(false);
        }
        let mut rest = Fields(bytes);
        while let Some((opcode, length)) = rest.u8().zip(rest.u64()) {
            let Some(body) = usize::try_from(length).ok().and_then(|length| rest.take(length)) else { break };
            let mut message = Fields(body);
            if opcode != Opcode::Message.code() {
                continue;
            }
            let Some((id, (_, (time, _)))) = message.u16().zip(message.u32().zip(message.u64().zip(message.u64())))
            else {
                break;
            };
            if let Some((_, channel)) = self.channels.iter().find(|(number, _)| *number == id) {
                self.writer.message(*channel, time, message.0)?;
                self.messages += 1;
            }
        }
        Ok(is_whole)
    }
}

/// A record, or the beginning of the last one.
struct Record {
    opcode: u8,
    body: Vec<u8>,
    is_whole: bool,
}

/// Records of a file, one after the other.
struct Records(BufReader<File>);

impl Records {
    /// Opens a file; `None` if it is not MCAP.
    fn open(path: &Path) -> io::Result<Option<Self>> {
        let mut file = BufReader::new(File::open(path)?);
        let mut magic = Vec::new();
        file.by_ref().take(8).read_to_end(&mut magic)?;
        Ok((magic == MAGIC).then_some(Self(file)))
    }

    /// True if the file has an end. The place in it stays.
    fn is_complete(&mut self) -> io::Result<bool> {
        let begin = self.0.stream_position()?;
        let end = self.0.seek(SeekFrom::End(0))?;
        // The head alone is no end.
        self.0.seek(SeekFrom::Start(end.saturating_sub(8).max(1)))?;
        let mut last = Vec::new();
        self.0.read_to_end(&mut last)?;
        self.0.seek(SeekFrom::Start(begin))?;
        Ok(last == MAGIC)
    }

    fn next(&mut self) -> io::Result<Option<Record>> {
        let mut head = Vec::new();
        self.0.by_ref().take(9).read_to_end(&mut head)?;
        let mut fields = Fields(&head);
        let Some((opcode, length)) = fields.u8().zip(fields.u64()).filter(|_| head.len() == HEAD) else {
            return Ok(None);
        };
        let mut body = Vec::new();
        let read = self.0.by_ref().take(length.min(LONGEST)).read_to_end(&mut body)?;
        let is_whole = u64::try_from(read).is_ok_and(|read| read == length);
        Ok(Some(Record { opcode, body, is_whole }))
    }
}

/// Fields of a record, little-endian.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn take(&mut self, length: usize) -> Option<&'a [u8]> {
        let (field, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(field)
    }

    fn array<const L: usize>(&mut self) -> Option<[u8; L]> {
        self.take(L).and_then(|bytes| bytes.try_into().ok())
    }

    fn u8(&mut self) -> Option<u8> {
        self.array::<1>().map(u8::from_le_bytes)
    }

    fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// Bytes behind their length of 32 bits.
    fn sized(&mut self) -> Option<&'a [u8]> {
        let length = self.u32()?;
        self.take(usize::try_from(length).ok()?)
    }

    fn text(&mut self) -> Option<&'a str> {
        std::str::from_utf8(self.sized()?).ok()
    }
}
