//! Pose of the platform under load: nonlinear, quasi-static equilibrium of links and carts as
//! springs `[T 3.3]`.
//!
//! World axes; moments about the tool centre point (TCP). `s_ij` points from platform to cart,
//! `l_ij = R b_ij`. `w = (F, M)` is what the environment applies to the platform, `f` are link
//! tensions:
//!
//! - balance `W f + w = 0` with `W = [s; l x s]` `[T 3.24]`, so the tensions follow from the pose
//!   alone `[T 3.25]`;
//! - length of a link: `L_i + c_ij f_ij`, plus the backlash in cluster 3 ([`Backlash`]);
//! - position of an axis: `q_i + c_i tau_i`, with `tau = t - D^T f` `[T 3.26]`, `t` what pushes at
//!   the axis itself.
//!
//! All three are evaluated at the *deflected* pose, which is found by stepping on the six length
//! errors. No mass, no damping: the platform is in equilibrium in every cycle. (A machine with mass is
//! in [`crate::dynamics`]; at home its first modes are at 7 Hz (F1) and 21 Hz (L2), which drives of 1 kHz do excite.)

use std::fmt;

use gantry_tau_core::model::f1;
use gantry_tau_core::model::kinematics::Pose as RigidPose;
use gantry_tau_core::model::robot::{ARM_OF_LINK, ARMS, LINKS};
use nalgebra::{Matrix6, Matrix6x3, Rotation3, SMatrix, SVector, UnitQuaternion, Vector3, Vector6};

use super::backlash::Backlash;
use super::compliances::RawCompliances;
use super::joints::{Corner, Plate, TurnAxes, plates};

/// The search ends when no step is larger than this, in metres and in radians.
pub const STEP_TOLERANCE: f64 = 1e-13;
/// Largest length error of a result, in metres. Rounding leaves about 1e-16 per metre of link.
pub const RESIDUAL_TOLERANCE_M: f64 = 1e-12;
/// Largest number of steps. At rest none is needed, after a step of the load up to 6, from a cold
/// start under 10.
pub const MAX_ITERATIONS: u32 = 30;
/// First link of cluster 3 in link order.
const CLUSTER_3: usize = 3;

/// Position of the TCP (metres) and orientation of the platform, world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// TCP, metres.
    pub translation_m: Vector3<f64>,
    /// Platform axes to world axes. A unit quaternion: it cannot drift away from a rotation over
    /// millions of warm starts.
    pub rotation: UnitQuaternion<f64>,
}

impl From<&RigidPose> for Pose {
    fn from(pose: &RigidPose) -> Self {
        let rotation = Rotation3::from_matrix_unchecked(pose.rotation);
        Self {
            translation_m: pose.position_m,
            rotation: UnitQuaternion::from_rotation_matrix(&rotation),
        }
    }
}

/// Pose under load, with the forces that hold it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Equilibrium<const N: usize> {
    /// Pose of the platform.
    pub pose: Pose,
    /// Tension of each link, newtons, link order; without the constant part that the weight causes.
    pub tensions_n: Vector6<f64>,
    /// Generalised load on each actuator, positive along `+q`: newtons times metres per unit of
    /// `q`, axis order.
    pub axis_loads: SVector<f64, N>,
    /// Steps taken.
    pub iterations: u32,
    /// Largest remaining length error, metres.
    pub residual_m: f64,
}

/// Reason why no equilibrium was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ElasticError {
    /// Axes, load or start are not finite.
    NotFinite,
    /// The links cannot take the load in this pose: their lines do not span all forces and moments.
    Singular,
    /// No equilibrium within [`MAX_ITERATIONS`].
    NotConverged {
        /// Largest remaining length error, metres.
        residual_m: f64,
    },
}

