//! Writer of MCAP files, version 0: schemas, channels, messages in uncompressed chunks with their indexes, and a summary.
//!
//! What is held is one chunk, the index of its messages, and the index of the chunks, some 150 bytes each.

use std::io::{self, Write};

use crc32fast::hash;

pub(super) const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";
/// Bytes of a chunk above which it is written ...
const CHUNK: usize = 1 << 20;
/// ... or time of a chunk, ns: what is in an open chunk is lost when the process is killed.
const CHUNK_NS: u64 = 1_000_000_000;

/// Kinds of records.
#[derive(Clone, Copy)]
pub(super) enum Opcode {
    Header = 0x01,
    Footer = 0x02,
    Schema = 0x03,
    Channel = 0x04,
    Message = 0x05,
    Chunk = 0x06,
    MessageIndex = 0x07,
    ChunkIndex = 0x08,
    Statistics = 0x0b,
    Metadata = 0x0c,
    MetadataIndex = 0x0d,
    DataEnd = 0x0f,
}

/// Number of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ChannelId(u16);

/// Messages of a channel.
#[derive(Debug, Default)]
struct Channel {
    count: u64,
    /// Times and offsets of the messages in the chunk.
    index: Vec<(u64, u64)>,
}

/// File that is written.
#[derive(Debug)]
pub(super) struct Writer<W> {
    out: W,
    /// Bytes that are written.
    at: u64,
    channels: Vec<Channel>,
    /// Schemas, channels and the index of metadata, for the summary.
    definitions: Bytes,
    metadata_count: u32,
    /// Records of the chunk that is open.
    chunk: Bytes,
    /// First and last time in the chunk.
    chunk_times: Option<(u64, u64)>,
    /// Indexes of the chunks, for the summary.
    chunks: Bytes,
    chunk_count: u32,
    /// First and last time in the file.
    times: Option<(u64, u64)>,
}

impl<W: Write> Writer<W> {
    /// Begins a file.
    pub(super) fn new(mut out: W, library: &str) -> io::Result<Self> {
        let mut start = Bytes(MAGIC.to_vec());
        start.record(Opcode::Header, |header| {
            header.text("");
            header.text(library);
        });
        out.write_all(&start.0)?;
        Ok(Self {
            out,
            at: start.len(),
            channels: Vec::new(),
            definitions: Bytes::default(),
            metadata_count: 0,
            chunk: Bytes::default(),
            chunk_times: None,
            chunks: Bytes::default(),
            chunk_count: 0,
            times: None,
        })
    }

    /// Adds facts about the file, by a name.
    pub(super) fn metadata(&mut self, name: &str, entries: &[(&str, &str)]) -> io::Result<()> {
        let at = self.at;
        let mut record = Bytes::default();
        record.record(Opcode::Metadata, |record| {
            record.text(name);
            record.sized(|map| {
                for (key, value) in entries {
                    map.text(key);
                    map.text(value);
                }
            });
        });
        self.put(&record.0)?;
        self.metadata_count += 1;
        self.definitions.record(Opcode::MetadataIndex, |index| {
            index.u64(at);
            index.u64(record.len());
            index.text(name);
        });
        Ok(())
    }

    /// The file.
    pub(super) const fn out_mut(&mut self) -> &mut W {
        &mut self.out
    }

    /// Adds a channel of JSON messages; its schema is a JSON schema.
    pub(super) fn channel(&mut self, topic: &str, schema_name: &str, schema: &str) -> io::Result<ChannelId> {
        // As many as there are kinds of samples.
        let id = u16::try_from(self.channels.len().saturating_add(1)).map_err(io::Error::other)?;
        self.channels.push(Channel::default());
        let mut records = Bytes::default();
        records.record(Opcode::Schema, |record| {
            record.u16(id);
            record.text(schema_name);
            record.text("jsonschema");
            record.text(schema);
        });
        records.record(Opcode::Channel, |record| {
            record.u16(id);
            record.u16(id);
            record.text(topic);
            record.text("json");
            // No metadata.
            record.u32(0);
        });
        self.put(&records.0)?;
        self.definitions.0.extend(&records.0);
        Ok(ChannelId(id))
    }

    /// Adds a message; times are in ns.
    pub(super) fn message(&mut self, channel: ChannelId, time_ns: u64, data: &[u8]) -> io::Result<()> {
        let offset = self.chunk.len();
        let Some(of) = self.channels.get_mut(usize::from(channel.0).saturating_sub(1)) else {
            return Err(io::Error::other("a channel of another file"));
        };
        of.index.push((time_ns, offset));
        // The sequence wraps; readers sort by time.
        let sequence = u32::try_from(of.count & u64::from(u32::MAX)).unwrap_or_default();
        of.count += 1;
        self.chunk.record(Opcode::Message, |record| {
            record.u16(channel.0);
            record.u32(sequence);
            record.u64(time_ns);
            record.u64(time_ns);
            record.0.extend(data);
        });
        self.chunk_times = Some(extended(self.chunk_times, time_ns));
        self.times = Some(extended(self.times, time_ns));
        let is_long = self.chunk_times.is_some_and(|(first, last)| last.saturating_sub(first) >= CHUNK_NS);
        if is_long || self.chunk.0.len() >= CHUNK { self.end_chunk() } else { Ok(()) }
    }

