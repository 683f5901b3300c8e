//! Choice of measurements by exchange: from a random start, each entry is replaced by the best
//! candidate, until none improves.
//!
//! A candidate's whitened rows `A` add `A^T A` to the information. Without one entry the covariance
//! is `C`; with a candidate in its place `E`,
//!
//! ```text
//! trace(E M) = trace(C M) - trace(S^-1 A C M C A^T),    log det E^-1 = log det C^-1 + log det S,    S = 1 + A C A^T
//! ```
//!
//! so that one inverse serves all candidates. (V. V. Fedorov, Theory of Optimal Experiments, 1972.)

use nalgebra::{Cholesky, DMatrix, Dyn};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

/// Quantity that a plan makes small.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Criterion {
    /// Mean predicted variance of what the robot is for: `trace(C M)`.
    I,
    /// Volume of the parameters' confidence ellipsoid: `-log det C^-1`.
    D,
}

/// Standard deviation of every direction before anything is measured, in the parameters' scales: so
/// large that it decides nothing, and finite, so that a plan with one entry taken out still has a
/// covariance.
const PRIOR_SD: f64 = 10.0;
/// Decrease of the logarithm of a cost that is rounding.
const ROUNDING: f64 = 1e-9;
/// Sweeps over all entries; five are usual.
const MAX_SWEEPS: u32 = 40;

/// A measurement that a plan may contain.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Candidate {
    /// Whitened derivatives, row per reading, in scaled parameters.
    pub(super) rows: DMatrix<f64>,
    /// Index of its pose.
    pub(super) place: usize,
    /// Index of its strap; one candidate per pose and strap.
    pub(super) strap: usize,
}

/// Candidates, and what a plan is to be.
#[derive(Debug)]
pub(super) struct Search<'a> {
    candidates: &'a [Candidate],
    /// `A^T` of each.
    columns: Vec<DMatrix<f64>>,
    /// `M`: mean of `G^T G`, `G` the derivative of what is asked for.
    goal: &'a DMatrix<f64>,
    criterion: Criterion,
    count: usize,
    max_places: usize,
}

/// A plan without one entry.
struct PartialPlan {
    /// `C`.
    covariance: DMatrix<f64>,
    /// `C M C`.
    spread: DMatrix<f64>,
    /// `trace(C M)`, or `-log det C^-1`.
    cost: f64,
}

impl<'a> Search<'a> {
    /// A search for `count` different candidates at `max_places` poses or fewer.
    pub(super) fn new(
        candidates: &'a [Candidate],
        goal: &'a DMatrix<f64>,
        criterion: Criterion,
        count: usize,
        max_places: usize,
    ) -> Self {
        let columns = candidates
            .iter()
            .map(|candidate| candidate.rows.transpose())
            .collect();
        Self {
            candidates,
            columns,
            goal,
            criterion,
            count,
            max_places: max_places.min(count),
        }
    }

    /// Returns the best plan of several starts, as indices of candidates; `None` where there are
    /// not enough of them.
    pub(super) fn best(&self, starts: u64) -> Option<Vec<usize>> {
        let found = (0..starts).filter_map(|seed| self.start(seed));
        found
            .min_by(|one, other| one.0.total_cmp(&other.0))
            .map(|(_, chosen)| chosen)
    }

    /// Logarithm of the cost of a plan.
    pub(super) fn cost(&self, chosen: &[usize]) -> f64 {
        let Some(factor) = self.information(chosen.iter().copied()) else {
            return f64::INFINITY;
        };
        match self.criterion {
            Criterion::I => (factor.inverse() * self.goal).trace().ln(),
            Criterion::D => -factor.ln_determinant(),
        }
    }

    fn information(&self, chosen: impl Iterator<Item = usize>) -> Option<Cholesky<f64, Dyn>> {
        let size = self.goal.ncols();
        let mut information =
            DMatrix::from_diagonal_element(size, size, 1.0 / (PRIOR_SD * PRIOR_SD));
        for index in chosen {
            let rows = &self.candidates[index].rows;
            information += rows.tr_mul(rows);
        }
        information.cholesky()
    }

