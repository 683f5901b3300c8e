//! Directions that no step of a fit goes along: what the readings do not see keeps the value that
//! the fit began with.
//!
//! Lost directions depend on the state that the rows are linearised at. A direction that is stepped
//! along while it is seen, and lost at the end, would leave its parameters anywhere. So the set is
//! decided for the final state: a fit begins again from its start with what is lost at its end,
//! until the two agree.
//!
//! A parameter most of which lies in lost directions is *kept*: it is held alone, so that its value
//! stays to the bit, and the parameters that the readings see together with it follow. What is left
//! of the lost directions is held as it is.

use nalgebra::{DMatrix, DVector};

use super::least_squares::{Observability, Rows, with_columns_scaled};

/// Share of a parameter's axis in lost directions above which it is kept. Of two equal parameters
/// neither is.
const MAX_LOST: f64 = 0.5 + 1e-6;
/// Smallest part of that share that lies outside of what the parameters kept before it take.
const MIN_OWN: f64 = 0.2;
/// Largest sine of the angle between two sets of directions that count as one.
const CLOSE: f64 = 0.1;
/// Decisions that may turn in a circle; after them what was lost once is held.
const FREE_DECISIONS: u32 = 3;

/// Directions that are held: orthonormal columns, one component per parameter, in scales.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldDirections {
    directions: DMatrix<f64>,
    kept: Vec<usize>,
}

impl HeldDirections {
    /// Nothing is held of so many parameters.
    #[must_use]
    pub fn none(parameters: usize) -> Self {
        Self {
            directions: DMatrix::zeros(parameters, 0),
            kept: Vec::new(),
        }
    }

    /// Holds as many directions as are lost (orthonormal columns), parameters alone where that is
    /// enough.
    #[must_use]
    pub fn of(lost: &DMatrix<f64>) -> Self {
        let parameters = lost.nrows();
        let mut held = Self::none(parameters);
        // Combinations of the lost directions that contain none of the kept parameters.
        let mut rest = lost.clone();
        loop {
            let next = (0..parameters)
                .filter(|parameter| share_in(lost, *parameter) > MAX_LOST)
                .map(|parameter| (share_in(&rest, parameter), parameter))
                .max_by(|(one, _), (other, _)| one.total_cmp(other));
            let Some((_, next)) = next.filter(|(own, _)| *own > MIN_OWN) else {
                break;
            };
            rest = without(&rest, next);
            held.kept.push(next);
        }
        held.kept.sort_unstable();
        let alone = held
            .kept
            .iter()
            .map(|parameter| axis(parameters, *parameter));
        let columns: Vec<DVector<f64>> = alone
            .chain(rest.column_iter().map(|column| column.into_owned()))
            .collect();
        if !columns.is_empty() {
            held.directions = DMatrix::from_columns(&columns);
        }
        held
    }

    /// Holds the directions that are lost at the end of a fit with this; after some `decisions`
    /// also those that were lost before.
    #[must_use]
    pub fn decided(&self, lost: &DMatrix<f64>, decisions: u32) -> Self {
        if decisions < FREE_DECISIONS {
            return Self::of(lost);
        }
        let both = lost.column_iter().fold(self.clone(), |held, column| {
            let column = column.into_owned();
            if held.outside(&column).norm() < CLOSE {
                held
            } else {
                held.with(&column)
            }
        });
        Self::of(&both.directions)
    }

    /// The same, and a parameter alone.
    #[must_use]
    pub fn with_kept(&self, parameter: usize) -> Self {
        if self.is_kept(parameter) {
            return self.clone();
        }
        let mut kept: Vec<usize> = self.kept.iter().copied().chain([parameter]).collect();
        kept.sort_unstable();
        let axis = axis(self.directions.nrows(), parameter);
        Self {
            directions: self.joined(&axis),
            kept,
        }
    }

    /// The same directions, where no parameter has kept its value.
    #[must_use]
    pub(super) fn without_kept(&self) -> Self {
        Self {
            directions: self.directions.clone(),
            kept: Vec::new(),
        }
    }

    /// The same, and the part of a direction that is not held yet.
    #[must_use]
    pub fn with(&self, direction: &DVector<f64>) -> Self {
        Self {
            directions: self.joined(direction),
            kept: self.kept.clone(),
        }
    }

    /// Part of a direction that is not held.
    fn outside(&self, direction: &DVector<f64>) -> DVector<f64> {
        direction - &self.directions * self.directions.tr_mul(direction)
    }

    /// The directions, and one more for the part of a direction that is not held, orthonormal.
    fn joined(&self, direction: &DVector<f64>) -> DMatrix<f64> {
        let count = self.directions.ncols();
        let mut joined = self.directions.clone().insert_column(count, 0.0);
        joined.set_column(count, &self.outside(direction).normalize());
        joined
    }

    /// Number of directions.
    #[must_use]
    pub fn count(&self) -> usize {
        self.directions.ncols()
    }

    /// Directions, orthonormal columns in scales.
    #[must_use]
    pub const fn directions(&self) -> &DMatrix<f64> {
        &self.directions
    }

    /// Parameters that keep their values.
    #[must_use]
    pub fn kept(&self) -> &[usize] {
        &self.kept
    }

    /// True if a parameter keeps its value.
    #[must_use]
    pub fn is_kept(&self, parameter: usize) -> bool {
        self.kept.contains(&parameter)
    }

    /// The same of more parameters, of which nothing is held.
    #[must_use]
    pub fn of_more(&self, parameters: usize) -> Self {
        let more = parameters.saturating_sub(self.directions.nrows());
        let directions = self
            .directions
            .clone()
            .insert_rows(self.directions.nrows(), more, 0.0);
        Self {
            directions,
            kept: self.kept.clone(),
        }
    }

