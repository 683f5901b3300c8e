use nalgebra::Vector3;

use super::*;
use crate::fit::statistics::NORMAL_95;
use crate::measurements::springs::Noise;
use crate::robot_file::RobotFile;
use crate::springs::campaigns::{Bench, FINE, HOME, HOOKS, Strap, campaign_a, never, seeded};
use crate::springs::fit::fit;

const STATED: Intervals = Intervals { is_scaled: false };

fn agreed(bench: &Bench<3>) -> Option<Agreement<3>> {
    let question = bench.question();
    let choice = Choice::all(&bench.campaign);
    let solved = fit(&question, &choice, State::start(&question)).ok()?;
    Some(Agreement { solved, choice, refused: Vec::new() })
}

/// Known to a third of a percent: chi-squared is a parabola, and the profile is 1.96 standard deviations on either side.
#[test]
fn what_is_known_well_has_a_symmetric_profile() {
    let mut random = seeded(2);
    let mut bench = campaign_a(FINE);
    let truth = bench.true_springs(&mut random);
    bench.measure(&truth, &mut random, 0.0, never);
    let agreement = agreed(&bench).unwrap();
    let covariance = agreement.solved.seen.covariance();
    let values = agreement.solved.state.springs.vector();
    for (spring, tolerance) in [(0, 0.01), (4, 0.01), (7, 0.03)] {
        let Profiled { ends: [low, high], .. } = profile(&bench.question(), &agreement, STATED, spring).unwrap();
        let sd = covariance[(spring, spring)].sqrt();
        let (below, above) = ((values[spring] - low) / sd, (high - values[spring]) / sd);
        println!("{spring}: {below} {above}");
        assert!((below / NORMAL_95 - 1.0).abs() < tolerance && (above / NORMAL_95 - 1.0).abs() < tolerance);
    }
    // Nothing of a clean campaign is known badly enough to be profiled.
    assert_eq!(profiles(&bench.question(), &agreement, STATED), []);
    // Scaled by the residuals both are: they agree still.
    let scaled = Intervals { is_scaled: true };
    let Profiled { ends: [low, high], .. } = profile(&bench.question(), &agreement, scaled, 0).unwrap();
    let reach = scaled.reach(&agreement.solved) * (covariance[(0, 0)] * scaled.variance(&agreement.solved)).sqrt();
    assert!(((high - low) / (2.0 * reach) - 1.0).abs() < 0.01);
}

/// One strap, pulled once, its force known to a fifth or so: a spring is elongation over force, `e / f`. Of the force, what the readings do
/// not contradict is `f +- 1.96 sd`, so that the profile holds in 95 % of the campaigns; `+- 1.96 sd` of the spring misses on one side only, 9 %.
#[test]
fn a_spring_that_is_known_badly_has_a_longer_arm_above() {
    let noise = Noise { gauge_um: 0.01, force_n: 8.0, moment_nm: 0.2 };
    let robot = RobotFile::builtin_l2().unwrap();
    let direction = Vector3::new(1.0, 1.0, 1.0).normalize();
    let planned = || {
        let strap = Strap { pose: 0, hook: HOOKS[0], direction, levels: vec![0.0, 60.0] };
        Bench::new(&robot, &[HOME], &[strap], noise)
    };
    let share = |agreement: &Agreement<3>, spring: usize| {
        agreement.solved.seen.covariance()[(spring, spring)].sqrt() / agreement.solved.state.springs.vector()[spring]
    };
    // Exact readings of the file's machine show how well each link is known.
    let mut exact = planned();
    exact.campaign.noise = Noise { gauge_um: 1e-6, force_n: 1e-6, moment_nm: 1e-6 };
    let file = exact.file.clone();
    exact.measure(&file, &mut seeded(0), 0.0, never);
    exact.campaign.noise = noise;
    let expected = agreed(&exact).unwrap();
    let shares: Vec<f64> = (0..6).map(|link| share(&expected, link)).collect();
    let links: Vec<usize> = (0..6).filter(|link| (0.15..0.35).contains(&shares[*link])).collect();
    println!("{shares:?}");
    assert!(links.len() >= 2, "{shares:?}");
    let [mut held, mut symmetric, mut all, mut below] = [0.0; 4];
    for seed in 0..400 {
        let mut random = seeded(seed);
        let mut bench = planned();
        let truth = bench.true_springs(&mut random);
        bench.measure(&truth, &mut random, 0.0, never);
        let Some(agreement) = agreed(&bench) else { continue };
        let values = agreement.solved.state.springs.vector();
        for &link in &links {
            let Some(Profiled { ends: [low, high], .. }) = profile(&bench.question(), &agreement, STATED, link) else {
                continue;
            };
            let (truth, value) = (truth.vector()[link], values[link]);
            let reach = NORMAL_95 * share(&agreement, link) * value;
            all += 1.0;
            held += f64::from(u8::from((low..=high).contains(&truth)));
            symmetric += f64::from(u8::from((value - reach..=value + reach).contains(&truth)));
            below += f64::from(u8::from(high - value > value - low));
        }
    }
    println!("{all} {held} {symmetric} {below}");
    assert!(all > 350.0 * links.len() as f64 && below > 0.98 * all, "{all} {below}");
    let (held, symmetric) = (held / all, symmetric / all);
    assert!((0.92..=0.975).contains(&held), "{held}");
    assert!(symmetric < held - 0.01 && (held - 0.95).abs() < (symmetric - 0.95).abs(), "{held} {symmetric}");
}