impl fmt::Display for ElasticError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite => f.write_str("axes, load or start pose are not finite"),
            Self::Singular => f.write_str("the links cannot carry a load in this pose"),
            Self::NotConverged { residual_m } => {
                write!(
                    f,
                    "no equilibrium after {MAX_ITERATIONS} steps, length error {residual_m:.1e} m"
                )
            }
        }
    }
}

impl std::error::Error for ElasticError {}

/// Links, axes and joint backlash of one machine with `N` axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElasticMachine<const N: usize> {
    geometry: f1::Geometry,
    /// Of the geometry.
    turn_axes: TurnAxes,
    compliances: RawCompliances<N>,
    backlash: Backlash,
}

impl<const N: usize> Equilibrium<N> {
    /// Returns a start for the search: at `pose`, with nothing loaded.
    #[must_use]
    pub fn unloaded(pose: Pose) -> Self {
        Self {
            pose,
            tensions_n: Vector6::zeros(),
            axis_loads: SVector::zeros(),
            iterations: 0,
            residual_m: 0.0,
        }
    }

    /// Returns a start for the search: the platform unturned with the TCP at `home_m`, with nothing
    /// loaded.
    #[must_use]
    pub fn at_home(home_m: [f64; 3]) -> Self {
        Self::unloaded(Pose {
            translation_m: home_m.into(),
            rotation: UnitQuaternion::identity(),
        })
    }

    /// Returns the sum of the tensions of links 31, 32, 33, newtons.
    #[must_use]
    pub fn cluster_3_n(&self) -> f64 {
        self.tensions_n.fixed_rows::<3>(CLUSTER_3).sum()
    }
}

impl<const N: usize> ElasticMachine<N> {
    /// Creates a machine with its *true* compliances.
    #[must_use]
    pub fn new(
        geometry: f1::Geometry,
        compliances: impl Into<RawCompliances<N>>,
        backlash: Backlash,
    ) -> Self {
        Self {
            turn_axes: TurnAxes::of(&geometry),
            geometry,
            compliances: compliances.into(),
            backlash,
        }
    }

    /// Returns the true compliances.
    #[must_use]
    pub const fn compliances(&self) -> &RawCompliances<N> {
        &self.compliances
    }

    /// Returns the geometry.
    #[must_use]
    pub const fn geometry(&self) -> &f1::Geometry {
        &self.geometry
    }

    /// Returns the backlash.
    #[must_use]
    pub const fn backlash(&self) -> &Backlash {
        &self.backlash
    }

    /// Returns the pose with the motors at `axes` (q-units) under `load` (force N, moment N m about
    /// the TCP, world axes). The search begins at `start`, which also chooses the assembly mode;
    /// the last cycle's result is the best start.
    ///
    /// With zero load this is the forward kinematics of the rigid machine.
    ///
    /// # Errors
    /// [`ElasticError`]. A result is finite and balanced, and fits every length to
    /// [`RESIDUAL_TOLERANCE_M`].
    pub fn equilibrium(
        &self,
        axes: &[f64; N],
        load: &Vector6<f64>,
        start: &Equilibrium<N>,
    ) -> Result<Equilibrium<N>, ElasticError> {
        self.pushed_equilibrium(axes, load, &SVector::zeros(), start)
    }

