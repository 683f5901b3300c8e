//! The jump `[T 5.2.2, 6.1]`: play of the joint of cluster 3, found as windows beyond a force of its links.
//!
//! The joint rests at one end of its play by the preload `P0`, the sum of the tensions of links 31, 32, 33 that the weight causes. It crosses
//! where that sum, with the sum `F3` by the load, changes its sign: at one `F3` while the force rises, and at another, with hysteresis, while it falls.
//! Every pair of such thresholds is tried, one projection each. A window inside the crossing belongs to neither side.

use nalgebra::{DMatrix, DVector};

use super::agreement::{Agreement, TUKEY, deviations};
use super::blocks::{Blocks, covariance};
use super::choice::Choice;
use super::fit::{SeriesErrors, Solved, SpringsError, fit, series_errors};
use super::lines::{Lines, Question, State};

/// Decrease of chi-squared that a play must bring: three unknowns.
const LEAST_GAIN: f64 = 50.0;
/// The same without the windows inside the crossing. Less is asked: readings that disagree as a whole without the play cost no more than if
/// they were refused, so that a real one may explain little.
const LEAST_GAIN_OUTSIDE: f64 = 25.0;
/// Decrease of chi-squared that leaving out a window beside a crossing must bring.
const LEAST_GAIN_OF_WINDOW: f64 = 30.0;
/// Most readings of the windows beside the crossings that are refused while those inside are looked for.
const MOST_DISTURBED: usize = 4;
/// Windows of the largest forces that are tried, per stroke.
const MAX_CANDIDATES: usize = 80;
/// Standard deviations of the cluster force that an interval of the preload is wider on either side.
const MARGIN_SD: f64 = 3.0;
/// Rounds of looking for the thresholds again with the play fitted.
const MAX_ROUNDS: u32 = 4;

/// Windows beyond a jump.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Crossing {
    /// Sign of the cluster force that opens the play.
    sign: f64,
    /// Windows by falling magnitude of the cluster force; rising strokes, falling strokes.
    candidates: [Vec<usize>; 2],
    /// Number of candidates that are beyond; rising, falling.
    beyond: [usize; 2],
}

/// The play as it was found.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FoundPlay {
    /// Play of the joint, m.
    pub(super) gap_m: f64,
    /// Sign of the elongation of the links beyond the jump.
    pub(super) sign: f64,
    /// Interval of the preload, N: while the force rises, while it falls; `None` where no window of the stroke is beyond the jump.
    pub(super) preload_n: [Option<[f64; 2]>; 2],
    /// Windows inside a crossing, which belong to neither side.
    pub(super) inside: Vec<usize>,
}

impl Crossing {
    fn is_crossed(&self, windows: usize) -> Vec<bool> {
        let mut is_crossed = vec![false; windows];
        for (candidates, beyond) in self.candidates.iter().zip(self.beyond) {
            candidates.iter().take(beyond).for_each(|window| is_crossed[*window] = true);
        }
        is_crossed
    }

    /// The windows beside the crossing of a stroke: the last before it, the first behind it.
    fn beside(&self, stroke: usize) -> [Option<usize>; 2] {
        let [before, behind] = self.sides(stroke);
        [before.first().copied(), behind.first().copied()]
    }

    /// The windows before the crossing of a stroke, and those behind it, the nearest first.
    fn sides(&self, stroke: usize) -> [Vec<usize>; 2] {
        let (behind, before) = self.candidates[stroke].split_at(self.beyond[stroke]);
        [before.to_vec(), behind.iter().rev().copied().collect()]
    }
}

