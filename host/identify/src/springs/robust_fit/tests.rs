use gantry_tau_test_support::seeds::Seeds;
use rand::Rng;

use super::*;
use crate::springs::fixture::{FINE, TestBench, campaign_a, never, seeded};

#[test]
fn a_step_is_found_where_it_is() {
    let values = [0.1, -0.5, 0.3, 0.0, 9.8, 10.4, 10.1, 9.9];
    let (first, size) = step(&values).unwrap();
    assert_eq!(first, 4);
    assert!((size - 9.95).abs() < 0.2, "{size}");
    // One reading beside it is off: the step stays.
    let disturbed = [
        0.1, -0.5, 20.0, 0.3, 0.0, 0.2, -0.1, 0.4, 0.1, -0.3, 9.8, 10.4, 10.1, 9.9,
    ];
    assert_eq!(step(&disturbed).map(|(first, _)| first), Some(10));
}

#[test]
fn what_comes_back_or_ends_the_series_is_no_step() {
    assert_eq!(
        step(&[
            0.0, 0.1, 0.0, -0.1, 10.0, 10.2, 9.9, 10.1, 0.2, -0.1, 0.0, 0.1
        ]),
        None,
        "a jump and the way back"
    );
    assert_eq!(
        step(&[0.0, 0.1, -0.2, 0.3, 0.1, 10.0]),
        None,
        "a single reading"
    );
    assert_eq!(step(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]), None, "a slope");
    assert_eq!(step(&[]), None);
}

#[test]
fn the_largest_of_the_steps_is_the_shift() {
    let bench = campaign_a(FINE);
    let problem = bench.problem();
    let possible: Vec<Vec<f64>> = bench
        .campaign
        .windows
        .iter()
        .map(|_| vec![1.0; 9])
        .collect();
    // From the sixth window of the series on.
    let deviations: Vec<Vec<f64>> = (0..99)
        .map(|window| match (window / 11, window % 11 >= 5) {
            (1, true) => [vec![20.0], vec![0.0; 8]].concat(),
            (2, true) => [vec![0.0; 4], vec![-45.0], vec![0.0; 4]].concat(),
            (2, false) => [vec![0.0; 8], vec![30.0]].concat(),
            _ => vec![0.0; 9],
        })
        .collect();
    let mut active = ActiveSet::all(&bench.campaign);
    let largest = Shift {
        series: 2,
        gauge: 4,
        window: 27,
    };
    assert_eq!(
        largest_shift(&problem, &active, &possible, &deviations, 1.5),
        Some(largest)
    );
    active.shifts.push(largest);
    assert_eq!(
        largest_shift(&problem, &active, &possible, &deviations, 1.5),
        Some(Shift {
            gauge: 8,
            ..largest
        })
    );
}

fn agreed(bench: &TestBench<3>) -> RobustFit<3> {
    let problem = bench.problem();
    fit_agreeing(
        &problem,
        &ActiveSet::all(&bench.campaign),
        FitState::start(&problem),
    )
    .unwrap()
}

#[test]
fn what_is_left_out_costs_as_much_as_the_limit() {
    let mut bench = campaign_a(FINE);
    bench.measure(&bench.file.clone(), &mut seeded(1), 0.0, never);
    let mut robust_fit = agreed(&bench);
    robust_fit.refused.clear();
    robust_fit.active.shifts.clear();
    let chi2 = robust_fit.solution.rows.chi_squared();
    assert!((robust_fit.cost() - chi2).abs() < 1e-12);
    robust_fit.refused = vec![(0, 1), (5, 2), (7, 2)];
    robust_fit.active.shifts.push(Shift {
        series: 2,
        gauge: 4,
        window: 27,
    });
    assert!((robust_fit.cost() - chi2 - 4.0 * TUKEY * TUKEY).abs() < 1e-9);
}

/// Squared errors of the springs in standard deviations of an undisturbed campaign, summed over
/// campaigns; readings that were disturbed, found, and accused wrongly.
#[derive(Default)]
struct Tally {
    squares: f64,
    disturbed: usize,
    found: usize,
    accused: usize,
    readings: usize,
    shifts: usize,
}