    fn start(&self, seed: u64) -> Option<(f64, Vec<usize>)> {
        let mut chosen = self.random(&mut ChaCha8Rng::seed_from_u64(seed))?;
        let mut cost = self.cost(&chosen);
        for _ in 0..MAX_SWEEPS {
            for entry in 0..chosen.len() {
                self.exchange(&mut chosen, entry);
            }
            if self.max_places < self.count {
                self.move_places(&mut chosen);
            }
            let now = self.cost(&chosen);
            if cost - now < ROUNDING {
                break;
            }
            cost = now;
        }
        Some((cost, chosen))
    }

    /// Different candidates at no more poses than allowed.
    pub(super) fn random(&self, random: &mut ChaCha8Rng) -> Option<Vec<usize>> {
        let mut places: Vec<usize> = self
            .candidates
            .iter()
            .map(|candidate| candidate.place)
            .collect();
        places.sort_unstable();
        places.dedup();
        places.shuffle(random);
        places.truncate(self.max_places);
        let mut chosen: Vec<usize> = (0..self.candidates.len())
            .filter(|index| places.contains(&self.candidates[*index].place))
            .collect();
        chosen.shuffle(random);
        chosen.truncate(self.count);
        (chosen.len() == self.count).then_some(chosen)
    }

    /// Replaces one entry by the best candidate.
    fn exchange(&self, chosen: &mut [usize], entry: usize) {
        let mut others = chosen.to_vec();
        others.remove(entry);
        let Some(partial) = self.partial(&others) else {
            return;
        };
        let mut places: Vec<usize> = others
            .iter()
            .map(|index| self.candidates[*index].place)
            .collect();
        places.sort_unstable();
        places.dedup();
        let may_move = places.len() < self.max_places;
        let allowed = (0..self.candidates.len()).filter(|index| {
            (may_move || places.contains(&self.candidates[*index].place)) && !others.contains(index)
        });
        let mut best = (self.cost_with(&partial, chosen[entry]), chosen[entry]);
        for index in allowed {
            let cost = self.cost_with(&partial, index);
            if cost < best.0 - ROUNDING {
                best = (cost, index);
            }
        }
        chosen[entry] = best.1;
    }

    /// Terms that are the same for every candidate that is added to these.
    fn partial(&self, chosen: &[usize]) -> Option<PartialPlan> {
        let factor = self.information(chosen.iter().copied())?;
        let covariance = factor.inverse();
        Some(PartialPlan {
            spread: &covariance * self.goal * &covariance,
            cost: match self.criterion {
                Criterion::I => (&covariance * self.goal).trace(),
                Criterion::D => -factor.ln_determinant(),
            },
            covariance,
        })
    }

    /// Logarithm of the cost of a plan with one more candidate.
    fn cost_with(&self, partial: &PartialPlan, index: usize) -> f64 {
        let count = self.candidates[index].rows.nrows();
        let mut sum = self.block(&partial.covariance, index);
        sum += DMatrix::<f64>::identity(count, count);
        let Some(sum) = sum.cholesky() else {
            return f64::INFINITY;
        };
        match self.criterion {
            Criterion::I => {
                let block = self.block(&partial.spread, index);
                (partial.cost - sum.solve(&block).trace()).ln()
            }
            Criterion::D => partial.cost - sum.ln_determinant(),
        }
    }

    /// `A X A^T` of a candidate.
    fn block(&self, of: &DMatrix<f64>, index: usize) -> DMatrix<f64> {
        let rows = &self.columns[index];
        rows.tr_mul(&(of * rows))
    }

