//! Numbers of the protocol: lengths, indices, counts and codes; and the generations, which write
//! them differently.

use crate::error::{ErrorKind, Malformed};

/// Largest number of bytes of a number.
pub const MAX_NUMBER: usize = 5;

/// Generation of the format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Version {
    /// Until 2013: numbers of 32 bits, no version text, no packet lengths.
    V2006,
    /// Version text "LabComm2014.v1": packed numbers, every packet with its length.
    V2014,
    /// Version text "LabComm2014", of the releases v2014.0 to v2014.4; the same but for the text.
    V2014_0,
}

impl Version {
    /// Version text; none in 2006.
    #[must_use]
    pub const fn text(self) -> Option<&'static str> {
        match self {
            Self::V2006 => None,
            Self::V2014 => Some("LabComm2014.v1"),
            Self::V2014_0 => Some("LabComm2014"),
        }
    }

    /// First index that an encoder gives: 0x80 in 2006, because the C decoder of 2012 returns to
    /// its caller only for such an index; else 0x40.
    #[must_use]
    pub const fn first_index(self) -> u32 {
        match self {
            Self::V2006 => 0x80,
            Self::V2014 | Self::V2014_0 => 0x40,
        }
    }

    /// True if numbers are packed and packets have lengths.
    #[must_use]
    pub const fn is_packed(self) -> bool {
        !matches!(self, Self::V2006)
    }
}

/// Number as bytes.
#[derive(Clone, Copy, Debug)]
pub struct NumberBytes {
    /// Right-aligned.
    bytes: [u8; MAX_NUMBER],
    start: usize,
}

impl NumberBytes {
    /// Returns the bytes.
    #[must_use]
    pub fn as_slice(&self) -> &[u8] {
        self.bytes.get(self.start..).unwrap_or_default()
    }
}

/// Encodes a number. 2006: 32 bits, big endian. 2014: groups of 7 bits, most significant group
/// first, bit 7 set on all but the last byte; no more groups than needed.
#[must_use]
pub fn encode(version: Version, number: u32) -> NumberBytes {
    let [b3, b2, b1, b0] = number.to_be_bytes();
    if !version.is_packed() {
        return NumberBytes {
            bytes: [0, b3, b2, b1, b0],
            start: 1,
        };
    }
    let bytes = [
        group(number, 28),
        group(number, 21),
        group(number, 14),
        group(number, 7),
        b0 & 0x7f,
    ];
    let start = match number {
        0..0x80 => 4,
        0x80..0x4000 => 3,
        0x4000..0x20_0000 => 2,
        0x20_0000..0x1000_0000 => 1,
        _ => 0,
    };
    NumberBytes { bytes, start }
}

/// Seven bits of a number from `shift` on, as a group that another one follows.
const fn group(number: u32, shift: u32) -> u8 {
    let [.., low] = (number >> shift).to_be_bytes();
    low | 0x80
}

/// Number of bytes of a number.
#[must_use]
pub fn encoded_len(version: Version, number: u32) -> usize {
    encode(version, number).as_slice().len()
}

/// Decodes the number at the front of `bytes`; returns it and the number of bytes taken.
///
/// # Errors
/// `Incomplete`; 2014: a leading zero group, or more than 32 bits. A number therefore has one
/// encoding.
pub fn decode(version: Version, bytes: &[u8]) -> Result<(u32, usize), ErrorKind> {
    if !version.is_packed() {
        let (four, _) = bytes.split_first_chunk().ok_or(ErrorKind::Incomplete)?;
        return Ok((u32::from_be_bytes(*four), 4));
    }
    if bytes.first() == Some(&0x80) {
        return Err(Malformed::LongNumber.into());
    }
    let mut number = 0_u32;
    for taken in 1..=MAX_NUMBER {
        let byte = bytes
            .get(taken.saturating_sub(1))
            .ok_or(ErrorKind::Incomplete)?;
        if number > u32::MAX >> 7 {
            break;
        }
        number = (number << 7) | u32::from(byte & 0x7f);
        if byte & 0x80 == 0 {
            return Ok((number, taken));
        }
    }
    Err(Malformed::LargeNumber.into())
}
