//! Steers the cycle to the reference clock of the bus: from the time at which a frame passed the
//! reference to the shift of the next cycle. Integers only, and no time source of its own.
//!
//! The *phase* is the time by which a frame passes later than it should: a fixed time before a
//! pulse of SYNC0. The median of the last five phases is followed by a proportional and an integral
//! part, together at most a thousandth of a cycle per cycle: clocks that differ by more are refused
//! by name instead of followed badly.

/// Samples of the median.
const WINDOW: usize = 5;
/// Divisors of the proportional part, and of the integral per cycle.
const PROPORTIONAL: i64 = 32;
const INTEGRAL: i64 = 8_192;
/// Median below which the cycle counts as in phase, ns, and for how many cycles.
const LOCKED_NS: i64 = 20_000;
const LOCKED_CYCLES: u32 = 200;
/// Phase that must not last, ns, and for how many samples in a row.
const LOST_NS: i64 = 400_000;
const LOST_SAMPLES: u32 = 3;
/// Samples in a row whose time is not later than the last one's.
const STANDING_SAMPLES: u32 = 3;
/// Time for which the correction may stay at its limit, ns.
const AT_LIMIT_NS: i64 = 1_000_000_000;
/// Delay of a cycle after which its sample is not learned from, ns.
const LATE_NS: u64 = 150_000;
/// Late cycles in a row after which the cycle does not count as in phase.
const LATE_CYCLES: u32 = 5;

/// Settings of the steering.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SteeringConfig {
    /// Length of a cycle, ns.
    pub cycle_ns: u32,
    /// Time from the passage of a frame to the pulse of SYNC0, ns; below a cycle.
    pub frame_to_sync0_ns: u32,
}

/// Reason why the cycle does not follow the reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SteeringFault {
    /// Frames passed too far from where they should, three times in a row.
    #[error("frames pass {phase_us} us from their place before SYNC0")]
    Phase {
        /// Phase of the last one, µs.
        phase_us: i32,
    },
    /// The time of the reference stands still, or goes back.
    #[error("the time of the reference clock does not go on")]
    Standing,
    /// The correction has been at its limit for a second.
    #[error("the clocks of PC and bus differ by more than 1000 ppm")]
    Drift,
}

/// One step of the steering.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step {
    /// Time by which the next cycle is to begin later, ns; at most a thousandth of a cycle.
    pub shift_ns: i64,
    /// Phase of this sample, ns; `None` without one.
    pub phase_ns: Option<i64>,
    /// A fault that this sample shows.
    pub fault: Option<SteeringFault>,
}

/// Steering of a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Steering {
    cycle_ns: i64,
    target_ns: i64,
    start_ns: u64,
    window: [i64; WINDOW],
    /// Place of the oldest phase.
    oldest: usize,
    samples: usize,
    /// Sum of the medians.
    integral: i64,
    /// Time of the last sample; 0 before the first.
    last_ns: u64,
    in_phase: u32,
    far: u32,
    late: u32,
    standing: u32,
    at_limit: i64,
}

impl Steering {
    /// Creates a steering for pulses that begin at a time of the reference, ns.
    #[must_use]
    pub fn new(config: SteeringConfig, start_ns: u64) -> Self {
        let cycle_ns = i64::from(config.cycle_ns.max(1));
        Self {
            cycle_ns,
            target_ns: cycle_ns - i64::from(config.frame_to_sync0_ns) % cycle_ns,
            start_ns,
            window: [0; WINDOW],
            oldest: 0,
            samples: 0,
            integral: 0,
            last_ns: 0,
            in_phase: 0,
            far: 0,
            late: 0,
            standing: 0,
            at_limit: 0,
        }
    }

    /// Returns the phase of a frame that passed the reference at a time, ns.
    #[must_use]
    pub fn phase(&self, dc_time_ns: u64) -> i64 {
        let cycle = self.cycle_ns.unsigned_abs();
        // Time since the last pulse that begins a cycle; before the first pulse, as if it had come.
        let since_pulse = match dc_time_ns.checked_sub(self.start_ns) {
            Some(since) => since % cycle,
            None => (cycle - (self.start_ns - dc_time_ns) % cycle) % cycle,
        };
        let phase = i64::try_from(since_pulse).unwrap_or(0) - self.target_ns;
        // Wrapped to half a cycle: it is from less than -cycle to less than cycle.
        let half = self.cycle_ns / 2;
        if phase > half {
            phase - self.cycle_ns
        } else if phase < -half {
            phase + self.cycle_ns
        } else {
            phase
        }
    }

    /// True if the median was below 20 µs for 200 cycles.
    #[must_use]
    pub const fn is_locked(&self) -> bool {
        self.in_phase >= LOCKED_CYCLES
    }

    /// Takes the time at which the frame of a cycle passed the reference, `None` for one that is
    /// not known, and the time by which its cycle began late, ns. Once per cycle.
    pub fn step(&mut self, dc_time_ns: Option<u64>, late_ns: u64) -> Step {
        let phase_ns = dc_time_ns.map(|time| self.phase(time));
        let goes_on = self.note_time(dc_time_ns);
        if let Some(phase) = phase_ns.filter(|_| goes_on) {
            self.note_place(phase, late_ns);
        }
        let Some(phase) = phase_ns.filter(|_| goes_on && late_ns <= LATE_NS) else {
            // Coasts: nothing is learned.
            return Step {
                shift_ns: -self.bounded(self.integral / INTEGRAL),
                phase_ns,
                fault: self.fault(phase_ns.unwrap_or(0)),
            };
        };
        let median = self.median_with(phase);
        let (proportional, limit) = (median / PROPORTIONAL, self.limit());
        let wanted = proportional.saturating_add(self.integral / INTEGRAL);
        // At its limit the integral learns only what leads away from it.
        if wanted.abs() < limit || wanted.signum() != median.signum() {
            let most = limit.saturating_mul(INTEGRAL);
            self.integral = self.integral.saturating_add(median).clamp(-most, most);
        }
        let correction = self.bounded(proportional.saturating_add(self.integral / INTEGRAL));
        let is_in_phase = median.abs() < LOCKED_NS && self.samples >= WINDOW;
        self.in_phase = if is_in_phase {
            self.in_phase.saturating_add(1)
        } else {
            0
        };
        self.at_limit = if correction.abs() >= limit {
            self.at_limit.saturating_add(1)
        } else {
            0
        };
        Step {
            shift_ns: -correction,
            phase_ns,
            fault: self.fault(phase),
        }
    }

