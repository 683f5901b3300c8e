//! Singular values by one-sided Jacobi rotations.
//!
//! nalgebra's `svd` is wrong for matrices with equal columns, which is what a direction that cannot
//! be observed looks like: with 0.33.3 it returns wrong singular values for 231 of the 841 matrices
//! of ones up to 29 x 29 (its issue 1172). Rotations do not converge too early: they end when every
//! pair of columns is orthogonal. (G. H. Golub, C. F. Van Loan, Matrix Computations, 8.6.3.)

use nalgebra::{DMatrix, DVector};

/// Cosine between two columns below which they are orthogonal.
const ORTHOGONAL: f64 = 1e-15;
/// Sweeps over all pairs of columns. Ten are many; a matrix of NaN ends here.
const MAX_SWEEPS: usize = 60;

/// Decomposition `A = U diag(s) V^T` of a matrix; without enough rows some values are zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Svd {
    /// `s`: singular values, the largest first.
    pub values: DVector<f64>,
    /// `V`: directions in the space of the columns, one per singular value.
    pub directions: DMatrix<f64>,
    /// `U diag(s)`: the images of the directions.
    pub images: DMatrix<f64>,
}

impl Svd {
    /// Decomposes a matrix.
    ///
    /// `A P = Q R`, and `R^T = Q' L^T`: the columns of the lower triangle `L` are nearer to
    /// orthogonal than those of `A`, and converge in fewer sweeps. (Z. Drmac, K. Veselic, "New fast
    /// and accurate Jacobi SVD algorithm I", SIAM J. Matrix Anal. Appl. 29(4), 2008.)
    #[must_use]
    pub fn new(matrix: DMatrix<f64>) -> Self {
        let (rows, columns) = matrix.shape();
        // Directions are as many as columns, where rows are fewer too.
        let pivoted = matrix
            .resize_vertically(rows.max(columns), 0.0)
            .col_piv_qr();
        let transposed = pivoted.r().transpose().qr();
        let mut images = transposed.r().transpose();
        let mut directions = transposed.q();
        pivoted.p().inv_permute_rows(&mut directions);
        for _ in 0..MAX_SWEEPS {
            if !swept(&mut images, &mut directions) {
                break;
            }
        }
        let images = (pivoted.q() * images).rows(0, rows).into_owned();
        Self::sorted(&images, &directions)
    }

    fn sorted(images: &DMatrix<f64>, directions: &DMatrix<f64>) -> Self {
        let norms: Vec<f64> = images.column_iter().map(|column| column.norm()).collect();
        let mut order: Vec<usize> = (0..norms.len()).collect();
        order.sort_by(|one, other| norms[*other].total_cmp(&norms[*one]));
        Self {
            values: DVector::from_iterator(order.len(), order.iter().map(|index| norms[*index])),
            directions: directions.select_columns(&order),
            images: images.select_columns(&order),
        }
    }
}

/// Rotates each pair of columns that are not orthogonal. Returns false where none was.
fn swept(images: &mut DMatrix<f64>, directions: &mut DMatrix<f64>) -> bool {
    let columns = images.ncols();
    let mut squares: Vec<f64> = images
        .column_iter()
        .map(|column| column.norm_squared())
        .collect();
    let largest = squares.iter().copied().fold(0.0, f64::max);
    let mut rotated = false;
    for one in 0..columns {
        for other in one + 1..columns {
            let product = images.column(one).dot(&images.column(other));
            let turn = Turn::between(squares[one], squares[other], product, largest);
            if let Some(turn) = turn {
                turn.apply(images, one, other);
                turn.apply(directions, one, other);
                for column in [one, other] {
                    squares[column] = images.column(column).norm_squared();
                }
                rotated = true;
            }
        }
    }
    rotated
}

/// Rotation of two columns.
struct Turn {
    cosine: f64,
    sine: f64,
}

