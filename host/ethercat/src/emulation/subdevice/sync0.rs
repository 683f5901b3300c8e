//! Pulses of SYNC0: the device takes its outputs with them.

use super::SubDevice;
use super::states::{al, code};
use crate::emulation::device::{Device, MAX_PROCESS_DATA};
use crate::emulation::distributed_clock::DistributedClock;
use crate::emulation::memory::Memory;

/// Intervals in a row without outputs after which a device that requires SYNC0 leaves OP.
const MAX_EMPTY: u32 = 3;

/// Intervals of SYNC0 in OP, by the frames with outputs in them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sync0Intervals {
    /// Exactly one.
    pub one: u64,
    /// None.
    pub none: u64,
    /// Two or more.
    pub more: u64,
}

/// The present interval of SYNC0, and those before.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sync0Interval {
    /// Outputs that wait for the pulse, and their length.
    outputs: ([u8; MAX_PROCESS_DATA], usize),
    /// Frames with outputs since the last pulse.
    frames: u32,
    /// Intervals in a row without one.
    empty: u32,
    /// The interval began in OP.
    is_whole: bool,
    before: Sync0Intervals,
}

impl Default for Sync0Interval {
    fn default() -> Self {
        Self {
            outputs: ([0; MAX_PROCESS_DATA], 0),
            frames: 0,
            empty: 0,
            is_whole: false,
            before: Sync0Intervals::default(),
        }
    }
}

impl Sync0Interval {
    pub(super) const fn take(&mut self) -> Sync0Intervals {
        let before = self.before;
        self.before = Sync0Intervals {
            one: 0,
            none: 0,
            more: 0,
        };
        before
    }

    const fn count(&mut self) {
        match self.frames {
            0 => self.before.none += 1,
            1 => self.before.one += 1,
            _ => self.before.more += 1,
        }
    }
}

/// A distributed clock, to be disturbed.
#[derive(Debug)]
pub struct ClockHandle<'a> {
    pub(super) clock: &'a mut DistributedClock,
    pub(super) memory: &'a Memory,
    pub(super) now_ns: u64,
}

impl ClockHandle<'_> {
    /// Changes the drift from now on, parts per billion.
    pub fn set_drift(&mut self, drift_ppb: i32) {
        self.clock.set_drift(self.now_ns, drift_ppb);
    }

    /// Moves its time by a jump, ns.
    pub fn jump(&mut self, by_ns: i64) {
        self.clock.jump(by_ns);
    }

    /// Lets the time that is read stand still from now on.
    pub fn freeze(&mut self) {
        self.clock.freeze(self.memory, self.now_ns);
    }

    /// Takes no write of SYNC0's period from now on.
    pub fn ignore_period(&mut self) {
        self.clock.ignore_period();
    }
}

impl<D: Device> SubDevice<D> {
    /// True if SYNC0 is set up.
    pub(in crate::emulation) fn has_sync0(&self) -> bool {
        self.clock.as_ref().is_some_and(DistributedClock::is_active)
    }

    /// Takes outputs that have just been written whole: at once, or with the next pulse.
    pub(super) fn note_outputs(&mut self, data: &[u8]) {
        if !self.has_sync0() {
            return self.device.take_outputs(data);
        }
        let (bytes, length) = &mut self.sync0.outputs;
        if let Some(place) = bytes.get_mut(..data.len()) {
            place.copy_from_slice(data);
            *length = data.len();
        }
        self.sync0.frames = self.sync0.frames.saturating_add(1);
    }

    /// Runs the pulses that have come by now.
    pub(super) fn run_sync0(&mut self, now_ns: u64) {
        loop {
            let Some(clock) = &mut self.clock else {
                return;
            };
            if !clock.take_pulse(&self.memory, now_ns) {
                return;
            }
            self.pulse();
        }
    }

    fn pulse(&mut self) {
        let is_operational = self.is_operational();
        if is_operational && self.sync0.is_whole {
            self.sync0.count();
        }
        let frames = std::mem::take(&mut self.sync0.frames);
        self.sync0.is_whole = is_operational;
        if frames > 0 {
            let (bytes, length) = self.sync0.outputs;
            self.device.take_outputs(bytes.get(..length).unwrap_or(&[]));
            self.sync0.empty = 0;
        } else {
            self.sync0.empty = self.sync0.empty.saturating_add(1);
        }
        self.device.sync0();
        let is_lost = self.sync0.empty >= MAX_EMPTY && self.device.requires_sync0();
        if is_lost && self.state == al::OP {
            self.leave_op(al::SAFE_OP, code::SYNC);
        }
    }
}
