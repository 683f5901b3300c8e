//! Encoder of either generation, into a buffer of the caller.

use crate::cursor::{Sink, Writer, to_number};
use crate::decoder::{DEFINITION, FIRST_INDEX, VERSION};
use crate::error::{ErrorKind, Malformed};
use crate::number::{Version, encoded_len};
use crate::sample::{Sample, encoded_value_len, type_len};
use crate::ty::Type;

/// Encoder into a buffer. A call that fails writes nothing.
#[derive(Debug)]
pub struct Encoder<'b> {
    version: Version,
    buffer: &'b mut [u8],
    length: usize,
}

impl<'b> Encoder<'b> {
    /// Encoder at the front of a buffer.
    #[must_use]
    pub const fn new(version: Version, buffer: &'b mut [u8]) -> Self {
        Self {
            version,
            buffer,
            length: 0,
        }
    }

    /// Returns the bytes that are written.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        self.buffer.get(..self.length).unwrap_or_default()
    }

    /// Returns the number of bytes that are written.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.length
    }

    /// True if nothing is written.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// Writes the version packet, which begins a stream of 2014; nothing in 2006.
    ///
    /// # Errors
    /// `Limit(Room)`.
    pub fn version(&mut self) -> Result<(), ErrorKind> {
        let Some(text) = self.version.text() else {
            return Ok(());
        };
        self.packet(VERSION, text_len(self.version, text.len()), |writer| {
            writer.text(text.as_bytes())
        })
    }

    /// Writes the definition of a sample type under an index of at least 0x40.
    ///
    /// # Errors
    /// `Index` below 0x40, or `Limit(Room)`.
    pub fn define<T: Sample>(&mut self, index: u32) -> Result<(), ErrorKind> {
        self.definition(
            index,
            T::NAME.as_bytes(),
            type_len::<T>(self.version),
            |writer| T::write_type(writer),
        )
    }

    /// Writes the definition of a type that is known at run time.
    ///
    /// # Errors
    /// `Index` below 0x40, `Limit(Name)`, or `Limit(Room)`. `Type` must be of the encoder's
    /// version, or else is `PacketLength`.
    pub fn define_type(&mut self, index: u32, name: &[u8], ty: &Type<'_>) -> Result<(), ErrorKind> {
        if name.len() > crate::MAX_NAME {
            return Err(crate::Limit::Name.into());
        }
        self.same_version(ty)?;
        self.definition(index, name, ty.bytes().len(), |writer| {
            writer.slice(ty.bytes())
        })
    }

    /// Writes a value of a sample type under its index.
    ///
    /// # Errors
    /// `Index` below 0x40, or `Limit(Room)`.
    #[inline]
    pub fn data<T: Sample>(&mut self, index: u32, value: &T) -> Result<(), ErrorKind> {
        let length = if self.version.is_packed() {
            encoded_value_len(self.version, value)
        } else {
            0
        };
        self.packet(checked(index)?, length, |writer| value.write(writer))
    }

    /// Writes a value of a type that is known at run time.
    ///
    /// # Errors
    /// The bytes are not one value of the type, `Index` below 0x40, or `Limit(Room)`.
    pub fn data_bytes(&mut self, index: u32, ty: &Type<'_>, value: &[u8]) -> Result<(), ErrorKind> {
        self.same_version(ty)?;
        if crate::value_len(ty, value)? != value.len() {
            return Err(Malformed::PacketLength.into());
        }
        self.packet(checked(index)?, value.len(), |writer| writer.slice(value))
    }

    fn same_version(&self, ty: &Type<'_>) -> Result<(), ErrorKind> {
        if ty.version().is_packed() == self.version.is_packed() {
            Ok(())
        } else {
            Err(Malformed::PacketLength.into())
        }
    }

    /// Definition: index, name, in 2014 the length of the type, type.
    fn definition(
        &mut self,
        index: u32,
        name: &[u8],
        ty: usize,
        write_type: impl FnOnce(&mut Writer<'_>),
    ) -> Result<(), ErrorKind> {
        let version = self.version;
        let front =
            encoded_len(version, checked(index)?).saturating_add(text_len(version, name.len()));
        self.packet(
            DEFINITION,
            front.saturating_add(text_len(version, ty)),
            |writer| {
                writer.number(index);
                writer.text(name);
                if version.is_packed() {
                    writer.number(to_number(ty));
                }
                write_type(writer);
            },
        )
    }

    /// Tag, in 2014 the length, and contents of that length.
    #[inline]
    fn packet(
        &mut self,
        tag: u32,
        length: usize,
        write: impl FnOnce(&mut Writer<'_>),
    ) -> Result<(), ErrorKind> {
        let room = self.buffer.get_mut(self.length..).unwrap_or_default();
        let mut writer = Writer::new(self.version, room);
        writer.number(tag);
        if self.version.is_packed() {
            writer.number(to_number(length));
        }
        write(&mut writer);
        self.length = self.length.saturating_add(writer.finish()?);
        Ok(())
    }
}

/// Number of bytes of a text with its length.
fn text_len(version: Version, bytes: usize) -> usize {
    encoded_len(version, to_number(bytes)).saturating_add(bytes)
}

/// An index that is not a tag.
fn checked(index: u32) -> Result<u32, ErrorKind> {
    if index >= FIRST_INDEX {
        Ok(index)
    } else {
        Err(Malformed::Index(index).into())
    }
}
