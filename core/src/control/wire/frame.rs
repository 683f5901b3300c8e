//! Frames: header, length and checksum around a body.

use core::fmt;
use core::ops::Deref;

use super::body::Body;
use crate::control::message::{FrameError, MAX_BODY, Notice, PROTOCOL_VERSION};

/// First two bytes of every frame: "GT".
const MAGIC: [u8; 2] = *b"GT";
/// Version, kind and length of a [`Notice`]: a Refusal of version 1, which had no suite.
const NOTICE: [u8; 4] = [1, Kind::Refusal.code(), 8, 0];
/// Bytes of a notice between its detail and its checksum.
const NOTICE_ZEROS: usize = 6;
/// Trailers of this side: a checksum.
const SUITE: u16 = 0;
/// Bytes before the body: magic (2), version (1), kind (1), length of the body (2), suite (2).
pub const HEADER_LEN: usize = 8;
/// Bytes after the body: CRC-32 of header and body.
pub const TRAILER_LEN: usize = 4;
/// Longest frame, in bytes.
pub const MAX_FRAME: usize = HEADER_LEN + MAX_BODY + TRAILER_LEN;

/// An encoded frame; read as a slice. Not a `Vec`, which is filled byte by byte.
#[derive(Clone)]
pub struct FrameBytes {
    bytes: [u8; MAX_FRAME],
    /// Number of bytes of the frame.
    length: usize,
}

impl FrameBytes {
    /// No bytes.
    pub(crate) const EMPTY: Self = Self {
        bytes: [0; MAX_FRAME],
        length: 0,
    };

    /// As [`enclose`], in the place of another frame: that of every tick is not moved.
    // Not inlined: three copies would not fit the smallest firmware.
    #[inline(never)]
    pub(crate) fn enclose<B: Body>(&mut self, kind: Kind, body: &B) {
        const { assert!(B::LENGTH <= MAX_BODY, "the body does not fit a frame") };
        self.length = fill(&mut self.bytes, kind, body).unwrap_or(0);
    }

    /// As [`encode_notice`], in the place of another frame.
    pub(crate) fn notice(&mut self, notice: Notice) {
        self.length = fill_notice(&mut self.bytes, notice).unwrap_or(0);
    }
}

impl Deref for FrameBytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or_default()
    }
}

impl fmt::Debug for FrameBytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}

/// Compares the bytes of the frame only.
impl PartialEq for FrameBytes {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl Eq for FrameBytes {}

/// Kind of a frame's body; the fourth byte of every frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Kind {
    /// Client asks for the session.
    Hello,
    /// Server grants it.
    Welcome,
    /// Client's wanted offsets.
    Command,
    /// Server's state, one per tick.
    State,
    /// Client leaves.
    Goodbye,
    /// Client stops the machine's external offsets.
    Stop,
    /// Server refuses a Hello.
    Refusal,
}

impl Kind {
    /// Returns the byte of this kind.
    #[must_use]
    pub const fn code(self) -> u8 {
        match self {
            Self::Hello => 1,
            Self::Welcome => 2,
            Self::Command => 3,
            Self::State => 4,
            Self::Goodbye => 5,
            Self::Stop => 6,
            Self::Refusal => 7,
        }
    }

    /// Returns the kind of a byte; `None` for an unknown byte.
    #[must_use]
    pub const fn from_code(code: u8) -> Option<Self> {
        Some(match code {
            1 => Self::Hello,
            2 => Self::Welcome,
            3 => Self::Command,
            4 => Self::State,
            5 => Self::Goodbye,
            6 => Self::Stop,
            7 => Self::Refusal,
            _ => return None,
        })
    }
}

/// A frame with valid boundary, version, length and checksum. Its kind and content are not checked
/// yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Frame<'a> {
    kind: u8,
    body: &'a [u8],
}

impl<'a> Frame<'a> {
    /// Parses bytes that should be exactly one frame.
    ///
    /// # Errors
    /// The first error, front to back, the checksum last.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, FrameError> {
        let (header, rest) = bytes
            .split_first_chunk::<HEADER_LEN>()
            .ok_or(FrameError::Length)?;
        let (kind, length) = parse_header(*header)?;
        let (body, _) = rest
            .split_last_chunk::<TRAILER_LEN>()
            .ok_or(FrameError::Length)?;
        if body.len() != usize::from(length) {
            return Err(FrameError::Length);
        }
        check_trailer(bytes)?;
        Ok(Self { kind, body })
    }

    /// Builds a frame from a kind byte and a body, without a checksum; `None` for a body that is
    /// too long.
    #[must_use]
    pub const fn from_parts(kind: u8, body: &'a [u8]) -> Option<Self> {
        if body.len() <= MAX_BODY {
            Some(Self { kind, body })
        } else {
            None
        }
    }

    /// Returns the kind byte.
    #[must_use]
    pub const fn kind_code(&self) -> u8 {
        self.kind
    }

    /// Returns the bytes between header and checksum.
    #[must_use]
    pub const fn body(&self) -> &'a [u8] {
        self.body
    }
}

