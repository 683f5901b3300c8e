use gantry_tau_test_support::seeds::Seeds;
use nalgebra::{DMatrix, DVector, Vector3};
use rand::Rng;

use super::crossing::Sums;
use super::*;
use crate::springs::fixture::{
    FINE, HOME, HOOKS, Strap, TestBench, campaign_a, never, seeded, straps,
};
use crate::springs::robust_fit::fit_agreeing;
use gantry_tau_machine::robot_file::RobotFile;

/// Campaign A, and a strap in x up to 460 N and back in steps of 20 N.
fn with_long_series() -> TestBench<3> {
    let mut all = straps(1, &HOOKS);
    let up = (0..=23).map(|step| f64::from(step) * 20.0);
    let levels: Vec<f64> = up.clone().chain(up.rev().skip(1)).collect();
    all.push(Strap {
        pose: 0,
        hook: HOOKS[0],
        direction: Vector3::x(),
        levels,
    });
    TestBench::new(&RobotFile::builtin_l2().unwrap(), &[HOME], &all, FINE)
}

#[test]
fn the_windows_beside_a_crossing_are_the_nearest() {
    // The farthest beyond first: two of the rising ones, one of the falling ones.
    let crossing = Crossing {
        sign: 1.0,
        candidates: [vec![5, 4, 3, 2], vec![9, 10, 11]],
        beyond: [2, 1],
    };
    assert_eq!(
        [0, 1].map(|stroke| crossing.beside(stroke)),
        [[Some(3), Some(4)], [Some(10), Some(9)]]
    );
    assert_eq!(
        crossing
            .is_crossed(12)
            .iter()
            .filter(|is_crossed| **is_crossed)
            .count(),
        3
    );
}

#[test]
fn sums_are_those_over_all_pairs() {
    let mut random = seeded(1);
    let shares = DVector::from_fn(5, |_, _| random.random_range(-1.0..1.0));
    let half = DMatrix::from_fn(5, 5, |_, _| random.random_range(-1.0..1.0));
    let overlaps: DMatrix<f64> = &half + half.transpose();
    let sums = Sums::new(&shares, &overlaps, 3);
    for (risen, fallen) in (0..=3).flat_map(|risen| (0..=2).map(move |fallen| (risen, fallen))) {
        let chosen: Vec<usize> = (0..risen).chain(3..3 + fallen).collect();
        let share: f64 = chosen.iter().map(|one| shares[*one]).sum();
        let overlap: f64 = chosen
            .iter()
            .flat_map(|one| chosen.iter().map(|other| overlaps[(*one, *other)]))
            .sum();
        let (found_share, found_overlap) = sums.of(risen, fallen);
        assert!((found_share - share).abs() < 1e-12 && (found_overlap - overlap).abs() < 1e-12);
    }
}

#[test]
fn a_window_that_has_lost_a_third_of_its_readings_keeps_all() {
    let mut bench = campaign_a(FINE);
    bench.campaign.windows[2].readings_m[6..].fill(None);
    let mut active = ActiveSet::all(&bench.campaign);
    for (window, lost) in [(0, 3), (1, 2), (2, 2), (3, 5)] {
        active.weights[window][..lost].fill(0.0);
    }
    // Six are read in window 2, and two of those are lost.
    active.weights[2][8] = 0.0;
    let whole = with_whole_windows(&active, &bench.problem());
    assert_eq!(lost_by_window(&whole)[..5], [0, 2, 0, 0, 0]);
    active.weights[2][..2].copy_from_slice(&[0.0, 1.0]);
    active.weights[2][6..].fill(0.0);
    let whole = with_whole_windows(&active, &bench.problem());
    assert_eq!(
        lost_by_window(&whole)[2],
        4,
        "what was not read is not lost"
    );
}

/// Number of readings without a weight, by window.
fn lost_by_window(active: &ActiveSet) -> Vec<usize> {
    active
        .weights
        .iter()
        .map(|weights| weights.iter().filter(|weight| **weight <= 0.0).count())
        .collect()
}

/// Share of the play that has opened at a cluster force. The joint crosses within 2 N of the
/// threshold of the stroke: rising, falling.
fn crossed(thresholds_n: [f64; 2], force_n: f64, stroke: i8) -> f64 {
    let threshold_n = thresholds_n[usize::from(stroke < 0)];
    ((-force_n - threshold_n) / 2.0 + 0.5).clamp(0.0, 1.0)
}

fn found(bench: &TestBench<3>) -> (RobustFit<3>, Option<FoundPlay>) {
    let problem = bench.problem();
    let without = fit_agreeing(
        &problem,
        &ActiveSet::all(&bench.campaign),
        FitState::start(&problem),
    )
    .unwrap();
    match with_play(&problem, &without, true).unwrap() {
        Some((robust_fit, play)) => (robust_fit, Some(play)),
        None => (without, None),
    }
}

