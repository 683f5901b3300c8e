//! Cycle of a bus with clocks: where its beginnings lie on the clock of the wire, and the samples of
//! the steering.

use crate::bring_up::ClockSettings;
use crate::steering::{Steering, SteeringConfig, SteeringFault};

/// Cycle that follows the reference clock.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SteeredCycle {
    steering: Steering,
    cycle_ns: u64,
    /// A beginning of a cycle by the clock of the wire, ns; the others lie whole cycles from it.
    begin_ns: u64,
    /// Time by which the present cycle began late, ns.
    late_ns: u64,
    /// Time at which the last frame passed the reference; `None` without a sample.
    time_ns: Option<u64>,
    phase_ns: Option<i64>,
    /// Shifts that the owner of the cycle has not taken.
    shift_ns: i64,
}

impl SteeredCycle {
    pub(crate) fn new(clocks: &ClockSettings, cycle_ns: u32, start_ns: u64) -> Self {
        let config = SteeringConfig {
            cycle_ns,
            frame_to_sync0_ns: clocks.frame_to_sync0_ns,
        };
        Self {
            steering: Steering::new(config, start_ns),
            cycle_ns: u64::from(cycle_ns.max(1)),
            begin_ns: 0,
            late_ns: 0,
            time_ns: None,
            phase_ns: None,
            shift_ns: 0,
        }
    }

    /// Takes note of the time at which the frame passed the reference.
    pub(crate) const fn note_time(&mut self, time_ns: u64) {
        self.time_ns = Some(time_ns);
    }

    /// Returns the shift that brings the next cycle into phase at once, by the last frame; `None`
    /// without its time.
    pub(crate) fn align(&mut self) -> Option<i64> {
        let phase_ns = self.steering.phase(self.time_ns.take()?);
        self.begin_ns = self.begin_ns.saturating_add_signed(-phase_ns);
        Some(-phase_ns)
    }

    /// Takes note that a cycle begins at a time, ns, in time.
    pub(crate) const fn begin_in_time(&mut self, begin_ns: u64) {
        (self.begin_ns, self.late_ns) = (begin_ns, 0);
    }

    /// Returns the first beginning of a cycle after a time, ns.
    pub(crate) const fn upcoming_ns(&self, now_ns: u64) -> u64 {
        let since_ns = now_ns.saturating_sub(self.begin_ns);
        let cycles = since_ns / self.cycle_ns + 1;
        self.begin_ns
            .saturating_add(cycles.saturating_mul(self.cycle_ns))
    }

    /// Takes note of the time at which a cycle begins, ns.
    pub(crate) const fn begin(&mut self, now_ns: u64) {
        let since_ns = now_ns.saturating_sub(self.begin_ns);
        let late_ns = since_ns % self.cycle_ns;
        // A timer that ends a little early has not slept through a cycle.
        let is_early = late_ns > self.cycle_ns - self.cycle_ns / 50;
        self.late_ns = if is_early { 0 } else { late_ns };
        let began_ns = now_ns.saturating_sub(late_ns);
        self.begin_ns = if is_early {
            began_ns.saturating_add(self.cycle_ns)
        } else {
            began_ns
        };
    }

    /// Steers by the sample of the last frame. Returns the shift of the next cycle, and a fault.
    pub(crate) fn step(&mut self) -> (i64, Option<SteeringFault>) {
        let step = self.steering.step(self.time_ns.take(), self.late_ns);
        self.phase_ns = step.phase_ns;
        self.begin_ns = self.begin_ns.saturating_add_signed(step.shift_ns);
        self.shift_ns = self.shift_ns.saturating_add(step.shift_ns);
        (step.shift_ns, step.fault)
    }

    pub(crate) const fn take_shift_ns(&mut self) -> i64 {
        let shift_ns = self.shift_ns;
        self.shift_ns = 0;
        shift_ns
    }

    pub(crate) const fn phase_ns(&self) -> Option<i64> {
        self.phase_ns
    }

    pub(crate) const fn is_locked(&self) -> bool {
        self.steering.is_locked()
    }

    /// Begins to look for faults again, after a re-arm.
    pub(crate) const fn forget_faults(&mut self) {
        self.steering.forget_faults();
    }
}
