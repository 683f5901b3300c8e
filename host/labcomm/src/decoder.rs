//! Decoder of a stream of either generation, fed with the bytes that have come.

mod collector;

use crate::cursor::{Reader, to_usize};
use crate::error::{Error, ErrorKind, Limit, Malformed, Unsupported};
use crate::number::Version;
use crate::registry::{Definition, Entry, Registry};
use crate::ty::Type;
use crate::ty::scan::{MAX_TYPE, MAX_VALUE};
use crate::value::Value;

pub use collector::Collector;

/// Largest number of bytes of a name.
pub const MAX_NAME: usize = 1024;
/// Largest number of bytes of the version packet's contents.
const MAX_VERSION: u32 = 255;

/// Tag of the version packet.
pub(crate) const VERSION: u32 = 0x01;
/// Tag of a definition.
pub(crate) const DEFINITION: u32 = 0x02;
/// Tag of a sample reference.
const REFERENCE: u32 = 0x03;
/// Tags of type definitions, type bindings and pragmas.
const SKIPPED: [u32; 3] = [0x04, 0x05, 0x3f];
/// Smallest index of a definition; smaller numbers are tags.
pub(crate) const FIRST_INDEX: u32 = 0x40;

/// Part of a stream.
#[derive(Clone, Copy, Debug)]
pub enum Event<'d, 'b> {
    /// The version packet of 2014.
    Version(Version),
    /// Definition of a sample type.
    Define(Definition<'b>),
    /// Declaration of a type that sample references name. 2014 only.
    Reference(Definition<'b>),
    /// Value of a defined sample type.
    Data {
        /// Its definition.
        definition: Definition<'d>,
        /// Its value, checked against the type.
        value: Value<'d, 'b>,
    },
    /// Packet that was skipped: a type definition (4), type binding (5), pragma (0x3f), or data of
    /// an index (0x40 and above) without a definition. 2014 only.
    Skipped(u32),
}

/// Result of [`Decoder::decode`].
#[derive(Clone, Copy, Debug)]
pub enum Decoded<'d, 'b> {
    /// An event is complete; give the bytes from `used` on next.
    Event {
        /// The event.
        event: Event<'d, 'b>,
        /// Number of bytes taken, at least 1.
        used: usize,
    },
    /// The bytes are not a whole event; give the same bytes again, and at least this many.
    Need(usize),
}

/// Decision by the first byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
enum Stage {
    /// No byte has come.
    Start,
    /// Behind the first packet, or in a stream of 2006.
    Running,
    /// Has ended with an error.
    Broken(ErrorKind),
}

/// Decoder of one stream, with room for `S` definitions in `B` bytes of names and types.
#[derive(Clone, Debug)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Decoder<const S: usize, const B: usize> {
    registry: Registry<S, B>,
    stage: Stage,
    /// Offset in the stream, bytes.
    at: u64,
    /// Largest number of bytes of a value or packet.
    most: u32,
}

/// Event, before it borrows from the registry.
enum Found<'b> {
    /// Value of a definition.
    Data(Entry, &'b [u8]),
    Other(Event<'static, 'b>),
}

/// Front of the bytes: what it is, and its length; or the number of bytes that are needed.
enum Front<'b> {
    Whole(Found<'b>, usize),
    Need(usize),
}

impl<const S: usize, const B: usize> Default for Decoder<S, B> {
    fn default() -> Self {
        Self::new(MAX_VALUE)
    }
}

impl<const S: usize, const B: usize> Decoder<S, B> {
    /// Decoder at the beginning of a stream, for values and packets of at most `most` bytes, and of
    /// at most [`MAX_VALUE`].
    #[must_use]
    pub const fn new(most: u32) -> Self {
        let most = if most < MAX_VALUE { most } else { MAX_VALUE };
        Self {
            registry: Registry::new(Version::V2006),
            stage: Stage::Start,
            at: 0,
            most,
        }
    }

    /// The invariant: the registry is valid, and empty at the start.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.most <= MAX_VALUE
            && self.registry.is_valid()
            && (self.stage != Stage::Start || self.registry.is_empty())
    }

    /// Definitions that have come.
    #[must_use]
    pub const fn registry(&self) -> &Registry<S, B> {
        &self.registry
    }

    /// Version of the stream; `None` before its first byte.
    #[must_use]
    pub fn version(&self) -> Option<Version> {
        (self.stage != Stage::Start).then_some(self.registry.version())
    }

    /// Offset in the stream of the next byte to give, bytes.
    #[must_use]
    pub const fn offset(&self) -> u64 {
        self.at
    }

