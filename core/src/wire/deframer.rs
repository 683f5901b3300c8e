//! Frames out of a byte stream, fed in slices of any size. It never looks back further than one frame.

use heapless::Vec;

use super::frame::{Frame, FrameBytes, FrameError, HEADER_LEN, TRAILER_LEN, parse_header};

/// What one [`Deframer::feed`] found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Feed<'a> {
    /// Every byte was taken; the frame is not complete yet.
    Incomplete,
    /// A frame is complete; feed the bytes from `consumed` on again.
    Frame {
        /// The frame.
        frame: Frame<'a>,
        /// How many of the given bytes were taken.
        consumed: usize,
    },
    /// The boundary is lost, for good: every later feed says so again.
    Broken(FrameError),
}

/// What a deframer is about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Stage {
    /// Collects a frame.
    #[default]
    Collecting,
    /// Holds a frame that was handed out; it is dropped before the next byte is taken.
    HandedOut,
    /// Has lost the boundary, for good.
    Broken(FrameError),
}

/// Collects one frame at a time.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Deframer {
    buffer: FrameBytes,
    stage: Stage,
}

impl Deframer {
    /// An empty deframer.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            buffer: Vec::new(),
            stage: Stage::Collecting,
        }
    }

    /// A deframer in any state that satisfies the invariant.
    #[must_use]
    pub fn from_parts(buffer: &[u8], stage: Stage) -> Option<Self> {
        let buffer = FrameBytes::from_slice(buffer).ok()?;
        let deframer = Self { buffer, stage };
        deframer.is_valid().then_some(deframer)
    }

    /// The invariant, clause by clause: what is being collected is less than a header, or a good header and less than its frame;
    /// what was handed out is as long as its header says. What a broken deframer holds does not matter.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let held = self.buffer.len();
        match self.stage {
            Stage::Collecting => match self.whole_len() {
                None => held < HEADER_LEN,
                Some(whole) => whole.is_ok_and(|whole| held < whole),
            },
            Stage::HandedOut => self.whole_len() == Some(Ok(held)),
            Stage::Broken(_) => true,
        }
    }

    /// Takes bytes up to the end of the current frame.
    pub fn feed(&mut self, bytes: &[u8]) -> Feed<'_> {
        match self.stage {
            Stage::Collecting => {}
            Stage::HandedOut => self.buffer.clear(),
            Stage::Broken(error) => return Feed::Broken(error),
        }
        self.stage = Stage::Collecting;
        let whole = self.advance(bytes);
        let frame = match whole {
            Ok(None) => return Feed::Incomplete,
            Ok(Some(consumed)) => Frame::parse(&self.buffer).map(|frame| (frame, consumed)),
            Err(error) => Err(error),
        };
        match frame {
            Ok((frame, consumed)) => {
                self.stage = Stage::HandedOut;
                Feed::Frame { frame, consumed }
            }
            Err(error) => {
                self.stage = Stage::Broken(error);
                Feed::Broken(error)
            }
        }
    }

    /// Whether no byte of a frame is waiting for the rest.
    #[must_use]
    pub fn is_at_boundary(&self) -> bool {
        self.stage == Stage::HandedOut || self.buffer.is_empty()
    }

    /// Copies header, then body and checksum. `Some(consumed)` once the frame is complete.
    fn advance(&mut self, bytes: &[u8]) -> Result<Option<usize>, FrameError> {
        let taken = self.top_up(bytes, HEADER_LEN);
        let Some(whole) = self.whole_len().transpose()? else {
            return Ok(None);
        };
        let rest = bytes.get(taken..).unwrap_or_default();
        let consumed = taken.saturating_add(self.top_up(rest, whole));
        Ok((self.buffer.len() == whole).then_some(consumed))
    }

    /// Length of the frame being collected, once its header is there.
    fn whole_len(&self) -> Option<Result<usize, FrameError>> {
        let (header, _) = self.buffer.split_first_chunk::<HEADER_LEN>()?;
        Some(parse_header(*header).map(|(_, length)| {
            HEADER_LEN
                .saturating_add(usize::from(length))
                .saturating_add(TRAILER_LEN)
        }))
    }

    /// Copies bytes until the buffer holds `target` of them; returns how many were copied.
    fn top_up(&mut self, bytes: &[u8], target: usize) -> usize {
        let missing = target.saturating_sub(self.buffer.len());
        let part = bytes.get(..missing).unwrap_or(bytes);
        // `target` never exceeds the capacity: a header was checked before its length is believed.
        match self.buffer.extend_from_slice(part) {
            Ok(()) => part.len(),
            Err(()) => 0,
        }
    }
}