/// Jump at 330 to 390 N in x, up to 25 N earlier on the way back, of 25 to 55 um, in most
/// campaigns with a window inside the crossing.
#[test]
fn a_jump_is_found_with_its_preload() {
    let seeds = Seeds::new(8, 200);
    let campaigns = f64::from(seeds.count);
    let mut squares = 0.0;
    let mut reduced = 0.0_f64;
    let mut largest = 0.0_f64;
    for seed in seeds.iter() {
        let mut random = seeded(seed);
        let mut bench = with_long_series();
        let truth = bench.true_springs(&mut random);
        // 300 N in x are -141 N of the cluster at the file's springs and at any others: forces
        // balance.
        let rising = random.random_range(330.0..390.0) * 0.47;
        let falling = rising - random.random_range(0.0..25.0) * 0.47;
        let gap = random.random_range(25e-6..55e-6);
        bench.measure(&truth, &mut random, -gap, |force, stroke| {
            crossed([rising, falling], force, stroke)
        });
        let (robust_fit, play) = found(&bench);
        let play = play.unwrap_or_else(|| panic!("{seed}: no play"));
        let sd = robust_fit.solution.seen.covariance()[(9, 9)].sqrt();
        let score = (play.gap_m - gap) / sd;
        largest = largest.max(score.abs());
        squares += score * score / campaigns;
        let [Some([low_up, high_up]), Some([low_down, high_down])] = play.preload_n else {
            panic!("{seed}")
        };
        assert!(
            (low_up..=high_up).contains(&rising),
            "{seed}: rising {rising} {play:?}"
        );
        assert!(
            (low_down..=high_down).contains(&falling),
            "{seed}: falling {falling} {play:?}"
        );
        let chi = robust_fit.solution.rows.chi_squared() / float(robust_fit.solution.degrees());
        reduced = reduced.max(chi);
        let off = robust_fit.solution.state.springs.vector() - truth.vector();
        let covariance = robust_fit.solution.seen.covariance();
        assert!(
            off.iter()
                .enumerate()
                .all(|(spring, off)| off.abs() < 5.0 * covariance[(spring, spring)].sqrt()),
            "{seed}"
        );
    }
    assert!(
        largest < 4.0 && squares.sqrt() < 1.0 + seeds.widened(0.35),
        "{largest} {squares}"
    );
    assert!(reduced < 1.25, "{reduced}");
}

/// The same with 16 disturbed readings, two of them in windows at the crossing: the intervals
/// hold, no matter which window they put off.
#[test]
fn disturbed_readings_do_not_move_the_preload() {
    for seed in Seeds::new(3, 12).iter() {
        let mut random = seeded(500 + seed);
        let mut bench = with_long_series();
        let truth = bench.true_springs(&mut random);
        let rising = random.random_range(330.0..390.0) * 0.47;
        let falling = rising - random.random_range(0.0..25.0) * 0.47;
        bench.measure(&truth, &mut random, -40e-6, |force, stroke| {
            crossed([rising, falling], force, stroke)
        });
        bench.disturb(&mut random, 16.0 / 1314.0);
        // The first window behind the crossing of the rising stroke: its force is 0.47 of the
        // strap's.
        let first = bench
            .campaign
            .windows
            .iter()
            .position(|window| window.load[0] * 0.47 > rising + 3.0)
            .unwrap();
        for gauge in [1, 4] {
            bench.campaign.windows[first].readings_m[gauge] =
                bench.campaign.windows[first].readings_m[gauge].map(|reading| reading + 25e-6);
        }
        let (_, play) = found(&bench);
        let play = play.unwrap_or_else(|| panic!("{seed}: no play"));
        let [Some([low_up, high_up]), Some([low_down, high_down])] = play.preload_n else {
            panic!("{seed}")
        };
        assert!(
            (low_up..=high_up).contains(&rising),
            "{seed}: rising {rising} {play:?}"
        );
        assert!(
            (low_down..=high_down).contains(&falling),
            "{seed}: falling {falling} {play:?}"
        );
    }
}

/// A jump that only rising forces have crossed says nothing about falling ones.
#[test]
fn a_stroke_that_was_not_measured_has_no_interval() {
    let mut random = seeded(7);
    let mut bench = with_long_series();
    let truth = bench.true_springs(&mut random);
    bench.measure(&truth, &mut random, -40e-6, |force, _| {
        f64::from(u8::from(-force > 165.0))
    });
    bench
        .campaign
        .windows
        .retain(|window| window.series < 9 || window.stroke > 0);
    let (_, play) = found(&bench);
    let [Some([low, high]), None] = play.unwrap().preload_n else {
        panic!("an interval of the falling stroke")
    };
    assert!(
        low <= 165.0 && high >= 165.0 && high - low < 40.0,
        "{low} {high}"
    );
}

#[test]
fn no_play_is_invented() {
    for seed in Seeds::new(8, 200).iter() {
        let mut random = seeded(seed);
        let mut bench = if seed % 2 == 0 {
            campaign_a(FINE)
        } else {
            with_long_series()
        };
        let truth = bench.true_springs(&mut random);
        bench.measure(&truth, &mut random, 0.0, never);
        assert_eq!(found(&bench).1, None, "{seed}");
    }
}

/// Windows with disturbed readings are not left out for a play that is not there: of 2 to 10 %
/// of readings off by 10 to 30 um.
#[test]
fn no_play_is_invented_from_disturbed_readings() {
    for seed in Seeds::new(4, 32).iter() {
        let mut random = seeded(1000 + seed);
        let mut bench = campaign_a(FINE);
        let truth = bench.true_springs(&mut random);
        bench.measure(&truth, &mut random, 0.0, never);
        bench.disturb(&mut random, if seed % 2 == 0 { 0.1 } else { 0.02 });
        assert_eq!(found(&bench).1, None, "{seed}");
    }
}
