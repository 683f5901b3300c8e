use super::*;
use crate::fit::statistics::NORMAL_95;
use crate::measurements::springs::Noise;
use crate::robot_file::RobotFile;
use crate::springs::campaigns::{Bench, FINE, HOME, HOOKS, campaign_a, never, seeded, straps};
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
    let values = vector(&agreement.solved.state.compliances);
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

/// Forces that are known to a spring balance's fifth: 95 % of the profiles hold, and the misses are as many above as below; fewer of the
/// symmetric intervals hold, and nearly all of their misses are below the truth.
#[test]
fn a_spring_that_is_known_badly_has_a_longer_arm_above() {
    let noise = Noise { gauge_um: 0.5, force_n: 15.0, moment_nm: 1.0 };
    let robot = RobotFile::builtin_l2().unwrap();
    let mut all = straps(1, &HOOKS);
    all.iter_mut().for_each(|strap| strap.levels = vec![0.0, 40.0]);
    let mut counts = [0_u32; 5];
    for seed in 0..150 {
        let mut random = seeded(seed);
        let mut bench = Bench::new(&robot, &[HOME], &all, noise);
        let truth = bench.true_springs(&mut random);
        bench.measure(&truth, &mut random, 0.0, never);
        let Some(agreement) = agreed(&bench) else { continue };
        let covariance = agreement.solved.seen.covariance();
        let values = vector(&agreement.solved.state.compliances);
        for Profiled { parameter, ends: [low, high] } in profiles(&bench.question(), &agreement, STATED) {
            if parameter >= 6 {
                continue;
            }
            let (truth, value, reach) =
                (vector(&truth)[parameter], values[parameter], NORMAL_95 * covariance[(parameter, parameter)].sqrt());
            counts[0] += 1;
            counts[1] += u32::from(truth < low);
            counts[2] += u32::from(truth > high);
            counts[3] += u32::from(truth < value - reach);
            counts[4] += u32::from(truth > value + reach);
        }
    }
    println!("{counts:?}");
    let [all, below, above, symmetric_below, symmetric_above] = counts.map(f64::from);
    assert!(all > 300.0);
    let (held, symmetric) = (1.0 - (below + above) / all, 1.0 - (symmetric_below + symmetric_above) / all);
    assert!((held - 0.95).abs() < (symmetric - 0.95).abs(), "{held} {symmetric}");
    assert!((0.92..0.975).contains(&held), "{held}");
}
