//! Inertia of the tool, as an accelerometer on the platform measures it.

use gantry_tau_machine::accelerometer::Accelerometer;
use gantry_tau_machine::masses::RigidBody;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use nalgebra::{UnitQuaternion, Vector3, Vector6};

/// Largest linear zero error that a tare takes away, m/s^2: more is gravity in another axis, in
/// another unit, or without the file's word.
const MAX_ZERO_M_PER_S2: f64 = 1.0;
/// Largest component of a sample, m/s^2 and rad/s^2.
const MAX_COMPONENT: f64 = 1e4;
/// Largest distance of the ticks of a force sample and of the acceleration that belongs to it.
pub(crate) const MAX_APART: u64 = 1;

/// Reason against a sample of the accelerometer.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum AccelerometerError {
    /// None belongs to the force sample.
    #[error("the accelerometer has no sample within {MAX_APART} ms of the force sample")]
    Missing,
    /// A component is NaN, infinite or larger than any motion.
    #[error("the accelerometer shows {0}; expected at most {MAX_COMPONENT} m/s^2 or rad/s^2")]
    OutOfRange(f64),
    /// The mean of the tare is not that of a machine at rest.
    #[error(
        "the accelerometer shows ({:.2}, {:.2}, {:.2}) m/s^2 at rest, and ({:.2}, {:.2}, {:.2}) is expected: does the machine stand, and are the axes, the unit and `gravity` those of sensor.accelerometer?",
        shown[0], shown[1], shown[2], expected[0], expected[1], expected[2]
    )]
    NotAtRest {
        /// Mean of the tare, m/s^2, its axes.
        shown: [f64; 3],
        /// Sample of one without a zero error, m/s^2.
        expected: [f64; 3],
    },
}

/// Accelerometer of a machine, and the tool that it moves with.
#[derive(Clone, Debug)]
pub(crate) struct MeasuredInertia {
    accelerometer: Accelerometer,
    tool: RigidBody,
    tare_samples: u32,
    /// Number of samples of the tare so far.
    tared: u32,
    /// Their sum, less what a machine at rest shows.
    sum: Vector6<f64>,
}

impl MeasuredInertia {
    /// Accelerometer of a robot file. `None` without one, or without masses.
    pub(crate) fn of<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>) -> Option<Self> {
        Some(Self {
            accelerometer: robot.sensor.accelerometer?.into(),
            tool: robot.masses?.tool,
            tare_samples: robot.sensor.tare_samples,
            tared: 0,
            sum: Vector6::zeros(),
        })
    }

    /// Returns the share of what the tool's motion takes, about the tool centre point, world axes,
    /// with the platform turned by `platform`; zero while taring.
    ///
    /// # Errors
    /// [`AccelerometerError`].
    pub(crate) fn update(
        &mut self,
        sample: Option<&[f64; 6]>,
        platform: &UnitQuaternion<f64>,
    ) -> Result<Vector6<f64>, AccelerometerError> {
        let sample = Vector6::from(*sample.ok_or(AccelerometerError::Missing)?);
        let range = -MAX_COMPONENT..=MAX_COMPONENT;
        if let Some(value) = sample.iter().find(|value| !range.contains(*value)) {
            return Err(AccelerometerError::OutOfRange(*value));
        }
        if self.tared < self.tare_samples {
            self.sum += sample - self.at_rest(platform);
            self.tared += 1;
            return Ok(Vector6::zeros());
        }
        let zero = self.sum / f64::from(self.tare_samples);
        if zero.fixed_rows::<3>(0).norm() > MAX_ZERO_M_PER_S2 {
            let [expected, shown] = [self.at_rest(platform), self.at_rest(platform) + zero]
                .map(|both| both.fixed_rows::<3>(0).into_owned().into());
            return Err(AccelerometerError::NotAtRest { shown, expected });
        }
        Ok(self
            .accelerometer
            .tool_load(&self.tool, &(sample - zero), platform))
    }

    /// Sample at rest, without a zero error.
    fn at_rest(&self, platform: &UnitQuaternion<f64>) -> Vector6<f64> {
        self.accelerometer
            .seen(&Vector6::zeros(), &Vector3::zeros(), platform)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gantry_tau_machine::robot_file::AccelerometerKeys;

    fn robot() -> RobotFile<gantry_tau_machine::model::L2, 3> {
        let mut robot = RobotFile::builtin_l2().unwrap();
        robot.sensor.tare_samples = 4;
        robot.sensor.accelerometer = Some(AccelerometerKeys {
            place_m: robot.sensor.tool.centre_m,
            axes: 3,
            rotation: [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
            share: 0.5,
            gravity: true,
        });
        robot
    }

    const AT_REST: [f64; 6] = [0.1, -0.2, 9.9, 0.0, 0.0, 0.0];

    #[test]
    fn a_zero_error_is_tared_and_the_motion_remains() {
        let mut inertia = MeasuredInertia::of(&robot()).unwrap();
        let level = UnitQuaternion::identity();
        for _ in 0..4 {
            assert_eq!(inertia.update(Some(&AT_REST), &level), Ok(Vector6::zeros()));
        }
        // Its y is -x of the platform.
        let mut moving = AT_REST;
        moving[1] -= 2.0;
        let load = inertia.update(Some(&moving), &level).unwrap();
        let half_kg = 0.5 * robot().masses.unwrap().tool.mass_kg;
        assert!((load[0] - 2.0 * half_kg).abs() < 1e-12, "{load}");
        assert!(load[1].abs() + load[2].abs() < 1e-12, "{load}");
    }

    #[test]
    fn other_units_and_axes_are_seen_at_rest() {
        let level = UnitQuaternion::identity();
        let tared = |shown: [f64; 3]| {
            let mut inertia = MeasuredInertia::of(&robot()).unwrap();
            let sample = [shown[0], shown[1], shown[2], 0.0, 0.0, 0.0];
            let mut last = Ok(Vector6::zeros());
            for _ in 0..5 {
                last = inertia.update(Some(&sample), &level);
            }
            last
        };
        // In g; along another axis; upside down; without gravity.
        for shown in [
            [0.0, 0.0, 1.0],
            [9.81, 0.0, 0.0],
            [0.0, 0.0, -9.81],
            [0.0; 3],
        ] {
            let error = tared(shown).unwrap_err();
            assert!(
                matches!(error, AccelerometerError::NotAtRest { .. }),
                "{error}"
            );
        }
        assert!(tared([0.3, 0.3, 9.5]).is_ok());
        assert_eq!(
            tared([0.0, 0.0, 1.0]).unwrap_err().to_string(),
            "the accelerometer shows (0.00, 0.00, 1.00) m/s^2 at rest, and (0.00, 0.00, 9.81) is expected: does the machine stand, and are the axes, the unit and `gravity` those of sensor.accelerometer?"
        );
    }

    #[test]
    fn what_is_no_motion_is_refused() {
        let mut inertia = MeasuredInertia::of(&robot()).unwrap();
        let level = UnitQuaternion::identity();
        assert_eq!(
            inertia.update(None, &level),
            Err(AccelerometerError::Missing)
        );
        for value in [f64::NAN, f64::INFINITY, -1e5] {
            let sample = [0.0, value, 0.0, 0.0, 0.0, 0.0];
            let error = inertia.update(Some(&sample), &level).unwrap_err();
            assert!(
                matches!(error, AccelerometerError::OutOfRange(_)),
                "{error}"
            );
        }
        assert_eq!(inertia.tared, 0);
    }
}
