//! Load on the platform from the force sensor. The sensor turns with the platform, 2.5 mrad at 300
//! N on an L2, so what it sees is turned back by the rotation that the file's springs predict.

use gantry_tau_machine::elastic::backlash::Backlash;
use gantry_tau_machine::elastic::{ElasticError, ElasticMachine, Equilibrium, Pose};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{RobotFile, RobotFileError};
use gantry_tau_machine::sensor::Mounting;
use nalgebra::{Matrix6, UnitQuaternion, Vector6};
use thiserror::Error;

use crate::measurements::wrench_columns::WrenchMap;

/// Rounds of load and rotation: each one multiplies the error by a few thousandths.
const ROUNDS: u32 = 4;

/// The machine as its file describes it.
#[derive(Clone, Debug)]
pub struct Prediction<const N: usize> {
    machine: ElasticMachine<N>,
    mounting: Mounting,
}

impl<const N: usize> Prediction<N> {
    /// Creates the prediction of a robot file, without play.
    ///
    /// # Errors
    /// [`RobotFileError`]: the file has no compliances.
    pub fn new<K: MachineKind<N>>(robot: &RobotFile<K, N>) -> Result<Self, RobotFileError> {
        let compliances =
            robot.compliances_for("they predict how the platform turns under load")?;
        let machine = ElasticMachine::new(robot.model.geometry(), *compliances, Backlash::NONE);
        Ok(Self {
            machine,
            mounting: (&robot.sensor).into(),
        })
    }

    /// Returns the unloaded machine with the axes at `q`, q-units, near `pose`.
    ///
    /// # Errors
    /// [`ElasticError`].
    pub fn unloaded(
        &self,
        q: &[f64; N],
        pose: &gantry_tau_core::model::kinematics::Pose,
    ) -> Result<Equilibrium<N>, ElasticError> {
        unloaded(&self.machine, q, pose)
    }

    /// Returns what the sensor shows without a load, except for its zero error; force (N) and
    /// moment (N m) in sensor axes.
    #[must_use]
    pub fn weight_seen(&self, platform: &UnitQuaternion<f64>) -> Vector6<f64> {
        self.mounting.seen(&Vector6::zeros(), platform)
    }

    /// Returns how the load follows from what the sensor sees, with the platform as in a pose.
    pub(super) fn wrench_map(&self, pose: &gantry_tau_core::model::kinematics::Pose) -> WrenchMap {
        let platform = UnitQuaternion::from_matrix(&pose.rotation);
        WrenchMap {
            load_of_columns: linear_part(|seen| self.mounting.load(seen, &platform)),
            columns_of_load: linear_part(|load| self.mounting.seen(load, &platform)),
        }
    }

    /// Returns the load on the platform, about the tool centre point where it is, world axes, from
    /// what the sensor sees (sensor axes, its zero error taken off), with the axes at `q`; `start`
    /// is the unloaded machine.
    ///
    /// # Errors
    /// [`NotBorne`].
    pub fn load(
        &self,
        seen: &Vector6<f64>,
        q: &[f64; N],
        start: &Equilibrium<N>,
    ) -> Result<Vector6<f64>, NotBorne> {
        self.load_and_turn(seen, q, start).map(|(load, _)| load)
    }

    /// As [`load`](Self::load), with the rotation of the platform that was predicted.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn load_and_turn(
        &self,
        seen: &Vector6<f64>,
        q: &[f64; N],
        start: &Equilibrium<N>,
    ) -> Result<(Vector6<f64>, UnitQuaternion<f64>), NotBorne> {
        let mut now = *start;
        for _ in 0..ROUNDS {
            let load = self.turned(seen, &now.pose.rotation);
            now = self
                .machine
                .equilibrium(q, &load, &now)
                .map_err(|error| NotBorne::new(seen, error))?;
        }
        Ok((self.turned(seen, &now.pose.rotation), now.pose.rotation))
    }

    /// Returns the load with the platform in a rotation that is known.
    #[must_use]
    pub fn turned(&self, seen: &Vector6<f64>, platform: &UnitQuaternion<f64>) -> Vector6<f64> {
        self.mounting.load(seen, platform)
    }
}

/// Matrix of an affine map.
fn linear_part(map: impl Fn(&Vector6<f64>) -> Vector6<f64>) -> Matrix6<f64> {
    let zero = map(&Vector6::zeros());
    Matrix6::from_columns(&[0, 1, 2, 3, 4, 5].map(|column| map(&Vector6::ith(column, 1.0)) - zero))
}

/// A load that the sensor shows, under which the robot file's machine has no equilibrium.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[error(
    "the sensor shows {force_n:.0} N and {moment_nm:.0} N m, which the robot file's machine does not bear: {error}; look at the sensor's units"
)]
pub struct NotBorne {
    /// Size of the force, N.
    pub force_n: f64,
    /// Size of the moment, N m.
    pub moment_nm: f64,
    /// The elastic model's error.
    pub error: ElasticError,
}

impl NotBorne {
    fn new(seen: &Vector6<f64>, error: ElasticError) -> Self {
        let [force_n, moment_nm] = [0, 3].map(|first| seen.fixed_rows::<3>(first).norm());
        Self {
            force_n,
            moment_nm,
            error,
        }
    }
}

/// Returns a machine unloaded, with the axes at `q`, near `pose`.
pub(crate) fn unloaded<const N: usize>(
    machine: &ElasticMachine<N>,
    q: &[f64; N],
    pose: &gantry_tau_core::model::kinematics::Pose,
) -> Result<Equilibrium<N>, ElasticError> {
    let start = Pose {
        translation_m: pose.position_m,
        rotation: UnitQuaternion::from_matrix(&pose.rotation),
    };
    machine.equilibrium(q, &Vector6::zeros(), &Equilibrium::unloaded(start))
}