    /// As [`equilibrium`](Self::equilibrium), with further loads on the axes, such as a strap
    /// around a cart `[T 4.2.10]`: generalised, positive along `+q`, newtons times metres per unit
    /// of `q`.
    ///
    /// # Errors
    /// As [`equilibrium`](Self::equilibrium).
    pub fn pushed_equilibrium(
        &self,
        axes: &[f64; N],
        load: &Vector6<f64>,
        pushes: &SVector<f64, N>,
        start: &Equilibrium<N>,
    ) -> Result<Equilibrium<N>, ElasticError> {
        let motors = SVector::from(*axes);
        let mut now = *start;
        let given = motors.iter().chain(load.iter()).chain(pushes.iter());
        if !given.chain(now.axis_loads.iter()).all(|x| x.is_finite()) || !is_finite(&now.pose) {
            return Err(ElasticError::NotFinite);
        }
        for iterations in 0..=MAX_ITERATIONS {
            let lines = self.lines(&self.displaced(&motors, &now.axis_loads), &now.pose);
            let inverse = lines.matrix.try_inverse().ok_or(ElasticError::Singular)?;
            let tensions_n = -(inverse * load);
            let axis_loads = pushes - lines.drives.transpose() * tensions_n;
            // An unloaded machine has its axes where they were.
            let lengths_m = if axis_loads == now.axis_loads {
                lines.lengths_m
            } else {
                self.lengths_m(&self.displaced(&motors, &axis_loads), &now.pose)
            };
            let errors = lengths_m - self.loaded_lengths_m(&tensions_n);
            // Moving the platform by `step` shortens the links by W^T step.
            let step = inverse.transpose() * errors;
            let axis_step =
                self.displaced(&motors, &axis_loads) - self.displaced(&motors, &now.axis_loads);
            now = Equilibrium {
                tensions_n,
                axis_loads,
                iterations,
                residual_m: errors.amax(),
                ..now
            };
            // `amax` overlooks NaN.
            if !step.iter().chain(axis_loads.iter()).all(|x| x.is_finite()) {
                return Err(ElasticError::Singular);
            }
            if step.amax().max(axis_step.amax()) < STEP_TOLERANCE
                && now.residual_m < RESIDUAL_TOLERANCE_M
            {
                return Ok(now);
            }
            now.pose = moved(&now.pose, &step);
        }
        Err(ElasticError::NotConverged {
            residual_m: now.residual_m,
        })
    }

    /// Returns how loads go through the machine in an equilibrium with the motors at `axes`; `None`
    /// where the links cannot take them.
    #[must_use]
    pub fn transmission(&self, axes: &[f64; N], at: &Equilibrium<N>) -> Option<Transmission<N>> {
        let lines = self.lines(
            &self.displaced(&SVector::from(*axes), &at.axis_loads),
            &at.pose,
        );
        let directions = lines.matrix.fixed_rows::<3>(0).transpose();
        Some(Transmission {
            inverse: lines.matrix.try_inverse()?,
            directions,
            drives: lines.drives,
        })
    }

    /// Returns the axes behind their springs: `q_i + c_i tau_i`, q-units.
    fn displaced(&self, motors: &SVector<f64, N>, axis_loads: &SVector<f64, N>) -> SVector<f64, N> {
        motors + SVector::from(self.compliances.axes).component_mul(axis_loads)
    }

