//! Vectors and symmetric matrices over the coordinates of a machine: six of the platform, `N` axes.

use std::ops::{Add, AddAssign, Mul, Sub};

use nalgebra::{DMatrix, DVector, Matrix6, SMatrix, SVector, Vector6};

/// Rates of the coordinates, their derivatives, or the forces along them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coordinates<const N: usize> {
    /// Of the platform: of the tool centre point, then of its orientation, world axes.
    pub platform: Vector6<f64>,
    /// Of the axes, q-units.
    pub axes: SVector<f64, N>,
}

impl<const N: usize> Coordinates<N> {
    /// Returns zero.
    #[must_use]
    pub fn zeros() -> Self {
        Self {
            platform: Vector6::zeros(),
            axes: SVector::zeros(),
        }
    }

    /// Returns the platform's part, then the axes'.
    #[must_use]
    pub fn to_vector(&self) -> DVector<f64> {
        let parts = self.platform.iter().chain(self.axes.iter());
        DVector::from_iterator(6 + N, parts.copied())
    }

    /// True if no component is NaN or infinite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let parts = self.platform.iter().chain(self.axes.iter());
        parts.copied().all(f64::is_finite)
    }
}

impl<const N: usize> Add for Coordinates<N> {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            platform: self.platform + other.platform,
            axes: self.axes + other.axes,
        }
    }
}

impl<const N: usize> AddAssign for Coordinates<N> {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<const N: usize> Sub for Coordinates<N> {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self {
            platform: self.platform - other.platform,
            axes: self.axes - other.axes,
        }
    }
}

impl<const N: usize> Mul<f64> for Coordinates<N> {
    type Output = Self;

    fn mul(self, factor: f64) -> Self {
        Self {
            platform: self.platform * factor,
            axes: self.axes * factor,
        }
    }
}

/// Returns `A x`. That of nalgebra is no straight code for these sizes, and takes most of the time of
/// a simulation.
#[inline]
#[must_use]
pub fn product<const R: usize, const C: usize>(
    matrix: &SMatrix<f64, R, C>,
    vector: &SVector<f64, C>,
) -> SVector<f64, R> {
    let mut sums = [0.0; R];
    for (column, factor) in matrix.data.0.iter().zip(&vector.data.0[0]) {
        for (sum, entry) in sums.iter_mut().zip(column) {
            *sum += entry * factor;
        }
    }
    sums.into()
}

/// Returns `A^T x`; as [`product`].
#[inline]
#[must_use]
pub fn transposed_product<const R: usize, const C: usize>(
    matrix: &SMatrix<f64, R, C>,
    vector: &SVector<f64, R>,
) -> SVector<f64, C> {
    let mut sums = [0.0; C];
    for (sum, column) in sums.iter_mut().zip(&matrix.data.0) {
        for (entry, factor) in column.iter().zip(&vector.data.0[0]) {
            *sum += entry * factor;
        }
    }
    sums.into()
}

/// A symmetric matrix over the coordinates, by blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoordinateMatrix<const N: usize> {
    /// Platform by platform.
    pub platform: Matrix6<f64>,
    /// Platform by axes.
    pub cross: SMatrix<f64, 6, N>,
    /// Axes by axes.
    pub axes: SMatrix<f64, N, N>,
}

impl<const N: usize> CoordinateMatrix<N> {
    /// Returns zero.
    #[must_use]
    pub fn zeros() -> Self {
        Self {
            platform: Matrix6::zeros(),
            cross: SMatrix::zeros(),
            axes: SMatrix::zeros(),
        }
    }

    /// Returns the product with a vector.
    #[must_use]
    pub fn times(&self, vector: &Coordinates<N>) -> Coordinates<N> {
        Coordinates {
            platform: product(&self.platform, &vector.platform)
                + product(&self.cross, &vector.axes),
            axes: transposed_product(&self.cross, &vector.platform)
                + product(&self.axes, &vector.axes),
        }
    }

    /// Returns `x` of `A x = b`, of a positive definite matrix; `None` of another one. By the
    /// platform's block and its Schur complement.
    #[must_use]
    pub fn solve(&self, vector: &Coordinates<N>) -> Option<Coordinates<N>> {
        let platform = self.platform.cholesky()?;
        let across = platform.solve(&self.cross);
        let complement = (self.axes - self.cross.transpose() * across).cholesky()?;
        let reduced = vector.axes - across.transpose() * vector.platform;
        let axes = complement.solve(&reduced);
        Some(Coordinates {
            platform: platform.solve(&(vector.platform - self.cross * axes)),
            axes,
        })
    }

    /// Returns the inverse of a positive definite matrix; `None` of another one. By the platform's
    /// block and its Schur complement.
    #[must_use]
    pub fn inverse(&self) -> Option<Self> {
        let platform = self.platform.cholesky()?.inverse();
        let across = platform * self.cross;
        let axes = (self.axes - self.cross.transpose() * across)
            .cholesky()?
            .inverse();
        Some(Self {
            platform: platform + across * axes * across.transpose(),
            cross: -(across * axes),
            axes,
        })
    }

    /// Returns the whole matrix, (6 + N) x (6 + N): the platform's rows, then the axes'.
    #[must_use]
    pub fn to_matrix(&self) -> DMatrix<f64> {
        let mut whole = DMatrix::zeros(6 + N, 6 + N);
        whole.view_mut((0, 0), (6, 6)).copy_from(&self.platform);
        whole.view_mut((0, 6), (6, N)).copy_from(&self.cross);
        whole
            .view_mut((6, 0), (N, 6))
            .copy_from(&self.cross.transpose());
        whole.view_mut((6, 6), (N, N)).copy_from(&self.axes);
        whole
    }

    /// Matrix of the blocks of a whole one, as of [`to_matrix`](Self::to_matrix).
    #[must_use]
    pub fn from_matrix(whole: &DMatrix<f64>) -> Self {
        Self {
            platform: whole.fixed_view::<6, 6>(0, 0).into_owned(),
            cross: whole.fixed_view::<6, N>(0, 6).into_owned(),
            axes: whole.fixed_view::<N, N>(6, 6).into_owned(),
        }
    }
}
