//! Readings that agree with each other.
//!
//! Each reading is compared with what the others of its window, with which it shares the error of the load, let expect. Readings that are
//! far off are found with weights that forgive them (Huber once, then Tukey's biweight); the estimate is then made without them, and with the
//! full weight of all others, so that it is the maximum likelihood of what is left and its intervals are right.
//! A gauge that stays shifted from a window on was moved: it gets another zero from there, and is one event.

use nalgebra::{DMatrix, DVector};

use super::choice::{Choice, Shift};
use super::fit::{Solved, SpringsError, fit, rounds};
use super::lines::{Lines, Question, State};
use crate::fit::statistics::median;

/// Deviations beyond which Huber's weights fall; beyond which Tukey's are zero, and a reading is refused. Usual constants: 95 % efficiency.
const HUBER: f64 = 1.345;
pub(super) const TUKEY: f64 = 4.685;
/// Median of the magnitudes to standard deviation, of normal deviations.
const MAD: f64 = 1.4826;
/// Rounds of weights, steps of the fit before the first, and between two.
const MAX_ROUNDS: u32 = 12;
const FIRST_STEPS: u32 = 4;
const STEPS: u32 = 2;
/// Smallest step of a gauge that was moved, in standard deviations, and smallest number of readings on either side of it.
const LEAST_SHIFT: f64 = 6.0;
const LEAST_READINGS: usize = 4;
/// Share of the readings beside a step that agree with their own side.
const AGREEING: f64 = 0.9;
/// Largest number of gauges that were moved.
const MAX_SHIFTS: usize = 20;

/// A fit, and what it leaves out.
#[derive(Clone, Debug)]
pub(super) struct Agreement<const N: usize> {
    pub(super) solved: Solved<N>,
    pub(super) choice: Choice,
    /// Readings that do not agree: window and gauge.
    pub(super) refused: Vec<(usize, usize)>,
}

impl<const N: usize> Agreement<N> {
    /// Fits; leaves out what does not agree only if `is_robust`.
    pub(super) fn find(
        question: &Question<'_, N>,
        choice: &Choice,
        start: State<N>,
        is_robust: bool,
    ) -> Result<Self, SpringsError> {
        if is_robust {
            return fit_agreeing(question, choice, start);
        }
        Ok(Self { solved: fit(question, choice, start)?, choice: choice.clone(), refused: Vec::new() })
    }

    /// Chi-squared, with every refused reading and every moved gauge at the limit: what fits with different choices are compared by.
    pub(super) fn cost(&self) -> f64 {
        let events = self.refused.len() + self.choice.shifts.len();
        self.solved.rows.chi_squared() + TUKEY * TUKEY * crate::fit::statistics::float(events)
    }
}

/// Fits, and leaves out what does not agree. `choice`: readings with weight 0 take no part, neither now nor later.
pub(super) fn fit_agreeing<const N: usize>(
    question: &Question<'_, N>,
    choice: &Choice,
    start: State<N>,
) -> Result<Agreement<N>, SpringsError> {
    let mut choice = choice.clone();
    let possible = choice.weights.clone();
    let mut solved = forgiving(question, &mut choice, &possible, start)?;
    while choice.shifts.len() < MAX_SHIFTS {
        let deviations = deviations(question, &choice, &solved);
        let scale = scale(&deviations, &possible);
        let Some(shift) = largest_shift(question, &choice, &possible, &deviations, scale) else { break };
        choice.shifts.push(shift);
        choice.weights.clone_from(&possible);
        solved = forgiving(question, &mut choice, &possible, solved.state)?;
    }
    for _ in 0..MAX_ROUNDS {
        let deviations = deviations(question, &choice, &solved);
        let scale = scale(&deviations, &possible);
        let weights =
            weighted(&possible, &deviations, |deviation| if deviation.abs() <= TUKEY * scale { 1.0 } else { 0.0 });
        let is_settled = weights == choice.weights && solved.is_settled;
        choice.weights = weights;
        if is_settled {
            break;
        }
        solved = fit(question, &choice, solved.state)?;
    }
    let refused = (choice.weights.iter().zip(&possible).enumerate())
        .flat_map(|(window, (used, possible))| {
            let pairs = used.iter().zip(possible).enumerate();
            pairs
                .filter(|(_, (used, possible))| **used <= 0.0 && **possible > 0.0)
                .map(move |(gauge, _)| (window, gauge))
        })
        .filter(|(window, gauge)| question.campaign.windows[*window].readings_m[*gauge].is_some())
        .collect();
    Ok(Agreement { solved, choice, refused })
}

