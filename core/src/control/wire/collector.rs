//! Bytes of one frame, collected from slices of any size: first a header, then the length that it
//! states. No trailer is checked here.

use super::frame::{HEADER_LEN, MAX_FRAME, Suite, parse_header};
use crate::control::message::FrameError;

/// Collects the bytes of one frame.
#[derive(Clone, Debug)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Collector {
    bytes: [u8; MAX_FRAME],
    /// Number of bytes in use.
    held: usize,
    suite: Suite,
}

/// Writes the bytes in use.
#[cfg(feature = "defmt")]
impl defmt::Format for Collector {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "{=[u8]}", self.held());
    }
}

impl Collector {
    /// An empty collector of frames with checksums.
    #[must_use]
    pub const fn new() -> Self {
        Self::of(Suite::Checksum)
    }

    /// An empty collector of frames of a suite.
    #[must_use]
    pub const fn of(suite: Suite) -> Self {
        Self {
            bytes: [0; MAX_FRAME],
            held: 0,
            suite,
        }
    }

    /// Builds a collector with the first `held` of these bytes, if they satisfy the invariant.
    #[must_use]
    pub fn from_parts(bytes: [u8; MAX_FRAME], held: usize, suite: Suite) -> Option<Self> {
        let collector = Self { bytes, held, suite };
        collector.is_valid().then_some(collector)
    }

    /// Returns the suite of the frames.
    #[must_use]
    pub const fn suite(&self) -> Suite {
        self.suite
    }

    /// The invariant: less than a header, or a valid header and at most its frame.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        match self.whole_len() {
            None => true,
            Some(whole) => whole.is_ok_and(|whole| self.held <= whole),
        }
    }

    /// Returns the bytes in use.
    #[must_use]
    pub fn held(&self) -> &[u8] {
        self.bytes.get(..self.held).unwrap_or(&self.bytes)
    }

    /// True if the frame is complete.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.whole_len() == Some(Ok(self.held))
    }

    /// Consumes bytes up to the end of the frame. Returns the number of bytes consumed once the
    /// frame is complete; `None` after consuming all of them.
    ///
    /// # Errors
    /// An invalid header.
    // With keys two deframers' loops call it.
    #[cfg_attr(feature = "keyed", inline(never))]
    pub fn consume(&mut self, bytes: &[u8]) -> Result<Option<usize>, FrameError> {
        let header_part = self.top_up(bytes, HEADER_LEN);
        let Some(whole) = self.whole_len().transpose()? else {
            return Ok(None);
        };
        let rest = bytes.get(header_part..).unwrap_or_default();
        let consumed = header_part.saturating_add(self.top_up(rest, whole));
        Ok((self.held == whole).then_some(consumed))
    }

    /// Clears the bytes in use.
    pub const fn clear(&mut self) {
        self.held = 0;
    }

    /// Returns the length of the frame, once its header is complete.
    fn whole_len(&self) -> Option<Result<usize, FrameError>> {
        let (header, _) = self.bytes.split_first_chunk::<HEADER_LEN>()?;
        (self.held >= HEADER_LEN).then(|| {
            parse_header(*header, self.suite).map(|(_, length)| {
                HEADER_LEN
                    .saturating_add(usize::from(length))
                    .saturating_add(self.suite.trailer_len())
            })
        })
    }

    /// Copies bytes until `target` of them are held; returns how many were copied.
    fn top_up(&mut self, bytes: &[u8], target: usize) -> usize {
        // `target` never exceeds the capacity: a header was checked before its length is believed.
        let room = self.bytes.get_mut(self.held..target).unwrap_or_default();
        for (place, byte) in room.iter_mut().zip(bytes) {
            *place = *byte;
        }
        let copied = room.len().min(bytes.len());
        self.held = self.held.saturating_add(copied);
        copied
    }
}

impl Default for Collector {
    fn default() -> Self {
        Self::new()
    }
}

/// Compares the bytes in use only.
impl PartialEq for Collector {
    fn eq(&self, other: &Self) -> bool {
        self.held() == other.held() && self.suite == other.suite
    }
}

impl Eq for Collector {}
