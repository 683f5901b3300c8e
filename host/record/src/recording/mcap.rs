//! A recording as MCAP: each sample as JSON on a channel of its name, and a scene that draws the
//! machine.
//!
//! The messages are the samples of LabComm: types become JSON schemas, values JSON. Their time is
//! the tick, 1 ms each.

mod entities;
mod fields;
mod recover;
mod scene;
mod writer;

use std::fmt;
use std::io;

use gantry_tau_labcomm::{Decoded, Decoder, Event as Part, Version};
use gantry_tau_machine::figure::Moving;
use gantry_tau_server::publication::{Samples, Ticks};
use gantry_tau_server::record::Event;
use gantry_tau_system::output::GrowingFile;
use mcap::records::Metadata;

use super::about::About;
use super::labcomm_file::NAMES;
use crate::labcomm::{Floats, json_schema, write_value};
pub use recover::{RecoverError, Recovered, recover};
use scene::SceneChannel;
use writer::{ChannelId, McapWriter};

/// Length of a tick, ns.
const TICK_NS: u64 = 1_000_000;
/// Largest sample, bytes.
const MAX_SAMPLE: u32 = 4_096;

/// Decoder of the samples of a tick.
type TickDecoder = Decoder<8, 4_096>;

/// File of one recording.
pub(super) struct McapFile {
    writer: McapWriter,
    ticks: Ticks,
    decoder: Box<TickDecoder>,
    /// Channels, by the indices of the samples.
    channels: Vec<(u32, ChannelId)>,
    scene: SceneChannel,
    /// JSON of a message.
    text: String,
}

impl fmt::Debug for McapFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("McapFile")
            .field("channels", &self.channels)
            .finish_non_exhaustive()
    }
}

impl McapFile {
    /// Begins the file, with its origin, the channels of `N` axes, and of the scene of a machine.
    pub(super) fn create<const N: usize>(
        file: GrowingFile,
        about: &About,
        machine: Box<dyn Moving>,
    ) -> io::Result<Self> {
        let ticks = Ticks::of::<N>(Version::V2014, &NAMES)?;
        let mut writer = McapWriter::new(file, &about.written_by)?;
        let entries = about.entries();
        writer.metadata(&Metadata {
            name: "gantry-tau".to_owned(),
            metadata: entries
                .map(|(key, value)| (key.to_owned(), value.to_owned()))
                .into(),
        })?;
        let mut decoder = Box::new(TickDecoder::new(MAX_SAMPLE));
        let mut channels = Vec::new();
        each_part(&mut decoder, ticks.preamble(), |part| {
            let Part::Define(definition) = part else {
                return Ok(());
            };
            let sample = String::from_utf8_lossy(definition.name);
            let schema = json_schema(&definition.ty, &|name, schema| {
                fields::describe(&sample, name, schema)
            })
            .to_string();
            let channel = writer.channel(
                &format!("/{sample}"),
                &format!("gantry_tau.{sample}"),
                schema.as_bytes(),
            )?;
            channels.push((definition.index, channel));
            Ok(())
        })?;
        let scene = SceneChannel::open(&mut writer, &about.robot, machine)?;
        Ok(Self {
            writer,
            ticks,
            decoder,
            channels,
            scene,
            text: String::new(),
        })
    }

    pub(super) fn write<const N: usize>(
        &mut self,
        samples: &Samples<N>,
        events: &[Event],
    ) -> io::Result<()> {
        let Self {
            writer,
            ticks,
            decoder,
            channels,
            scene,
            text,
        } = self;
        let tick = u64::try_from(samples.axes.tick).unwrap_or_default();
        let time_ns = tick.saturating_mul(TICK_NS);
        each_part(decoder, ticks.encode(samples, events, None), |part| {
            let Part::Data { definition, value } = part else {
                return Ok(());
            };
            let channel = channels
                .iter()
                .find(|(index, _)| *index == definition.index);
            let Some((_, channel)) = channel else {
                return Ok(());
            };
            text.clear();
            // JSON has no other numbers than finite ones.
            write_value(text, &value, Floats::FiniteOrNull)
                .map_err(|error| io::Error::other(error.to_string()))?;
            writer.message(*channel, time_ns, text.as_bytes())
        })?;
        scene.show(writer, tick, time_ns, samples)
    }

    pub(super) fn finish(self) -> io::Result<()> {
        self.writer.finish()
    }
}

/// Calls `each` with the parts of a piece of the stream.
fn each_part(
    decoder: &mut TickDecoder,
    bytes: &[u8],
    mut each: impl FnMut(Part<'_, '_>) -> io::Result<()>,
) -> io::Result<()> {
    let mut rest = bytes;
    while !rest.is_empty() {
        match decoder
            .decode(rest)
            .map_err(|error| io::Error::other(error.to_string()))?
        {
            Decoded::Event { event, used } => {
                each(event)?;
                rest = rest.get(used..).unwrap_or_default();
            }
            Decoded::Need(_) => return Err(io::Error::other("a tick is not whole")),
        }
    }
    Ok(())
}
