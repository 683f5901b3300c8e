//! A recorder of steps: the last inputs and outputs, and the state before the oldest of them.
//!
//! Three segments of `HALF` steps take turns; each begins with the state as it was. So at least
//! `2 HALF` steps are at hand, and recording a step costs one copy of its input and output, never a
//! second run. Once a step has ended what is recorded, recording goes on for `HALF` steps and then
//! freezes: at least `HALF` steps before the end and `HALF` after it remain, until
//! [`Recorder::release`]. Generic over state, input and output.

use heapless::Vec;

use super::{Input, Output, Session};

/// Recorder of the ticks of an endpoint: [`NoRecorder`], or a [`super::BlackBox`] in storage of the
/// caller.
pub trait Record<const N: usize> {
    /// Called before a tick with the session that it starts from.
    fn before_tick(&mut self, session: &Session<N>);
    /// Called after a tick with its input and output.
    fn after_tick(&mut self, input: &Input<N>, output: &Output<N>);
}

/// Records nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NoRecorder;

impl<const N: usize> Record<N> for NoRecorder {
    #[inline]
    fn before_tick(&mut self, _: &Session<N>) {}

    #[inline]
    fn after_tick(&mut self, _: &Input<N>, _: &Output<N>) {}
}

impl<const N: usize, const HALF: usize> Record<N>
    for Recorder<Session<N>, Input<N>, Output<N>, HALF>
{
    #[inline]
    fn before_tick(&mut self, session: &Session<N>) {
        Self::before_tick(self, session);
    }

    #[inline]
    fn after_tick(&mut self, input: &Input<N>, output: &Output<N>) {
        Self::after_tick(self, input, output, output.ended.is_some());
    }
}

/// One recorded step.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Entry<I, O> {
    /// Input of the step.
    pub input: I,
    /// Output of the step.
    pub output: O,
}

/// Storage for the entries of a segment.
pub type Entries<I, O, const HALF: usize> = Vec<Entry<I, O>, HALF>;

/// Up to `HALF` steps, and the state before them.
#[derive(Clone, Debug)]
pub struct Segment<S, I, O, const HALF: usize> {
    before: Option<S>,
    /// Entries, the first `used` of them valid; the others are places to write the next ones into.
    entries: Entries<I, O, HALF>,
    used: usize,
}

impl<S: Clone, I: Clone, O: Clone, const HALF: usize> Segment<S, I, O, HALF> {
    #[inline(always)] // As `Recorder::new`.
    const fn new() -> Self {
        Self {
            before: None,
            entries: Vec::new(),
            used: 0,
        }
    }

    /// Builds a segment from its parts, if they satisfy the invariant.
    #[must_use]
    pub fn from_parts(
        before: Option<S>,
        entries: Entries<I, O, HALF>,
        used: usize,
    ) -> Option<Self> {
        let segment = Self {
            before,
            entries,
            used,
        };
        segment.is_valid().then_some(segment)
    }

    /// The invariant: the entries in use exist, and the state before them is kept.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.used <= self.entries.len() && (self.used == 0 || self.before.is_some())
    }

    const fn is_full(&self) -> bool {
        self.used >= HALF
    }

    /// Returns the state before the first entry.
    #[must_use]
    pub const fn before(&self) -> Option<&S> {
        self.before.as_ref()
    }

    /// Returns the recorded steps, oldest first.
    #[must_use]
    pub fn entries(&self) -> &[Entry<I, O>] {
        self.entries.get(..self.used).unwrap_or_default()
    }

    /// Writes into the next place: an entry has some kilobytes and is not to be moved.
    fn push(&mut self, input: &I, output: &O) {
        if let Some(place) = self.entries.get_mut(self.used) {
            place.input.clone_from(input);
            place.output.clone_from(output);
        } else {
            let entry = Entry {
                input: input.clone(),
                output: output.clone(),
            };
            // There is room: `before_tick` has just begun a segment if the last one was full.
            self.entries.push(entry).unwrap_or(());
        }
        self.used = self.used.saturating_add(1);
    }

    fn clear(&mut self) {
        self.before = None;
        self.used = 0;
    }
}

/// A recorder of up to `3 HALF` steps of a state `S` with inputs `I` and outputs `O`. `HALF` = 0
/// records nothing.
#[derive(Clone, Debug)]
pub struct Recorder<S, I, O, const HALF: usize> {
    segments: [Segment<S, I, O, HALF>; SEGMENTS],
    /// Index of the segment being filled; the next one in the circle is the oldest.
    latest: usize,
    /// Steps still to record after an end.
    countdown: Option<usize>,
}