    /// Returns the joint of a link on its plate, the lever of that on the platform and the vector from
    /// this to the former, world axes, m.
    // Returned through memory it takes a sixth of the time of a simulation.
    #[inline(always)]
    fn link<'a>(
        &self,
        plates: &'a [Plate; ARMS],
        link: usize,
        q: &[f64; N],
        pose: &Pose,
    ) -> (Corner<'a>, Vector3<f64>, Vector3<f64>) {
        let joint = plates[ARM_OF_LINK[link]].corner(&self.geometry, link, q);
        let lever = pose.rotation * self.geometry.platform_joints_m[link];
        let vector = joint.place_m - (pose.translation_m + lever);
        (joint, lever, vector)
    }

    /// Returns the distances of the joints with the axes (not the motors) at `axes`, m, link order.
    fn lengths_m(&self, axes: &SVector<f64, N>, pose: &Pose) -> Vector6<f64> {
        let q = &axes.data.0[0];
        let plates = plates(&self.turn_axes, q);
        Vector6::from_fn(|link, _| {
            let (_, _, vector) = self.link(&plates, link, q, pose);
            vector.norm()
        })
    }

    /// Returns the tensions of links whose joints are so far apart, N. In the play of the joint of
    /// cluster 3 they follow by the sum of its tensions, which it grows with.
    #[must_use]
    pub fn tensions_n(&self, lengths_m: &Vector6<f64>) -> Vector6<f64> {
        let compliances = Vector6::from(self.compliances.links_m_per_n);
        let stretched_m = lengths_m - Vector6::from(self.geometry.lengths_m);
        let tension_n = |link: usize, play_m: f64| {
            let play_m = if link >= CLUSTER_3 { play_m } else { 0.0 };
            (stretched_m[link] - play_m) / compliances[link]
        };
        let play_m = self.backlash.settled_m(|play_m| {
            let cluster_3 = CLUSTER_3..LINKS;
            cluster_3.map(|link| tension_n(link, play_m)).sum()
        });
        Vector6::from_fn(|link, _| tension_n(link, play_m))
    }

    /// Returns the distances of the joints, `W` and `D` with the axes (not the motors) at `axes`.
    #[must_use]
    pub fn lines(&self, axes: &SVector<f64, N>, pose: &Pose) -> LineMatrices<N> {
        let mut lines = LineMatrices {
            lengths_m: Vector6::zeros(),
            matrix: Matrix6::zeros(),
            drives: SMatrix::zeros(),
        };
        let q = &axes.data.0[0];
        let plates = plates(&self.turn_axes, q);
        for link in 0..LINKS {
            let (joint, lever, vector) = self.link(&plates, link, q, pose);
            let length_m = vector.norm();
            lines.lengths_m[link] = length_m;
            let direction = vector / length_m;
            let moment = lever.cross(&direction);
            lines
                .matrix
                .fixed_view_mut::<3, 1>(0, link)
                .copy_from(&direction);
            lines
                .matrix
                .fixed_view_mut::<3, 1>(3, link)
                .copy_from(&moment);
            for axis in 0..N {
                if let Some(slope) = joint.slope(axis) {
                    lines.drives[(link, axis)] = direction.dot(&slope);
                }
            }
        }
        lines
    }

    /// Returns the lengths of the links under these tensions, with the play of their joints, m.
    fn loaded_lengths_m(&self, tensions_n: &Vector6<f64>) -> Vector6<f64> {
        let play_m = self
            .backlash
            .elongation_m(tensions_n.fixed_rows::<3>(CLUSTER_3).sum());
        Vector6::from_fn(|link, _| {
            let spring_m = self.compliances.links_m_per_n[link] * tensions_n[link];
            let joint_m = if link >= CLUSTER_3 { play_m } else { 0.0 };
            let length_m = self.geometry.lengths_m[link];
            length_m + spring_m + joint_m
        })
    }
}

/// Path of loads through the machine in one pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transmission<const N: usize> {
    inverse: Matrix6<f64>,
    /// `s_ij`, by rows.
    directions: Matrix6x3<f64>,
    drives: SMatrix<f64, 6, N>,
}

impl<const N: usize> Transmission<N> {
    /// Tensions of the links under a load on the platform (about the tool centre point, world
    /// axes), newtons: `-W^-1 w`.
    #[must_use]
    pub fn tensions_n(&self, load: &Vector6<f64>) -> Vector6<f64> {
        -(self.inverse * load)
    }

    /// Elongations of the links with the platform moved and not turned, and the axes shifted
    /// (q-units), m: `s . (dA - dT)`.
    #[must_use]
    pub fn elongations_m(&self, moved_m: &Vector3<f64>, shifts: &SVector<f64, N>) -> Vector6<f64> {
        self.drives * shifts - self.directions * moved_m
    }

    /// Loads of the axes under these tensions, and pushed at: `t - D^T f`.
    #[must_use]
    pub fn axis_loads(
        &self,
        tensions_n: &Vector6<f64>,
        pushes: &SVector<f64, N>,
    ) -> SVector<f64, N> {
        pushes - self.drives.transpose() * tensions_n
    }
}