/// Fits with weights that forgive readings that are far off, and leaves these weights in the choice.
fn forgiving<const N: usize>(
    question: &Question<'_, N>,
    choice: &mut Choice,
    possible: &[Vec<f64>],
    start: State<N>,
) -> Result<Solved<N>, SpringsError> {
    // Nothing need settle while the weights change.
    let mut solved = rounds(question, choice, start, FIRST_STEPS)?;
    for round in 0..MAX_ROUNDS {
        let deviations = deviations(question, choice, &solved);
        let scale = scale(&deviations, possible);
        let weight = |deviation: f64| if round == 0 { huber(deviation) } else { tukey(deviation) };
        let weights = weighted(possible, &deviations, |deviation| weight(deviation / scale));
        let is_settled = round > 1 && zeros(&weights) == zeros(&choice.weights);
        choice.weights = weights;
        if is_settled {
            break;
        }
        solved = rounds(question, choice, solved.state, STEPS)?;
    }
    Ok(solved)
}

fn huber(deviation: f64) -> f64 {
    (HUBER / deviation.abs()).min(1.0)
}

fn tukey(deviation: f64) -> f64 {
    (1.0 - (deviation / TUKEY).powi(2)).max(0.0).powi(2)
}

fn zeros(weights: &[Vec<f64>]) -> Vec<bool> {
    weights.iter().flatten().map(|weight| *weight <= 0.0).collect()
}

/// Weights of the deviations; those that are not possible stay zero.
fn weighted(possible: &[Vec<f64>], deviations: &[Vec<f64>], weight: impl Fn(f64) -> f64) -> Vec<Vec<f64>> {
    let of_window = |(possible, deviations): (&Vec<f64>, &Vec<f64>)| {
        possible.iter().zip(deviations).map(|(possible, deviation)| possible * weight(*deviation)).collect()
    };
    possible.iter().zip(deviations).map(of_window).collect()
}

/// Standard deviation that most of the deviations say, at least that of the stated noise.
fn scale(deviations: &[Vec<f64>], possible: &[Vec<f64>]) -> f64 {
    let pairs = deviations.iter().flatten().zip(possible.iter().flatten());
    let all = pairs.filter(|(deviation, possible)| **possible > 0.0 && !deviation.is_nan());
    (MAD * median(all.map(|(deviation, _)| deviation.abs()).collect())).max(1.0)
}

/// Deviation of each reading from what the other readings of its window let expect, in standard deviations; by window and gauge, NaN where
/// there is no reading.
pub(super) fn deviations<const N: usize>(
    question: &Question<'_, N>,
    choice: &Choice,
    solved: &Solved<N>,
) -> Vec<Vec<f64>> {
    let load_variances = DMatrix::from_diagonal(&DVector::from_column_slice(question.load_variances().as_slice()));
    let gauges = question.campaign.gauges.len();
    let of_window = |(lines, left): (&Lines, &DVector<f64>)| {
        let mut deviations = vec![f64::NAN; gauges];
        let shared = &lines.load * &load_variances * lines.load.transpose();
        let weights = &choice.weights[lines.window];
        for (row, gauge) in lines.gauges.iter().enumerate() {
            let is_other = |other: &usize| *other != row && weights[lines.gauges[*other]] > 0.0;
            let others: Vec<usize> = (0..lines.gauges.len()).filter(is_other).collect();
            let mut covariance = shared.select_rows(&others).select_columns(&others);
            for (place, other) in others.iter().enumerate() {
                covariance[(place, place)] += lines.variances[*other] / weights[lines.gauges[*other]];
            }
            let with_others = shared.column(row).select_rows(&others);
            let (mut expected, mut variance) = (0.0, shared[(row, row)] + lines.variances[row]);
            if let Some(factor) = covariance.cholesky() {
                let shares = factor.solve(&with_others);
                expected = shares.dot(&left.select_rows(&others));
                variance -= shares.dot(&with_others);
            }
            deviations[*gauge] = (left[row] - expected) / variance.sqrt();
        }
        deviations
    };
    solved.lines.iter().zip(&solved.left).map(of_window).collect()
}

/// Returns the largest step of a gauge within a series that stays to the end of the series.
fn largest_shift<const N: usize>(
    question: &Question<'_, N>,
    choice: &Choice,
    possible: &[Vec<f64>],
    deviations: &[Vec<f64>],
    scale: f64,
) -> Option<Shift> {
    let campaign = question.campaign;
    let mut largest: Option<(f64, Shift)> = None;
    for series in 0..campaign.series.len() {
        let windows: Vec<usize> =
            (0..campaign.windows.len()).filter(|window| campaign.windows[*window].series == series).collect();
        for gauge in 0..campaign.gauges.len() {
            if choice.shifts.iter().any(|shift| (shift.series, shift.gauge) == (series, gauge)) {
                continue;
            }
            let read = |window: &&usize| possible[**window][gauge] > 0.0 && !deviations[**window][gauge].is_nan();
            let read: Vec<usize> = windows.iter().filter(read).copied().collect();
            let values: Vec<f64> = read.iter().map(|window| deviations[*window][gauge] / scale).collect();
            let Some((first, size)) = step(&values) else { continue };
            if largest.is_none_or(|(other, _)| size > other) {
                largest = Some((size, Shift { series, gauge, window: read[first] }));
            }
        }
    }
    largest.map(|(_, shift)| shift)
}

