//! Line matrix, link forces, actuator loads `[T 3.3.2, 3.3.3]`: six links, any orientation, three
//! axes or six.
//!
//! This is the general path; a machine makes its [`LineMatrix`] (`line_matrix`). `W` is factored by
//! blocks of three, and as a whole, with pivots, where a block is near singular. The cyclic path of
//! the L2 is [`crate::model::l2::Elastic`].

use nalgebra::{ArrayStorage, Matrix6, SMatrix, Vector3};

use crate::model::block_solve::BlockFactors;
use crate::model::kinematics::KinematicsError;
use crate::model::linalg::are_finite;
use crate::model::lu::Lu;
use crate::model::robot::{ARMS, LINKS};
use crate::zip::zip;

/// Load on the platform: applied by the environment to the platform, world axes, moment about the
/// tool centre point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wrench {
    /// `F`, in newtons.
    pub force_n: Vector3<f64>,
    /// `M`, in newton metres.
    pub moment_nm: Vector3<f64>,
}

#[cfg(feature = "defmt")]
impl defmt::Format for Wrench {
    fn format(&self, f: defmt::Formatter<'_>) {
        let [fx, fy, fz, mx, my, mz] = self.to_array();
        defmt::write!(
            f,
            "({}, {}, {}) N, ({}, {}, {}) N m",
            fx,
            fy,
            fz,
            mx,
            my,
            mz
        );
    }
}

impl Wrench {
    /// Zero load.
    #[must_use]
    pub fn zero() -> Self {
        Self {
            force_n: Vector3::zeros(),
            moment_nm: Vector3::zeros(),
        }
    }

    /// From `[Fx, Fy, Fz, Mx, My, Mz]`, N and N m.
    #[must_use]
    pub fn from_array([fx, fy, fz, mx, my, mz]: [f64; 6]) -> Self {
        Self {
            force_n: Vector3::new(fx, fy, fz),
            moment_nm: Vector3::new(mx, my, mz),
        }
    }

    /// As `[Fx, Fy, Fz, Mx, My, Mz]`, N and N m.
    #[must_use]
    pub fn to_array(&self) -> [f64; 6] {
        let (f, m) = (&self.force_n, &self.moment_nm);
        [f.x, f.y, f.z, m.x, m.y, m.z]
    }

    /// True if every component is finite.
    #[inline]
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let (f, m) = (&self.force_n, &self.moment_nm);
        f.x.is_finite()
            && f.y.is_finite()
            && f.z.is_finite()
            && m.x.is_finite()
            && m.y.is_finite()
            && m.z.is_finite()
    }
}

/// The six links in a pose, factored once: `W = [s; l x s]` `[T 3.17, 3.22]` and `D`, for a machine
/// with `N` axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineMatrix<const N: usize> {
    /// `s_ij`: from platform to cart, link order.
    directions: [Vector3<f64>; LINKS],
    /// `l_ij x s_ij`, metres.
    moments_m: [Vector3<f64>; LINKS],
    /// `D_(ij),k = s_ij . dA_ij/dq_k`: rows in link order, columns in axis order.
    drives: [[f64; N]; LINKS],
    /// `W^T`, factored; `None` where a block is near singular: there each solve factors it as a
    /// whole, with pivots.
    factors: Option<BlockFactors>,
}

impl<const N: usize> LineMatrix<N> {
    /// Factors the lines of links with these directions (`s_ij`), drives (`D`), and levers of their
    /// platform joints about the tool centre point (`l_ij`, world axes, metres).
    ///
    /// # Errors
    /// `Singular` and `NotFinite`.
    #[inline]
    pub(crate) fn new(
        directions: &[Vector3<f64>; LINKS],
        drives: &[[f64; N]; LINKS],
        levers_m: &[Vector3<f64>; LINKS],
    ) -> Result<Self, KinematicsError> {
        let moments_m = moments(levers_m, directions);
        let factors = BlockFactors::new(directions, &moments_m);
        if factors.is_none() {
            pivots(directions, &moments_m)?;
        }
        Ok(Self {
            directions: *directions,
            moments_m,
            drives: *drives,
            factors,
        })
    }