/// Looks for a play, and fits with it where it is there; `without` is the fit without it.
pub(super) fn with_play<const N: usize>(
    question: &Question<'_, N>,
    without: &Agreement<N>,
    is_robust: bool,
) -> Result<Option<(Agreement<N>, FoundPlay)>, SpringsError> {
    let mut choice = without.choice.anew(question.campaign, &[]);
    let Some(mut crossing) = thresholds(question, &choice, &without.solved) else { return Ok(None) };
    let mut found = None;
    for _ in 0..MAX_ROUNDS {
        choice.is_crossed = crossing.is_crossed(choice.is_crossed.len());
        let start = State { elongation_m: 0.0, ..without.solved.state.clone() };
        let agreement = Agreement::find(question, &choice, start, is_robust)?;
        // Windows that disagree as a whole may only be on the wrong side.
        let again = with_whole_windows(&agreement.choice, question);
        let next = thresholds(question, &again, &agreement.solved);
        found = Some(agreement);
        match next {
            Some(next) if next != crossing => crossing = next,
            _ => break,
        }
    }
    let Some(agreement) = found else { return Ok(None) };
    let Some(agreement) = without_inside(question, &crossing, agreement, is_robust)? else { return Ok(None) };
    let (agreement, inside) = agreement;
    let gap_m = agreement.solved.state.elongation_m * crossing.sign;
    if gap_m <= 0.0 || !is_better(question, without, &agreement, &inside, is_robust)? {
        return Ok(None);
    }
    let preload_n = [0, 1].map(|stroke| preload(question, &crossing, &agreement.solved, &inside, stroke));
    if preload_n == [None, None] {
        return Ok(None);
    }
    Ok(Some((agreement, FoundPlay { gap_m, sign: crossing.sign, preload_n, inside })))
}

/// The readings of a choice, and all of every window that has lost a third of them.
fn with_whole_windows<const N: usize>(choice: &Choice, question: &Question<'_, N>) -> Choice {
    let mut choice = choice.clone();
    for (weights, window) in choice.weights.iter_mut().zip(&question.campaign.windows) {
        let read = window.readings_m.iter().flatten().count();
        let lost =
            weights.iter().zip(&window.readings_m).filter(|(weight, reading)| reading.is_some() && **weight <= 0.0);
        if lost.count() * 3 >= read {
            weights.fill(1.0);
        }
    }
    choice
}

/// Finds the pair of thresholds whose play explains most.
fn thresholds<const N: usize>(question: &Question<'_, N>, choice: &Choice, solved: &Solved<N>) -> Option<Crossing> {
    [-1.0, 1.0]
        .into_iter()
        .filter_map(|sign| {
            let candidates = [true, false].map(|rising| candidates(question, &solved.lines, sign, rising));
            best(question, choice, solved, sign, candidates)
        })
        .max_by(|(one, _), (other, _)| one.total_cmp(other))
        .filter(|(explained, _)| *explained > LEAST_GAIN)
        .map(|(_, crossing)| crossing)
}

/// Windows of a stroke whose cluster force has this sign, the largest force first.
fn candidates<const N: usize>(question: &Question<'_, N>, lines: &[Lines], sign: f64, rising: bool) -> Vec<usize> {
    let of_stroke = |lines: &&Lines| (question.campaign.windows[lines.window].stroke >= 0) == rising;
    let force = |lines: &Lines| sign * lines.cluster_3_n[0];
    let loaded = |lines: &&Lines| force(lines) > MARGIN_SD * lines.cluster_3_n[1];
    let mut windows: Vec<(f64, usize)> =
        lines.iter().filter(of_stroke).filter(loaded).map(|lines| (force(lines), lines.window)).collect();
    windows.sort_by(|(one, _), (other, _)| other.total_cmp(one));
    windows.into_iter().take(MAX_CANDIDATES).map(|(_, window)| window).collect()
}

