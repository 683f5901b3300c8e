//! Recovery of a recording whose program was killed: its whole messages, in a file with summary and
//! end.
//!
//! Contents of records are read by the crate `mcap`; records and chunks are separated here. The
//! crate's own readers take a chunk that is cut off either not at all or without its checksum, and
//! subtract lengths unchecked: a damaged file would panic.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use crc32fast::hash;
use gantry_tau_system::output::{GrowingFile, WriteError};
use mcap::MAGIC;
use mcap::read::parse_record;
use mcap::records::{Record, op};

use super::writer::{ChannelId, McapWriter};

/// Longest record, bytes; a chunk of ours is little more than 1 MiB.
const MAX_RECORD: u64 = 64 << 20;
/// Bytes of a chunk before its records: first and last time, size, checksum, no compression, size.
const CHUNK_HEAD: usize = 40;
/// Records that the new file takes over.
const COPIED: [u8; 4] = [op::SCHEMA, op::CHANNEL, op::METADATA, op::MESSAGE];

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

impl RecoverError {
    /// Returns the conversion of errors with a file.
    fn of(path: &Path) -> impl Fn(io::Error) -> Self {
        move |reason| Self::Io {
            path: path.display().to_string(),
            reason,
        }
    }
}

/// A file that was recovered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recovered {
    /// The new file, beside the old one.
    pub path: PathBuf,
    /// Messages in it.
    pub messages: u64,
}

/// Writes the whole messages of `FILE.mcap`, which has no end, to `FILE-recovered.mcap` beside it.
/// The old file stays.
///
/// # Errors
/// [`RecoverError`].
pub fn recover(path: &Path) -> Result<Recovered, RecoverError> {
    let name = path.display().to_string();
    let mut records = Records::open(path)
        .map_err(RecoverError::of(path))?
        .ok_or_else(|| RecoverError::NotOurs(name.clone()))?;
    let mut stem = path.file_stem().unwrap_or_default().to_owned();
    stem.push("-recovered.mcap");
    let mut file = GrowingFile::fresh(&path.with_file_name(stem), None)?;
    if records.is_complete().map_err(RecoverError::of(path))? {
        return Err(RecoverError::Complete(name));
    }
    let mut target: Option<RecoveredFile> = None;
    while let Some(record) = records.next().map_err(RecoverError::of(path))? {
        if record.opcode == op::HEADER {
            let library = match parse_record(record.opcode, &record.body) {
                Ok(Record::Header(header)) if header.library.starts_with("gantry-tau ") => {
                    header.library
                }
                _ => return Err(RecoverError::NotOurs(name)),
            };
            file.open().map_err(RecoverError::of(path))?;
            let next = GrowingFile::continuing(file.path())?;
            target = Some(RecoveredFile {
                path: file.path().to_owned(),
                writer: McapWriter::new(next, &library).map_err(RecoverError::of(path))?,
                schemas: BTreeMap::new(),
                channels: BTreeMap::new(),
                messages: 0,
            });
        } else if let Some(target) = &mut target {
            if !target.copy(&record).map_err(RecoverError::of(path))? {
                break;
            }
        }
    }
    let target = target.ok_or(RecoverError::NotOurs(name))?;
    target.writer.finish().map_err(RecoverError::of(path))?;
    Ok(Recovered {
        path: target.path,
        messages: target.messages,
    })
}

/// The new file.
struct RecoveredFile {
    path: PathBuf,
    writer: McapWriter,
    /// Names and texts of the schemas, by their old numbers.
    schemas: BTreeMap<u16, (String, Vec<u8>)>,
    /// Channels by their old numbers.
    channels: BTreeMap<u16, ChannelId>,
    messages: u64,
}

impl RecoveredFile {
    /// Copies a record, or the records of a chunk. False: what follows is damaged.
    fn copy(&mut self, record: &McapRecord) -> io::Result<bool> {
        if record.opcode != op::CHUNK {
            return self.copy_one(record);
        }
        let Some((head, records)) = record.body.split_at_checked(CHUNK_HEAD) else {
            return Ok(false);
        };
        let (Some(checksum), Some([0, 0, 0, 0])) = (head.get(24..28), head.get(28..32)) else {
            return Ok(false);
        };
        if record.is_whole && checksum != hash(records).to_le_bytes() {
            return Ok(false);
        }
        let mut records = Records(records);
        while let Some(record) = records.next()? {
            if !self.copy_one(&record)? {
                return Ok(false);
            }
        }
        Ok(record.is_whole)
    }

    /// Copies a record that is not a chunk. False: what follows is damaged.
    fn copy_one(&mut self, record: &McapRecord) -> io::Result<bool> {
        if !record.is_whole {
            return Ok(false);
        }
        if !COPIED.contains(&record.opcode) {
            return Ok(true);
        }
        match parse_record(record.opcode, &record.body) {
            Ok(Record::Schema { header, data }) => {
                self.schemas
                    .insert(header.id, (header.name, data.into_owned()));
            }
            Ok(Record::Channel(channel)) => {
                if let Some((name, text)) = self.schemas.get(&channel.schema_id) {
                    let copy = self.writer.channel(&channel.topic, name, text)?;
                    self.channels.insert(channel.id, copy);
                }
            }
            Ok(Record::Metadata(metadata)) => self.writer.metadata(&metadata)?,
            Ok(Record::Message { header, data }) => {
                if let Some(channel) = self.channels.get(&header.channel_id) {
                    self.writer.message(*channel, header.log_time, &data)?;
                    self.messages += 1;
                }
            }
            _ => return Ok(false),
        }
        Ok(true)
    }
}

/// A record, or the beginning of the last one.
struct McapRecord {
    opcode: u8,
    body: Vec<u8>,
    is_whole: bool,
}

/// Records of a file or a chunk, one after the other.
struct Records<R>(R);

impl Records<BufReader<File>> {
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
        // The head alone is not an end.
        self.0.seek(SeekFrom::Start(end.saturating_sub(8).max(1)))?;
        let mut last = Vec::new();
        self.0.read_to_end(&mut last)?;
        self.0.seek(SeekFrom::Start(begin))?;
        Ok(last == MAGIC)
    }
}

impl<R: Read> Records<R> {
    /// Reads a record: opcode, length of 64 bits, contents. `None` at the end.
    fn next(&mut self) -> io::Result<Option<McapRecord>> {
        let mut head = Vec::new();
        self.0.by_ref().take(9).read_to_end(&mut head)?;
        let [opcode, length @ ..] = head.as_slice() else {
            return Ok(None);
        };
        let Ok(length) = length.try_into().map(u64::from_le_bytes) else {
            return Ok(None);
        };
        let mut body = Vec::new();
        let read = self
            .0
            .by_ref()
            .take(length.min(MAX_RECORD))
            .read_to_end(&mut body)?;
        Ok(Some(McapRecord {
            opcode: *opcode,
            body,
            is_whole: u64::try_from(read).is_ok_and(|read| read == length),
        }))
    }
}
