//! Forward kinematics cycle by cycle, seeded by the pose of the cycle before.

use super::{AXES, Kinematics};
use crate::model::kinematics::{COLD_ITERATIONS, KinematicsError, Pose, Solution, WARM_ITERATIONS};

/// Tracks the pose of an F1 from cycle to cycle.
///
/// # Examples
/// ```
/// use gantry_tau_core::model::kinematics::Pose;
/// use gantry_tau_core::model::{f1, nalgebra::Vector3, presets};
///
/// let kinematics = f1::Kinematics::new(&f1::Robot::new(presets::f1())?);
/// let mut tracker = f1::PoseTracker::default();
/// for step in 0..5 {
///     let there = Pose::at(Vector3::new(0.0, 0.0, 0.3 + 1e-3 * f64::from(step)));
///     let q = kinematics.inverse(&there, None)?.value;
///     let pose = tracker.track(&kinematics, &q)?.value;
///     assert!((pose.position_m - there.position_m).amax() < 1e-9);
/// }
/// assert!(tracker.track(&kinematics, &[f64::NAN; 6]).is_err());
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseTracker {
    /// Last pose found, the seed of the next call. With `None` that call is cold, which needs a machine with a synchronised form.
    pub last: Option<Pose>,
}

impl PoseTracker {
    /// Returns the pose of the machine for positions `q` (q-units), solved from the last pose: warm ([`WARM_ITERATIONS`], enough at 1 m/s
    /// and 1 kHz), then with [`COLD_ITERATIONS`] from the same pose, then cold.
    ///
    /// # Errors
    /// As [`Kinematics::forward`]; the last pose stays, and the next call works.
    pub fn track(&mut self, kinematics: &Kinematics, q: &[f64; AXES]) -> Result<Solution<Pose>, KinematicsError> {
        let solution = match &self.last {
            Some(seed) => kinematics
                .forward_from(q, seed, WARM_ITERATIONS)
                .or_else(|_| kinematics.forward_from(q, seed, COLD_ITERATIONS))
                .or_else(|_| kinematics.forward(q))?,
            None => kinematics.forward(q)?,
        };
        self.last = Some(solution.value);
        Ok(solution)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::f1::Robot;
    use crate::model::presets;
    use nalgebra::Vector3;

    fn at(x: f64, z: f64) -> Pose {
        Pose::at(Vector3::new(x, 0.0, z))
    }

    #[test]
    fn a_near_pose_is_warm_and_a_far_one_is_found() {
        let kinematics = Kinematics::new(&Robot::new(presets::f1()).unwrap());
        let mut tracker = PoseTracker::default();
        let mut track = |pose: &Pose| {
            let q = kinematics.inverse(pose, None).unwrap().value;
            let found = tracker.track(&kinematics, &q).unwrap();
            assert_eq!(tracker.last, Some(found.value));
            assert!((found.value.position_m - pose.position_m).amax() < 1e-9);
            found
        };
        track(&at(0.0, 0.3));
        let near = track(&at(1e-3, 0.3));
        assert!(near.iterations <= WARM_ITERATIONS, "{near:?}");
        track(&at(-0.2, 0.6));
    }

    #[test]
    fn without_a_synchronised_form_it_needs_no_seed_but_the_first() {
        let mut geometry = presets::f1();
        geometry.lengths_m[2] += 1e-3;
        let kinematics = Kinematics::new(&Robot::new(geometry).unwrap());
        let q = kinematics.inverse(&at(0.0, 0.3), None).unwrap().value;
        let mut tracker = PoseTracker::default();
        assert_eq!(tracker.track(&kinematics, &q), Err(KinematicsError::SeedRequired));
        tracker.last = Some(at(0.0, 0.3));
        let pose = tracker.track(&kinematics, &q).unwrap().value;
        assert!((pose.position_m - at(0.0, 0.3).position_m).amax() < 1e-9);
    }
}
