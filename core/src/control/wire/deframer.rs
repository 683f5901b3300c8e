//! Frames out of a byte stream, fed in slices of any size. It never looks back further than one frame.

use super::collector::Collector;
use super::frame::Frame;
use crate::control::message::FrameError;

/// What one [`Deframer::feed`] found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
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
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
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
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Deframer {
    collector: Collector,
    stage: Stage,
}

impl Deframer {
    /// An empty deframer.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            collector: Collector::new(),
            stage: Stage::Collecting,
        }
    }

    /// A deframer in any state that satisfies the invariant.
    #[must_use]
    pub fn from_parts(collector: Collector, stage: Stage) -> Option<Self> {
        let deframer = Self { collector, stage };
        deframer.is_valid().then_some(deframer)
    }

    /// The invariant, clause by clause: what is being collected is not complete; what was handed out is.
    /// What a broken deframer holds does not matter.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        match self.stage {
            Stage::Collecting => self.collector.is_valid() && !self.collector.is_whole(),
            Stage::HandedOut => self.collector.is_whole(),
            Stage::Broken(_) => true,
        }
    }

    /// Takes bytes up to the end of the current frame.
    pub fn feed(&mut self, bytes: &[u8]) -> Feed<'_> {
        match self.stage {
            Stage::Collecting => {}
            Stage::HandedOut => self.collector.clear(),
            Stage::Broken(error) => return Feed::Broken(error),
        }
        self.stage = Stage::Collecting;
        let frame = match self.collector.take(bytes) {
            Ok(None) => return Feed::Incomplete,
            Ok(Some(consumed)) => {
                Frame::parse(self.collector.held()).map(|frame| (frame, consumed))
            }
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
        self.stage == Stage::HandedOut || self.collector.held().is_empty()
    }
}
