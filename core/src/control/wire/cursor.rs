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

    /// Reads the next `K` bytes.
    #[inline]
    pub(super) fn read_exact<const K: usize>(&mut self) -> Result<[u8; K], Short> {
        let (field, rest) = self.rest.split_first_chunk::<K>().ok_or(Short)?;
        self.rest = rest;
        Ok(*field)
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
}

/// Gives reader and writer one method for each of these integers.
macro_rules! integers {
    ($($integer:ident)*) => {
        impl Reader<'_> {$(
            #[inline]
            pub(super) fn $integer(&mut self) -> Result<$integer, Short> {
                self.read_exact().map($integer::from_le_bytes)
            }
        )*}

        impl Writer<'_> {$(
            #[inline]
            pub(super) fn $integer(&mut self, value: $integer) -> Result<(), Short> {
                self.bytes(value.to_le_bytes())
            }
        )*}
    };
}

integers!(u8 u16 i16 u32 i32 u64 i64);
