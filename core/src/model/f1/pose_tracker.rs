//! Forward kinematics cycle by cycle, seeded by the pose of the cycle before.

use super::{AXES, Kinematics};
use crate::model::kinematics::{COLD_ITERATIONS, KinematicsError, Pose, Solution, WARM_ITERATIONS};

/// Last pose of a machine; the seed of the next.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Seed(Option<Pose>);

impl Seed {
    /// As [`PoseTracker::track`].
    pub(super) fn track(
        &mut self,
        kinematics: &Kinematics,
        q: &[f64; AXES],
    ) -> Result<Solution<Pose>, KinematicsError> {
        let solution = match &self.0 {
            Some(seed) => kinematics
                .forward_from(q, seed, WARM_ITERATIONS)
                .or_else(|_| kinematics.forward_from(q, seed, COLD_ITERATIONS))
                .or_else(|_| kinematics.forward(q))?,
            None => kinematics.forward(q)?,
        };
        self.0 = Some(solution.value);
        Ok(solution)
    }
}

/// Tracks the pose of an F1 from cycle to cycle.
///
/// Each call solves from the last pose: warm ([`WARM_ITERATIONS`], enough at 1 m/s and 1 kHz), then with [`COLD_ITERATIONS`] from the same
/// pose, then cold. After an error the last pose stays, and the next call works.
///
/// # Examples
/// ```
/// use gantry_tau_core::model::kinematics::Pose;
/// use gantry_tau_core::model::{f1, nalgebra::Vector3, presets};
///
/// let kinematics = f1::Kinematics::new(&f1::Robot::new(presets::f1())?);
/// let mut tracker = f1::PoseTracker::new(&kinematics);
/// for step in 0..5 {
///     let there = Pose::at(Vector3::new(0.0, 0.0, 0.3 + 1e-3 * f64::from(step)));
///     let q = kinematics.inverse(&there, None)?.value;
///     let pose = tracker.pose_at(&q)?;
///     assert!((pose.position_m - there.position_m).amax() < 1e-9);
/// }
/// assert!(tracker.pose_at(&[f64::NAN; 6]).is_err());
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseTracker {
    kinematics: Kinematics,
    seed: Seed,
}

impl PoseTracker {
    /// A tracker without a last pose: its first call is cold.
    #[must_use]
    pub const fn new(kinematics: &Kinematics) -> Self {
        Self { kinematics: *kinematics, seed: Seed(None) }
    }

    /// The machine.
    #[must_use]
    pub const fn kinematics(&self) -> &Kinematics {
        &self.kinematics
    }

    /// The last pose found.
    #[must_use]
    pub const fn last(&self) -> Option<&Pose> {
        self.seed.0.as_ref()
    }

    /// Takes a pose as the last one: the seed of the next call, for a machine without a synchronised form.
    pub const fn start_from(&mut self, pose: &Pose) {
        self.seed = Seed(Some(*pose));
    }

    /// Forgets the last pose: the next call is cold.
    pub const fn reset(&mut self) {
        self.seed = Seed(None);
    }

    /// Returns the pose for positions `q` (q-units).
    ///
    /// # Errors
    /// As [`Kinematics::forward`]; the last pose stays.
    pub fn pose_at(&mut self, q: &[f64; AXES]) -> Result<Pose, KinematicsError> {
        Ok(self.track(q)?.value)
    }

    /// As [`pose_at`](Self::pose_at), with iterations and residual.
    ///
    /// # Errors
    /// As [`pose_at`](Self::pose_at).
    pub fn track(&mut self, q: &[f64; AXES]) -> Result<Solution<Pose>, KinematicsError> {
        self.seed.track(&self.kinematics, q)
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

    fn fresh() -> PoseTracker {
        PoseTracker::new(&Kinematics::new(&Robot::new(presets::f1()).unwrap()))
    }

    #[test]
    fn a_near_pose_is_warm_and_a_far_one_is_found() {
        let mut tracker = fresh();
        let kinematics = *tracker.kinematics();
        let q = |pose: &Pose| kinematics.inverse(pose, None).unwrap().value;
        assert_eq!(tracker.last(), None);
        let cold = tracker.track(&q(&at(0.0, 0.3))).unwrap();
        assert_eq!(tracker.last(), Some(&cold.value));
        let near = tracker.track(&q(&at(1e-3, 0.3))).unwrap();
        assert!(near.iterations <= WARM_ITERATIONS, "{near:?}");
        let far = at(-0.2, 0.6);
        let found = tracker.pose_at(&q(&far)).unwrap();
        assert!((found.position_m - far.position_m).amax() < 1e-9);
        tracker.reset();
        assert_eq!(tracker, fresh());
    }

    #[test]
    fn an_error_leaves_the_last_pose() {
        let mut tracker = fresh();
        let q = (tracker.kinematics().inverse(&at(0.0, 0.3), None)).unwrap();
        let pose = tracker.pose_at(&q.value).unwrap();
        for wild in [f64::NAN, f64::INFINITY, 1e6] {
            let mut lost = q.value;
            lost[0] = wild;
            assert!(tracker.pose_at(&lost).is_err());
            assert_eq!(tracker.last(), Some(&pose));
        }
        assert_eq!(tracker.pose_at(&q.value), Ok(pose));
    }

    #[test]
    fn without_a_synchronised_form_it_needs_no_seed_but_the_first() {
        let mut geometry = presets::f1();
        geometry.lengths_m[2] += 1e-3;
        let kinematics = Kinematics::new(&Robot::new(geometry).unwrap());
        let mut tracker = PoseTracker::new(&kinematics);
        let q = kinematics.inverse(&at(0.0, 0.3), None).unwrap().value;
        assert_eq!(tracker.pose_at(&q), Err(KinematicsError::SeedRequired));
        tracker.start_from(&at(0.0, 0.3));
        let pose = tracker.pose_at(&q).unwrap();
        assert!((pose.position_m - at(0.0, 0.3).position_m).amax() < 1e-9);
    }
}
