//! Windows of synthetic samples.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::experiment::noise::normal;

const NOISE: Noise = Noise {
    gauge_um: 1.0,
    force_n: 1.0,
    moment_nm: 0.05,
};
const RULES: WindowRules = WindowRules::new(NOISE);
/// Noise of a sample: gauge, m; force, N.
const GAUGE_M: f64 = 0.3e-6;
const FORCE_N: f64 = 0.2;

/// Samples of one level: force and gauge as functions of the time, and white noise.
fn samples(
    seed: u64,
    seconds: f64,
    force_n: impl Fn(f64) -> f64,
    gauge_m: impl Fn(f64) -> f64,
) -> impl Iterator<Item = InstrumentSample<3>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    (0..ticks(seconds)).map(move |tick| {
        let time = tick as f64 * TICK_S;
        let mut lengths_m = [0.0; MAX_GAUGES];
        lengths_m[0] = gauge_m(time) + normal(&mut random, GAUGE_M);
        let force = force_n(time) + normal(&mut random, FORCE_N);
        InstrumentSample {
            tick,
            q: [0.1, 0.2, 0.3],
            wrench: [force, normal(&mut random, FORCE_N), 0.0, 0.0, 0.0, 0.0],
            lengths_m,
            gauges: 1,
        }
    })
}

/// The first window of a level, if there is one.
fn taken(samples: impl Iterator<Item = InstrumentSample<3>>) -> Vec<Means<3>> {
    let mut collector = WindowCollector::new(RULES);
    let windows = samples.filter_map(|sample| match collector.feed(&sample) {
        Progress::Taken(means) => Some(means),
        Progress::Settling | Progress::Averaging | Progress::Refused { .. } => None,
    });
    windows.take(1).collect()
}

#[test]
fn the_variance_of_a_sample_has_one_degree_of_freedom_less() {
    assert!((variance(&[1.0, 2.0, 6.0], 3.0) - 7.0).abs() < 1e-12);
}

#[test]
fn a_calm_level_gives_one_window_of_two_seconds() {
    let windows = taken(samples(1, 20.0, |_| 120.0, |_| 50e-6));
    let [window] = windows.as_slice() else {
        panic!("{windows:?}")
    };
    assert_eq!(window.samples, 2_000);
    // Rounding of a sum of 2 000.
    assert!(
        window
            .q
            .iter()
            .zip([0.1, 0.2, 0.3])
            .all(|(mean, q)| (mean - q).abs() < 1e-13)
    );
    // Three seconds, or a few tests more: one in twenty fails by chance.
    assert!(
        (3_000..3_500).contains(&window.first_tick),
        "{}",
        window.first_tick
    );
    // Five standard deviations of a mean.
    assert!((window.wrench[0] - 120.0).abs() < 5.0 * FORCE_N / 2_000_f64.sqrt());
    assert!((window.gauges[0].length_m - 50e-6).abs() < 5.0 * GAUGE_M / 2_000_f64.sqrt());
}

/// The deviation of the mean that a window states, against that of the means of many windows; for
/// white noise and for noise of which neighbours are alike, with 1/19 of the samples effective.
#[test]
fn the_stated_deviation_is_that_of_the_means() {
    for memory in [0.0_f64, 0.9] {
        let mut squares = 0.0;
        let mut stated = 0.0;
        let count = 200;
        for seed in 0..count {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let mut value = 0.0;
            let values: Vec<f64> = (0..2_000)
                .map(|_| {
                    let unit: f64 = StandardNormal.sample(&mut random);
                    value = memory * value + (1.0 - memory * memory).sqrt() * unit;
                    value
                })
                .collect();
            let mean = mean(&values);
            squares += mean * mean / count as f64;
            stated += variance(&values, mean) / effective(&values) / count as f64;
        }
        // 200 means: the deviation of their variance is 10 %; correlations cut off at their first
        // zero are a few percent low or high.
        let expected = (1.0 + memory) / (1.0 - memory) / 2_000.0;
        assert!(
            (stated / expected - 1.0).abs() < 0.15,
            "{memory}: {stated:e} {expected:e}"
        );
        assert!(
            (stated / squares - 1.0).abs() < 0.35,
            "{memory}: {stated:e} {squares:e}"
        );
    }
}

