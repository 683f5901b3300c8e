//! Campaigns without a mistake are accused of nothing.

use gantry_tau_test_support::seeds::Seeds;
use nalgebra::Vector3;

use super::{Verdict, f1, good, verdict};
use crate::springs::fixture::{FINE, TestBench, campaign_a, never, seeded};
use crate::springs::identify::weak_campaigns::{WEAK_CAMPAIGNS, measured, on_home, strap};

/// Asserts that at most one of a hundred campaigns is accused.
fn assert_accused_of_nothing<const N: usize>(
    name: &str,
    campaign: impl Fn(u64) -> (TestBench<N>, Vec<f64>),
) {
    let seeds = Seeds::new(1, 6);
    let accused = seeds.iter().filter_map(|seed| {
        let (bench, truth) = campaign(seed);
        match verdict(&bench, &truth) {
            Verdict::Refused(said) => Some(format!("seed {seed}: {said}")),
            Verdict::Doubted(doubts) => Some(format!("seed {seed}: {}", doubts.join("; "))),
            Verdict::Unseen | Verdict::Written(_) => None,
        }
    });
    let accused: Vec<String> = accused.collect();
    let is_few = 100 * accused.len() <= seeds.iter().count().max(100);
    assert!(
        is_few,
        "{name}: {} of {}: {}",
        accused.len(),
        seeds.count,
        accused.join("\n")
    );
}

#[test]
fn campaigns_without_a_mistake_are_accused_of_nothing() {
    assert_accused_of_nothing("nine straps", |seed| good(campaign_a(FINE), seed));
    assert_accused_of_nothing("nine straps, F1", |seed| good(f1(), seed));
    for kind in &WEAK_CAMPAIGNS {
        assert_accused_of_nothing(kind.name, |seed| measured(kind, &mut seeded(seed)));
    }
    // A tare at the beginning of a series reads zero, and so does what was typed at its end.
    assert_accused_of_nothing("series that begin and end with a load of zero", |seed| {
        let (mut bench, truth) = good(campaign_a(FINE), seed);
        for series in bench
            .campaign
            .windows
            .chunk_by_mut(|one, other| one.series == other.series)
        {
            for end in [0, series.len() - 1] {
                series[end].load.fill(0.0);
            }
        }
        (bench, truth)
    });
    // Readings and loads as coarse instruments show them.
    for resolution_um in [0.1_f64, 0.5, 1.0] {
        assert_accused_of_nothing(&format!("a resolution of {resolution_um} um"), |seed| {
            let (mut bench, truth) = good(campaign_a(FINE), seed);
            let step = resolution_um * 1e-6;
            bench.campaign.noise.gauge_um = (1.0_f64 + resolution_um.powi(2) / 12.0).sqrt();
            for window in &mut bench.campaign.windows {
                for reading in &mut window.readings_m {
                    *reading = reading.map(|reading| (reading / step).round() * step);
                }
                window.load = window.load.map(|value| (value * 50.0).round() / 50.0);
            }
            (bench, truth)
        });
    }
}

/// Further campaigns, whose stiff axes hardly move.
#[test]
fn a_gauge_that_has_nothing_to_show_is_not_stuck() {
    let straps = [strap(Vector3::y(), 100.0, 5), strap(Vector3::z(), 100.0, 5)];
    for seed in Seeds::new(2, 6).iter() {
        let mut random = seeded(seed);
        let mut bench = on_home(&straps);
        let truth = bench.true_springs(&mut random);
        bench.measure(&truth, &mut random, 0.0, never);
        let verdict = verdict(&bench, truth.vector().as_slice());
        assert!(!matches!(verdict, Verdict::Refused(_)), "{verdict:?}");
    }
}
