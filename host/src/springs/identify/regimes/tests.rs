use nalgebra::{Vector3, Vector6};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::robot_file::RobotFile;
use crate::springs::campaigns::{Bench, FINE, HOME, HOOKS, Strap, seeded, straps};
use crate::springs::compliances::Springs;
use crate::springs::lines::State;
use crate::springs::play::with_play;

/// Three straps, and one in x up to 520 N and back in steps of 20 N.
fn planned() -> Bench<3> {
    let mut all = straps(1, &HOOKS[..1]);
    let up = (0..=26).map(|step| f64::from(step) * 20.0);
    let levels: Vec<f64> = up.clone().chain(up.rev().skip(1)).collect();
    all.push(Strap { pose: 0, hook: HOOKS[0], direction: Vector3::x(), levels });
    Bench::new(&RobotFile::builtin_l2().unwrap(), &[HOME], &all, FINE)
}

/// Measures a machine that jumps by `gap_m` where the cluster force is that of 330 to 390 N in x, up to 25 N earlier on the way back. Beyond it
/// each link has `ratios` of its compliance, with the line through the point of the jump.
fn measure(bench: &mut Bench<3>, truth: &Springs<3>, random: &mut ChaCha8Rng, ratios: &[f64; LINKS]) {
    let rising = random.random_range(330.0..390.0);
    let falling = rising - random.random_range(0.0..25.0);
    let gap_m = random.random_range(25e-6..55e-6);
    // A window is a force in x where anything jumps: 300 N of it are -141 N of the cluster.
    let beyond = |force: f64, stroke: i8| {
        let threshold = if stroke >= 0 { rising } else { falling };
        if -force > 0.47 * threshold { 1.0 } else { 0.0 }
    };
    let changes: Vector6<f64> = Vector6::from_fn(|link, _| truth.machine.links_m_per_n[link] * (ratios[link] - 1.0));
    bench.measure_with(truth, random, beyond, |tensions_n| {
        let from_jump = 1.0 - 0.47 * rising / -tensions_n.fixed_rows::<3>(3).sum();
        let mut longer = changes.component_mul(tensions_n) * from_jump;
        longer.fixed_rows_mut::<3>(3).add_scalar_mut(-gap_m);
        longer
    });
}

fn compared(bench: &Bench<3>) -> Option<TwoRegimes> {
    let question = bench.question();
    let without = Agreement::find(&question, &Choice::all(&bench.campaign), State::start(&question), true).unwrap();
    let (agreement, play) = with_play(&question, &without, true).unwrap()?;
    Some(compare(&question, &agreement, &play, Intervals { is_scaled: false }, true).unwrap())
}

/// 200 campaigns with a jump, and the same compliances beyond it.
#[test]
fn the_same_compliances_are_not_taken_for_others() {
    let (mut accused, mut held, mut all) = (0, 0, 0);
    for seed in 0..200 {
        let mut random = seeded(seed);
        let mut bench = planned();
        let truth = bench.true_springs(&mut random);
        measure(&mut bench, &truth, &mut random, &[1.0; LINKS]);
        let regimes = compared(&bench).unwrap_or_else(|| panic!("{seed}: no jump"));
        assert_eq!(regimes.degrees[0], LINKS, "{seed}");
        accused += u32::from(regimes.differs());
        for link in regimes.links.iter().filter(|link| link.is_seen) {
            held += u32::from((link.ends[0]..=link.ends[1]).contains(&1.0));
            all += 1;
        }
    }
    // Binomial: of 200 with 1 % more than 7 are 0.1 %.
    assert!(accused <= 7, "{accused}");
    assert!((0.93..=0.97).contains(&(f64::from(held) / f64::from(all))), "{held} of {all}");
}

/// `[T Table 5.2]`: after over used.
#[test]
fn the_ratios_of_the_thesis_are_found() {
    let (mut held, mut all) = (0, 0);
    for seed in 0..30 {
        let mut random = seeded(seed);
        let mut bench = planned();
        let truth = bench.true_springs(&mut random);
        let ratios = std::array::from_fn(|_| random.random_range(0.43..0.62));
        measure(&mut bench, &truth, &mut random, &ratios);
        let regimes = compared(&bench).unwrap_or_else(|| panic!("{seed}: no jump"));
        assert!(regimes.differs() && regimes.p < 1e-6, "{seed}: {regimes:?}");
        for (link, ratio) in regimes.links.iter().zip(ratios).filter(|(link, _)| link.is_seen) {
            held += u32::from((link.ends[0]..=link.ends[1]).contains(&ratio));
            all += 1;
        }
    }
    assert!(all >= 150 && f64::from(held) >= 0.9 * f64::from(all), "{held} of {all}");
}
