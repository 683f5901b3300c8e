//! The bytes of one frame, out of slices of any size: first a header, then as many as it states. No checksum here.

use super::frame::{FrameBytes, FrameError, HEADER_LEN, TRAILER_LEN, parse_header};

/// Collects the bytes of one frame.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Collector {
    held: FrameBytes,
}

impl Collector {
    /// An empty collector.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            held: FrameBytes::new(),
        }
    }

    /// A collector that holds these bytes, if they satisfy the invariant.
    #[must_use]
    pub fn from_parts(held: &[u8]) -> Option<Self> {
        let held = FrameBytes::from_slice(held).ok()?;
        let collector = Self { held };
        collector.is_valid().then_some(collector)
    }

    /// The invariant: less than a header, or a good header and at most its frame.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        match self.whole_len() {
            None => true,
            Some(whole) => whole.is_ok_and(|whole| self.held.len() <= whole),
        }
    }

    /// The bytes that are there.
    #[must_use]
    pub fn held(&self) -> &[u8] {
        &self.held
    }

    /// Whether the frame is complete.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.whole_len() == Some(Ok(self.held.len()))
    }

    /// Takes bytes up to the end of the frame. `Some(taken)` once it is complete; `None` has taken them all.
    ///
    /// # Errors
    /// What is wrong with the header.
    pub fn take(&mut self, bytes: &[u8]) -> Result<Option<usize>, FrameError> {
        let header_part = self.top_up(bytes, HEADER_LEN);
        let Some(whole) = self.whole_len().transpose()? else {
            return Ok(None);
        };
        let rest = bytes.get(header_part..).unwrap_or_default();
        let taken = header_part.saturating_add(self.top_up(rest, whole));
        Ok((self.held.len() == whole).then_some(taken))
    }

    /// Forgets what is held.
    pub fn clear(&mut self) {
        self.held.clear();
    }

    /// Length of the frame, once its header is there.
    fn whole_len(&self) -> Option<Result<usize, FrameError>> {
        let (header, _) = self.held.split_first_chunk::<HEADER_LEN>()?;
        Some(parse_header(*header).map(|(_, length)| {
            HEADER_LEN
                .saturating_add(usize::from(length))
                .saturating_add(TRAILER_LEN)
        }))
    }

    /// Copies bytes until `target` of them are held; returns how many were copied.
    fn top_up(&mut self, bytes: &[u8], target: usize) -> usize {
        let missing = target.saturating_sub(self.held.len());
        let part = bytes.get(..missing).unwrap_or(bytes);
        // `target` never exceeds the capacity: a header was checked before its length is believed.
        match self.held.extend_from_slice(part) {
            Ok(()) => part.len(),
            Err(()) => 0,
        }
    }
}