/// Distances of the links' joints, line matrix `W` (6 x 6) and `D_(ij),k = s_ij . dA_ij/dq_k`
/// (6 x N).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineMatrices<const N: usize> {
    /// Distances of the joints, m, link order.
    pub lengths_m: Vector6<f64>,
    /// `W`.
    pub matrix: Matrix6<f64>,
    /// `D`.
    pub drives: SMatrix<f64, 6, N>,
}

/// Returns `T + dT`, `exp(dtheta) R`.
fn moved(pose: &Pose, step: &Vector6<f64>) -> Pose {
    let translation = Vector3::new(step[0], step[1], step[2]);
    let turn = Vector3::new(step[3], step[4], step[5]);
    let rotation = UnitQuaternion::from_scaled_axis(turn) * pose.rotation;
    Pose {
        translation_m: pose.translation_m + translation,
        rotation: UnitQuaternion::new_normalize(rotation.into_inner()),
    }
}

fn is_finite(pose: &Pose) -> bool {
    let rotation = pose.rotation.coords.iter();
    pose.translation_m
        .iter()
        .chain(rotation)
        .all(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elastic::fixture;
    use gantry_tau_core::model::robot::ARMS;
    use gantry_tau_test_support::vectors::{Case, Vectors};

    /// Equilibrium of a case with a share of its load, from its own pose.
    fn under_load<const N: usize>(
        vectors: &Vectors<N>,
        case: &Case<N>,
        axes: &[f64; N],
        share: f64,
    ) -> Equilibrium<N> {
        let start = Equilibrium::unloaded(fixture::pose(case));
        fixture::machine(vectors)
            .equilibrium(axes, &(case.load * share), &start)
            .unwrap()
    }

    fn finds_the_unloaded_pose<const N: usize>(
        vectors: &Vectors<N>,
        away: [f64; 6],
        tolerance: f64,
        steps: u32,
    ) {
        for case in &vectors.cases {
            let start = Equilibrium::unloaded(moved(&fixture::pose(case), &away.into()));
            let found = fixture::machine(vectors)
                .equilibrium(&case.q, &Vector6::zeros(), &start)
                .unwrap();
            assert!(
                (found.pose.translation_m - fixture::pose(case).translation_m).amax() < tolerance
            );
            assert!(found.pose.rotation.angle_to(&fixture::pose(case).rotation) < tolerance);
            assert!(found.iterations <= steps, "{} steps", found.iterations);
        }
    }

    #[test]
    fn unloaded_it_is_the_forward_kinematics() {
        finds_the_unloaded_pose(
            &Vectors::l2(),
            [0.02, -0.01, 0.015, 0.0, 0.0, 0.0],
            1e-12,
            8,
        );
        finds_the_unloaded_pose(
            &Vectors::f1(),
            [0.02, -0.01, 0.015, 0.02, 0.01, -0.03],
            1e-11,
            MAX_ITERATIONS,
        );
    }

    /// Both signs of a share of the load, so that the second order cancels; a small one, so that
    /// the third vanishes.
    fn agrees_to_first_order<const N: usize>(vectors: &Vectors<N>, share: f64) {
        for case in &vectors.cases {
            let [ahead, back] =
                [share, -share].map(|share| under_load(vectors, case, &case.q, share));
            let tensions = (ahead.tensions_n - back.tensions_n) / (2.0 * share);
            let loads = (ahead.axis_loads - back.axis_loads) / (2.0 * share);
            assert!((tensions - case.tensions_n).amax() < 1e-6 * case.tensions_n.amax());
            assert!((loads - case.axis_loads).amax() < 1e-6 * case.axis_loads.amax());
            if let Some(compliance) = &case.compliance {
                let (ahead, back) = (ahead.pose, back.pose);
                let shift = (ahead.translation_m - back.translation_m) / (2.0 * share);
                let turn = (ahead.rotation * back.rotation.inverse()).scaled_axis() / (2.0 * share);
                let expected = compliance * case.load;
                let found = Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z);
                assert!(
                    (found - expected).amax() < 1e-6 * expected.amax(),
                    "{found} {expected}"
                );
            }
        }
    }

    #[test]
    fn small_loads_agree_with_the_vectors_to_first_order() {
        let l2 = Vectors::l2();
        assert!(l2.cases.iter().all(|case| case.compliance.is_some()));
        agrees_to_first_order(&l2, 1e-3);
        // The axes of the F1 yield by millimetres under the full load.
        agrees_to_first_order(&Vectors::f1(), 1e-6);
    }

    /// Energy of links and carts less the work of the load, with the platform moved and the carts
    /// shifted.
    fn potential(
        machine: &ElasticMachine<ARMS>,
        motors: &[f64; 3],
        carts: &Vector3<f64>,
        pose: &Pose,
        load: &Vector6<f64>,
        moved_by: &Vector6<f64>,
    ) -> f64 {
        let compliances = machine.compliances();
        let mut energy = -load.dot(moved_by);
        let lengths_m = machine.lengths_m(carts, pose);
        for link in 0..LINKS {
            let length = machine.geometry.lengths_m[link];
            let elongation = lengths_m[link] - length;
            energy += elongation * elongation / (2.0 * compliances.links_m_per_n[link]);
        }
        for arm in 0..ARMS {
            let shift = carts[arm] - motors[arm];
            energy += shift * shift / (2.0 * compliances.axes[arm]);
        }
        energy
    }

    #[test]
    fn the_potential_is_stationary() {
        let l2 = Vectors::l2();
        let machine = fixture::machine(&l2);
        for case in &l2.cases {
            let found = under_load(&l2, case, &case.q, 1.0);
            let carts = machine.displaced(&Vector3::from(case.q), &found.axis_loads);
            let h = 1e-7;
            for direction in 0..LINKS + ARMS {
                let [behind, ahead] = [-1.0, 1.0].map(|sign| {
                    let mut step = Vector6::zeros();
                    let mut carts = carts;
                    if direction < LINKS {
                        step[direction] = sign * h;
                    } else {
                        carts[direction - LINKS] += sign * h;
                    }
                    let pose = moved(&found.pose, &step);
                    potential(&machine, &case.q, &carts, &pose, &case.load, &step)
                });
                let slope = (ahead - behind) / (2.0 * h);
                // A force or moment left over, against loads of hundreds of newtons.
                assert!(slope.abs() < 1e-4, "direction {direction}: {slope:e}");
            }
        }
    }

    #[test]
    fn the_work_of_a_slow_load_is_stored_in_the_springs() {
        let l2 = Vectors::l2();
        let (machine, case) = (fixture::machine(&l2), &l2.cases[0]);
        let mut last = Equilibrium::unloaded(fixture::pose(case));
        let steps = 200;
        let mut work = 0.0;
        for step in 1..=steps {
            let middle = case.load * ((f64::from(step) - 0.5) / f64::from(steps));
            let full = case.load * (f64::from(step) / f64::from(steps));
            let now = machine.equilibrium(&case.q, &full, &last).unwrap();
            let shift = now.pose.translation_m - last.pose.translation_m;
            let turn = (now.pose.rotation * last.pose.rotation.inverse()).scaled_axis();
            work += middle.fixed_rows::<3>(0).dot(&shift) + middle.fixed_rows::<3>(3).dot(&turn);
            last = now;
        }
        let carts = machine.displaced(&Vector3::from(case.q), &last.axis_loads);
        let stored = potential(
            &machine,
            &case.q,
            &carts,
            &last.pose,
            &case.load,
            &Vector6::zeros(),
        );
        assert!((work - stored).abs() < 1e-5 * stored, "{work} {stored}");
    }

    #[test]
    fn forces_balance_at_the_deflected_pose() {
        let l2 = Vectors::l2();
        let machine = fixture::machine(&l2);
        for case in &l2.cases {
            let found = under_load(&l2, case, &case.q, 1.0);
            let carts = machine.displaced(&Vector3::from(case.q), &found.axis_loads);
            let lines = machine.lines(&carts, &found.pose);
            let left = (lines.matrix * found.tensions_n + case.load).amax();
            assert!(left < 1e-9, "{left:e} N");
            assert!(found.residual_m < RESIDUAL_TOLERANCE_M);
            assert!(found.iterations <= 10, "{} steps", found.iterations);
        }
    }

    /// The sign test between this model and the compensation: the vectors' `q_comp` must bring back
    /// the tool, and six axes the platform.
    fn is_brought_back<const N: usize>(vectors: &Vectors<N>) {
        for case in &vectors.cases {
            // First order, so a hundredth of load and correction leaves a hundredth of the share.
            let scale = 0.01;
            let compensated = std::array::from_fn(|axis| {
                case.q[axis] + scale * (case.q_compensated[axis] - case.q[axis])
            });
            let [before, after] = [case.q, compensated].map(|axes| {
                let pose = under_load(vectors, case, &axes, scale).pose;
                let shift = (pose.translation_m - fixture::pose(case).translation_m).norm();
                (shift, pose.rotation.angle_to(&fixture::pose(case).rotation))
            });
            assert!(after.0 < 0.01 * before.0, "{before:?}, then {after:?}");
            assert!(
                N == ARMS || after.1 < 0.01 * before.1,
                "{before:?}, then {after:?}"
            );
        }
    }

    #[test]
    fn the_compensation_of_the_vectors_brings_the_tool_back() {
        is_brought_back(&Vectors::l2());
        is_brought_back(&Vectors::f1());
    }

    #[test]
    fn a_warm_start_changes_nothing_but_the_effort() {
        let l2 = Vectors::l2();
        let case = &l2.cases[0];
        let first = under_load(&l2, case, &case.q, 1.0);
        let again = fixture::machine(&l2)
            .equilibrium(&case.q, &case.load, &first)
            .unwrap();
        assert_eq!(again.iterations, 0);
        assert_eq!(again.pose, first.pose);
    }

    #[test]
    fn says_why_there_is_no_result() {
        let l2 = Vectors::l2();
        let case = &l2.cases[0];
        let start = Equilibrium::unloaded(fixture::pose(case));
        let machine = fixture::machine(&l2);
        let mut bad = Vector6::zeros();
        bad[4] = f64::NAN;
        assert_eq!(
            machine.equilibrium(&case.q, &bad, &start),
            Err(ElasticError::NotFinite)
        );
        // Carts too far apart for the links.
        let apart = [case.q[0] + 5.0, case.q[1] - 5.0, case.q[2]];
        let none = machine.equilibrium(&apart, &Vector6::zeros(), &start);
        assert!(none.is_err());
        let none = machine.equilibrium(&case.q, &Vector6::repeat(1e300), &start);
        assert!(none.is_err());
    }

    /// Without a load on the tool no link is under tension, so a push only moves its own axis, by
    /// `c t`.
    #[test]
    fn a_push_moves_its_axis() {
        let vectors = Vectors::f1();
        let machine = fixture::machine(&vectors);
        let case = &vectors.cases[0];
        let start = Equilibrium::unloaded(fixture::pose(case));
        for axis in 0..6 {
            let mut pushes = SVector::zeros();
            pushes[axis] = 700.0;
            let pushed = machine
                .pushed_equilibrium(&case.q, &Vector6::zeros(), &pushes, &start)
                .unwrap();
            let mut moved = case.q;
            moved[axis] += 700.0 * machine.compliances().axes[axis];
            let expected = machine
                .equilibrium(&moved, &Vector6::zeros(), &start)
                .unwrap();
            assert!(
                (pushed.pose.translation_m - expected.pose.translation_m).amax() < 1e-11,
                "axis {axis}"
            );
            assert!(pushed.tensions_n.amax() < 1e-9 && (pushed.axis_loads - pushes).amax() < 1e-9);
        }
    }
}