/// A strap creeps, exponentially: the window waits until it has.
#[test]
fn a_creeping_gauge_delays_the_window() {
    let creeping = samples(2, 40.0, |_| 120.0, |time| 40e-6 * (-time / 1.5).exp());
    let windows = taken(creeping);
    let [window] = windows.as_slice() else {
        panic!("{windows:?}")
    };
    // At 3 s the gauge moves by 3.6 um/s; the test sees 0.1 um/s.
    assert!(window.first_tick > 6_000, "{}", window.first_tick);
    assert!(
        window.gauges[0].length_m.abs() < 0.3e-6,
        "{:e}",
        window.gauges[0].length_m
    );
}

#[test]
fn a_force_that_drifts_is_never_taken() {
    // 2 N/s at 120 N: 3.3 % in two seconds.
    assert!(taken(samples(3, 30.0, |time| 120.0 + 2.0 * time, |_| 0.0)).is_empty());
    // A gauge that runs: 1 um/s, ten times what the test sees.
    assert!(taken(samples(4, 30.0, |_| 120.0, |time| 1e-6 * time)).is_empty());
}

/// The drift begins after the settle test has passed: the window is refused, and the next one is
/// taken when the force is calm.
#[test]
fn a_window_whose_force_drifts_is_refused() {
    let drifting = samples(
        5,
        30.0,
        |time| 120.0 + 3.0 * (time - 3.2).clamp(0.0, 2.0),
        |_| 0.0,
    );
    let mut collector = WindowCollector::new(RULES);
    let mut refused = 0;
    let mut first_tick = None;
    for sample in drifting {
        match collector.feed(&sample) {
            Progress::Refused { drift_n } => {
                assert!(drift_n > 2.4, "{drift_n}");
                refused += 1;
            }
            Progress::Taken(means) => {
                first_tick = Some(means.first_tick);
                assert!((means.wrench[0] - 126.0).abs() < 0.1);
                break;
            }
            Progress::Settling | Progress::Averaging => {}
        }
    }
    assert_eq!(refused, 1);
    assert!(
        first_tick.is_some_and(|tick| tick > 5_200),
        "{first_tick:?}"
    );
}

/// A real drift of a few micrometres a minute does not delay a window: it moves a mean by less than
/// its noise.
#[test]
fn a_slow_drift_of_a_quiet_gauge_is_no_obstacle() {
    let quiet = samples(6, 20.0, |_| 120.0, |_| 0.0).map(|sample| {
        let mut quiet = sample;
        // 2 um/min, shown in steps of 0.5 um.
        quiet.lengths_m[0] = ((sample.tick as f64 * 2e-6 / 6e4) / 0.5e-6).round() * 0.5e-6;
        quiet
    });
    assert_eq!(taken(quiet).len(), 1);
}

fn calm() -> impl Iterator<Item = InstrumentSample<3>> {
    samples(7, 10.0, |_| 60.0, |_| 0.0)
}

#[test]
fn gaps_and_nonsense_begin_the_level_again() {
    // A window would be taken from 3 to 5 s.
    let gap = taken(calm().filter(|sample| !(4_000..4_200).contains(&sample.tick)));
    assert!(gap.is_empty() || gap[0].first_tick >= 7_200, "{gap:?}");
    let nonsense = calm().map(|sample| match sample.tick {
        4_000 => InstrumentSample {
            wrench: [f64::NAN; 6],
            ..sample
        },
        _ => sample,
    });
    let nonsense = taken(nonsense);
    assert!(nonsense[0].first_tick > 7_000 && nonsense[0].wrench[0].is_finite());
    // Samples that come twice, or late, count once.
    let twice = taken(calm().flat_map(|sample| [sample, sample]));
    assert_eq!(twice, taken(calm()));
}

/// Of a first-order filter whose neighbours have a correlation of 0.8 a ninth of the samples
/// counts.
#[test]
fn samples_that_are_alike_count_less() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let alone: Vec<f64> = (0..20_000).map(|_| normal(&mut random, 1e-6)).collect();
    let alike = alone.iter().scan(0.0, |last, value| {
        *last = 0.8 * *last + value;
        Some(*last)
    });
    let alike: Vec<f64> = alike.collect();
    let [of_alike, of_alone] = [&alike, &alone].map(|values| effective(values) / 20_000.0);
    assert!(
        (0.8..1.25).contains(&(9.0 * of_alike)) && of_alone > 0.9,
        "{of_alike}"
    );
}
