//! Thresholds of the cluster force at which the joint crosses its play.
//!
//! Each window's derivative by the play is a column of its own, so that every pair of thresholds,
//! while the force rises and while it falls, is one projection.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::{MARGIN_SD, MIN_GAIN};
use crate::fit::least_squares::eliminated;
use crate::springs::active_set::ActiveSet;
use crate::springs::blocks::Blocks;
use crate::springs::fit::Solution;
use crate::springs::linearize::LinearizedWindow;
use crate::springs::problem::SpringsProblem;

/// Windows of the largest forces that are tried, per stroke.
const MAX_CANDIDATES: usize = 80;

/// Windows beyond a jump.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Crossing {
    /// Sign of the cluster force that opens the play.
    pub(super) sign: f64,
    /// Windows by falling magnitude of the cluster force; rising strokes, falling strokes.
    pub(super) candidates: [Vec<usize>; 2],
    /// Number of candidates that are beyond; rising, falling.
    pub(super) beyond: [usize; 2],
}

impl Crossing {
    pub(super) fn is_crossed(&self, windows: usize) -> Vec<bool> {
        let mut is_crossed = vec![false; windows];
        for (candidates, beyond) in self.candidates.iter().zip(self.beyond) {
            candidates
                .iter()
                .take(beyond)
                .for_each(|window| is_crossed[*window] = true);
        }
        is_crossed
    }

    /// The windows beside the crossing of a stroke: the last before it, the first behind it.
    pub(super) fn beside(&self, stroke: usize) -> [Option<usize>; 2] {
        let [before, behind] = self.sides(stroke);
        [before.first().copied(), behind.first().copied()]
    }

    /// The windows before the crossing of a stroke, and those behind it, the nearest first.
    pub(super) fn sides(&self, stroke: usize) -> [Vec<usize>; 2] {
        let (behind, before) = self.candidates[stroke].split_at(self.beyond[stroke]);
        [before.to_vec(), behind.iter().rev().copied().collect()]
    }
}

/// Finds the pair of thresholds whose play explains most.
pub(super) fn thresholds<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &ActiveSet,
    solution: &Solution<N>,
) -> Option<Crossing> {
    [-1.0, 1.0]
        .into_iter()
        .filter_map(|sign| {
            let candidates =
                [true, false].map(|rising| candidates(problem, &solution.linearized, sign, rising));
            best(problem, active, solution, sign, candidates)
        })
        .max_by(|(one, _), (other, _)| one.total_cmp(other))
        .filter(|(explained, _)| *explained > MIN_GAIN)
        .map(|(_, crossing)| crossing)
}

/// Windows of a stroke whose cluster force has this sign, the largest force first.
fn candidates<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    linearized: &[LinearizedWindow],
    sign: f64,
    rising: bool,
) -> Vec<usize> {
    let mut windows = Vec::new();
    for linearized in linearized {
        let is_of_stroke = (problem.campaign.windows[linearized.window].stroke >= 0) == rising;
        let [force_n, sd_n] = linearized.cluster_3_n;
        if is_of_stroke && sign * force_n > MARGIN_SD * sd_n {
            windows.push((sign * force_n, linearized.window));
        }
    }
    windows.sort_by(|(one, _), (other, _)| other.total_cmp(one));
    windows
        .into_iter()
        .take(MAX_CANDIDATES)
        .map(|(_, window)| window)
        .collect()
}