/// Tries all pairs of numbers of candidates beyond. Returns what the best explains of chi-squared.
fn best<const N: usize>(
    question: &Question<'_, N>,
    choice: &Choice,
    solved: &Solved<N>,
    sign: f64,
    candidates: [Vec<usize>; 2],
) -> Option<(f64, Crossing)> {
    let extras: Vec<usize> = candidates.iter().flatten().copied().collect();
    let plain = Choice { is_crossed: vec![false; choice.is_crossed.len()], ..choice.clone() };
    // What the fitted play explains already is put back.
    let mut lines = solved.lines.clone();
    for lines in lines.iter_mut().filter(|lines| choice.is_crossed[lines.window]) {
        lines.misclosures += lines.play() * solved.state.elongation_m;
    }
    // Each window's derivative by the play is a column of its own.
    let of_window = |lines: &Lines| {
        let mut columns = DMatrix::zeros(lines.gauges.len(), extras.len());
        if let Some(column) = extras.iter().position(|window| *window == lines.window) {
            columns.column_mut(column).copy_from(&lines.play());
        }
        columns
    };
    let columns: Vec<_> = lines.iter().map(of_window).collect();
    let blocks = Blocks::new(question, &plain, &lines, &solved.state.setup, &columns)?;
    let mut together = blocks.extras.clone().insert_column(extras.len(), 0.0);
    together.set_column(extras.len(), &blocks.rows.residuals);
    let left = crate::fit::least_squares::eliminated(blocks.rows.derivatives.clone(), together);
    let columns = left.columns(0, extras.len());
    let (shares, overlaps) = (columns.tr_mul(&left.column(extras.len())), columns.tr_mul(&columns));
    let (rising, falling) = (candidates[0].len(), candidates[1].len());
    let sums = Sums::new(&shares, &overlaps, rising);
    let mut best: Option<(f64, [usize; 2])> = None;
    for risen in 0..=rising {
        for fallen in 0..=falling {
            let (share, overlap) = sums.of(risen, fallen);
            // A play adds to the displacement along the force, never against it.
            if overlap <= 0.0 || share * sign <= 0.0 {
                continue;
            }
            let explained = share * share / overlap;
            if best.is_none_or(|(most, _)| explained > most) {
                best = Some((explained, [risen, fallen]));
            }
        }
    }
    best.map(|(explained, beyond)| (explained, Crossing { sign, candidates, beyond }))
}

/// Sums over the first rising and the first falling candidates.
struct Sums {
    rising: usize,
    shares: [Vec<f64>; 2],
    overlaps: [Vec<f64>; 2],
    across: DMatrix<f64>,
}

impl Sums {
    fn new(shares: &DVector<f64>, overlaps: &DMatrix<f64>, rising: usize) -> Self {
        let count = shares.len();
        let ranges = [0..rising, rising..count];
        let of_shares = |range: std::ops::Range<usize>| {
            let sums = range.scan(0.0, |sum, index| {
                *sum += shares[index];
                Some(*sum)
            });
            [0.0].into_iter().chain(sums).collect()
        };
        let of_overlaps = |range: std::ops::Range<usize>| {
            let first = range.start;
            let sums = range.scan(0.0, |sum, index| {
                let with_earlier: f64 = (first..index).map(|earlier| overlaps[(earlier, index)]).sum();
                *sum += overlaps[(index, index)] + 2.0 * with_earlier;
                Some(*sum)
            });
            [0.0].into_iter().chain(sums).collect()
        };
        let mut across = DMatrix::zeros(rising + 1, count - rising + 1);
        for row in 0..rising {
            for column in 0..count - rising {
                across[(row + 1, column + 1)] =
                    overlaps[(row, rising + column)] + across[(row, column + 1)] + across[(row + 1, column)]
                        - across[(row, column)];
            }
        }
        Self { rising, shares: ranges.clone().map(of_shares), overlaps: ranges.map(of_overlaps), across }
    }

    /// Share and overlap of the play in so many rising and falling candidates.
    fn of(&self, risen: usize, fallen: usize) -> (f64, f64) {
        debug_assert!(risen <= self.rising);
        let share = self.shares[0][risen] + self.shares[1][fallen];
        (share, self.overlaps[0][risen] + self.overlaps[1][fallen] + 2.0 * self.across[(risen, fallen)])
    }
}