    /// Error that has ended the stream.
    #[must_use]
    pub const fn error(&self) -> Option<Error> {
        match self.stage {
            Stage::Broken(kind) => Some(Error { at: self.at, kind }),
            Stage::Start | Stage::Running => None,
        }
    }

    /// Decodes the event at the front of the bytes. Events and errors are the same however a stream
    /// is cut: bytes that are not used are given again, with more behind them.
    ///
    /// # Errors
    /// The stream is not LabComm, or exceeds a limit; every later call returns the same error.
    pub fn decode<'b>(&mut self, bytes: &'b [u8]) -> Result<Decoded<'_, 'b>, Error> {
        if let Some(error) = self.error() {
            return Err(error);
        }
        match self.front(bytes) {
            Ok(Front::Need(least)) => Ok(Decoded::Need(least)),
            Ok(Front::Whole(found, used)) => {
                self.stage = Stage::Running;
                self.at = self
                    .at
                    .saturating_add(u64::try_from(used).unwrap_or(u64::MAX));
                let event = match found {
                    Found::Data(entry, bytes) => self.data_event(&entry, bytes),
                    Found::Other(event) => event,
                };
                Ok(Decoded::Event { event, used })
            }
            Err(kind) => {
                self.stage = Stage::Broken(kind);
                Err(Error { at: self.at, kind })
            }
        }
    }

    fn data_event<'b>(&self, entry: &Entry, bytes: &'b [u8]) -> Event<'_, 'b> {
        // Entries are valid, so each has a definition.
        let Some(definition) = self.registry.definition(entry) else {
            return Event::Skipped(entry.index);
        };
        Event::Data {
            definition,
            value: Value::new(definition.ty, bytes),
        }
    }

    fn front<'b>(&mut self, bytes: &'b [u8]) -> Result<Front<'b>, ErrorKind> {
        let Some(first) = bytes.first() else {
            return Ok(Front::Need(1));
        };
        if self.stage == Stage::Start {
            match first {
                0x00 => self.registry.restart(Version::V2006),
                0x01 => self.registry.restart(Version::V2014),
                0x02 | 0x0b => return Err(ErrorKind::Version(Unsupported::LabComm2013)),
                _ => return Err(Malformed::Start.into()),
            }
        }
        if self.registry.version().is_packed() {
            self.packet(bytes)
        } else {
            self.unframed(bytes)
        }
    }

    /// Definition or data of 2006.
    fn unframed<'b>(&mut self, bytes: &'b [u8]) -> Result<Front<'b>, ErrorKind> {
        let mut reader = Reader::new(Version::V2006, bytes);
        let found = match reader.number() {
            Ok(DEFINITION) => unframed_definition(&mut reader)
                .map(|definition| Found::Other(Event::Define(definition))),
            Ok(index) if index >= FIRST_INDEX => self.data(index, &mut reader),
            Ok(tag) => Err(Malformed::Tag(tag).into()),
            Err(error) => Err(error),
        };
        match found {
            Ok(found) => {
                if let Found::Other(Event::Define(Definition { index, name, ty })) = found {
                    self.registry.define(index, name, &ty)?;
                }
                Ok(Front::Whole(
                    found,
                    bytes.len().saturating_sub(reader.rest().len()),
                ))
            }
            Err(ErrorKind::Incomplete) => Ok(Front::Need(bytes.len().saturating_add(1))),
            Err(error) => Err(error),
        }
    }

    /// Value of 2006.
    fn data<'b>(&self, index: u32, reader: &mut Reader<'b>) -> Result<Found<'b>, ErrorKind> {
        let entry = self
            .registry
            .entry(index)
            .ok_or(ErrorKind::UnknownIndex(index))?;
        if entry.extent.smallest > self.most {
            return Err(Limit::Value.into());
        }
        if entry.extent.fixed {
            return Ok(Found::Data(
                *entry,
                reader.read_exact(to_usize(entry.extent.smallest))?,
            ));
        }
        let most = to_usize(self.most);
        // A window one byte longer than the largest value: a value that reaches into that byte is
        // too long.
        let window = reader
            .rest()
            .get(..most.saturating_add(1))
            .unwrap_or(reader.rest());
        match self.registry.value_len(entry, window) {
            Ok(length) if length <= most => Ok(Found::Data(*entry, reader.read_exact(length)?)),
            Err(ErrorKind::Incomplete) if window.len() <= most => Err(ErrorKind::Incomplete),
            Ok(_) | Err(ErrorKind::Incomplete) => Err(Limit::Value.into()),
            Err(error) => Err(error),
        }
    }

    /// Packet of 2014.
    fn packet<'b>(&mut self, bytes: &'b [u8]) -> Result<Front<'b>, ErrorKind> {
        let mut reader = Reader::new(self.registry.version(), bytes);
        let head = reader
            .number()
            .and_then(|tag| Ok((self.tag(tag)?, reader.number()?)));
        let (tag, length) = match head {
            Ok(head) => head,
            Err(ErrorKind::Incomplete) => return Ok(Front::Need(bytes.len().saturating_add(1))),
            Err(error) => return Err(error),
        };
        let most = if tag == VERSION {
            MAX_VERSION
        } else {
            self.most
        };
        if length > most {
            return Err(Limit::Value.into());
        }
        let used = bytes
            .len()
            .saturating_sub(reader.rest().len())
            .saturating_add(to_usize(length));
        let Ok(contents) = reader.read_exact(to_usize(length)) else {
            return Ok(Front::Need(used));
        };
        match self.contents(tag, contents) {
            Ok(found) => Ok(Front::Whole(found, used)),
            // The packet is complete, so its length is wrong.
            Err(ErrorKind::Incomplete) => Err(Malformed::PacketLength.into()),
            Err(error) => Err(error),
        }
    }

    /// Checks that a tag may stand here.
    fn tag(&self, tag: u32) -> Result<u32, ErrorKind> {
        match tag {
            VERSION if self.stage == Stage::Start => Ok(tag),
            VERSION => Err(Malformed::VersionPlace.into()),
            DEFINITION | REFERENCE | FIRST_INDEX.. => Ok(tag),
            _ if SKIPPED.contains(&tag) => Ok(tag),
            _ => Err(Malformed::Tag(tag).into()),
        }
    }

    /// Contents of a packet that is complete.
    fn contents<'b>(&mut self, tag: u32, contents: &'b [u8]) -> Result<Found<'b>, ErrorKind> {
        let mut reader = Reader::new(self.registry.version(), contents);
        let found = match tag {
            VERSION => Found::Other(Event::Version(version_of(
                reader.text(contents.len(), Limit::Value)?,
            )?)),
            DEFINITION => Found::Other(Event::Define(packed_definition(&mut reader)?)),
            REFERENCE => Found::Other(Event::Reference(packed_definition(&mut reader)?)),
            FIRST_INDEX.. => {
                let Some(entry) = self.registry.entry(tag) else {
                    return Ok(Found::Other(Event::Skipped(tag)));
                };
                reader.read_exact(self.registry.value_len(entry, contents)?)?;
                Found::Data(*entry, contents)
            }
            _ => return Ok(Found::Other(Event::Skipped(tag))),
        };
        if !reader.rest().is_empty() {
            return Err(Malformed::PacketLength.into());
        }
        match found {
            Found::Other(Event::Version(version)) => self.registry.restart(version),
            Found::Other(Event::Define(Definition { index, name, ty })) => {
                self.registry.define(index, name, &ty)?
            }
            _ => {}
        }
        Ok(found)
    }
}

