//! Feed-forward of inertia: the load by which the nominal motion bends the machine, before it does.
//!
//! By the accelerations of the nominal pose and of the axes, `Q = -M(x) (a, alpha, ddq)` acts on
//! the platform and on the axes like a load. They are second differences of the poses, and not
//! `J ddq` with the Jacobian of a place: that changes with speed, too. The forces at constant rates
//! are left out.
#![expect(
    clippy::indexing_slicing,
    reason = "off the reference path: arrays have a length of N"
)]

use gantry_tau_core::model::compensation::Correction;
use gantry_tau_core::units::{CrossingError, Metres, OffsetNm, TorquePermille};
use gantry_tau_machine::dynamics::{Coordinates, MassiveMachine};
use gantry_tau_machine::elastic::Pose;
use gantry_tau_machine::robot_file::CYCLE_US;
use gantry_tau_machine::stability::Filter;
use gantry_tau_machine::stability::filter::Past;
use nalgebra::{SVector, Vector6};

/// Cut-off of the accelerations, Hz: nominal positions have steps of 1 nm.
const CUTOFF_HZ: f64 = 60.0;
/// Largest acceleration of the tool centre point that is fed forward, m/s^2. A nominal reference
/// that jumps has a thousand.
const MAX_M_PER_S2: f64 = 20.0;
/// Longest gap between two poses, ticks; after a longer one the differences are restarted.
const MAX_GAP: u64 = 10;

/// Loads of the nominal motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct InertialLoads<const N: usize> {
    /// `Q` on the platform, about the tool centre point, and on the axes, along `+q`.
    pub(crate) on_machine: Coordinates<N>,
    /// Load that the force sensor reads of the tool's inertia, as far as no accelerometer takes it
    /// out, about the tool centre point, world axes.
    pub(crate) on_sensor: Vector6<f64>,
    /// Accelerations of the axes, q-units.
    pub(crate) accelerations: SVector<f64, N>,
}

/// Torque of the motors of each axis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TorqueScale<const N: usize> {
    /// Per mille of each motor's rated torque by a force on the axis at the drives' metre, 1/N.
    pub(crate) permille_per_n: [f64; N],
    /// Largest magnitude, per mille.
    pub(crate) most: [i16; N],
}

/// Nominal motion of a machine with masses.
#[derive(Clone, Debug)]
pub(crate) struct FeedForward<const N: usize> {
    machine: MassiveMachine<N>,
    low_pass: Filter,
    /// Of the low-pass, per coordinate.
    platform: [[Past; 1]; 6],
    axes: [[Past; 1]; N],
    /// The last place and its tick.
    last: Option<(u64, Pose, [f64; N])>,
    /// Rates on the way there, and the ticks it took.
    rates: Option<(Coordinates<N>, f64)>,
    metres_per_q: [f64; N],
    /// Largest magnitude of each axis' offset.
    limits: [OffsetNm; N],
    /// Torques that are asked for, if any are.
    torques: Option<TorqueScale<N>>,
    /// Share of the correction that is asked for, 0 to 1.
    pub(crate) gain: f64,
}

impl<const N: usize> FeedForward<N> {
    pub(crate) fn new(
        machine: MassiveMachine<N>,
        metres_per_q: [f64; N],
        limits: [OffsetNm; N],
        torques: Option<TorqueScale<N>>,
        gain: f64,
    ) -> Self {
        Self {
            machine,
            metres_per_q,
            limits,
            torques,
            gain,
            low_pass: Filter::butterworth(CUTOFF_HZ),
            platform: Default::default(),
            axes: [Default::default(); N],
            last: None,
            rates: None,
        }
    }

    /// Takes the nominal pose and axes (q-units) of a tick. Returns the loads of the motion; zero
    /// until it is known.
    pub(crate) fn update(&mut self, tick: u64, pose: &Pose, axes: &[f64; N]) -> InertialLoads<N> {
        let accelerations = self.accelerations(tick, pose, axes);
        let filtered = self.filtered(&accelerations);
        self.loads(pose, axes, &filtered)
    }

