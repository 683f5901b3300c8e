//! Reading and writing of primitives, big endian. Floats are moved by their bits.

use crate::error::{ErrorKind, Limit};
use crate::number::{self, Version};

/// Cursor over bytes to read. A failed read takes nothing.
#[derive(Clone, Copy, Debug)]
pub struct Reader<'a> {
    bytes: &'a [u8],
    version: Version,
}

impl<'a> Reader<'a> {
    /// Cursor at the front of bytes.
    #[must_use]
    pub const fn new(version: Version, bytes: &'a [u8]) -> Self {
        Self { bytes, version }
    }

    /// Returns the bytes that are left.
    #[must_use]
    pub const fn rest(&self) -> &'a [u8] {
        self.bytes
    }

    /// Version of the numbers.
    #[must_use]
    pub const fn version(&self) -> Version {
        self.version
    }

    /// Takes `N` bytes.
    ///
    /// # Errors
    /// `Incomplete`.
    #[inline]
    pub fn array<const N: usize>(&mut self) -> Result<[u8; N], ErrorKind> {
        let (taken, rest) = self
            .bytes
            .split_first_chunk()
            .ok_or(ErrorKind::Incomplete)?;
        self.bytes = rest;
        Ok(*taken)
    }

    /// Reads `length` bytes.
    ///
    /// # Errors
    /// `Incomplete`.
    pub fn read_exact(&mut self, length: usize) -> Result<&'a [u8], ErrorKind> {
        let (taken, rest) = self
            .bytes
            .split_at_checked(length)
            .ok_or(ErrorKind::Incomplete)?;
        self.bytes = rest;
        Ok(taken)
    }

    /// Takes a number of the protocol.
    ///
    /// # Errors
    /// Those of [`number::decode`].
    pub fn number(&mut self) -> Result<u32, ErrorKind> {
        let (number, taken) = number::decode(self.version, self.bytes)?;
        self.bytes = self.bytes.get(taken..).unwrap_or_default();
        Ok(number)
    }

    /// Takes a text: its length and its bytes, at most `most`, which are text in any or no
    /// character set.
    ///
    /// # Errors
    /// `Incomplete`, malformed number, or `limit` if it is longer.
    pub fn text(&mut self, most: usize, limit: Limit) -> Result<&'a [u8], ErrorKind> {
        let mut after = *self;
        let length = to_usize(after.number()?);
        if length > most {
            return Err(limit.into());
        }
        let text = after.read_exact(length)?;
        *self = after;
        Ok(text)
    }
}

/// Destination of encoded bytes. Encoding is written once, and run to count, to compare and to
/// write.
pub trait Sink {
    /// Takes an array of bytes.
    fn array<const N: usize>(&mut self, bytes: [u8; N]);

    /// Takes bytes.
    fn slice(&mut self, bytes: &[u8]);

    /// Version of the numbers.
    fn version(&self) -> Version;

    /// Takes a number of the protocol.
    fn number(&mut self, number: u32) {
        let bytes = number::encode(self.version(), number);
        self.slice(bytes.as_slice());
    }

    /// Takes a text: its length and its bytes. Only the first `u32::MAX` bytes have a length.
    fn text(&mut self, text: &[u8]) {
        self.number(to_number(text.len()));
        self.slice(text);
    }
}

/// Cursor over a buffer to write into. Bytes beyond its end are not written, and fail
/// [`Writer::finish`].
#[derive(Debug)]
pub struct Writer<'b> {
    room: &'b mut [u8],
    capacity: usize,
    fits: bool,
    version: Version,
}

impl<'b> Writer<'b> {
    /// Cursor at the front of a buffer.
    #[must_use]
    pub const fn new(version: Version, room: &'b mut [u8]) -> Self {
        Self {
            capacity: room.len(),
            room,
            fits: true,
            version,
        }
    }

    /// Number of bytes written.
    ///
    /// # Errors
    /// `Limit(Room)` if not all of them fitted.
    pub const fn finish(self) -> Result<usize, ErrorKind> {
        if self.fits {
            Ok(self.capacity.saturating_sub(self.room.len()))
        } else {
            Err(ErrorKind::Limit(Limit::Room))
        }
    }
}

impl Sink for Writer<'_> {
    #[inline]
    fn array<const N: usize>(&mut self, bytes: [u8; N]) {
        let Some((place, rest)) = core::mem::take(&mut self.room).split_first_chunk_mut() else {
            self.fits = false;
            return;
        };
        *place = bytes;
        self.room = rest;
    }

    fn slice(&mut self, bytes: &[u8]) {
        let Some((place, rest)) = core::mem::take(&mut self.room).split_at_mut_checked(bytes.len())
        else {
            self.fits = false;
            return;
        };
        for (place, byte) in place.iter_mut().zip(bytes) {
            *place = *byte;
        }
        self.room = rest;
    }

    fn version(&self) -> Version {
        self.version
    }
}

/// Counts bytes.
#[derive(Clone, Copy, Debug)]
pub struct Counter {
    count: usize,
    version: Version,
}

impl Counter {
    /// Counter at zero.
    #[must_use]
    pub const fn new(version: Version) -> Self {
        Self { count: 0, version }
    }

    /// Number of bytes.
    #[must_use]
    pub const fn count(&self) -> usize {
        self.count
    }
}

impl Sink for Counter {
    fn array<const N: usize>(&mut self, _: [u8; N]) {
        self.count = self.count.saturating_add(N);
    }

    fn slice(&mut self, bytes: &[u8]) {
        self.count = self.count.saturating_add(bytes.len());
    }

    fn version(&self) -> Version {
        self.version
    }
}

/// Compares with bytes that are given.
#[derive(Clone, Copy, Debug)]
pub struct Comparer<'a> {
    rest: Option<&'a [u8]>,
    version: Version,
}

impl<'a> Comparer<'a> {
    /// Compares with these bytes.
    #[must_use]
    pub const fn new(version: Version, bytes: &'a [u8]) -> Self {
        Self {
            rest: Some(bytes),
            version,
        }
    }

    /// True if the bytes taken are the bytes given.
    #[must_use]
    pub fn is_equal(&self) -> bool {
        self.rest.is_some_and(<[u8]>::is_empty)
    }
}

impl Sink for Comparer<'_> {
    fn array<const N: usize>(&mut self, bytes: [u8; N]) {
        self.slice(&bytes);
    }

    fn slice(&mut self, bytes: &[u8]) {
        self.rest = self.rest.and_then(|rest| rest.strip_prefix(bytes));
    }

    fn version(&self) -> Version {
        self.version
    }
}

/// A number as a length. On a 16-bit target a larger one exceeds every slice, as it should.
pub(crate) fn to_usize(number: u32) -> usize {
    usize::try_from(number).unwrap_or(usize::MAX)
}

/// A length as a number; the largest where it is longer, which no buffer of an encoder holds.
pub(crate) fn to_number(length: usize) -> u32 {
    u32::try_from(length).unwrap_or(u32::MAX)
}
