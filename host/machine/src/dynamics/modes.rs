//! Natural frequencies, and damping by modes.

use std::f64::consts::TAU;

use nalgebra::{Cholesky, DMatrix, DVector, Matrix6, SMatrix, SymmetricEigen};

use super::{CoordinateMatrix, MassiveMachine};
use crate::elastic::Pose;

/// Natural vibrations of a machine about an unloaded place, its drives held, lowest first.
#[derive(Clone, Debug, PartialEq)]
pub struct Modes<const N: usize> {
    /// Mass matrix.
    pub mass: CoordinateMatrix<N>,
    /// Stiffness matrix.
    pub stiffness: CoordinateMatrix<N>,
    /// Frequencies, rad/s.
    pub rad_per_s: DVector<f64>,
    /// Shapes by columns, with `V^T M V = 1`.
    pub shapes: DMatrix<f64>,
}

impl<const N: usize> Modes<N> {
    /// Finds the modes of a machine with its drives held: `K V = M V diag(w^2)`. `None` where there
    /// are none: masses or compliances that no body has.
    #[must_use]
    pub fn of(machine: &MassiveMachine<N>, pose: &Pose, axes: &[f64; N]) -> Option<Self> {
        let mass = machine.mass_matrix(pose, axes);
        let stiffness = machine.stiffness(pose, axes);
        // Of L^-1 K L^-T, with M = L L^T: the shapes are L^-T U.
        let factor = Cholesky::new(mass.to_matrix())?.unpack();
        let half = factor.solve_lower_triangular(&stiffness.to_matrix())?;
        let reduced = factor.solve_lower_triangular(&half.transpose())?;
        let eigen = SymmetricEigen::try_new(reduced, f64::EPSILON, 10_000)?;
        let mut order: Vec<usize> = (0..6 + N).collect();
        order.sort_by(|one, other| eigen.eigenvalues[*one].total_cmp(&eigen.eigenvalues[*other]));
        let squares =
            DVector::from_iterator(6 + N, order.iter().map(|mode| eigen.eigenvalues[*mode]));
        if !squares
            .iter()
            .all(|square| square.is_finite() && *square > 0.0)
        {
            return None;
        }
        let directions = eigen.eigenvectors.select_columns(&order);
        Some(Self {
            mass,
            stiffness,
            rad_per_s: squares.map(f64::sqrt),
            shapes: factor.tr_solve_lower_triangular(&directions)?,
        })
    }

    /// Returns the frequencies, Hz, lowest first.
    #[must_use]
    pub fn hz(&self) -> Vec<f64> {
        self.rad_per_s.iter().map(|w| w / TAU).collect()
    }

    /// Returns the damping matrix by which every mode has this damping ratio:
    /// `M V diag(2 zeta w) V^T M`.
    #[must_use]
    pub fn damping(&self, ratio: f64) -> CoordinateMatrix<N> {
        let mut left = self.mass.to_matrix() * &self.shapes;
        let right = left.transpose();
        for (mut column, w) in left.column_iter_mut().zip(self.rad_per_s.iter()) {
            column *= 2.0 * ratio * w;
        }
        CoordinateMatrix::from_matrix(&(left * right))
    }
}

impl<const N: usize> MassiveMachine<N> {
    /// Returns the stiffness matrix about an unloaded place with the drives held:
    /// `B^T diag(1 / c) B` of the links, with `B = [-W^T, D]`, and `1 / c` of the axes.
    #[must_use]
    pub fn stiffness(&self, pose: &Pose, axes: &[f64; N]) -> CoordinateMatrix<N> {
        let (by_platform, by_axes) = self.elongations(pose, axes);
        let compliances = self.elastic.compliances();
        let stiffness = Matrix6::from_diagonal(&compliances.links_m_per_n.map(f64::recip).into());
        let of_axes = SMatrix::from_diagonal(&compliances.axes.map(f64::recip).into());
        CoordinateMatrix {
            platform: by_platform.transpose() * stiffness * by_platform,
            cross: by_platform.transpose() * stiffness * by_axes,
            axes: by_axes.transpose() * stiffness * by_axes + of_axes,
        }
    }

    /// Returns the rates of the platform by those of the drives with unloaded springs:
    /// `G = W^-T D`, 6 x N. `None` where the links do not hold the platform.
    #[must_use]
    pub fn rigid_motion(&self, pose: &Pose, axes: &[f64; N]) -> Option<SMatrix<f64, 6, N>> {
        let (by_platform, by_axes) = self.elongations(pose, axes);
        Some(-by_platform.try_inverse()? * by_axes)
    }

    /// Returns the displacement of the platform by a load on it with the drives held, to first
    /// order: `W^-T diag(c) W^-1 + G diag(c_axes) G^T`, 6 x 6. `None` where the links do not hold
    /// it.
    #[must_use]
    pub fn compliance(&self, pose: &Pose, axes: &[f64; N]) -> Option<Matrix6<f64>> {
        let (by_platform, by_axes) = self.elongations(pose, axes);
        let inverse = by_platform.try_inverse()?;
        let motion = inverse * by_axes;
        let compliances = self.elastic.compliances();
        let of_links = Matrix6::from_diagonal(&compliances.links_m_per_n.into());
        let of_axes = SMatrix::<f64, N, N>::from_diagonal(&compliances.axes.into());
        Some(inverse * of_links * inverse.transpose() + motion * of_axes * motion.transpose())
    }
}