    /// Returns the second differences of the places, per second squared.
    fn accelerations(&mut self, tick: u64, pose: &Pose, axes: &[f64; N]) -> Coordinates<N> {
        let before = self.last.replace((tick, *pose, *axes));
        let began = self.rates.take();
        let Some((last, last_pose, last_axes)) = before else {
            return Coordinates::zeros();
        };
        let gap = tick.wrapping_sub(last);
        if !(1..=MAX_GAP).contains(&gap) {
            return Coordinates::zeros();
        }
        let ticks = gap as f64;
        let turned_rad = (pose.rotation * last_pose.rotation.inverse()).scaled_axis();
        let moved_m = pose.translation_m - last_pose.translation_m;
        let mut moved = Coordinates::zeros();
        moved.platform.fixed_rows_mut::<3>(0).copy_from(&moved_m);
        moved.platform.fixed_rows_mut::<3>(3).copy_from(&turned_rad);
        moved.axes = SVector::from(*axes) - SVector::from(last_axes);
        let cycle_s = f64::from(CYCLE_US) * 1e-6;
        let rates = moved * (ticks * cycle_s).recip();
        self.rates = Some((rates, ticks));
        match began {
            Some((before, gap)) => (rates - before) * (0.5 * (ticks + gap) * cycle_s).recip(),
            None => Coordinates::zeros(),
        }
    }

    /// Adds the deflection of the axes' springs under their own loads (q-units) to a correction.
    ///
    /// # Errors
    /// A load is NaN.
    pub(crate) fn correct_axes(
        &self,
        loads: &SVector<f64, N>,
        correction: &mut Correction<N>,
    ) -> Result<(), CrossingError> {
        let compliances = &self.machine.elastic.compliances().axes;
        for axis in 0..N {
            let deflected_m = compliances[axis] * loads[axis] * self.metres_per_q[axis];
            let offset_m = correction.offsets[axis].to_metres().0 - self.gain * deflected_m;
            let (offset, is_cut) =
                OffsetNm::from_metres_within(Metres(offset_m), self.limits[axis])?;
            correction.offsets[axis] = offset;
            correction.saturated[axis] |= is_cut;
        }
        Ok(())
    }

    /// Returns the torques of the drives for a motion: `G^T Q` of what is behind the springs, and
    /// their own mass. Zero unless they are asked for.
    pub(crate) fn torques(
        &self,
        pose: &Pose,
        axes: &[f64; N],
        loads: &InertialLoads<N>,
    ) -> [TorquePermille; N] {
        let mut torques = [TorquePermille(0); N];
        let motion = self.machine.rigid_motion(pose, axes);
        let (Some(scale), Some(motion)) = (&self.torques, motion) else {
            return torques;
        };
        let on_axes = motion.transpose() * loads.on_machine.platform + loads.on_machine.axes;
        let motors_kg = &self.machine.masses.motors_kg;
        for axis in 0..N {
            let metres = self.metres_per_q[axis];
            let own_n = motors_kg[axis] * loads.accelerations[axis] * metres;
            let force_n = own_n - on_axes[axis] / metres;
            let most = f64::from(scale.most[axis]);
            let permille = self.gain * force_n * scale.permille_per_n[axis];
            torques[axis] = TorquePermille(permille.round().clamp(-most, most) as i16);
        }
        torques
    }

    fn filtered(&mut self, accelerations: &Coordinates<N>) -> Coordinates<N> {
        let low_pass = &self.low_pass;
        let mut filtered = *accelerations;
        let platform = filtered.platform.iter_mut().zip(&mut self.platform);
        for (component, past) in platform.chain(filtered.axes.iter_mut().zip(&mut self.axes)) {
            *component = low_pass.next(past, *component);
        }
        filtered
    }