    /// Takes all entries at a pose to another pose, where that is better.
    fn move_places(&self, chosen: &mut Vec<usize>) {
        let places = self
            .candidates
            .iter()
            .map(|candidate| candidate.place)
            .max()
            .map_or(0, |last| last + 1);
        for from in 0..places {
            if !chosen
                .iter()
                .any(|index| self.candidates[*index].place == from)
            {
                continue;
            }
            let mut best = (self.cost(chosen), None);
            for to in 0..places {
                let Some(moved) = self.moved(chosen, from, to) else {
                    continue;
                };
                let cost = self.cost(&moved);
                if cost < best.0 - ROUNDING {
                    best = (cost, Some(moved));
                }
            }
            if let (_, Some(moved)) = best {
                *chosen = moved;
            }
        }
    }

    /// The same straps at another pose, where all of them are candidates and nothing is measured
    /// yet.
    fn moved(&self, chosen: &[usize], from: usize, to: usize) -> Option<Vec<usize>> {
        if chosen
            .iter()
            .any(|index| self.candidates[*index].place == to)
        {
            return None;
        }
        chosen
            .iter()
            .map(|index| {
                let here = &self.candidates[*index];
                if here.place != from {
                    return Some(*index);
                }
                self.candidates
                    .iter()
                    .position(|there| there.place == to && there.strap == here.strap)
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng;

    /// Thirty readings of three parameters.
    fn candidates() -> Vec<Candidate> {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        (0..30)
            .map(|index| Candidate {
                rows: DMatrix::from_fn(2, 3, |_, _| random.random_range(-5.0..5.0)),
                place: index / 6,
                strap: index % 6,
            })
            .collect()
    }

    /// All pairs of four candidates would be 27405 plans: the search finds the best of them, by
    /// either criterion.
    #[test]
    fn the_best_of_all_plans_is_found() {
        let candidates = candidates();
        let goal = DMatrix::from_diagonal(&nalgebra::DVector::from_vec(vec![1.0, 4.0, 0.5]));
        for criterion in [Criterion::I, Criterion::D] {
            let search = Search::new(&candidates, &goal, criterion, 3, 3);
            let found = search.best(10).unwrap();
            let mut best = f64::INFINITY;
            for one in 0..30 {
                for two in one + 1..30 {
                    for three in two + 1..30 {
                        best = best.min(search.cost(&[one, two, three]));
                    }
                }
            }
            assert!(
                (search.cost(&found) - best).abs() < 1e-9,
                "{criterion:?} {found:?}"
            );
        }
    }

    /// The same straps show most at the first pose, or at the last: there they go, from wherever
    /// they are.
    #[test]
    fn all_entries_move_to_the_best_pose() {
        for best in [0, 3] {
            let candidates: Vec<Candidate> = (0..8)
                .map(|index| (index / 2, index % 2))
                .map(|(place, strap)| {
                    let size = if place == best { 3.0 } else { 1.0 };
                    let rows = DMatrix::from_fn(
                        1,
                        2,
                        |_, column| {
                            if column == strap { size } else { 0.0 }
                        },
                    );
                    Candidate { rows, place, strap }
                })
                .collect();
            let goal = DMatrix::identity(2, 2);
            let search = Search::new(&candidates, &goal, Criterion::I, 2, 1);
            for from in 0..4 {
                let mut chosen = vec![2 * from, 2 * from + 1];
                search.move_places(&mut chosen);
                assert_eq!(chosen, [2 * best, 2 * best + 1], "from {from}");
            }
        }
    }

    #[test]
    fn no_more_poses_than_allowed_and_nothing_twice() {
        let candidates = candidates();
        let goal = DMatrix::identity(3, 3);
        let mut found = Search::new(&candidates, &goal, Criterion::I, 9, 2)
            .best(3)
            .unwrap();
        let mut places: Vec<usize> = found.iter().map(|index| candidates[*index].place).collect();
        places.sort_unstable();
        places.dedup();
        found.sort_unstable();
        found.dedup();
        assert!(found.len() == 9 && places.len() <= 2, "{found:?}");
        // Two poses have twelve.
        assert_eq!(
            Search::new(&candidates, &goal, Criterion::I, 13, 2).best(3),
            None
        );
    }
}
