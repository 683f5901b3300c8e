//! Detector of the swings of one axis that grow, or that stay wide.
//!
//! With the swings between turning points that are `0.6 S` apart at least, where `S` is the largest
//! change of the offset per tick:
//!
//! - *growing*: of the last 8 swings the last is more than 1.3 times the first and more than three
//!   times the hysteresis, and the last four together are more than 1.15 times the first four;
//! - *sustained*: the last 16 swings are all more than `6 S`.

use std::collections::VecDeque;

use gantry_tau_machine::robot_file::CYCLE_US;

use super::turning_points::{Swing, TurningPoints};

/// Swings by which growth is judged.
const GROWING: usize = 8;
/// Swings that are sustained.
const SUSTAINED: usize = 16;
/// Hysteresis of the turning points, and smallest of the swings that are sustained, in tenths of
/// the step.
const HYSTERESIS: u32 = 6;
const WIDE: u32 = 60;

/// Swings that do not decay.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Pattern {
    /// True if they grow.
    pub(super) is_growing: bool,
    /// The last one, nm.
    pub(super) swing_nm: u32,
    /// Mean period, µs; positive.
    pub(super) period_us: u64,
}

/// Detector of one axis. It allocates when it is made.
#[derive(Clone, Debug)]
pub(super) struct Detector {
    points: TurningPoints,
    hysteresis_nm: u32,
    wide_nm: u32,
    /// Last swings, oldest first, at most [`SUSTAINED`].
    swings: VecDeque<Swing>,
}

impl Detector {
    /// Detector of an axis whose offset changes by at most `step_nm` per tick.
    pub(super) fn new(step_nm: u32) -> Self {
        let [hysteresis_nm, wide_nm] =
            [HYSTERESIS, WIDE].map(|tenths| step_nm.saturating_mul(tenths) / 10);
        Self {
            points: TurningPoints::new(hysteresis_nm),
            hysteresis_nm,
            wide_nm,
            swings: VecDeque::with_capacity(SUSTAINED),
        }
    }

    /// Forgets all targets.
    pub(super) fn restart(&mut self) {
        self.points.restart();
        self.swings.clear();
    }

    /// Takes the target of a tick. A swing longer than `longest_ticks` clears the list.
    pub(super) fn update(&mut self, tick: u64, nm: i32, longest_ticks: u64) -> Option<Pattern> {
        let swing = self.points.update(tick, nm)?;
        if swing.ticks > longest_ticks {
            self.swings.clear();
            return None;
        }
        if self.swings.len() == SUSTAINED {
            self.swings.pop_front();
        }
        self.swings.push_back(swing);
        let (is_growing, is_sustained) = (self.is_growing(), self.is_sustained());
        (is_growing || is_sustained).then(|| Pattern {
            is_growing,
            swing_nm: swing.nm,
            period_us: self.period_us(),
        })
    }

    /// Sizes of the swings, newest first, nm.
    fn sizes(&self) -> impl Iterator<Item = u64> {
        self.swings.iter().rev().map(|swing| u64::from(swing.nm))
    }

    fn is_growing(&self) -> bool {
        let (Some(last), Some(first)) = (self.sizes().next(), self.sizes().nth(GROWING - 1)) else {
            return false;
        };
        let later: u64 = self.sizes().take(GROWING / 2).sum();
        let earlier: u64 = self.sizes().skip(GROWING / 2).take(GROWING / 2).sum();
        10 * last > 13 * first
            && last > 3 * u64::from(self.hysteresis_nm)
            && 100 * later > 115 * earlier
    }

    fn is_sustained(&self) -> bool {
        self.swings.len() == SUSTAINED && self.sizes().all(|nm| nm > self.wide_nm.into())
    }

