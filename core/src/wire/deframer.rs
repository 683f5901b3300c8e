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

/// Collects one frame at a time.
#[derive(Clone, Debug, Default)]
pub struct Deframer {
    buffer: FrameBytes,
    /// The buffer holds a frame that was handed out; it is dropped before the next byte is taken.
    handed_out: bool,
    broken: Option<FrameError>,
}

impl Deframer {
    /// An empty deframer.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            buffer: Vec::new(),
            handed_out: false,
            broken: None,
        }
    }

    /// Takes bytes up to the end of the current frame.
    pub fn feed(&mut self, bytes: &[u8]) -> Feed<'_> {
        if let Some(error) = self.broken {
            return Feed::Broken(error);
        }
        if self.handed_out {
            self.buffer.clear();
            self.handed_out = false;
        }
        match self.advance(bytes) {
            Ok(None) => Feed::Incomplete,
            Ok(Some(consumed)) => match Frame::parse(&self.buffer) {
                Ok(frame) => {
                    self.handed_out = true;
                    Feed::Frame { frame, consumed }
                }
                Err(error) => {
                    self.broken = Some(error);
                    Feed::Broken(error)
                }
            },
            Err(error) => {
                self.broken = Some(error);
                Feed::Broken(error)
            }
        }
    }

    /// Whether no byte of a frame is waiting for the rest.
    #[must_use]
    pub fn is_at_boundary(&self) -> bool {
        self.handed_out || self.buffer.is_empty()
    }

    /// Copies header, then body and checksum. `Some(consumed)` once the frame is complete.
    fn advance(&mut self, bytes: &[u8]) -> Result<Option<usize>, FrameError> {
        let taken = self.top_up(bytes, HEADER_LEN);
        let Some((header, _)) = self.buffer.split_first_chunk::<HEADER_LEN>() else {
            return Ok(None);
        };
        let (_, length) = parse_header(*header)?;
        let whole = HEADER_LEN
            .saturating_add(usize::from(length))
            .saturating_add(TRAILER_LEN);
        let rest = bytes.get(taken..).unwrap_or_default();
        let consumed = taken.saturating_add(self.top_up(rest, whole));
        Ok((self.buffer.len() == whole).then_some(consumed))
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