/// Returns kind and body length of a valid header.
pub(super) fn parse_header(header: [u8; HEADER_LEN]) -> Result<(u8, u16), FrameError> {
    let [m0, m1, version, kind, l0, l1, s0, s1] = header;
    if [m0, m1] != MAGIC {
        return Err(FrameError::Magic);
    }
    if [version, kind, l0, l1] == NOTICE {
        let (reason, detail) = (s0, s1);
        return Err(FrameError::Notice(Notice { reason, detail }));
    }
    if version != PROTOCOL_VERSION {
        return Err(FrameError::Version { received: version });
    }
    let length = u16::from_le_bytes([l0, l1]);
    if usize::from(length) > MAX_BODY {
        return Err(FrameError::TooLong { length });
    }
    let received = u16::from_le_bytes([s0, s1]);
    if received != SUITE {
        return Err(FrameError::Suite { received });
    }
    Ok((kind, length))
}

/// Puts header and checksum around a body. A body that does not fit a frame does not compile.
#[must_use]
pub fn enclose<B: Body>(kind: Kind, body: &B) -> FrameBytes {
    let mut frame = FrameBytes::EMPTY;
    frame.enclose(kind, body);
    frame
}

/// Returns the bytes of a notice.
#[must_use]
pub fn encode_notice(notice: Notice) -> FrameBytes {
    let mut frame = FrameBytes::EMPTY;
    frame.notice(notice);
    frame
}

/// Writes header, body and checksum. Returns the number of bytes; `None` would be a body that does
/// not fit.
fn fill<B: Body>(bytes: &mut [u8; MAX_FRAME], kind: Kind, body: &B) -> Option<usize> {
    let [m0, m1] = MAGIC;
    let [l0, l1] = u16::try_from(B::LENGTH).ok()?.to_le_bytes();
    let [s0, s1] = SUITE.to_le_bytes();
    let (header, rest) = bytes.split_first_chunk_mut::<HEADER_LEN>()?;
    *header = [m0, m1, PROTOCOL_VERSION, kind.code(), l0, l1, s0, s1];
    body.write(rest.get_mut(..B::LENGTH)?).ok()?;
    seal(bytes, HEADER_LEN.checked_add(B::LENGTH)?)
}

/// Writes a notice. Returns the number of bytes.
fn fill_notice(bytes: &mut [u8; MAX_FRAME], notice: Notice) -> Option<usize> {
    let [m0, m1] = MAGIC;
    let [version, kind, l0, l1] = NOTICE;
    let Notice { reason, detail } = notice;
    let (header, rest) = bytes.split_first_chunk_mut::<HEADER_LEN>()?;
    *header = [m0, m1, version, kind, l0, l1, reason, detail];
    *rest.first_chunk_mut()? = [0; NOTICE_ZEROS];
    seal(bytes, HEADER_LEN.checked_add(NOTICE_ZEROS)?)
}

/// Writes the checksum behind so many bytes. Returns the number of all.
fn seal(bytes: &mut [u8; MAX_FRAME], length: usize) -> Option<usize> {
    let (checked, rest) = bytes.split_at_mut_checked(length)?;
    *rest.first_chunk_mut::<TRAILER_LEN>()? = checksum(checked).to_le_bytes();
    length.checked_add(TRAILER_LEN)
}

/// Returns the CRC-32/ISO-HDLC of header and body, as in Ethernet and zlib.
#[inline]
#[must_use]
pub fn checksum(bytes: &[u8]) -> u32 {
    crc32fast::hash(bytes)
}

/// Compares the last bytes with the checksum of those before them.
fn check_trailer(frame: &[u8]) -> Result<(), FrameError> {
    let (checked, trailer) = frame
        .split_last_chunk::<TRAILER_LEN>()
        .ok_or(FrameError::Length)?;
    if checksum(checked) == u32::from_le_bytes(*trailer) {
        Ok(())
    } else {
        Err(FrameError::Checksum)
    }
}