    /// Rows of `W^T`.
    fn rows(&self) -> [[f64; LINKS]; LINKS] {
        rows(&self.directions, &self.moments_m)
    }

    /// `x` of `W^T x = right`.
    #[inline]
    pub(crate) fn solve(&self, right: &[f64; LINKS]) -> Result<[f64; LINKS], KinematicsError> {
        let Some(factors) = &self.factors else {
            return self.solve_by_pivots(right);
        };
        let (x, y) = factors.solve(right);
        finite([x.x, x.y, x.z, y.x, y.y, y.z])
    }

    /// `f` of `W f = w`.
    #[inline]
    fn solve_transposed(&self, load: &Wrench) -> Result<[f64; LINKS], KinematicsError> {
        let Some(factors) = &self.factors else {
            return self.solve_transposed_by_pivots(load);
        };
        finite(factors.solve_transposed(&load.force_n, &load.moment_nm))
    }

    // Not inlined: the factors of all six rows would be on every caller's stack.
    #[cold]
    #[inline(never)]
    fn solve_by_pivots(&self, right: &[f64; LINKS]) -> Result<[f64; LINKS], KinematicsError> {
        finite(Lu::factor(&self.rows())?.solve(right))
    }

    #[cold]
    #[inline(never)]
    fn solve_transposed_by_pivots(&self, load: &Wrench) -> Result<[f64; LINKS], KinematicsError> {
        finite(Lu::factor(&self.rows())?.solve_transposed(&load.to_array()))
    }
}

/// Looks near a singularity of either block whether the lines depend on each other.
#[cold]
#[inline(never)]
fn pivots(
    directions: &[Vector3<f64>; LINKS],
    moments_m: &[Vector3<f64>; LINKS],
) -> Result<(), KinematicsError> {
    Lu::factor(&rows(directions, moments_m)).map(|_| ())
}

impl LineMatrix<ARMS> {
    /// `[D_(ij), -(l_ij x s_ij)]`: derivatives of the link lengths by the carts and the platform's
    /// rotation.
    pub(crate) fn rows_by_carts(&self) -> [[f64; LINKS]; LINKS] {
        let mut rows = [[0.0; LINKS]; LINKS];
        for (row, (drives, m)) in rows.iter_mut().zip(zip(&self.drives, &self.moments_m)) {
            let [d1, d2, d3] = *drives;
            *row = [d1, d2, d3, -m.x, -m.y, -m.z];
        }
        rows
    }
}

/// `l_ij x s_ij`.
#[inline]
pub(crate) fn moments(
    levers_m: &[Vector3<f64>; LINKS],
    directions: &[Vector3<f64>; LINKS],
) -> [Vector3<f64>; LINKS] {
    let [l11, l21, l22, l31, l32, l33] = levers_m;
    let [s11, s21, s22, s31, s32, s33] = directions;
    [
        l11.cross(s11),
        l21.cross(s21),
        l22.cross(s22),
        l31.cross(s31),
        l32.cross(s32),
        l33.cross(s33),
    ]
}

/// Rows `[s_ij, l_ij x s_ij]` of `W^T`, from these vectors in link order.
pub(crate) fn rows(
    directions: &[Vector3<f64>; LINKS],
    moments_m: &[Vector3<f64>; LINKS],
) -> [[f64; LINKS]; LINKS] {
    let mut rows = [[0.0; LINKS]; LINKS];
    for (row, (s, m)) in rows.iter_mut().zip(zip(directions, moments_m)) {
        *row = [s.x, s.y, s.z, m.x, m.y, m.z];
    }
    rows
}

impl<const N: usize> LineMatrix<N> {
    /// `W`: forces (dimensionless) over moments (m) of a unit tension in each link.
    #[must_use]
    pub fn matrix(&self) -> Matrix6<f64> {
        Matrix6::from_column_slice(self.rows().as_flattened())
    }

