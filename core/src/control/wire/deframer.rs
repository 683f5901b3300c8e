//! Deframer: frames out of a byte stream, fed in slices of any size. It never looks back further
//! than one frame.

use super::collector::Collector;
use super::frame::{Frame, Sealed, Suite};
use crate::control::message::FrameError;

/// Result of a feed; `F` is [`Frame`] or [`Sealed`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Feed<F> {
    /// Every byte was taken; the frame is incomplete.
    Incomplete,
    /// A frame is complete; feed the bytes from `consumed` on again.
    Frame {
        /// The frame.
        frame: F,
        /// Number of bytes taken.
        consumed: usize,
    },
    /// The frame boundary is lost; every later feed returns this again.
    Broken(FrameError),
}

/// State of a deframer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Stage {
    /// Collects a frame.
    #[default]
    Collecting,
    /// Holds a frame that was returned; it is dropped before the next byte is taken.
    Returned,
    /// Has lost the frame boundary.
    Broken(FrameError),
}

/// Collects one frame at a time.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Deframer {
    collector: Collector,
    stage: Stage,
}

impl Deframer {
    /// An empty deframer of frames with checksums.
    #[must_use]
    pub const fn new() -> Self {
        Self::of(Suite::Checksum)
    }

    /// An empty deframer of frames of a suite.
    #[must_use]
    pub const fn of(suite: Suite) -> Self {
        Self {
            collector: Collector::of(suite),
            stage: Stage::Collecting,
        }
    }

    /// Builds a deframer from its parts, if they satisfy the invariant.
    #[must_use]
    pub fn from_parts(collector: Collector, stage: Stage) -> Option<Self> {
        let deframer = Self { collector, stage };
        deframer.is_valid().then_some(deframer)
    }

    /// The invariant, clause by clause: a frame being collected is incomplete; a returned frame is
    /// complete; a broken deframer may hold anything.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        match self.stage {
            Stage::Collecting => self.collector.is_valid() && !self.collector.is_whole(),
            Stage::Returned => self.collector.is_whole(),
            Stage::Broken(_) => true,
        }
    }

    /// Returns the suite of the frames.
    #[must_use]
    pub const fn suite(&self) -> Suite {
        self.collector.suite()
    }

    /// Returns the bytes of the frame that is collected, or was collected last.
    pub(crate) fn held(&self) -> &[u8] {
        self.collector.held()
    }

    /// Takes bytes up to the end of the current frame, which has a checksum.
    pub fn feed(&mut self, bytes: &[u8]) -> Feed<Frame<'_>> {
        self.feed_with(bytes, Sealed::check_sum)
    }

    /// Takes bytes up to the end of the current frame. Its trailer is not checked: [`Self::give_up`] if
    /// it is found wrong.
    pub fn feed_sealed(&mut self, bytes: &[u8]) -> Feed<Sealed<'_>> {
        self.feed_with(bytes, Ok)
    }

    /// Takes the frame boundary for lost.
    pub const fn give_up(&mut self, error: FrameError) {
        self.stage = Stage::Broken(error);
    }

    #[inline]
    fn feed_with<'a, F>(
        &'a mut self,
        bytes: &[u8],
        open: impl FnOnce(Sealed<'a>) -> Result<F, FrameError>,
    ) -> Feed<F> {
        match self.stage {
            Stage::Collecting => {}
            Stage::Returned => self.collector.clear(),
            Stage::Broken(error) => return Feed::Broken(error),
        }
        self.stage = Stage::Collecting;
        let frame = match self.collector.consume(bytes) {
            Ok(None) => return Feed::Incomplete,
            Ok(Some(consumed)) => Sealed::parse(self.collector.held(), self.collector.suite())
                .and_then(open)
                .map(|frame| (frame, consumed)),
            Err(error) => Err(error),
        };
        match frame {
            Ok((frame, consumed)) => {
                self.stage = Stage::Returned;
                Feed::Frame { frame, consumed }
            }
            Err(error) => {
                self.stage = Stage::Broken(error);
                Feed::Broken(error)
            }
        }
    }

    /// True if no incomplete frame is held.
    #[must_use]
    pub fn is_at_boundary(&self) -> bool {
        self.stage == Stage::Returned || self.collector.held().is_empty()
    }
}