    /// Returns twice the mean length of the swings by which growth is judged, µs; at least that of
    /// two ticks.
    fn period_us(&self) -> u64 {
        let last = self.swings.iter().rev().take(GROWING);
        let (ticks, count) = last.fold((0, 0), |(ticks, count), swing| {
            (ticks + swing.ticks, count + 1)
        });
        2 * u64::from(CYCLE_US) * ticks.max(count) / count.max(1)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    /// Step of an L2, nm: hysteresis 3 µm, sustained above 30 µm.
    const STEP_NM: u32 = 5_000;
    /// Longest swing of an L2 at home, ticks: half a period of 12.4 Hz.
    const LONGEST: u64 = 40;

    /// Feeds targets (nm), one per tick. Returns the first pattern and its tick.
    fn first(targets: impl IntoIterator<Item = f64>) -> Option<(u64, Pattern)> {
        let mut detector = Detector::new(STEP_NM);
        (0..)
            .zip(targets)
            .find_map(|(tick, nm)| Some((tick, detector.update(tick, nm as i32, LONGEST)?)))
    }

    /// Targets with exactly these swings (nm), 10 ticks each.
    fn swinging(sizes_nm: &[i32]) -> Option<(u64, Pattern)> {
        const FAR: i32 = i32::MAX / 4;
        // Falls to the first turning point, and goes back from the last.
        let mut turning = vec![FAR, 0];
        let mut value = 0;
        for (number, size) in sizes_nm.iter().enumerate() {
            value += if number % 2 == 0 { *size } else { -size };
            turning.push(value);
        }
        let back = if sizes_nm.len() % 2 == 0 { FAR } else { -FAR };
        turning.push(back);
        let mut detector = Detector::new(STEP_NM);
        let mut points = (0..).step_by(10).zip(turning);
        points.find_map(|(tick, nm)| Some((tick, detector.update(tick, nm, LONGEST)?)))
    }

    /// `amplitude exp(growth t) sin(2 pi f t)` in µm and seconds, for some seconds.
    fn sine(hz: f64, amplitude_um: f64, growth_per_s: f64, s: f64) -> impl Iterator<Item = f64> {
        (0..(s * 1e3) as u32).map(move |tick| {
            let t = f64::from(tick) * 1e-3;
            1e3 * amplitude_um * (growth_per_s * t).exp() * (TAU * hz * t).sin()
        })
    }

    /// From 13 Hz, above the lowest frequency, to 200 Hz.
    const FREQUENCIES_HZ: [f64; 8] = [13.0, 17.8, 20.7, 31.3, 47.6, 57.6, 84.2, 200.0];

    #[test]
    fn growing_sines_are_found_within_a_doubling_or_two() {
        for hz in FREQUENCIES_HZ {
            // By 1.3 in 7 swings and more: at least 1.4.
            for factor in [1.4_f64, 2.0, 4.0] {
                let growth = factor.ln() / 3.5 * hz;
                let (tick, pattern) = first(sine(hz, 0.5, growth, 2.0)).unwrap();
                assert!(pattern.is_growing, "{hz} Hz: {pattern:?}");
                let swing_um = f64::from(pattern.swing_nm) * 1e-3;
                // Above three times the hysteresis, and not much wider.
                assert!(
                    (9.0..3.0 * factor * 9.0).contains(&swing_um),
                    "{hz} Hz, {factor}: {swing_um} um"
                );
                let found_hz = 1e6 / pattern.period_us as f64;
                assert!((found_hz / hz - 1.0).abs() < 0.1, "{hz} Hz: {found_hz}");
                assert!(tick < 2_000);
            }
        }
    }

    #[test]
    fn decaying_and_constant_sines_below_the_width_are_left() {
        for hz in FREQUENCIES_HZ {
            for amplitude_um in [1.0, 5.0, 14.9] {
                for growth in [0.0, -0.1, -1.0, -10.0] {
                    let found = first(sine(hz, amplitude_um, growth, 5.0));
                    assert_eq!(found, None, "{hz} Hz, {amplitude_um} um, {growth}/s");
                }
            }
            // A wide one that decays by a fifth per swing.
            let found = first(sine(hz, 400.0, 0.8_f64.ln() * 2.0 * hz, 5.0));
            assert_eq!(found, None, "{hz} Hz");
        }
    }

    /// A constant amplitude above 15 µm is 16 swings above 30 µm.
    #[test]
    fn sustained_sines_are_found_after_sixteen_swings() {
        for hz in FREQUENCIES_HZ {
            let (tick, pattern) = first(sine(hz, 40.0, 0.0, 5.0)).unwrap();
            assert!(!pattern.is_growing, "{hz} Hz: {pattern:?}");
            let swings = tick as f64 * 1e-3 * 2.0 * hz;
            assert!((16.0..18.5).contains(&swings), "{hz} Hz: {swings}");
        }
    }

    /// Swings slower than the machine are work.
    #[test]
    fn slow_swings_are_left() {
        for hz in [0.5, 3.0, 6.0, 12.0] {
            for growth in [0.0, 0.3 * hz, hz] {
                assert_eq!(first(sine(hz, 40.0, growth, 3.0)), None, "{hz} Hz");
            }
        }
    }

    #[test]
    fn steps_ramps_and_noise_are_left() {
        let square = |ticks: u32| {
            (0..5_000_u32).map(
                move |tick| {
                    if (tick / ticks) % 2 == 0 { 0.0 } else { 250e3 }
                },
            )
        };
        for ticks in [41, 100, 500] {
            assert_eq!(first(square(ticks)), None, "{ticks} ticks");
        }
        assert_eq!(first((0..5_000).map(|tick| f64::from(tick) * 300.0)), None);
        // Linear congruential noise, uniform.
        let mut seed = 1_u64;
        let mut noise = move |most_nm: f64| {
            seed = seed
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            most_nm * (2.0 * (seed >> 11) as f64 / (1_u64 << 53) as f64 - 1.0)
        };
        // Below half of three times the hysteresis no swing is large enough.
        let found = first((0..100_000).map(|_| noise(4_500.0)));
        assert_eq!(found, None);
        // Noise of half a hysteresis on a growing sine hides nothing.
        let noisy = sine(20.7, 2.0, 2.0, 5.0).map(|nm| nm + noise(1_500.0));
        assert!(first(noisy).is_some());
    }

    /// The rules at their bounds, in swings that are exact.
    #[test]
    fn each_bound_of_growing_is_exact() {
        let grown = |sizes: [i32; 8]| swinging(&sizes).map(|(_, pattern)| pattern.is_growing);
        // The last 1.3 times the first: 13 000 is not, 13 001 is.
        let base = [10_000, 10_000, 10_000, 10_000, 12_000, 12_000, 12_000];
        let with = |last: i32| {
            let mut sizes = [last; 8];
            sizes[..7].copy_from_slice(&base);
            sizes
        };
        assert_eq!(grown(with(13_000)), None);
        assert_eq!(grown(with(13_001)), Some(true));
        // The sums 1.15 times: 40 000 and 46 000 are not.
        let sums = |seventh: i32| {
            [
                10_000, 10_000, 10_000, 10_000, 10_000, 10_000, seventh, 14_000,
            ]
        };
        assert_eq!(grown(sums(12_000)), None);
        assert_eq!(grown(sums(12_001)), Some(true));
        // Three times the hysteresis of 3 µm: 9 µm is not.
        let small = |last: i32| [4_000, 4_000, 4_000, 4_000, 6_000, 6_000, 6_000, last];
        assert_eq!(grown(small(9_000)), None);
        assert_eq!(grown(small(9_001)), Some(true));
        // Seven swings are too few.
        assert_eq!(swinging(&with(20_000)[1..]), None);
    }

    #[test]
    fn each_bound_of_sustained_is_exact() {
        let constant = |nm: i32, count: usize| {
            swinging(&vec![nm; count]).map(|(_, pattern)| pattern.is_growing)
        };
        assert_eq!(constant(30_000, 64), None);
        assert_eq!(constant(30_001, 15), None);
        assert_eq!(constant(30_001, 16), Some(false));
        let mut one_below = [40_000; 31];
        one_below[15] = 30_000;
        assert_eq!(swinging(&one_below), None);
    }

    /// A swing of the longest time is one, a longer one clears the list.
    #[test]
    fn a_swing_that_is_too_long_clears_the_list() {
        let square = |ticks: usize| {
            let period = [vec![0.0; ticks], vec![40e3; ticks]].concat();
            first(std::iter::repeat_n(period, 20).flatten())
        };
        assert!(square(LONGEST as usize).is_some());
        assert_eq!(square(LONGEST as usize + 1), None);
        // One among others.
        let mut detector = Detector::new(STEP_NM);
        let mut found = 0;
        for swing in 0..90_u64 {
            // The swing that ends at number 15, 30, .. is long.
            let tick = 10 * swing + 100 * (swing / 15);
            let nm = if swing % 2 == 0 { 0 } else { 40_000 };
            found += u32::from(detector.update(tick, nm, LONGEST).is_some());
        }
        assert_eq!(found, 0);
    }

    #[test]
    fn restarting_forgets_every_swing() {
        let mut detector = Detector::new(STEP_NM);
        for (tick, nm) in (0_u64..).zip(sine(20.7, 40.0, 0.0, 20.0)) {
            if tick % 350 == 0 {
                detector.restart();
            }
            assert_eq!(detector.update(tick, nm as i32, LONGEST), None);
        }
    }

    #[test]
    fn nothing_overflows_and_nothing_grows() {
        for step_nm in [0, 1, u32::MAX] {
            let mut detector = Detector::new(step_nm);
            let capacity = detector.swings.capacity();
            for tick in 0..10_000_u64 {
                let nm = if tick % 2 == 0 { i32::MAX } else { i32::MIN };
                let pattern = detector.update(tick, nm, LONGEST);
                assert!(pattern.is_none_or(|pattern| pattern.period_us >= 2_000));
            }
            assert_eq!(detector.swings.capacity(), capacity);
        }
        // Ticks that do not advance.
        let mut detector = Detector::new(STEP_NM);
        for number in 0..100 {
            let nm = if number % 2 == 0 { 0 } else { 40_000 };
            let pattern = detector.update(7, nm, LONGEST);
            assert!(pattern.is_none_or(|pattern| pattern.period_us == 2_000));
        }
    }
}