/// Leaves out the windows inside the crossing: beside each threshold none, the last before or the first behind, whatever brings most.
fn without_inside<const N: usize>(
    question: &Question<'_, N>,
    crossing: &Crossing,
    agreement: Agreement<N>,
    is_robust: bool,
) -> Result<Option<(Agreement<N>, Vec<usize>)>, SpringsError> {
    let beside: Vec<[Option<usize>; 2]> = (0..2).map(|stroke| crossing.beside(stroke)).collect();
    let mut choice = agreement.choice.clone();
    for window in beside.iter().flatten().flatten() {
        choice.weights[*window].fill(1.0);
    }
    let mut best: Option<(f64, Vec<usize>, Choice)> = None;
    let one_of = |stroke: usize| [None, beside[stroke][0], beside[stroke][1]];
    for rising in one_of(0) {
        for falling in one_of(1) {
            let inside: Vec<usize> = rising.into_iter().chain(falling).collect();
            let mut tried = choice.clone();
            inside.iter().for_each(|window| tried.weights[*window].fill(0.0));
            let windows: Vec<usize> = beside.iter().flatten().flatten().copied().collect();
            let most = if is_robust { MOST_DISTURBED } else { 0 };
            let start = agreement.solved.state.clone();
            let Ok(cost) = cost_of_windows(question, &mut tried.clone(), start, &windows, most) else { continue };
            let cost = cost + LEAST_GAIN_OF_WINDOW * crate::fit::statistics::float(inside.len());
            if best.as_ref().is_none_or(|(least, ..)| cost < *least) {
                best = Some((cost, inside, tried));
            }
        }
    }
    let Some((_, inside, _)) = best else { return Ok(None) };
    if inside.is_empty() {
        return Ok(Some((agreement, inside)));
    }
    let choice = agreement.choice.anew(question.campaign, &inside);
    if !choice.has_play() {
        return Ok(None);
    }
    let start = agreement.solved.state;
    Ok(Some((Agreement::find(question, &choice, start, is_robust)?, inside)))
}

/// Smallest chi-squared of a choice, with every reading of these windows that is refused at the limit, at most so many: a disturbed reading
/// does not put its window inside a crossing.
fn cost_of_windows<const N: usize>(
    question: &Question<'_, N>,
    choice: &mut Choice,
    mut start: State<N>,
    windows: &[usize],
    most: usize,
) -> Result<f64, SpringsError> {
    let mut least = f64::INFINITY;
    for refused in 0..=most {
        let solved = fit(question, choice, start)?;
        least = least.min(solved.rows.chi_squared() + TUKEY * TUKEY * crate::fit::statistics::float(refused));
        let deviations = deviations(question, choice, &solved);
        let readings =
            windows.iter().flat_map(|window| (0..choice.weights[*window].len()).map(|gauge| (*window, gauge)));
        let used = readings.filter(|(window, gauge)| choice.weights[*window][*gauge] > 0.0);
        let of_used = used.map(|(window, gauge)| (deviations[window][gauge].abs(), window, gauge));
        let worst = of_used.filter(|(deviation, ..)| *deviation > TUKEY).max_by(|one, other| one.0.total_cmp(&other.0));
        let Some((_, window, gauge)) = worst else { break };
        choice.weights[window][gauge] = 0.0;
        start = solved.state;
    }
    Ok(least)
}

/// True if a play is better than none: by all readings, by those outside the crossing, by those that agree with it, and by series that are
/// left out.
fn is_better<const N: usize>(
    question: &Question<'_, N>,
    without: &Agreement<N>,
    with: &Agreement<N>,
    inside: &[usize],
    is_robust: bool,
) -> Result<bool, SpringsError> {
    if without.cost() - with.cost() <= LEAST_GAIN {
        return Ok(false);
    }
    // The windows inside the crossing are missing in both fits: their disturbed readings are no merit of the play.
    let choice = without.choice.anew(question.campaign, inside);
    let none = Agreement::find(question, &choice, without.solved.state.clone(), is_robust)?;
    if none.cost() - with.cost() <= LEAST_GAIN_OUTSIDE {
        return Ok(false);
    }
    // From the same readings it is the square of the play in its variances.
    let choice = Choice { is_crossed: vec![false; with.choice.is_crossed.len()], ..with.choice.clone() };
    let none = fit(question, &choice, State { elongation_m: 0.0, ..with.solved.state.clone() })?;
    let gained = none.rows.chi_squared() - with.solved.rows.chi_squared();
    Ok(gained > LEAST_GAIN && predicts_better(question, (&choice, &none), with))
}

