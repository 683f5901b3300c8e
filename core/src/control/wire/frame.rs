//! Frames: header, length and trailer around a body.

use core::fmt;
use core::ops::Deref;

use super::body::Body;
#[cfg(feature = "keyed")]
use crate::control::keys::{MacKey, is_same, tag};
use crate::control::message::{FrameError, MAX_BODY, Notice, PROTOCOL_VERSION};

/// First two bytes of every frame: "GT".
const MAGIC: [u8; 2] = *b"GT";
/// Version, kind and length of a [`Notice`]: a Refusal of version 1, which had no suite.
const NOTICE: [u8; 4] = [1, Kind::Refusal.code(), 8, 0];
/// Bytes of a notice between its detail and its checksum.
const NOTICE_ZEROS: usize = 6;
/// Bytes before the body: magic (2), version (1), kind (1), length of the body (2), suite (2).
pub const HEADER_LEN: usize = 8;
/// Bytes after the body of a frame with a checksum.
pub const TRAILER_LEN: usize = 4;
/// Bytes after the body of a frame with a tag.
pub const TAG_LEN: usize = 16;
/// Longest frame, in bytes.
pub const MAX_FRAME: usize = HEADER_LEN + MAX_BODY + TAG_LEN;

/// Form of the trailers of a side. A server speaks one, and negotiates none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Suite {
    /// CRC-32 of header and body: no protection against people.
    #[default]
    Checksum,
    /// Tag of header and body under a shared key ([`crate::control::keys`]).
    #[cfg(feature = "keyed")]
    Tag,
}

impl Suite {
    /// Returns the number in a header.
    #[must_use]
    pub const fn code(self) -> u8 {
        match self {
            Self::Checksum => 0,
            #[cfg(feature = "keyed")]
            Self::Tag => 1,
        }
    }

    /// Returns the number of bytes after the body.
    #[must_use]
    pub const fn trailer_len(self) -> usize {
        match self {
            Self::Checksum => TRAILER_LEN,
            #[cfg(feature = "keyed")]
            Self::Tag => TAG_LEN,
        }
    }
}

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

    /// Puts a tag in the place of the checksum.
    ///
    /// `context`: bytes behind header and body that the tag covers and the frame has not.
    #[cfg(feature = "keyed")]
    #[inline(never)]
    pub fn tag(&mut self, key: &MacKey, context: &[u8]) {
        self.length = exchange(&mut self.bytes, self.length, key, context).unwrap_or(0);
    }

    /// Leaves nothing of the frame.
    #[cfg(feature = "keyed")]
    pub(crate) const fn clear(&mut self) {
        self.length = 0;
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
    /// Client with a key asks for the session.
    KeyedHello,
    /// Server asks it to do so again.
    Challenge,
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
            Self::KeyedHello => 8,
            Self::Challenge => 9,
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
            8 => Self::KeyedHello,
            9 => Self::Challenge,
            _ => return None,
        })
    }
}

/// A frame with valid boundary, version and length. Its trailer is not checked yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sealed<'a> {
    kind: u8,
    /// Header and body.
    covered: &'a [u8],
    body: &'a [u8],
    trailer: &'a [u8],
}

impl<'a> Sealed<'a> {
    /// Parses bytes that should be exactly one frame of a suite.
    ///
    /// # Errors
    /// The first error, front to back.
    #[inline]
    pub fn parse(bytes: &'a [u8], suite: Suite) -> Result<Self, FrameError> {
        let header = bytes.first_chunk().ok_or(FrameError::Length)?;
        let (kind, length) = parse_header(*header, suite)?;
        let whole = HEADER_LEN
            .saturating_add(usize::from(length))
            .saturating_add(suite.trailer_len());
        if bytes.len() != whole {
            return Err(FrameError::Length);
        }
        let (covered, trailer) = bytes
            .len()
            .checked_sub(suite.trailer_len())
            .and_then(|covered| bytes.split_at_checked(covered))
            .ok_or(FrameError::Length)?;
        let body = covered.get(HEADER_LEN..).ok_or(FrameError::Length)?;
        Ok(Self {
            kind,
            covered,
            body,
            trailer,
        })
    }

    /// Returns the kind byte.
    #[must_use]
    pub const fn kind_code(&self) -> u8 {
        self.kind
    }

    /// Returns the bytes between header and trailer, which anybody can have written.
    #[must_use]
    pub const fn body(&self) -> &'a [u8] {
        self.body
    }

    /// Compares the trailer with the checksum of what is before it.
    ///
    /// # Errors
    /// [`FrameError::Checksum`].
    #[inline]
    pub fn check_sum(self) -> Result<Frame<'a>, FrameError> {
        let right = checksum(self.covered).to_le_bytes();
        self.open(self.trailer == right, FrameError::Checksum)
    }

    /// Compares the trailer with the tag of what is before it and of `context`.
    ///
    /// # Errors
    /// [`FrameError::Tag`].
    #[cfg(feature = "keyed")]
    pub fn check_tag(self, key: &MacKey, context: &[u8]) -> Result<Frame<'a>, FrameError> {
        let right = tag(key, self.covered, context);
        let trailer = self.trailer.first_chunk();
        let is_right = trailer.is_some_and(|trailer| is_same(trailer, &right));
        self.open(is_right, FrameError::Tag)
    }

    #[inline]
    const fn open(self, is_right: bool, error: FrameError) -> Result<Frame<'a>, FrameError> {
        if is_right {
            Ok(Frame {
                kind: self.kind,
                body: self.body,
            })
        } else {
            Err(error)
        }
    }
}

/// A frame with valid boundary, version, length and trailer. Its kind and content are not checked
/// yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Frame<'a> {
    kind: u8,
    body: &'a [u8],
}

impl<'a> Frame<'a> {
    /// Parses bytes that should be exactly one frame with a checksum.
    ///
    /// # Errors
    /// The first error, front to back, the checksum last.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, FrameError> {
        Sealed::parse(bytes, Suite::Checksum)?.check_sum()
    }

    /// Builds a frame from a kind byte and a body, without a trailer; `None` for a body that is
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

    /// Returns the bytes between header and trailer.
    #[must_use]
    pub const fn body(&self) -> &'a [u8] {
        self.body
    }
}

/// Returns kind and body length of a valid header.
pub(super) fn parse_header(
    header: [u8; HEADER_LEN],
    suite: Suite,
) -> Result<(u8, u16), FrameError> {
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
    if received != u16::from(suite.code()) {
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
    let [s0, s1] = [Suite::Checksum.code(), 0];
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
    let (covered, rest) = bytes.split_at_mut_checked(length)?;
    *rest.first_chunk_mut()? = checksum(covered).to_le_bytes();
    length.checked_add(TRAILER_LEN)
}

/// Puts a tag in the place of the checksum of a frame of so many bytes. Returns the number of all.
#[cfg(feature = "keyed")]
fn exchange(
    bytes: &mut [u8; MAX_FRAME],
    length: usize,
    key: &MacKey,
    context: &[u8],
) -> Option<usize> {
    let (covered, rest) = bytes.split_at_mut_checked(length.checked_sub(TRAILER_LEN)?)?;
    let [.., suite, _] = covered.first_chunk_mut::<HEADER_LEN>()?;
    *suite = Suite::Tag.code();
    *rest.first_chunk_mut()? = tag(key, covered, context);
    covered.len().checked_add(TAG_LEN)
}

/// Returns the CRC-32/ISO-HDLC of header and body, as in Ethernet and zlib.
#[inline]
#[must_use]
pub fn checksum(bytes: &[u8]) -> u32 {
    crc32fast::hash(bytes)
}