    fn loads(&self, pose: &Pose, axes: &[f64; N], motion: &Coordinates<N>) -> InertialLoads<N> {
        let norm = motion.platform.fixed_rows::<3>(0).norm();
        let motion = *motion * (MAX_M_PER_S2 / norm).min(1.0);
        let masses = self.machine.mass_matrix(pose, axes);
        let tool = self.machine.felt_tool(&pose.rotation);
        InertialLoads {
            on_machine: masses.times(&motion) * -1.0,
            on_sensor: -(tool * motion.platform),
            accelerations: motion.axes,
        }
    }
}

#[cfg(test)]
mod tests {
    use gantry_tau_machine::robot_file::RobotFile;
    use nalgebra::UnitQuaternion;

    use super::*;

    /// The F1, whose last three axes have 0.1 m per radian, at home.
    fn f1() -> (FeedForward<6>, Pose, [f64; 6]) {
        let robot = RobotFile::builtin_f1().unwrap();
        let feed_forward = FeedForward::new(
            MassiveMachine::of(&robot).unwrap(),
            robot.metres_per_q,
            [OffsetNm(i32::MAX); 6],
            Some(TorqueScale {
                permille_per_n: [50.0; 6],
                most: [i16::MAX; 6],
            }),
            1.0,
        );
        let pose = Pose {
            translation_m: robot.home_m(),
            rotation: UnitQuaternion::identity(),
        };
        (feed_forward, pose, robot.home_q().unwrap())
    }

    /// By `tau dq = F dx`: at accelerations of the axes that are like their rates, the power of the
    /// motors is twice the kinetic energy per second, that of the motors included.
    #[test]
    fn torques_move_all_masses() {
        let (feed_forward, pose, q) = f1();
        let motion = feed_forward.machine.rigid_motion(&pose, &q).unwrap();
        for axis in 0..6 {
            let mut rates = SVector::<f64, 6>::zeros();
            rates[axis] = 0.7;
            rates[(axis + 1) % 6] = -0.4;
            let moved = Coordinates {
                platform: motion * rates,
                axes: rates,
            };
            let momentum = feed_forward.machine.mass_matrix(&pose, &q).times(&moved);
            let along = SVector::from(feed_forward.metres_per_q).component_mul(&rates);
            let motors_kg = SVector::from(feed_forward.machine.masses.motors_kg);
            let twice_j = momentum.platform.dot(&moved.platform)
                + momentum.axes.dot(&rates)
                + motors_kg.dot(&along.component_mul(&along));
            let loads = feed_forward.loads(&pose, &q, &moved);
            let torques = feed_forward.torques(&pose, &q, &loads);
            let power: f64 = (torques.iter().zip(along.iter()))
                .map(|(permille, along)| f64::from(permille.0) / 50.0 * along)
                .sum();
            // Two whole per mille, each off by a half.
            assert!((power - twice_j).abs() < 0.011, "{power} {twice_j}");
            assert!(twice_j > 0.2, "{twice_j}");
        }
    }

    /// An axis is asked for a place in front of that of its spring, in metres of its drive.
    #[test]
    fn springs_of_the_axes_are_made_up_for_in_metres_of_the_drives() {
        let (feed_forward, ..) = f1();
        let compliances = feed_forward.machine.elastic.compliances().axes;
        let loads = SVector::from([100.0, -100.0, 50.0, 10.0, -10.0, 5.0]);
        let mut correction = Correction::ZERO;
        feed_forward.correct_axes(&loads, &mut correction).unwrap();
        for axis in 0..6 {
            let deflected_m = compliances[axis] * loads[axis] * if axis < 3 { 1.0 } else { 0.1 };
            let off_m = correction.offsets[axis].to_metres().0 + deflected_m;
            assert!(
                off_m.abs() < 1e-9 && deflected_m.abs() > 1e-8,
                "axis {axis}"
            );
        }
        let nan = SVector::from([f64::NAN; 6]);
        assert!(feed_forward.correct_axes(&nan, &mut correction).is_err());
    }
}