/// Finds a step in a sequence: index of the first value behind it, and its size.
fn step(values: &[f64]) -> Option<(usize, f64)> {
    let count = values.len();
    let best = (LEAST_READINGS..count.saturating_sub(LEAST_READINGS - 1)).filter_map(|first| {
        let (before, behind) = values.split_at_checked(first)?;
        let (low, high) = (median(before.to_vec()), median(behind.to_vec()));
        let spread = |side: &[f64], middle: f64| side.iter().map(|value| (value - middle).abs()).sum::<f64>();
        let is_agreeing = |side: &[f64], middle: f64| {
            let agreeing = side.iter().filter(|value| (**value - middle).abs() <= TUKEY).count();
            crate::fit::statistics::float(agreeing) >= AGREEING * crate::fit::statistics::float(side.len())
        };
        let (size, is_step) = ((high - low).abs(), is_agreeing(before, low) && is_agreeing(behind, high));
        (is_step && size > LEAST_SHIFT).then(|| (spread(before, low) + spread(behind, high), first, size))
    });
    best.min_by(|(one, ..), (other, ..)| one.total_cmp(other)).map(|(_, first, size)| (first, size))
}

#[cfg(test)]
mod tests {
    use rand::Rng;

    use super::*;
    use crate::springs::campaigns::{Bench, FINE, campaign_a, never, seeded};

    #[test]
    fn a_step_is_found_where_it_is() {
        let values = [0.1, -0.5, 0.3, 0.0, 9.8, 10.4, 10.1, 9.9];
        let (first, size) = step(&values).unwrap();
        assert_eq!(first, 4);
        assert!((size - 9.95).abs() < 0.2, "{size}");
        // One reading beside it is off: the step stays.
        let disturbed = [0.1, -0.5, 20.0, 0.3, 0.0, 0.2, -0.1, 0.4, 0.1, -0.3, 9.8, 10.4, 10.1, 9.9];
        assert_eq!(step(&disturbed).map(|(first, _)| first), Some(10));
    }

