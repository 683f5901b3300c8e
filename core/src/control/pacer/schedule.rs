//! Targets in the order of their times, and the straight lines between them.

use core::mem;

use heapless::Vec;

use super::{Target, TargetError};
use crate::units::{OffsetNm, Tick};

/// The target that was played last, and those that wait for their time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Schedule<const N: usize, const WAITING: usize> {
    from: Target<N>,
    /// The next one last.
    waiting: Vec<Target<N>, WAITING>,
}

impl<const N: usize, const WAITING: usize> Schedule<N, WAITING> {
    /// A schedule of zero.
    pub(super) const fn at(at: Tick) -> Self {
        Self {
            from: Target {
                at,
                offsets: [OffsetNm(0); N],
            },
            waiting: Vec::new(),
        }
    }

    /// Is at these offsets, on the way to the next target.
    pub(super) const fn stand(&mut self, at: Tick, offsets: [OffsetNm; N]) {
        self.from = Target { at, offsets };
    }

    /// Forgets all targets, and stays at these offsets.
    pub(super) fn rest(&mut self, at: Tick, offsets: [OffsetNm; N]) {
        self.stand(at, offsets);
        self.waiting.clear();
    }

    /// Adds a target, or replaces the one of its time.
    pub(super) fn insert(&mut self, target: Target<N>) -> Result<(), TargetError> {
        let same = self.waiting.iter_mut().find(|other| other.at == target.at);
        if let Some(same) = same {
            *same = target;
            return Ok(());
        }
        if self.waiting.is_full() {
            return Err(TargetError::Full);
        }
        // Each that is earlier moves on by one place.
        let mut moved = target;
        for other in &mut self.waiting {
            if other.at < moved.at {
                mem::swap(other, &mut moved);
            }
        }
        self.waiting.push(moved).map_err(|_| TargetError::Full)
    }

    /// Returns the offsets that are wanted at a time.
    pub(super) fn play(&mut self, at: Tick) -> [OffsetNm; N] {
        for _ in 0..WAITING {
            match self.waiting.last() {
                Some(next) if next.at <= at => self.from = *next,
                _ => break,
            }
            self.waiting.pop();
        }
        match self.waiting.last() {
            Some(next) => between(&self.from, next, at),
            None => {
                // The line to the next target begins when that is there.
                self.from.at = at;
                self.from.offsets
            }
        }
    }
}

/// Offsets on the line from one target to another.
fn between<const N: usize>(from: &Target<N>, to: &Target<N>, at: Tick) -> [OffsetNm; N] {
    let span = to.at.0.saturating_sub(from.at.0);
    let elapsed = at.0.saturating_sub(from.at.0);
    let mut offsets = from.offsets;
    for (offset, to) in offsets.iter_mut().zip(to.offsets) {
        *offset = OffsetNm(part(offset.0, to.0, elapsed, span));
    }
    offsets
}

/// `from + (to - from) elapsed / span`, rounded towards `from`.
fn part(from: i32, to: i32, elapsed: u64, span: u64) -> i32 {
    // Below 2^32 times below 2^18: the horizon and the latency.
    let way = u64::from(to.abs_diff(from));
    let gone = way.saturating_mul(elapsed.min(span)).checked_div(span);
    // At most the way, so that nothing saturates.
    let gone = u32::try_from(gone.unwrap_or(0)).unwrap_or(0);
    if to > from {
        from.saturating_add_unsigned(gone)
    } else {
        from.saturating_sub_unsigned(gone)
    }
}

#[cfg(kani)]
impl<const N: usize, const WAITING: usize> kani::Arbitrary for Schedule<N, WAITING> {
    /// Any targets at any times, in order or not.
    fn any() -> Self {
        let mut waiting = Vec::new();
        for _ in 0..WAITING {
            if kani::any() {
                let _ = waiting.push(kani::any());
            }
        }
        Self {
            from: kani::any(),
            waiting,
        }
    }
}