    /// Takes note of where a frame passed, learned from or not.
    fn note_place(&mut self, phase: i64, late_ns: u64) {
        self.far = if phase.abs() > LOST_NS.min(self.cycle_ns / 5 * 2) {
            self.far.saturating_add(1)
        } else {
            0
        };
        self.late = if late_ns > LATE_NS {
            self.late.saturating_add(1)
        } else {
            0
        };
        // The median stands for cycles that begin in time.
        if self.late >= LATE_CYCLES {
            self.in_phase = 0;
        }
    }

    /// Begins to look for faults again.
    pub const fn forget_faults(&mut self) {
        (self.far, self.standing, self.at_limit) = (0, 0, 0);
    }

    /// Takes note of the time of a sample; true if it went on since the last one.
    fn note_time(&mut self, dc_time_ns: Option<u64>) -> bool {
        let Some(time_ns) = dc_time_ns else {
            return false;
        };
        let goes_on = time_ns > self.last_ns;
        self.standing = if goes_on {
            0
        } else {
            self.standing.saturating_add(1)
        };
        self.last_ns = time_ns;
        goes_on
    }

    /// Returns the fault that there is: the cycle is then not in phase.
    fn fault(&mut self, phase: i64) -> Option<SteeringFault> {
        let fault = self.found_fault(phase);
        if fault.is_some() {
            self.in_phase = 0;
        }
        fault
    }

    fn found_fault(&self, phase: i64) -> Option<SteeringFault> {
        if self.standing >= STANDING_SAMPLES {
            return Some(SteeringFault::Standing);
        }
        let at_limit_ns = self.at_limit.saturating_mul(self.cycle_ns);
        let is_far = self.far >= LOST_SAMPLES;
        // A phase that grows while the correction is at its limit has the same cause.
        if at_limit_ns >= AT_LIMIT_NS || is_far && at_limit_ns >= AT_LIMIT_NS / 2 {
            return Some(SteeringFault::Drift);
        }
        is_far.then(|| SteeringFault::Phase {
            phase_us: i32::try_from(phase / 1_000).unwrap_or(0),
        })
    }

    const fn limit(&self) -> i64 {
        self.cycle_ns / 1_000
    }

    fn bounded(&self, correction: i64) -> i64 {
        correction.clamp(-self.limit(), self.limit())
    }

    /// Adds a phase; returns the median of the last ones.
    fn median_with(&mut self, phase: i64) -> i64 {
        if let Some(oldest) = self.window.get_mut(self.oldest) {
            *oldest = phase;
        }
        self.oldest = (self.oldest + 1) % WINDOW;
        self.samples = self.samples.saturating_add(1).min(WINDOW);
        if self.samples == WINDOW {
            return median_of_five(self.window);
        }
        let mut sorted = self.window;
        let Some(known) = sorted.get_mut(..self.samples) else {
            return phase;
        };
        known.sort_unstable();
        known.get(known.len() / 2).copied().unwrap_or(phase)
    }
}

/// Returns the median, without a sort.
fn median_of_five([a, b, c, d, e]: [i64; WINDOW]) -> i64 {
    // Of the four, neither the least nor the largest is the median of all.
    let low = a.min(b).max(c.min(d));
    let high = a.max(b).min(c.max(d));
    e.clamp(low.min(high), low.max(high))
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: SteeringConfig = SteeringConfig {
        cycle_ns: 1_000_000,
        frame_to_sync0_ns: 500_000,
    };

    /// Time of a frame of a cycle, with a phase.
    fn time_ns(cycle: u64, phase_ns: i64) -> Option<u64> {
        let place_ns = 1_000_000 * (cycle + 1) + 500_000;
        place_ns.checked_add_signed(phase_ns)
    }

    /// All orders of five numbers, some of which are the same.
    #[test]
    fn the_median_is_that_of_a_sort() {
        for number in 0..5_i64.pow(5) {
            let digits = [1, 5, 25, 125, 625].map(|place| number / place % 5);
            let mut sorted = digits;
            sorted.sort_unstable();
            assert_eq!(median_of_five(digits), sorted[2], "{digits:?}");
        }
    }

    /// A computer that is late in every cycle learns nothing, and is told so.
    #[test]
    fn a_cycle_that_is_always_late_is_not_in_phase_and_a_fault_far_away() {
        let mut steering = Steering::new(CONFIG, 0);
        for cycle in 0..300 {
            steering.step(time_ns(cycle, 0), 0);
        }
        assert!(steering.is_locked());
        for cycle in 300..310 {
            let step = steering.step(time_ns(cycle, 160_000), 160_000);
            assert_eq!((step.shift_ns, step.fault), (0, None));
            assert_eq!(steering.is_locked(), cycle < 304, "{cycle}");
        }
        let faults =
            [310, 311, 312].map(|cycle| steering.step(time_ns(cycle, 450_000), 450_000).fault);
        assert_eq!(
            faults,
            [None, None, Some(SteeringFault::Phase { phase_us: 450 })]
        );
    }
}