    /// True if the same parameters are kept, and the directions are the same but for a small angle.
    #[must_use]
    pub fn agrees(&self, other: &Self) -> bool {
        if self.kept != other.kept || self.count() != other.count() {
            return false;
        }
        other
            .directions
            .column_iter()
            .all(|column| self.outside(&column.into_owned()).norm() < CLOSE)
    }

    /// Rows that do not see what is held.
    #[must_use]
    pub fn blinded(&self, rows: &Rows, scales: &DVector<f64>) -> Rows {
        let scaled = with_columns_scaled(&rows.derivatives, scales);
        let along = &scaled * &self.directions;
        let mut left = scaled - along * self.directions.transpose();
        self.kept
            .iter()
            .for_each(|parameter| left.column_mut(*parameter).fill(0.0));
        Rows::new(
            rows.residuals.clone(),
            with_columns_scaled(&left, &scales.map(f64::recip)),
        )
    }

    /// Changes of all parameters, in scales, when what is held changes by one scale along each of
    /// its directions, and what is seen follows: a column per direction.
    #[must_use]
    pub fn following(&self, rows: &Rows, seen: &Observability) -> DMatrix<f64> {
        let scales = seen.scales();
        let along = with_columns_scaled(&rows.derivatives, scales) * &self.directions;
        let half = DMatrix::from_diagonal(&scales.map(f64::recip)) * seen.half_covariance();
        let blinded = with_columns_scaled(&self.blinded(rows, scales).derivatives, scales);
        &self.directions - &half * half.tr_mul(&blinded.tr_mul(&along))
    }
}

/// Share of a parameter's axis in orthonormal columns.
fn share_in(columns: &DMatrix<f64>, parameter: usize) -> f64 {
    columns.row(parameter).norm_squared()
}

/// Combinations of columns that do not contain a parameter, orthonormal, one less.
fn without(columns: &DMatrix<f64>, parameter: usize) -> DMatrix<f64> {
    // A Householder reflection that turns the parameter's row into its first component.
    let row = columns.row(parameter).transpose();
    let mut normal = row.clone();
    normal[0] += row.norm().copysign(row[0]);
    let turned = columns - (columns * &normal) * normal.transpose() * (2.0 / normal.norm_squared());
    let mut rest = turned.remove_column(0);
    rest.row_mut(parameter).fill(0.0);
    rest
}

fn axis(parameters: usize, parameter: usize) -> DVector<f64> {
    let mut axis = DVector::zeros(parameters);
    axis[parameter] = 1.0;
    axis
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Orthonormal columns of so many random ones.
    fn random(parameters: usize, count: usize, seed: u64) -> DMatrix<f64> {
        use rand::{Rng, SeedableRng};
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        DMatrix::from_fn(parameters, count, |_, _| random.random_range(-1.0..1.0))
            .qr()
            .q()
    }

    #[test]
    fn a_parameter_that_is_lost_is_held_alone() {
        let lost = DMatrix::from_column_slice(4, 1, &[0.0, 0.999_5, 0.0, -0.031_619]);
        let held = HeldDirections::of(&lost);
        assert_eq!((held.kept(), held.count()), (&[1][..], 1));
        assert_eq!(held.directions().as_slice(), &[0.0, 1.0, 0.0, 0.0]);
    }

    #[test]
    fn a_combination_without_a_main_parameter_is_held_as_it_is() {
        let lost = DMatrix::from_column_slice(4, 1, &[0.5, 0.5, -0.5, 0.5]);
        let held = HeldDirections::of(&lost);
        assert!(held.kept().is_empty());
        assert!((held.directions() - &lost).amax() < 1e-15);
    }

    /// As many directions are held as are lost, orthonormal, and nothing that is seen only is held.
    #[test]
    fn what_is_held_stands_for_what_is_lost() {
        for seed in 0..200 {
            let count = 1 + usize::try_from(seed % 6).unwrap();
            let lost = random(9, count, seed);
            let held = HeldDirections::of(&lost);
            assert_eq!(held.count(), count);
            let overlaps = held.directions().tr_mul(held.directions());
            assert!((overlaps - DMatrix::identity(count, count)).amax() < 1e-12);
            // The held ones and the lost ones see each other.
            let least = held.directions().tr_mul(&lost).singular_values().min();
            assert!(least > 0.05, "{seed}: {least}");
            assert!(
                held.kept()
                    .iter()
                    .all(|parameter| lost.row(*parameter).norm_squared() > MAX_LOST)
            );
            assert!(held.agrees(&HeldDirections::of(&(-&lost))));
        }
    }

    #[test]
    fn what_is_kept_does_not_move_and_what_is_seen_follows() {
        // Rows see the sum of the first two parameters, and the third.
        let derivatives =
            DMatrix::from_row_slice(3, 3, &[2.0, 2.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
        let rows = Rows::new(DVector::from_vec(vec![4.0, 3.0, 5.0]), derivatives);
        let scales = DVector::from_vec(vec![1.0, 10.0, 1.0]);
        let held = HeldDirections::none(3).with_kept(1);
        let seen = Observability::holding(&rows, &scales, &held);
        assert_eq!(
            (seen.kept(), seen.step(0.0)[1].to_bits()),
            (2, 0.0_f64.to_bits())
        );
        assert!((seen.step(0.0) - DVector::from_vec(vec![2.0, 0.0, 4.0])).amax() < 1e-12);
        let following = held.following(&rows, &seen);
        assert!((following - DMatrix::from_column_slice(3, 1, &[-10.0, 1.0, 0.0])).amax() < 1e-12);
    }
}
