//! Line matrix, link forces, actuator loads `[T 3.3.2, 3.3.3]`: six links, any orientation, three axes or six.
//!
//! This is the general path, by a 6x6 decomposition. The cyclic path of the 3-DOF machine is [`crate::stiffness::TauModel`].

use nalgebra::{ArrayStorage, Matrix3, Matrix6, SMatrix, Vector3};

use crate::kinematics::{KinematicsError, Pose, SixLinkKinematics, links};
use crate::linalg::{Lu, unit};
use crate::robot::{ARM_OF_LINK, ARMS, AXES, LINKS, Robot};
use crate::rows::pairs;

/// Load on the platform: applied by the environment to the platform, world axes, moment about the tool centre point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wrench {
    /// `F`, in newtons.
    pub force_n: Vector3<f64>,
    /// `M`, in newton metres.
    pub moment_nm: Vector3<f64>,
}

impl Wrench {
    /// No load.
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

    /// Whether every component is finite.
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

/// The six links in a pose, factored once: `W = [s; l x s]` `[T 3.17, 3.22]` and `D`, for a machine with `N` axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineMatrix<const N: usize = ARMS> {
    /// Rows of `W^T`: `[s_ij, l_ij x s_ij]`.
    rows: [[f64; LINKS]; LINKS],
    factors: Lu<LINKS>,
    /// `D_(ij),k = s_ij . dA_ij/dq_k`: rows in link order, columns in axis order.
    drives: [[f64; N]; LINKS],
}

impl LineMatrix<ARMS> {
    /// Directions and levers of the links of a 3-DOF machine in this pose with these positions (q-units).
    ///
    /// # Errors
    /// [`KinematicsError::Singular`] when the lines depend on each other, `NotFinite` when a number given is.
    pub fn new(robot: &Robot, pose: &Pose, q: &[f64; ARMS]) -> Result<Self, KinematicsError> {
        let mut links_m = [Vector3::zeros(); LINKS];
        for (vector, link) in links_m.iter_mut().zip(links(robot.geometry(), pose, q)) {
            *vector = link.vector_m;
        }
        let directions = directions(&links_m)?;
        let geometry = robot.geometry();
        let mut drives = [[0.0; ARMS]; LINKS];
        for ((row, s), arm) in drives.iter_mut().zip(&directions).zip(ARM_OF_LINK) {
            if let (Some(drive), Some(guideway)) = (row.get_mut(arm), geometry.guideways.get(arm)) {
                *drive = s.dot(guideway);
            }
        }
        Self::of_lines(&directions, &geometry.platform_joints_m, pose, drives)
    }
}

impl LineMatrix<AXES> {
    /// Directions and levers of the links of a 6-DOF machine in this pose with these positions (q-units).
    ///
    /// # Errors
    /// As [`LineMatrix::new`].
    pub fn of_six_link(
        kinematics: &SixLinkKinematics,
        pose: &Pose,
        q: &[f64; AXES],
    ) -> Result<Self, KinematicsError> {
        let directions = directions(&kinematics.links_m(pose, q))?;
        let drives = kinematics.drives(q, &directions);
        let joints = &kinematics.robot().geometry().platform_joints_m;
        Self::of_lines(&directions, joints, pose, drives)
    }
}

/// `s_ij`: from platform to cart.
fn directions(links_m: &[Vector3<f64>; LINKS]) -> Result<[Vector3<f64>; LINKS], KinematicsError> {
    let mut directions = *links_m;
    for direction in &mut directions {
        *direction = unit(direction).ok_or(KinematicsError::NotFinite)?;
    }
    Ok(directions)
}

impl<const N: usize> LineMatrix<N> {
    fn of_lines(
        directions: &[Vector3<f64>; LINKS],
        platform_joints_m: &[Vector3<f64>; LINKS],
        pose: &Pose,
        drives: [[f64; N]; LINKS],
    ) -> Result<Self, KinematicsError> {
        let mut rows = [[0.0; LINKS]; LINKS];
        for (row, (s, joint)) in rows.iter_mut().zip(pairs(directions, platform_joints_m)) {
            let moment = (pose.rotation * joint).cross(s);
            *row = [s.x, s.y, s.z, moment.x, moment.y, moment.z];
        }
        Ok(Self {
            rows,
            factors: Lu::factor(&rows)?,
            drives,
        })
    }

    /// `W`: forces (dimensionless) over moments (m) of a unit tension in each link.
    #[must_use]
    pub fn matrix(&self) -> Matrix6<f64> {
        Matrix6::from_column_slice(self.rows.as_flattened())
    }

    /// `f = -W^-1 w` `[T 3.25]`: tension of each link, N, link order.
    ///
    /// # Errors
    /// [`KinematicsError::NotFinite`].
    pub fn link_forces_n(&self, load: &Wrench) -> Result<[f64; LINKS], KinematicsError> {
        finite(
            self.factors
                .solve_transposed(&load.to_array())
                .map(|force| -force),
        )
    }

    /// `tau = -D^T f` `[T 3.26]`: load on each actuator, positive along `+q`, in newtons times metres per q-unit.
    /// The thesis takes the magnitude; the sign is what tells a cart which way to yield.
    #[must_use]
    pub fn cart_loads(&self, link_forces_n: &[f64; LINKS]) -> [f64; N] {
        let mut loads = [0.0; N];
        for (row, force) in pairs(&self.drives, link_forces_n) {
            for (load, drive) in loads.iter_mut().zip(row) {
                *load -= drive * force;
            }
        }
        loads
    }