/// Version of a text.
fn version_of(text: &[u8]) -> Result<Version, ErrorKind> {
    [Version::V2014, Version::V2014_0]
        .into_iter()
        .find(|version| version.text().is_some_and(|known| known.as_bytes() == text))
        .ok_or(ErrorKind::Version(Unsupported::Text))
}

/// Index and name of a definition.
fn index_and_name<'b>(reader: &mut Reader<'b>) -> Result<(u32, &'b [u8]), ErrorKind> {
    let index = reader.number()?;
    if index < FIRST_INDEX {
        return Err(Malformed::Index(index).into());
    }
    Ok((index, reader.text(MAX_NAME, Limit::Name)?))
}

/// Takes a definition of 2006, behind its tag.
pub fn unframed_definition<'b>(reader: &mut Reader<'b>) -> Result<Definition<'b>, ErrorKind> {
    let (index, name) = index_and_name(reader)?;
    let (ty, length) = Type::parse(reader.version(), reader.rest())?;
    reader.read_exact(length)?;
    Ok(Definition { index, name, ty })
}

/// Takes the contents of a definition of 2014: the type has its length before it.
pub fn packed_definition<'b>(reader: &mut Reader<'b>) -> Result<Definition<'b>, ErrorKind> {
    let (index, name) = index_and_name(reader)?;
    let ty = reader.text(MAX_TYPE, Limit::TypeBytes)?;
    if !reader.rest().is_empty() {
        return Err(Malformed::PacketLength.into());
    }
    Ok(Definition {
        index,
        name,
        ty: Type::whole(reader.version(), ty)?,
    })
}
