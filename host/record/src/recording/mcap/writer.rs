//! MCAP file with JSON channels, written by the crate `mcap` in uncompressed chunks.
//!
//! Memory holds one chunk, the index of its messages, and the index of all chunks, some hundred
//! bytes each. A file that is cut at any byte has all messages of its complete chunks, and those
//! before the cut.

use std::collections::BTreeMap;
use std::io;

use gantry_tau_system::output::GrowingFile;
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{McapError, WriteOptions, Writer};

/// Bytes of messages above which a chunk is written ...
const CHUNK: usize = 1 << 20;
/// ... or its duration, ns: a killed process loses the open chunk.
const CHUNK_NS: u64 = 1_000_000_000;

/// Number of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ChannelId(u16);

/// File that is written.
pub(super) struct McapWriter {
    writer: Writer<NoSeek<GrowingFile>>,
    /// Sequence numbers of the channels' next messages.
    sequences: BTreeMap<u16, u32>,
    /// Time of the first message in the open chunk, ns.
    chunk_since_ns: Option<u64>,
    /// Bytes of the messages in the open chunk.
    chunk_bytes: usize,
}

impl McapWriter {
    /// Begins a file.
    pub(super) fn new(out: GrowingFile, library: &str) -> io::Result<Self> {
        let options = WriteOptions::new()
            .library(library)
            .compression(None)
            // `message` ends the chunks.
            .chunk_size(None)
            // A pipe has no positions.
            .disable_seeking(true)
            // The chunks have checksums of their own.
            .calculate_data_section_crc(false);
        Ok(Self {
            writer: options.create(NoSeek::new(out)).map_err(io_error)?,
            sequences: BTreeMap::new(),
            chunk_since_ns: None,
            chunk_bytes: 0,
        })
    }

    /// Adds facts about the file, by a name.
    pub(super) fn metadata(&mut self, metadata: &Metadata) -> io::Result<()> {
        self.writer.write_metadata(metadata).map_err(io_error)
    }

    /// Adds a channel of JSON messages; its schema is a JSON schema.
    pub(super) fn channel(
        &mut self,
        topic: &str,
        schema_name: &str,
        schema: &[u8],
    ) -> io::Result<ChannelId> {
        let schema = self
            .writer
            .add_schema(schema_name, "jsonschema", schema)
            .map_err(io_error)?;
        self.writer
            .add_channel(schema, topic, "json", &BTreeMap::new())
            .map(ChannelId)
            .map_err(io_error)
    }

    /// Adds a message; times are in ns.
    pub(super) fn message(
        &mut self,
        ChannelId(channel_id): ChannelId,
        time_ns: u64,
        data: &[u8],
    ) -> io::Result<()> {
        let next = self.sequences.entry(channel_id).or_default();
        let header = MessageHeader {
            channel_id,
            sequence: *next,
            log_time: time_ns,
            publish_time: time_ns,
        };
        // Readers sort by time.
        *next = next.wrapping_add(1);
        self.writer
            .write_to_known_channel(&header, data)
            .map_err(io_error)?;
        self.chunk_bytes = self.chunk_bytes.saturating_add(data.len());
        let since_ns = *self.chunk_since_ns.get_or_insert(time_ns);
        if self.chunk_bytes >= CHUNK || time_ns.saturating_sub(since_ns) >= CHUNK_NS {
            self.writer.flush().map_err(io_error)?;
            self.chunk_since_ns = None;
            self.chunk_bytes = 0;
        }
        Ok(())
    }

    /// Writes the last chunk, the summary and the end, and flushes to the disk.
    pub(super) fn finish(mut self) -> io::Result<()> {
        self.writer.finish().map_err(io_error)?;
        self.writer.into_inner().into_inner().sync()
    }
}

/// Error of the file, where the crate reports one.
fn io_error(error: McapError) -> io::Error {
    match error {
        McapError::Io(error) => error,
        other => io::Error::other(other),
    }
}