    /// `f = -W^-1 w` `[T 3.25]`: tension of each link, N, link order.
    ///
    /// # Errors
    /// [`KinematicsError::NotFinite`].
    pub fn link_forces_n(&self, load: &Wrench) -> Result<[f64; LINKS], KinematicsError> {
        Ok(self.solve_transposed(load)?.map(|force| -force))
    }

    /// `tau = -D^T f` `[T 3.26]`: load on each actuator, positive along `+q`, in newtons times
    /// metres per q-unit. The thesis takes the magnitude; the sign is what tells a cart which way
    /// to yield.
    #[must_use]
    pub fn cart_loads(&self, link_forces_n: &[f64; LINKS]) -> [f64; N] {
        let mut loads = [0.0; N];
        for (row, force) in zip(&self.drives, link_forces_n) {
            for (load, drive) in loads.iter_mut().zip(row) {
                *load -= drive * force;
            }
        }
        loads
    }

    /// Platform displacement for changes of link length and axis position: `W^T dx = D dq - de`
    /// (`dq` in q-units, `de` in metres, both in their order; translation in m then rotation in
    /// rad, world axes).
    ///
    /// # Errors
    /// [`KinematicsError::NotFinite`].
    pub fn displacement(
        &self,
        dq: &[f64; N],
        elongations_m: &[f64; LINKS],
    ) -> Result<[f64; 6], KinematicsError> {
        let mut right = [0.0; LINKS];
        let drives = &self.drives;
        for (value, (row, elongation)) in right.iter_mut().zip(zip(drives, elongations_m)) {
            let driven: f64 = zip(row, dq).map(|(drive, dq)| drive * dq).sum();
            *value = driven - elongation;
        }
        self.solve(&right)
    }

    /// `J = W^-T D`: the platform's twist (translation of the tool centre point over rotation,
    /// world axes) per axis; metres and radians per q-unit.
    ///
    /// # Errors
    /// [`KinematicsError::NotFinite`].
    pub fn jacobian(&self) -> Result<SMatrix<f64, 6, N>, KinematicsError> {
        let mut columns = [[0.0; 6]; N];
        for (axis, column) in columns.iter_mut().enumerate() {
            let mut driven = [0.0; LINKS];
            for (value, row) in driven.iter_mut().zip(&self.drives) {
                *value = row.get(axis).copied().unwrap_or(0.0);
            }
            *column = self.solve(&driven)?;
        }
        Ok(SMatrix::from_data(ArrayStorage(columns)))
    }
}

/// Returns the numbers if every one is finite.
pub(crate) fn finite<const N: usize>(values: [f64; N]) -> Result<[f64; N], KinematicsError> {
    if are_finite(&values) {
        Ok(values)
    } else {
        Err(KinematicsError::NotFinite)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::kinematics::Pose;
    use crate::model::l2::Robot;
    use crate::model::l2::tests::{geometry, l2};

    #[test]
    fn dependent_lines_and_wild_numbers_are_refused() {
        let mut flat = geometry();
        // Every platform joint in one point: no link can carry a moment.
        for (cart, joint) in flat
            .cart_joints_m
            .iter_mut()
            .zip(&mut flat.platform_joints_m)
        {
            *cart -= *joint;
            *joint = Vector3::zeros();
        }
        let robot = Robot::new(flat).unwrap();
        let pose = Pose::at(Vector3::new(0.0, 0.5, 0.65));
        let q = l2().inverse(&pose.position_m).unwrap();
        assert!(matches!(
            robot.line_matrix(&pose, &q),
            Err(KinematicsError::Singular { .. })
        ));
        let robot = Robot::new(geometry()).unwrap();
        assert_eq!(
            robot.line_matrix(&pose, &[f64::NAN, 0.0, 0.0]),
            Err(KinematicsError::NotFinite)
        );
        let lines = robot.line_matrix(&pose, &q).unwrap();
        let wild = Wrench::from_array([f64::MAX; 6]);
        assert_eq!(lines.link_forces_n(&wild), Err(KinematicsError::NotFinite));
    }
}