    #[test]
    fn what_comes_back_or_ends_the_series_is_no_step() {
        assert_eq!(
            step(&[0.0, 0.1, 0.0, -0.1, 10.0, 10.2, 9.9, 10.1, 0.2, -0.1, 0.0, 0.1]),
            None,
            "a jump and the way back"
        );
        assert_eq!(step(&[0.0, 0.1, -0.2, 0.3, 0.1, 10.0]), None, "a single reading");
        assert_eq!(step(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]), None, "a slope");
        assert_eq!(step(&[]), None);
    }

    #[test]
    fn the_largest_of_the_steps_is_the_shift() {
        let bench = campaign_a(FINE);
        let question = bench.question();
        let possible: Vec<Vec<f64>> = bench.campaign.windows.iter().map(|_| vec![1.0; 9]).collect();
        // From the sixth window of the series on.
        let deviations: Vec<Vec<f64>> = (0..99)
            .map(|window| match (window / 11, window % 11 >= 5) {
                (1, true) => [vec![20.0], vec![0.0; 8]].concat(),
                (2, true) => [vec![0.0; 4], vec![-45.0], vec![0.0; 4]].concat(),
                (2, false) => [vec![0.0; 8], vec![30.0]].concat(),
                _ => vec![0.0; 9],
            })
            .collect();
        let shift = |choice: &Choice| {
            let found = largest_shift(&question, choice, &possible, &deviations, 1.5)?;
            Some((found.series, found.gauge, found.window))
        };
        let mut choice = Choice::all(&bench.campaign);
        assert_eq!(shift(&choice), Some((2, 4, 27)));
        choice.shifts.push(Shift { series: 2, gauge: 4, window: 27 });
        assert_eq!(shift(&choice), Some((2, 8, 27)));
    }

    fn agreed(bench: &Bench<3>) -> Agreement<3> {
        let question = bench.question();
        fit_agreeing(&question, &Choice::all(&bench.campaign), State::start(&question)).unwrap()
    }

    #[test]
    fn what_is_left_out_costs_as_much_as_the_limit() {
        let mut bench = campaign_a(FINE);
        bench.measure(&bench.file.clone(), &mut seeded(1), 0.0, never);
        let mut agreement = agreed(&bench);
        (agreement.refused, agreement.choice.shifts) = (Vec::new(), Vec::new());
        let chi2 = agreement.solved.rows.chi_squared();
        assert!((agreement.cost() - chi2).abs() < 1e-12);
        agreement.refused = vec![(0, 1), (5, 2), (7, 2)];
        agreement.choice.shifts.push(Shift { series: 2, gauge: 4, window: 27 });
        assert!((agreement.cost() - chi2 - 4.0 * TUKEY * TUKEY).abs() < 1e-9);
    }

    /// Squared errors of the springs in standard deviations of an undisturbed campaign, summed over campaigns; readings that were disturbed, found,
    /// and accused wrongly.
    #[derive(Default)]
    struct Tally {
        squares: f64,
        disturbed: usize,
        found: usize,
        accused: usize,
        readings: usize,
        shifts: usize,
    }

    fn tally(seeds: u64, share: f64) -> Tally {
        let mut tally = Tally::default();
        for seed in 0..seeds {
            let mut random = seeded(seed);
            let mut bench = campaign_a(FINE);
            let truth = bench.true_springs(&mut random);
            bench.measure(&truth, &mut random, 0.0, never);
            let question = bench.question();
            let clean = fit(&question, &Choice::all(&bench.campaign), State::start(&question)).unwrap();
            let covariance = clean.seen.covariance();
            let mut disturbed = Vec::new();
            for (index, window) in bench.campaign.windows.iter_mut().enumerate() {
                for (gauge, reading) in window.readings_m.iter_mut().enumerate() {
                    tally.readings += 1;
                    if random.random::<f64>() < share {
                        let off = random.random_range(10e-6..30e-6) * if random.random() { 1.0 } else { -1.0 };
                        *reading = reading.map(|reading| reading + off);
                        disturbed.push((index, gauge));
                    }
                }
            }
            let found = agreed(&bench);
            let off = found.solved.state.springs.vector() - truth.vector();
            let scores = off.iter().enumerate().map(|(spring, off)| off * off / covariance[(spring, spring)]);
            tally.squares += scores.sum::<f64>() / 9.0 / seeds as f64;
            tally.disturbed += disturbed.len();
            tally.found += disturbed.iter().filter(|reading| found.refused.contains(reading)).count();
            tally.accused += found.refused.iter().filter(|reading| !disturbed.contains(reading)).count();
            tally.shifts += found.choice.shifts.len();
        }
        tally
    }

    /// A tenth of all readings off by 10 to 30 um: least squares would be 4 to 7 times the bound off.
    #[test]
    fn disturbed_readings_are_found_and_do_no_harm() {
        let Tally { squares, disturbed, found, accused, readings, shifts } = tally(200, 0.1);
        assert!(squares.sqrt() <= 1.3, "{squares}");
        assert!(found * 100 >= 95 * disturbed, "{found} of {disturbed}");
        // Four in a row that happen to agree look like a gauge that was moved.
        assert!(shifts <= 2, "{shifts}");
        assert!(accused * 1000 <= readings, "{accused} of {readings}");
    }

    #[test]
    fn clean_readings_are_not_accused() {
        let Tally { squares, accused, readings, shifts, .. } = tally(200, 0.0);
        assert_eq!(shifts, 0);
        assert!(accused * 1000 <= readings, "{accused} of {readings}");
        assert!(squares.sqrt() <= 1.1, "{squares}");
    }

    /// Somebody touched a gauge: one event, and its readings are of use from there on.
    #[test]
    fn a_gauge_that_was_moved_is_one_event() {
        let mut random = seeded(3);
        let mut bench = campaign_a(FINE);
        let truth = bench.true_springs(&mut random);
        bench.measure(&truth, &mut random, 0.0, never);
        for window in bench.campaign.windows.iter_mut().filter(|window| window.series == 2) {
            if window.window.parse::<u32>().unwrap() >= 4 {
                window.readings_m[1] = window.readings_m[1].map(|reading| reading + 25e-6);
            }
        }
        let found = agreed(&bench);
        assert_eq!(found.choice.shifts, [Shift { series: 2, gauge: 1, window: 2 * 11 + 4 }]);
        assert_eq!(found.refused, []);
        let off = found.solved.state.springs.vector() - truth.vector();
        let covariance = found.solved.seen.covariance();
        assert!(off.iter().enumerate().all(|(spring, off)| off.abs() < 4.0 * covariance[(spring, spring)].sqrt()));
    }

    #[test]
    fn weights_fall_with_the_deviation() {
        assert!((huber(1.0) - 1.0).abs() < 1e-15 && (huber(-2.69) - 0.5).abs() < 1e-12);
        assert!((tukey(0.0) - 1.0).abs() < 1e-15 && tukey(4.685) <= 0.0 && tukey(-9.0) <= 0.0 && tukey(3.0) > 0.3);
    }
}
