//! The black box: the last ticks' complete inputs and outputs, the state before the oldest, and the configuration within it.
//!
//! Three segments of `HALF` ticks take turns; each begins with the session as it was. So at least `2 HALF` ticks are at hand,
//! and recording a tick costs one copy of its input, never a second run. When a session ends, recording goes on for
//! `HALF` ticks and then freezes: at least `HALF` ticks before the cause and `HALF` after it remain, until [`BlackBox::release`].
//! Replaying the inputs from the first segment's session gives every output again, bit for bit ([`super::replay`], T11).

use heapless::Vec;

use super::{Input, Output, Session};

/// One recorded tick.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry<const N: usize> {
    /// What the tick depended on.
    pub input: Input<N>,
    /// What it produced.
    pub output: Output<N>,
}

/// `HALF` ticks, and the session before them.
#[derive(Clone, Debug)]
struct Segment<const N: usize, const HALF: usize> {
    before: Option<Session<N>>,
    /// Entries, the first `used` of them valid; the others are places to write the next ones into.
    entries: Vec<Entry<N>, HALF>,
    used: usize,
}

impl<const N: usize, const HALF: usize> Segment<N, HALF> {
    const fn new() -> Self {
        Self {
            before: None,
            entries: Vec::new(),
            used: 0,
        }
    }

    const fn is_full(&self) -> bool {
        self.used >= HALF
    }

    fn valid(&self) -> impl Iterator<Item = &Entry<N>> {
        self.entries.iter().take(self.used)
    }

    /// Writes into the next place, so that an entry of some kilobytes is not moved about.
    fn push(&mut self, input: &Input<N>, output: &Output<N>) {
        if let Some(place) = self.entries.get_mut(self.used) {
            place.input.copy_from(input);
            place.output.clone_from(output);
        } else {
            let entry = Entry {
                input: input.clone(),
                output: output.clone(),
            };
            // There is room: `before_tick` has just put a full segment aside.
            self.entries.push(entry).unwrap_or(());
        }
        self.used = self.used.saturating_add(1);
    }

    const fn clear(&mut self) {
        self.before = None;
        self.used = 0;
    }
}

/// A recorder for a session of `N` axes; it holds up to `3 HALF` ticks. `HALF` = 0 records nothing.
#[derive(Clone, Debug)]
pub struct BlackBox<const N: usize, const HALF: usize> {
    segments: [Segment<N, HALF>; SEGMENTS],
    /// Which segment is being filled; the next one in the circle is the oldest.
    latest: usize,
    /// Ticks still to record after a cause.
    countdown: Option<usize>,
}

const SEGMENTS: usize = 3;

impl<const N: usize, const HALF: usize> Default for BlackBox<N, HALF> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize, const HALF: usize> BlackBox<N, HALF> {
    /// An empty recorder.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            segments: [const { Segment::new() }; SEGMENTS],
            latest: 0,
            countdown: None,
        }
    }

    /// Before a tick: keeps the session where a new segment begins.
    pub fn before_tick(&mut self, session: &Session<N>) {
        if self.is_frozen() || HALF == 0 {
            return;
        }
        if self.segment_mut().is_full() {
            self.latest = if self.latest.saturating_add(1) < SEGMENTS {
                self.latest.saturating_add(1)
            } else {
                0
            };
            self.segment_mut().clear();
        }
        let latest = self.segment_mut();
        if latest.used == 0 {
            latest.before = Some(*session);
        }
    }

    /// After a tick: keeps its input and output, and counts down to the freeze once a session has ended.
    pub fn after_tick(&mut self, input: &Input<N>, output: &Output<N>) {
        if self.is_frozen() || HALF == 0 {
            return;
        }
        self.segment_mut().push(input, output);
        self.countdown = match self.countdown {
            Some(left) => Some(left.saturating_sub(1)),
            None => output.ended.map(|_| HALF),
        };
    }

    /// Whether a cause has frozen the recording.
    #[must_use]
    pub fn is_frozen(&self) -> bool {
        self.countdown == Some(0)
    }

    /// Forgets everything and records again.
    pub fn release(&mut self) {
        for segment in &mut self.segments {
            segment.clear();
        }
        self.countdown = None;
    }

    /// The session before the oldest entry.
    #[must_use]
    pub fn before(&self) -> Option<&Session<N>> {
        self.oldest_first()
            .find_map(|segment| segment.before.as_ref())
    }

    /// The recorded ticks, oldest first.
    pub fn entries(&self) -> impl Iterator<Item = &Entry<N>> {
        self.oldest_first().flat_map(Segment::valid)
    }

    fn oldest_first(&self) -> impl Iterator<Item = &Segment<N, HALF>> {
        let oldest = self.latest.saturating_add(1);
        self.segments.iter().cycle().skip(oldest).take(SEGMENTS)
    }

    /// The segment being filled; `latest` never leaves the circle.
    const fn segment_mut(&mut self) -> &mut Segment<N, HALF> {
        let [first, second, third] = &mut self.segments;
        match self.latest {
            1 => second,
            2 => third,
            _ => first,
        }
    }
}