/// Number of segments.
pub const SEGMENTS: usize = 3;

impl<S: Clone, I: Clone, O: Clone, const HALF: usize> Default for Recorder<S, I, O, HALF> {
    fn default() -> Self {
        Self::new()
    }
}

impl<S: Clone, I: Clone, O: Clone, const HALF: usize> Recorder<S, I, O, HALF> {
    /// Creates an empty recorder. It may be large: build it in a `static` or on the heap.
    // Inlined also where the compiler optimises for size: as the result of a call it may be copied
    // from the stack, half a megabyte.
    #[inline(always)]
    #[must_use]
    pub const fn new() -> Self {
        Self {
            segments: [Segment::new(), Segment::new(), Segment::new()],
            latest: 0,
            countdown: None,
        }
    }

    /// Builds a recorder from its parts, if they satisfy the invariant.
    #[must_use]
    pub fn from_parts(
        segments: [Segment<S, I, O, HALF>; SEGMENTS],
        latest: usize,
        countdown: Option<usize>,
    ) -> Option<Self> {
        let recorder = Self {
            segments,
            latest,
            countdown,
        };
        recorder.is_valid().then_some(recorder)
    }

    /// The invariant, clause by clause: the latest segment exists; every segment is valid; those
    /// before the latest are full, or empty without a state, and the older one is not full without
    /// the newer; no more than `HALF` steps are still to be recorded.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let [oldest, newer, _] = self.segments();
        let whole =
            |segment: &Segment<S, I, O, HALF>| segment.is_full() || segment.before.is_none();
        self.latest < SEGMENTS
            && self.segments.iter().all(Segment::is_valid)
            && whole(oldest)
            && whole(newer)
            && (oldest.used == 0 || newer.is_full())
            && self.countdown.is_none_or(|left| left <= HALF)
    }

    /// Call before a step: keeps the state when a new segment begins.
    pub fn before_tick(&mut self, state: &S) {
        if self.is_frozen() || HALF == 0 {
            return;
        }
        if self.segment_mut().is_full() {
            self.latest = match self.latest {
                0 => 1,
                1 => 2,
                _ => 0,
            };
            self.segment_mut().clear();
        }
        let latest = self.segment_mut();
        if latest.used == 0 {
            latest.before = Some(state.clone());
        }
    }

    /// Call after a step: keeps its input and output. A step that `ends` what is recorded starts
    /// the countdown to the freeze. Not inlined, so that its stack, which may hold an entry, is not
    /// added to the caller's.
    #[inline(never)]
    pub fn after_tick(&mut self, input: &I, output: &O, ends: bool) {
        if self.is_frozen() || HALF == 0 {
            return;
        }
        self.segment_mut().push(input, output);
        let after_end = ends.then_some(HALF);
        self.countdown = match self.countdown {
            Some(left) => Some(left.saturating_sub(1)),
            None => after_end,
        };
    }

    /// True after the countdown that an end has started.
    #[must_use]
    pub fn is_frozen(&self) -> bool {
        self.countdown == Some(0)
    }

    /// Returns the steps until the freeze; `None` without an end.
    #[must_use]
    pub const fn left(&self) -> Option<usize> {
        self.countdown
    }

    /// Clears the recording and records again.
    pub fn release(&mut self) {
        for segment in &mut self.segments {
            segment.clear();
        }
        self.countdown = None;
    }

    /// Returns the state before the oldest entry.
    #[must_use]
    pub fn before(&self) -> Option<&S> {
        self.segments().into_iter().find_map(Segment::before)
    }

    /// Returns the recorded steps, oldest first.
    pub fn entries(&self) -> impl Iterator<Item = &Entry<I, O>> {
        self.segments().into_iter().flat_map(Segment::entries)
    }

    /// Returns the segments, oldest first.
    #[must_use]
    pub const fn segments(&self) -> [&Segment<S, I, O, HALF>; SEGMENTS] {
        let [first, second, third] = &self.segments;
        match self.latest {
            0 => [second, third, first],
            1 => [third, first, second],
            _ => [first, second, third],
        }
    }

    /// Returns the segment being filled.
    const fn segment_mut(&mut self) -> &mut Segment<S, I, O, HALF> {
        let [first, second, third] = &mut self.segments;
        match self.latest {
            0 => first,
            1 => second,
            _ => third,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec as StdVec;

    use super::*;

    type Numbers = Segment<u8, (), u8, 2>;
    type Numbered = Recorder<u8, (), u8, 2>;

    /// A segment of `used` steps after the state `before`, in storage for as many.
    fn segment(before: Option<u8>, used: usize) -> Numbers {
        let numbers = (1..).map(|number| Entry {
            input: (),
            output: before.unwrap_or(0) + number,
        });
        Segment {
            before,
            entries: numbers.take(used).collect(),
            used,
        }
    }

    /// True if the parts of the segment, with `used` steps of it, are a segment.
    fn is_segment(segment: Numbers, used: usize) -> bool {
        Segment::from_parts(segment.before, segment.entries, used).is_some()
    }

    /// Records the tick that leads to the state `number`; returns the steps until the freeze.
    fn record(recorder: &mut Numbered, number: u8, ends: bool) -> Option<usize> {
        recorder.before_tick(&(number - 1));
        recorder.after_tick(&(), &number, ends);
        assert!(recorder.is_valid());
        recorder.left()
    }

    #[test]
    fn a_recorder_of_the_wrong_shape_is_none() {
        assert!(is_segment(segment(None, 0), 0));
        assert!(is_segment(segment(Some(1), 0), 0));
        assert!(is_segment(segment(Some(1), 2), 1));
        assert!(!is_segment(segment(Some(1), 1), 2), "more than there are");
        assert!(!is_segment(segment(None, 1), 1), "no state to begin with");
        let empty = segment(None, 0);
        let full = segment(Some(3), 2);
        let partial = segment(Some(5), 1);
        // Oldest, newer, latest.
        let good = [&empty, &full, &partial].map(Clone::clone);
        let cases = [
            (good.clone(), None, true),
            (good.clone(), Some(2), true),
            (good.clone(), Some(3), false),
            ([&full, &full, &empty].map(Clone::clone), None, true),
            ([&empty, &empty, &partial].map(Clone::clone), None, true),
            ([&partial, &full, &empty].map(Clone::clone), None, false),
            ([&empty, &partial, &empty].map(Clone::clone), None, false),
            ([&full, &empty, &empty].map(Clone::clone), None, false),
            (
                [
                    empty.clone(),
                    full.clone(),
                    Segment {
                        used: 2,
                        ..partial.clone()
                    },
                ],
                None,
                false,
            ),
        ];
        for (segments, countdown, is_valid) in cases {
            let found = Recorder::from_parts(segments.clone(), 2, countdown);
            assert_eq!(found.is_some(), is_valid, "{segments:?} {countdown:?}");
            if let Some(recorder) = found {
                assert_eq!(recorder.left(), countdown);
                let count: usize = segments.iter().map(|segment| segment.used).sum();
                assert_eq!(recorder.entries().count(), count);
            }
        }
        assert!(Recorder::from_parts(good, SEGMENTS, None).is_none());
    }

    #[test]
    fn it_freezes_half_its_steps_after_an_end_until_released() {
        let mut recorder = Numbered::new();
        assert_eq!(
            (1..=7).find_map(|number| record(&mut recorder, number, false)),
            None
        );
        assert_eq!(
            [8, 9, 10, 11].map(|number| record(&mut recorder, number, number == 8)),
            [2, 1, 0, 0].map(Some)
        );
        let kept: StdVec<_> = recorder.entries().map(|entry| entry.output).collect();
        assert_eq!(
            (recorder.before(), &kept[..]),
            (Some(&4), &[5, 6, 7, 8, 9, 10][..])
        );
        recorder.release();
        assert_eq!(
            (
                recorder.left(),
                recorder.before(),
                recorder.entries().count()
            ),
            (None, None, 0)
        );
        assert_eq!(record(&mut recorder, 1, true), Some(2));
        assert_eq!(
            (recorder.before(), recorder.entries().count()),
            (Some(&0), 1)
        );
    }

    #[test]
    fn a_recorder_of_no_steps_records_none() {
        let mut recorder = Recorder::<u8, (), u8, 0>::new();
        recorder.before_tick(&0);
        recorder.after_tick(&(), &1, true);
        assert!(recorder.is_valid() && recorder.before().is_none() && recorder.left().is_none());
    }
}