    /// Writes the last chunk, the summary and the end.
    pub(super) fn finish(&mut self) -> io::Result<()> {
        self.end_chunk()?;
        let mut end = Bytes::default();
        // No checksum of all data: the chunks have theirs.
        end.record(Opcode::DataEnd, |record| record.u32(0));
        self.put(&end.0)?;
        let summary_start = self.at;
        let mut summary = std::mem::take(&mut self.definitions);
        let (first, last) = self.times.unwrap_or_default();
        summary.record(Opcode::Statistics, |record| {
            record.u64(self.channels.iter().map(|channel| channel.count).sum());
            let channels = u16::try_from(self.channels.len()).unwrap_or(u16::MAX);
            record.u16(channels);
            record.u32(channels.into());
            // No attachments.
            record.u32(0);
            record.u32(self.metadata_count);
            record.u32(self.chunk_count);
            record.u64(first);
            record.u64(last);
            record.sized(|map| {
                for (id, channel) in (1..).zip(&self.channels) {
                    map.u16(id);
                    map.u64(channel.count);
                }
            });
        });
        summary.0.extend(std::mem::take(&mut self.chunks).0);
        // The checksum covers the summary, and the footer up to itself.
        summary.record(Opcode::Footer, |record| {
            record.u64(summary_start);
            // No offsets of the summary's parts.
            record.u64(0);
            record.u32(0);
        });
        summary.0.truncate(summary.0.len().saturating_sub(size_of::<u32>()));
        let checksum = hash(&summary.0);
        summary.u32(checksum);
        summary.0.extend(MAGIC);
        self.put(&summary.0)?;
        self.out.flush()
    }

    /// Writes the open chunk, if there is something in it, and the indexes of its messages.
    fn end_chunk(&mut self) -> io::Result<()> {
        let Some((first, last)) = self.chunk_times.take() else { return Ok(()) };
        let (start, size) = (self.at, self.chunk.len());
        // Apart from the messages, so that these are not copied.
        let mut head = Bytes::default();
        head.u64(first);
        head.u64(last);
        head.u64(size);
        head.u32(hash(&self.chunk.0));
        // No compression.
        head.text("");
        head.u64(size);
        let mut front = Bytes(vec![Opcode::Chunk.code()]);
        front.u64(head.len().saturating_add(size));
        front.0.extend(head.0);
        self.out.write_all(&front.0)?;
        self.out.write_all(&self.chunk.0)?;
        self.chunk.0.clear();
        self.at += front.len() + size;
        let (length, index_start) = (self.at - start, self.at);
        let mut offsets = Bytes::default();
        let mut indexes = Bytes::default();
        for (id, channel) in (1..).zip(&mut self.channels).filter(|(_, channel)| !channel.index.is_empty()) {
            offsets.u16(id);
            offsets.u64(index_start + indexes.len());
            indexes.record(Opcode::MessageIndex, |record| {
                record.u16(id);
                record.sized(|entries| {
                    for (time, offset) in channel.index.drain(..) {
                        entries.u64(time);
                        entries.u64(offset);
                    }
                });
            });
        }
        self.put(&indexes.0)?;
        self.chunk_count += 1;
        self.chunks.record(Opcode::ChunkIndex, |record| {
            record.u64(first);
            record.u64(last);
            record.u64(start);
            record.u64(length);
            record.sized(|map| map.0.extend(offsets.0));
            record.u64(indexes.len());
            record.text("");
            record.u64(size);
            record.u64(size);
        });
        Ok(())
    }

    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.out.write_all(bytes)?;
        self.at += u64::try_from(bytes.len()).unwrap_or(u64::MAX);
        Ok(())
    }
}

/// First and last time with a further one.
fn extended(times: Option<(u64, u64)>, time: u64) -> (u64, u64) {
    times.map_or((time, time), |(first, last)| (first.min(time), last.max(time)))
}

impl Opcode {
    pub(super) const fn code(self) -> u8 {
        self as u8
    }
}

/// Bytes that grow; numbers are little-endian.
#[derive(Debug, Default)]
struct Bytes(Vec<u8>);

impl Bytes {
    fn len(&self) -> u64 {
        u64::try_from(self.0.len()).unwrap_or(u64::MAX)
    }

    fn u16(&mut self, number: u16) {
        self.0.extend(number.to_le_bytes());
    }

    fn u32(&mut self, number: u32) {
        self.0.extend(number.to_le_bytes());
    }

    fn u64(&mut self, number: u64) {
        self.0.extend(number.to_le_bytes());
    }

    /// Writes a text, or other bytes, behind their length.
    fn text(&mut self, text: &str) {
        self.sized(|bytes| bytes.0.extend(text.as_bytes()));
    }

    /// Writes contents behind their length of 32 bits.
    fn sized(&mut self, write: impl FnOnce(&mut Self)) {
        let start = self.0.len();
        self.u32(0);
        write(self);
        let contents = self.0.len().saturating_sub(start).saturating_sub(size_of::<u32>());
        // A chunk and all that it has is some megabytes.
        let length = u32::try_from(contents).unwrap_or(u32::MAX);
        self.overwrite(start, &length.to_le_bytes());
    }

    /// Writes a record: opcode, length of 64 bits, contents.
    fn record(&mut self, opcode: Opcode, write: impl FnOnce(&mut Self)) {
        self.0.push(opcode.code());
        let start = self.0.len();
        self.u64(0);
        write(self);
        let contents = self.0.len().saturating_sub(start).saturating_sub(size_of::<u64>());
        let length = u64::try_from(contents).unwrap_or(u64::MAX);
        self.overwrite(start, &length.to_le_bytes());
    }

    fn overwrite(&mut self, start: usize, bytes: &[u8]) {
        for (place, byte) in self.0.iter_mut().skip(start).zip(bytes) {
            *place = *byte;
        }
    }
}