fn tally(seeds: Seeds, share: f64) -> Tally {
    let mut tally = Tally::default();
    for seed in seeds.iter() {
        let mut random = seeded(seed);
        let mut bench = campaign_a(FINE);
        let truth = bench.true_springs(&mut random);
        bench.measure(&truth, &mut random, 0.0, never);
        let problem = bench.problem();
        let clean = fit(
            &problem,
            &ActiveSet::all(&bench.campaign),
            FitState::start(&problem),
        )
        .unwrap();
        let covariance = clean.seen.covariance();
        let mut disturbed = Vec::new();
        for (index, window) in bench.campaign.windows.iter_mut().enumerate() {
            for (gauge, reading) in window.readings_m.iter_mut().enumerate() {
                tally.readings += 1;
                if random.random::<f64>() < share {
                    let off = random.random_range(10e-6..30e-6)
                        * if random.random() { 1.0 } else { -1.0 };
                    *reading = reading.map(|reading| reading + off);
                    disturbed.push((index, gauge));
                }
            }
        }
        let found = agreed(&bench);
        let off = found.solution.state.springs.vector() - truth.vector();
        let scores = off
            .iter()
            .enumerate()
            .map(|(spring, off)| off * off / covariance[(spring, spring)]);
        tally.squares += scores.sum::<f64>() / 9.0 / f64::from(seeds.count);
        tally.disturbed += disturbed.len();
        tally.found += disturbed
            .iter()
            .filter(|reading| found.refused.contains(reading))
            .count();
        tally.accused += found
            .refused
            .iter()
            .filter(|reading| !disturbed.contains(reading))
            .count();
        tally.shifts += found.active.shifts.len();
    }
    tally
}

/// A tenth of all readings off by 10 to 30 um: least squares would be 4 to 7 times the bound
/// off.
#[test]
fn disturbed_readings_are_found_and_do_no_harm() {
    let seeds = Seeds::new(10, 200);
    let Tally {
        squares,
        disturbed,
        found,
        accused,
        readings,
        shifts,
    } = tally(seeds, 0.1);
    assert!(squares.sqrt() <= 1.0 + seeds.widened(0.3), "{squares}");
    assert!(found * 100 >= 95 * disturbed, "{found} of {disturbed}");
    // Four in a row that happen to agree look like a gauge that was moved.
    assert!(shifts <= 2, "{shifts}");
    assert!(accused * 1000 <= readings, "{accused} of {readings}");
}

#[test]
fn clean_readings_are_not_accused() {
    let seeds = Seeds::new(10, 200);
    let Tally {
        squares,
        accused,
        readings,
        shifts,
        ..
    } = tally(seeds, 0.0);
    assert_eq!(shifts, 0);
    assert!(accused * 1000 <= readings, "{accused} of {readings}");
    assert!(squares.sqrt() <= 1.0 + seeds.widened(0.1), "{squares}");
}

/// A gauge that was touched: one event, and its readings are of use from there on.
#[test]
fn a_gauge_that_was_moved_is_one_event() {
    let mut random = seeded(3);
    let mut bench = campaign_a(FINE);
    let truth = bench.true_springs(&mut random);
    bench.measure(&truth, &mut random, 0.0, never);
    for window in bench
        .campaign
        .windows
        .iter_mut()
        .filter(|window| window.series == 2)
    {
        if window.window.parse::<u32>().unwrap() >= 4 {
            window.readings_m[1] = window.readings_m[1].map(|reading| reading + 25e-6);
        }
    }
    let found = agreed(&bench);
    assert_eq!(
        found.active.shifts,
        [Shift {
            series: 2,
            gauge: 1,
            window: 2 * 11 + 4
        }]
    );
    assert_eq!(found.refused, []);
    let off = found.solution.state.springs.vector() - truth.vector();
    let covariance = found.solution.seen.covariance();
    assert!(
        off.iter()
            .enumerate()
            .all(|(spring, off)| off.abs() < 4.0 * covariance[(spring, spring)].sqrt())
    );
}

#[test]
fn weights_fall_with_the_deviation() {
    assert!((huber(1.0) - 1.0).abs() < 1e-15 && (huber(-2.69) - 0.5).abs() < 1e-12);
    assert!(
        (tukey(0.0) - 1.0).abs() < 1e-15
            && tukey(4.685) <= 0.0
            && tukey(-9.0) <= 0.0
            && tukey(3.0) > 0.3
    );
}
