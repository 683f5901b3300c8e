//! Simulated time, counted in cycles.

use gantry_tau_machine::robot_file::CYCLE_US;

/// Length of a cycle, s.
const CYCLE_S: f64 = CYCLE_US as f64 * 1e-6;
/// Largest deviation of a step from whole cycles, cycles: steps are sums and differences of times.
const STEP_TOLERANCE: f64 = 1e-3;
/// Largest deviation of a communication point, cycles, and in shares of the time since the start: it is a
/// sum of many steps, each of which is rounded. Below half a cycle.
const TIME_TOLERANCE: f64 = 0.1;
const TIME_DRIFT: f64 = 1e-8;
const MAX_TOLERANCE: f64 = 0.45;
/// Most cycles of one step.
const MAX_CYCLES: f64 = 1e6;
/// Latest time, s: cycles of a simulation are counted exactly far beyond it.
const MAX_TIME_S: f64 = 1e9;

/// Time of a unit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct SimulatedTime {
    start_s: f64,
    stop_s: Option<f64>,
    cycles: u64,
}

impl SimulatedTime {
    pub(super) fn new(start_s: f64, stop_s: Option<f64>) -> Result<Self, String> {
        let range = -MAX_TIME_S..=MAX_TIME_S;
        if !range.contains(&start_s) {
            return Err(format!(
                "start time {start_s}: expected within {MAX_TIME_S:e} s"
            ));
        }
        if let Some(stop_s) = stop_s.filter(|stop_s| !(start_s..=f64::MAX).contains(stop_s)) {
            return Err(format!("stop time {stop_s}: expected from {start_s} s on"));
        }
        Ok(Self {
            start_s,
            stop_s,
            cycles: 0,
        })
    }

    pub(super) fn time(&self) -> f64 {
        self.start_s + self.cycles as f64 * CYCLE_S
    }

    fn tolerance_s(&self) -> f64 {
        let drift = TIME_DRIFT * self.cycles as f64;
        (TIME_TOLERANCE + drift).min(MAX_TOLERANCE) * CYCLE_S
    }

    pub(super) const fn advance(&mut self) {
        self.cycles = self.cycles.saturating_add(1);
    }

    /// Returns the cycles of a step.
    pub(super) fn cycles(&self, time: f64, length: f64) -> Result<u64, String> {
        let now = self.time();
        // `contains` refuses NaN.
        let tolerance_s = self.tolerance_s();
        if !(-tolerance_s..=tolerance_s).contains(&(time - now)) {
            return Err(format!("step at {time} s: the unit is at {now} s"));
        }
        let cycles = (length / CYCLE_S).round();
        let is_whole = (length / CYCLE_S - cycles).abs() <= STEP_TOLERANCE;
        if !(is_whole && (1.0..=MAX_CYCLES).contains(&cycles)) {
            let most = MAX_CYCLES * CYCLE_S;
            return Err(format!(
                "step of {length} s: expected a whole multiple of {CYCLE_S} s, to {most} s"
            ));
        }
        let end = now + cycles * CYCLE_S;
        if let Some(stop) = self.stop_s.filter(|stop| end > stop + tolerance_s) {
            return Err(format!("step to {end} s: the experiment ends at {stop} s"));
        }
        Ok(cycles as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A master that adds the cycle up is off by the roundings.
    #[test]
    fn a_sum_of_steps_is_taken_for_a_day() {
        let mut time_s = 0.0;
        for cycles in 0..86_400_000_u64 {
            if cycles % 3_600_000 == 0 {
                let unit = SimulatedTime {
                    cycles,
                    ..SimulatedTime::default()
                };
                assert_eq!(unit.cycles(time_s, 1e-3), Ok(1), "{cycles}");
                assert!(unit.cycles(time_s + 1e-3, 1e-3).is_err());
            }
            time_s += 1e-3;
        }
    }

    #[test]
    fn whole_multiples_are_steps_and_nothing_else_is() {
        let clock = SimulatedTime::new(0.0, None).unwrap();
        for (length, cycles) in [
            (0.001, 1),
            (0.002, 2),
            (0.3 - 0.2, 100),
            (1000.0, 1_000_000),
        ] {
            assert_eq!(clock.cycles(0.0, length), Ok(cycles));
        }
        for length in [
            0.0,
            -0.001,
            0.0005,
            0.0015,
            1e-9,
            1000.001,
            1e300,
            f64::NAN,
            f64::INFINITY,
        ] {
            let refused = clock.cycles(0.0, length).unwrap_err();
            assert!(refused.contains("whole multiple of 0.001 s"), "{refused}");
        }
    }

    #[test]
    fn a_step_begins_where_the_last_one_ended() {
        let mut clock = SimulatedTime::new(5.0, Some(6.0)).unwrap();
        let mut time = 5.0;
        for _ in 0..1_000 {
            assert_eq!(clock.cycles(time, 0.001), Ok(1));
            clock.advance();
            time += 0.001;
        }
        let beyond = clock.cycles(time, 0.001).unwrap_err();
        assert!(beyond.contains("ends at 6 s"), "{beyond}");
        for wrong in [5.0, 6.001, f64::NAN] {
            let refused = clock.cycles(wrong, 0.001).unwrap_err();
            assert!(refused.contains("the unit is at 6 s"), "{refused}");
        }
    }

    #[test]
    fn times_that_are_none_are_refused() {
        for (start, stop) in [
            (f64::NAN, None),
            (f64::INFINITY, None),
            (2.0, Some(1.0)),
            (0.0, Some(f64::NAN)),
        ] {
            assert!(SimulatedTime::new(start, stop).is_err(), "{start} {stop:?}");
        }
    }
}