impl Turn {
    /// Returns the rotation that makes two columns orthogonal, whose squares are `aa` and `bb` and
    /// whose product is `ab`; `None` where they are.
    fn between(aa: f64, bb: f64, ab: f64, largest: f64) -> Option<Self> {
        // Also where one of them is rounding of the largest: it has no direction of its own.
        let small = ORTHOGONAL * (aa * bb).sqrt();
        if ab.abs() <= small || ab.abs() <= ORTHOGONAL * ORTHOGONAL * largest || !ab.is_finite() {
            return None;
        }
        let zeta = (bb - aa) / (2.0 * ab);
        let tangent = zeta.signum() / (zeta.abs() + zeta.hypot(1.0));
        let cosine = 1.0 / tangent.hypot(1.0);
        Some(Self {
            cosine,
            sine: cosine * tangent,
        })
    }

    fn apply(&self, matrix: &mut DMatrix<f64>, one: usize, other: usize) {
        let (mut left, mut right) = matrix.columns_range_pair_mut(one, other);
        for (a, b) in left.as_mut_slice().iter_mut().zip(right.as_mut_slice()) {
            (*a, *b) = (
                self.cosine * *a - self.sine * *b,
                self.sine * *a + self.cosine * *b,
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn is_decomposition(matrix: &DMatrix<f64>, svd: &Svd) {
        let scale = matrix.norm().max(1e-300);
        let unit = svd.directions.transpose() * &svd.directions;
        assert!((unit - DMatrix::identity(matrix.ncols(), matrix.ncols())).amax() < 1e-13);
        assert!((&svd.images * svd.directions.transpose() - matrix).amax() < 1e-13 * scale);
        let gram = svd.images.transpose() * &svd.images;
        let squares = DMatrix::from_diagonal(&svd.values.component_mul(&svd.values));
        assert!((gram - squares).amax() < 1e-12 * scale * scale);
        assert!(svd.values.as_slice().is_sorted_by(|one, next| one >= next));
    }

    #[test]
    fn matrices_of_ones_have_one_value() {
        for rows in 1..30_usize {
            for columns in 1..=rows {
                let matrix = DMatrix::repeat(rows, columns, 1.0);
                let svd = Svd::new(matrix.clone());
                is_decomposition(&matrix, &svd);
                let expected = f64::from(u16::try_from(rows * columns).unwrap()).sqrt();
                assert!(
                    (svd.values[0] - expected).abs() < 1e-12 * expected,
                    "{rows} x {columns}: {}",
                    svd.values
                );
                assert!(
                    svd.values.iter().skip(1).all(|value| *value < 1e-12),
                    "{rows} x {columns}: {}",
                    svd.values
                );
            }
        }
    }

    #[test]
    fn matrices_with_few_rows_have_all_directions() {
        let mut random = ChaCha8Rng::seed_from_u64(8);
        for columns in 1..12_usize {
            for rows in 1..columns {
                let matrix = DMatrix::from_fn(rows, columns, |_, _| random.random_range(-1.0..1.0));
                let svd = Svd::new(matrix.clone());
                is_decomposition(&matrix, &svd);
                assert_eq!(svd.values.len(), columns);
            }
        }
    }

    #[test]
    fn equal_columns_of_any_scale_lose_one_direction() {
        let mut random = ChaCha8Rng::seed_from_u64(7);
        for _ in 0..1_000 {
            let columns = random.random_range(2..9_usize);
            let rows = columns + random.random_range(0..9_usize);
            let mut matrix = DMatrix::from_fn(rows, columns, |_, _| random.random_range(-1.0..1.0));
            for column in 0..columns {
                let scale = 10.0_f64.powf(random.random_range(-2.0..2.0));
                matrix.column_mut(column).scale_mut(scale);
            }
            let twin = matrix.column(0) * 1.0;
            matrix.column_mut(columns - 1).copy_from(&twin);
            let svd = Svd::new(matrix.clone());
            is_decomposition(&matrix, &svd);
            assert!(svd.values[columns - 1] < 1e-13 * svd.values[0]);
            let lost = svd.directions.column(columns - 1);
            let expected = 0.5_f64.sqrt();
            assert!(
                (lost[0].abs() - expected).abs() < 1e-9
                    && (lost[0] + lost[columns - 1]).abs() < 1e-9,
                "{lost}"
            );
        }
    }

    #[test]
    fn numbers_that_are_none_end_too() {
        let svd = Svd::new(DMatrix::repeat(4, 3, f64::NAN));
        assert!(svd.values.iter().all(|value| value.is_nan()));
    }
}