/// True if the series that do not cross, or more than one that does, are predicted better by the others with the play than without it, from
/// the same readings.
fn predicts_better<const N: usize>(
    question: &Question<'_, N>,
    (choice, none): (&Choice, &Solved<N>),
    with: &Agreement<N>,
) -> bool {
    let none = series_errors(question, choice, none);
    let with = series_errors(question, &with.choice, &with.solved);
    let (Some(none), Some(with)) = (none, with) else { return false };
    let both = |(none, with): (SeriesErrors, SeriesErrors)| Some((none.left_out?, with.left_out?));
    let pairs = none.into_iter().zip(with).filter_map(both);
    let (none, with) = pairs.fold((0.0, 0.0), |sums, pair| (sums.0 + pair.0, sums.1 + pair.1));
    with <= none
}

/// Interval of the preload by the windows beside a crossing, N; `None` if no window of the stroke is beyond.
fn preload<const N: usize>(
    question: &Question<'_, N>,
    crossing: &Crossing,
    solved: &Solved<N>,
    inside: &[usize],
    stroke: usize,
) -> Option<[f64; 2]> {
    let line = |window: &usize| solved.lines.iter().find(|lines| lines.window == *window);
    let nearest = |side: &Vec<usize>| {
        let clear: Vec<&Lines> = side.iter().filter(|window| !inside.contains(window)).filter_map(line).collect();
        // A window that cannot tell its side from the middle of the play may be inside the crossing: the next one is the end.
        let is_sure = clear.first().is_some_and(|lines| tells_its_side(question, lines, solved.state.elongation_m));
        clear.get(usize::from(!is_sure)).or(clear.last()).map(|lines| lines.cluster_3_n)
    };
    let [before, behind] = crossing.sides(stroke);
    // Without a window before it the joint has crossed somewhere above no force at all.
    let [near, near_sd] = nearest(&before).unwrap_or_default();
    let [far, far_sd] = nearest(&behind)?;
    // The preload is minus the force that takes it away.
    let ends = [-(near - crossing.sign * MARGIN_SD * near_sd), -(far + crossing.sign * MARGIN_SD * far_sd)];
    Some([ends[0].min(ends[1]), ends[0].max(ends[1])])
}