/// Tries all pairs of numbers of candidates beyond. Returns what the best explains of chi-squared.
fn best<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &ActiveSet,
    solution: &Solution<N>,
    sign: f64,
    candidates: [Vec<usize>; 2],
) -> Option<(f64, Crossing)> {
    let extras: Vec<usize> = candidates.iter().flatten().copied().collect();
    let plain = ActiveSet {
        is_crossed: vec![false; active.is_crossed.len()],
        ..active.clone()
    };
    // What the fitted play explains already is put back.
    let mut linearized = solution.linearized.clone();
    for linearized in linearized
        .iter_mut()
        .filter(|linearized| active.is_crossed[linearized.window])
    {
        linearized.misclosures += linearized.play() * solution.state.elongation_m;
    }
    let columns: Vec<_> = linearized
        .iter()
        .map(|linearized| play_columns(linearized, &extras))
        .collect();
    let blocks = Blocks::new(
        problem,
        &plain,
        &linearized,
        &solution.state.setup,
        &columns,
    )?;
    let mut together = blocks.extras.clone().insert_column(extras.len(), 0.0);
    together.set_column(extras.len(), &blocks.rows.residuals);
    let left = eliminated(blocks.rows.derivatives.clone(), together);
    let columns = left.columns(0, extras.len());
    let shares = columns.tr_mul(&left.column(extras.len()));
    let overlaps = columns.tr_mul(&columns);
    let [rising, falling] = [candidates[0].len(), candidates[1].len()];
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
    best.map(|(explained, beyond)| {
        (
            explained,
            Crossing {
                sign,
                candidates,
                beyond,
            },
        )
    })
}

/// Columns of a window, one per candidate: its derivative by the play in that of its own.
fn play_columns(linearized: &LinearizedWindow, candidates: &[usize]) -> DMatrix<f64> {
    let mut columns = DMatrix::zeros(linearized.gauges.len(), candidates.len());
    if let Some(column) = candidates
        .iter()
        .position(|window| *window == linearized.window)
    {
        columns.column_mut(column).copy_from(&linearized.play());
    }
    columns
}

/// Sums over the first rising and the first falling candidates.
pub(super) struct Sums {
    rising: usize,
    shares: [Vec<f64>; 2],
    overlaps: [Vec<f64>; 2],
    across: DMatrix<f64>,
}

impl Sums {
    pub(super) fn new(shares: &DVector<f64>, overlaps: &DMatrix<f64>, rising: usize) -> Self {
        let count = shares.len();
        let strokes = [0..rising, rising..count];
        let mut across = DMatrix::zeros(rising + 1, count - rising + 1);
        for row in 0..rising {
            for column in 0..count - rising {
                across[(row + 1, column + 1)] = overlaps[(row, rising + column)]
                    + across[(row, column + 1)]
                    + across[(row + 1, column)]
                    - across[(row, column)];
            }
        }
        Self {
            rising,
            shares: strokes
                .clone()
                .map(|stroke| Self::of_shares(shares, stroke)),
            overlaps: strokes.map(|stroke| Self::of_overlaps(overlaps, stroke)),
            across,
        }
    }

    /// Sums of the shares of the first candidates of a stroke: of none, of one, of two..
    fn of_shares(shares: &DVector<f64>, stroke: Range<usize>) -> Vec<f64> {
        let sums = stroke.scan(0.0, |sum, index| {
            *sum += shares[index];
            Some(*sum)
        });
        [0.0].into_iter().chain(sums).collect()
    }

    /// Sums of the overlaps of the first candidates of a stroke: of none, of one, of two..
    fn of_overlaps(overlaps: &DMatrix<f64>, stroke: Range<usize>) -> Vec<f64> {
        let first = stroke.start;
        let sums = stroke.scan(0.0, |sum, index| {
            let with_earlier: f64 = (first..index)
                .map(|earlier| overlaps[(earlier, index)])
                .sum();
            *sum += overlaps[(index, index)] + 2.0 * with_earlier;
            Some(*sum)
        });
        [0.0].into_iter().chain(sums).collect()
    }

    /// Share and overlap of the play in so many rising and falling candidates.
    pub(super) fn of(&self, risen: usize, fallen: usize) -> (f64, f64) {
        debug_assert!(risen <= self.rising);
        let share = self.shares[0][risen] + self.shares[1][fallen];
        (
            share,
            self.overlaps[0][risen] + self.overlaps[1][fallen] + 2.0 * self.across[(risen, fallen)],
        )
    }
}