    /// Platform displacement for changes of link length and axis position: `W^T dx = D dq - de`
    /// (`dq` in q-units, `de` in metres, both in their order; translation in m then rotation in rad, world axes).
    ///
    /// # Errors
    /// [`KinematicsError::NotFinite`].
    pub fn displacement(
        &self,
        dq: &[f64; N],
        elongations_m: &[f64; LINKS],
    ) -> Result<[f64; 6], KinematicsError> {
        let mut right = [0.0; LINKS];
        for (value, (row, elongation)) in right.iter_mut().zip(pairs(&self.drives, elongations_m)) {
            let driven: f64 = pairs(row, dq).map(|(drive, dq)| drive * dq).sum();
            *value = driven - elongation;
        }
        finite(self.factors.solve(&right))
    }

    /// `J = W^-T D`: the platform's twist (translation of the tool centre point over rotation, world axes) per axis;
    /// metres and radians per q-unit.
    ///
    /// # Errors
    /// [`KinematicsError::NotFinite`].
    pub fn jacobian(&self) -> Result<SMatrix<f64, 6, N>, KinematicsError> {
        let mut columns = [[0.0; 6]; N];
        for (axis, column) in columns.iter_mut().enumerate() {
            let mut dq = [0.0; N];
            if let Some(moved) = dq.get_mut(axis) {
                *moved = 1.0;
            }
            *column = self.displacement(&dq, &[0.0; LINKS])?;
        }
        Ok(SMatrix::from_data(ArrayStorage(columns)))
    }

    /// Smallest pivot of `W` over its largest, 0 at a singularity.
    #[must_use]
    pub const fn regularity(&self) -> f64 {
        self.factors.pivot_ratio()
    }
}

/// `tau = J^T F` `[T 3.28]` for the 3-DOF machine, whose cart loads do not depend on the moment:
/// load on each actuator, positive along `+q`, in newtons times metres per q-unit.
#[inline]
#[must_use]
pub fn cart_loads_from_jacobian(jacobian: &Matrix3<f64>, force_n: &Vector3<f64>) -> [f64; ARMS] {
    let loads = jacobian.tr_mul(force_n);
    [loads.x, loads.y, loads.z]
}

/// The numbers, if every one is finite.
pub(crate) fn finite<const N: usize>(values: [f64; N]) -> Result<[f64; N], KinematicsError> {
    if values.iter().all(|value| value.is_finite()) {
        Ok(values)
    } else {
        Err(KinematicsError::NotFinite)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::tests::{Case, close, geometry, l2, machine, skewed};

    pub(crate) fn wrench(case: &Case) -> Wrench {
        Wrench::from_array(case.numbers("w").try_into().unwrap())
    }

    #[test]
    fn agrees_with_the_oracle_both_ways() {
        let robot = Robot::new(geometry()).unwrap();
        for case in Case::all() {
            let load = wrench(&case);
            let lines = LineMatrix::new(&robot, &Pose::at(case.tcp()), &case.three("q")).unwrap();
            let forces = lines.link_forces_n(&load).unwrap();
            case.agrees("f", forces);
            case.agrees("tau", lines.cart_loads(&forces));
            let jacobian = l2().jacobian(&case.tcp()).unwrap();
            case.agrees("tau", cart_loads_from_jacobian(&jacobian, &load.force_n));
        }
    }

    /// The lines of a turned machine with nonparallel, scaled guideways, the tool at `position_m` in the machine's own axes.
    fn skewed_lines(position_m: Vector3<f64>) -> LineMatrix {
        let (geometry, rotation) = skewed();
        let robot = Robot::new(geometry).unwrap();
        let position_m = rotation * position_m;
        let q = machine(geometry, &rotation).inverse(&position_m).unwrap();
        let pose = Pose {
            position_m,
            rotation,
        };
        LineMatrix::new(&robot, &pose, &q).unwrap()
    }

    #[test]
    fn the_links_balance_the_load() {
        let lines = skewed_lines(Vector3::new(0.1, 0.5, 0.6));
        let load = [120.0, -80.0, 250.0, 3.0, -5.0, 7.0];
        let forces = lines.link_forces_n(&Wrench::from_array(load)).unwrap();
        let sum = lines.matrix() * nalgebra::Vector6::from(forces);
        close(sum.as_slice(), &load.map(|value| -value), 1e-13, "W f + w");
    }

    #[test]
    fn cart_loads_do_the_work_of_the_load() {
        // Virtual work: tau . dq = F . dT + M . dtheta for every motion of the carts with rigid links.
        let lines = skewed_lines(Vector3::new(-0.1, 0.4, 0.7));
        let load = Wrench::from_array([120.0, -80.0, 250.0, 3.0, -5.0, 7.0]);
        let loads = lines.cart_loads(&lines.link_forces_n(&load).unwrap());
        for axis in 0..ARMS {
            let mut dq = [0.0; ARMS];
            dq[axis] = 1.0;
            let motion = lines.displacement(&dq, &[0.0; LINKS]).unwrap();
            let work: f64 = motion
                .iter()
                .zip(load.to_array())
                .map(|(dx, w)| dx * w)
                .sum();
            assert!(
                (work - loads[axis]).abs() < 1e-10 * work.abs(),
                "{work} {loads:?}"
            );
        }
    }

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
            LineMatrix::new(&robot, &pose, &q),
            Err(KinematicsError::Singular { .. })
        ));
        let robot = Robot::new(geometry()).unwrap();
        assert_eq!(
            LineMatrix::new(&robot, &pose, &[f64::NAN, 0.0, 0.0]),
            Err(KinematicsError::NotFinite)
        );
        let lines = LineMatrix::new(&robot, &pose, &q).unwrap();
        let wild = Wrench::from_array([f64::MAX; 6]);
        assert_eq!(lines.link_forces_n(&wild), Err(KinematicsError::NotFinite));
    }
}