/// True if half the play would stand out in the readings of this window alone, as a window inside a crossing must to be left out.
fn tells_its_side<const N: usize>(question: &Question<'_, N>, lines: &Lines, elongation_m: f64) -> bool {
    let covariance = covariance(&lines.load, lines.variances.iter().copied(), &question.load_variances());
    let play = lines.play() * (0.5 * elongation_m);
    covariance.cholesky().is_some_and(|factor| play.dot(&factor.solve(&play)) > LEAST_GAIN_OF_WINDOW)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use rand::Rng;

    use super::*;
    use crate::robot_file::RobotFile;
    use crate::springs::agreement::fit_agreeing;
    use crate::springs::campaigns::{Bench, FINE, HOME, HOOKS, Strap, campaign_a, never, seeded, straps};

    /// Campaign A, and a strap in x up to 460 N and back in steps of 20 N.
    fn with_long_series() -> Bench<3> {
        let mut all = straps(1, &HOOKS);
        let up = (0..=23).map(|step| f64::from(step) * 20.0);
        let levels: Vec<f64> = up.clone().chain(up.rev().skip(1)).collect();
        all.push(Strap { pose: 0, hook: HOOKS[0], direction: Vector3::x(), levels });
        Bench::new(&RobotFile::builtin_l2().unwrap(), &[HOME], &all, FINE)
    }

    #[test]
    fn the_windows_beside_a_crossing_are_the_nearest() {
        // The farthest beyond first: two of the rising ones, one of the falling ones.
        let crossing = Crossing { sign: 1.0, candidates: [vec![5, 4, 3, 2], vec![9, 10, 11]], beyond: [2, 1] };
        assert_eq!([0, 1].map(|stroke| crossing.beside(stroke)), [[Some(3), Some(4)], [Some(10), Some(9)]]);
        assert_eq!(crossing.is_crossed(12).iter().filter(|is_crossed| **is_crossed).count(), 3);
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
            let overlap: f64 = chosen.iter().flat_map(|one| chosen.iter().map(|other| overlaps[(*one, *other)])).sum();
            let (found_share, found_overlap) = sums.of(risen, fallen);
            assert!((found_share - share).abs() < 1e-12 && (found_overlap - overlap).abs() < 1e-12);
        }
    }

    #[test]
    fn a_window_that_has_lost_a_third_of_its_readings_keeps_all() {
        let mut bench = campaign_a(FINE);
        bench.campaign.windows[2].readings_m[6..].fill(None);
        let mut choice = Choice::all(&bench.campaign);
        for (window, lost) in [(0, 3), (1, 2), (2, 2), (3, 5)] {
            choice.weights[window][..lost].fill(0.0);
        }
        // Six are read in window 2, and two of those are lost.
        choice.weights[2][8] = 0.0;
        let whole = with_whole_windows(&choice, &bench.question());
        let lost = |window: usize| whole.weights[window].iter().filter(|weight| **weight <= 0.0).count();
        assert_eq!([0, 1, 2, 3, 4].map(lost), [0, 2, 0, 0, 0]);
        choice.weights[2][..2].copy_from_slice(&[0.0, 1.0]);
        choice.weights[2][6..].fill(0.0);
        let whole = with_whole_windows(&choice, &bench.question());
        assert_eq!(
            whole.weights[2].iter().filter(|weight| **weight <= 0.0).count(),
            4,
            "what was not read is not lost"
        );
    }

    fn found(bench: &Bench<3>) -> (Agreement<3>, Option<FoundPlay>) {
        let question = bench.question();
        let without = fit_agreeing(&question, &Choice::all(&bench.campaign), State::start(&question)).unwrap();
        match with_play(&question, &without, true).unwrap() {
            Some((agreement, play)) => (agreement, Some(play)),
            None => (without, None),
        }
    }

    /// Jump at 330 to 390 N in x, up to 25 N earlier on the way back, of 25 to 55 um, in most campaigns with a window inside the crossing.
    #[test]
    fn a_jump_is_found_with_its_preload() {
        let campaigns = 200;
        let (mut squares, mut reduced, mut largest) = (0.0, 0.0_f64, 0.0_f64);
        for seed in 0..campaigns {
            let mut random = seeded(seed);
            let mut bench = with_long_series();
            let truth = bench.true_springs(&mut random);
            // 300 N in x are -141 N of the cluster at the file's springs and at any others: forces balance.
            let rising = random.random_range(330.0..390.0) * 0.47;
            let falling = rising - random.random_range(0.0..25.0) * 0.47;
            let gap = random.random_range(25e-6..55e-6);
            // The joint crosses within 2 N of cluster force.
            let beyond = |force: f64, stroke: i8| {
                let threshold = if stroke >= 0 { rising } else { falling };
                ((-force - threshold) / 2.0 + 0.5).clamp(0.0, 1.0)
            };
            bench.measure(&truth, &mut random, -gap, beyond);
            let (agreement, play) = found(&bench);
            let play = play.unwrap_or_else(|| panic!("{seed}: no play"));
            let sd = agreement.solved.seen.covariance()[(9, 9)].sqrt();
            let score = (play.gap_m - gap) / sd;
            largest = largest.max(score.abs());
            squares += score * score / campaigns as f64;
            let [Some([low_up, high_up]), Some([low_down, high_down])] = play.preload_n else { panic!("{seed}") };
            assert!((low_up..=high_up).contains(&rising), "{seed}: rising {rising} {play:?}");
            assert!((low_down..=high_down).contains(&falling), "{seed}: falling {falling} {play:?}");
            let chi = agreement.solved.rows.chi_squared() / crate::fit::statistics::float(agreement.solved.degrees());
            reduced = reduced.max(chi);
            let off = agreement.solved.state.springs.vector() - truth.vector();
            let covariance = agreement.solved.seen.covariance();
            assert!(
                off.iter().enumerate().all(|(spring, off)| off.abs() < 5.0 * covariance[(spring, spring)].sqrt()),
                "{seed}"
            );
        }
        assert!(largest < 4.0 && squares.sqrt() < 1.35, "{largest} {squares}");
        assert!(reduced < 1.25, "{reduced}");
    }

    /// The same with 16 disturbed readings, two of them in windows at the crossing: the intervals hold, whatever window they put off.
    #[test]
    fn disturbed_readings_do_not_move_the_preload() {
        for seed in 0..12 {
            let mut random = seeded(500 + seed);
            let mut bench = with_long_series();
            let truth = bench.true_springs(&mut random);
            let rising = random.random_range(330.0..390.0) * 0.47;
            let falling = rising - random.random_range(0.0..25.0) * 0.47;
            let beyond = |force: f64, stroke: i8| {
                let threshold = if stroke >= 0 { rising } else { falling };
                ((-force - threshold) / 2.0 + 0.5).clamp(0.0, 1.0)
            };
            bench.measure(&truth, &mut random, -40e-6, beyond);
            bench.disturb(&mut random, 16.0 / 1314.0);
            // The first window behind the crossing of the rising stroke: its force is 0.47 of the strap's.
            let first = bench.campaign.windows.iter().position(|window| window.load[0] * 0.47 > rising + 3.0).unwrap();
            for gauge in [1, 4] {
                bench.campaign.windows[first].readings_m[gauge] =
                    bench.campaign.windows[first].readings_m[gauge].map(|reading| reading + 25e-6);
            }
            let (_, play) = found(&bench);
            let play = play.unwrap_or_else(|| panic!("{seed}: no play"));
            let [Some([low_up, high_up]), Some([low_down, high_down])] = play.preload_n else { panic!("{seed}") };
            assert!((low_up..=high_up).contains(&rising), "{seed}: rising {rising} {play:?}");
            assert!((low_down..=high_down).contains(&falling), "{seed}: falling {falling} {play:?}");
        }
    }

    /// A jump that only rising forces have crossed says nothing about falling ones.
    #[test]
    fn a_stroke_that_was_not_measured_has_no_interval() {
        let mut random = seeded(7);
        let mut bench = with_long_series();
        let truth = bench.true_springs(&mut random);
        bench.measure(&truth, &mut random, -40e-6, |force, _| f64::from(u8::from(-force > 165.0)));
        bench.campaign.windows.retain(|window| window.series < 9 || window.stroke > 0);
        let (_, play) = found(&bench);
        let [Some([low, high]), None] = play.unwrap().preload_n else { panic!("an interval of the falling stroke") };
        assert!(low <= 165.0 && high >= 165.0 && high - low < 40.0, "{low} {high}");
    }

    #[test]
    fn no_play_is_invented() {
        for seed in 0..200 {
            let mut random = seeded(seed);
            let mut bench = if seed % 2 == 0 { campaign_a(FINE) } else { with_long_series() };
            let truth = bench.true_springs(&mut random);
            bench.measure(&truth, &mut random, 0.0, never);
            assert_eq!(found(&bench).1, None, "{seed}");
        }
    }

    /// Windows with disturbed readings are not left out for a play that is not there: of 2 to 10 % of readings off by 10 to 30 um.
    #[test]
    fn no_play_is_invented_from_disturbed_readings() {
        for seed in 0..32 {
            let mut random = seeded(1000 + seed);
            let mut bench = campaign_a(FINE);
            let truth = bench.true_springs(&mut random);
            bench.measure(&truth, &mut random, 0.0, never);
            bench.disturb(&mut random, if seed % 2 == 0 { 0.1 } else { 0.02 });
            assert_eq!(found(&bench).1, None, "{seed}");
        }
    }
}
