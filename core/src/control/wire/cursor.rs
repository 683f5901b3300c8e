//! Reading and writing of little-endian fields in order, never outside the slice.

use core::fmt;

/// Error of a field beyond the end of its slice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Short;

impl fmt::Display for Short {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the slice ends before the field")
    }
}

impl core::error::Error for Short {}

/// Takes fields off the front of a slice.
#[derive(Clone, Copy)]
pub(super) struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    pub(super) const fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    #[inline]
    fn take<const K: usize>(&mut self) -> Result<[u8; K], Short> {
        let (field, rest) = self.rest.split_first_chunk::<K>().ok_or(Short)?;
        self.rest = rest;
        Ok(*field)
    }

    #[inline]
    pub(super) fn u8(&mut self) -> Result<u8, Short> {
        self.take().map(u8::from_le_bytes)
    }

    #[inline]
    pub(super) fn u16(&mut self) -> Result<u16, Short> {
        self.take().map(u16::from_le_bytes)
    }

    #[inline]
    pub(super) fn i16(&mut self) -> Result<i16, Short> {
        self.take().map(i16::from_le_bytes)
    }

    #[inline]
    pub(super) fn u32(&mut self) -> Result<u32, Short> {
        self.take().map(u32::from_le_bytes)
    }

    #[inline]
    pub(super) fn i32(&mut self) -> Result<i32, Short> {
        self.take().map(i32::from_le_bytes)
    }

    #[inline]
    pub(super) fn u64(&mut self) -> Result<u64, Short> {
        self.take().map(u64::from_le_bytes)
    }

    #[inline]
    pub(super) fn i64(&mut self) -> Result<i64, Short> {
        self.take().map(i64::from_le_bytes)
    }
}

/// Puts fields into a slice, front to back.
pub(super) struct Writer<'a> {
    rest: &'a mut [u8],
}

impl<'a> Writer<'a> {
    pub(super) const fn new(bytes: &'a mut [u8]) -> Self {
        Self { rest: bytes }
    }

    #[inline]
    pub(super) fn bytes<const K: usize>(&mut self, field: [u8; K]) -> Result<(), Short> {
        let whole = core::mem::take(&mut self.rest);
        let (place, rest) = whole.split_first_chunk_mut::<K>().ok_or(Short)?;
        *place = field;
        self.rest = rest;
        Ok(())
    }

    #[inline]
    pub(super) fn u8(&mut self, value: u8) -> Result<(), Short> {
        self.bytes(value.to_le_bytes())
    }

    #[inline]
    pub(super) fn u16(&mut self, value: u16) -> Result<(), Short> {
        self.bytes(value.to_le_bytes())
    }

    #[inline]
    pub(super) fn i16(&mut self, value: i16) -> Result<(), Short> {
        self.bytes(value.to_le_bytes())
    }

    #[inline]
    pub(super) fn u32(&mut self, value: u32) -> Result<(), Short> {
        self.bytes(value.to_le_bytes())
    }

    #[inline]
    pub(super) fn i32(&mut self, value: i32) -> Result<(), Short> {
        self.bytes(value.to_le_bytes())
    }

    #[inline]
    pub(super) fn u64(&mut self, value: u64) -> Result<(), Short> {
        self.bytes(value.to_le_bytes())
    }

    #[inline]
    pub(super) fn i64(&mut self, value: i64) -> Result<(), Short> {
        self.bytes(value.to_le_bytes())
    }
}
