//! Forward kinematics cycle by cycle, seeded by the pose of the cycle before.

use super::{AXES, Kinematics};
use crate::model::kinematics::{COLD_ITERATIONS, KinematicsError, Pose, Solution, WARM_ITERATIONS};

/// Tracks the pose of an F1 from cycle to cycle, by one attempt per call, so that no call takes
/// longer than one from nothing.
///
/// A call starts from the last pose and is warm ([`WARM_ITERATIONS`], enough at 1 m/s and 1 kHz);
/// without a last pose it is cold. After an error the next call is patient ([`COLD_ITERATIONS`]
/// from the last pose), the one after it cold, and so in turn until one succeeds. So the pose is
/// back with the third call at the latest that is given positions which it can be found for,
/// patiently or cold. Without a synchronised form a cold call with a last pose is patient too.
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
    /// Last pose found, the seed of the next call unless that is a cold one. With `None` every call
    /// is cold, which needs a machine with a synchronised form. To begin at a known pose, set it in
    /// a default tracker: one that has failed may be about to make a cold call.
    pub last: Option<Pose>,
    attempt: Attempt,
}

/// Way of the next call to a solution.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Attempt {
    /// From the last pose, with few iterations.
    #[default]
    Warm,
    /// From the last pose.
    Patient,
    /// From the synchronised form.
    Cold,
}

impl PoseTracker {
    /// Returns the pose of the machine for positions `q` (q-units).
    ///
    /// # Errors
    /// As [`Kinematics::forward`] or [`Kinematics::forward_from`], of this attempt; the last pose
    /// stays.
    pub fn track(
        &mut self,
        kinematics: &Kinematics,
        q: &[f64; AXES],
    ) -> Result<Solution<Pose>, KinematicsError> {
        let start = match (&self.last, self.attempt) {
            (Some(seed), Attempt::Warm) => Some((seed, WARM_ITERATIONS)),
            (Some(seed), Attempt::Patient) => Some((seed, COLD_ITERATIONS)),
            (Some(seed), Attempt::Cold) if !kinematics.is_synchronisable() => {
                Some((seed, COLD_ITERATIONS))
            }
            (Some(_), Attempt::Cold) | (None, _) => None,
        };
        let solution = match start {
            Some((seed, iterations)) => kinematics.forward_from(q, seed, iterations),
            None => kinematics.forward(q),
        };
        match (&solution, self.attempt) {
            (Ok(found), _) => {
                *self = Self {
                    last: Some(found.value),
                    attempt: Attempt::Warm,
                }
            }
            (Err(_), Attempt::Patient) => self.attempt = Attempt::Cold,
            (Err(_), Attempt::Warm | Attempt::Cold) => self.attempt = Attempt::Patient,
        }
        solution
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

    /// Tracks the axes of a pose; an answer must be that pose, and be kept.
    fn track(
        tracker: &mut PoseTracker,
        kinematics: &Kinematics,
        pose: &Pose,
    ) -> Result<Solution<Pose>, KinematicsError> {
        let q = kinematics.inverse(pose, None).unwrap().value;
        let found = tracker.track(kinematics, &q);
        if let Ok(found) = &found {
            assert_eq!(tracker.last, Some(found.value));
            assert!((found.value.position_m - pose.position_m).amax() < 1e-9);
        }
        found
    }

    #[test]
    fn a_near_pose_is_warm_and_a_far_one_is_found_by_the_second_call() {
        let kinematics = Kinematics::new(&Robot::new(presets::f1()).unwrap());
        let mut tracker = PoseTracker::default();
        track(&mut tracker, &kinematics, &at(0.0, 0.3)).unwrap();
        let near = track(&mut tracker, &kinematics, &at(1e-3, 0.3)).unwrap();
        assert!(near.iterations <= WARM_ITERATIONS, "{near:?}");
        let far = at(-0.2, 0.6);
        assert!(matches!(
            track(&mut tracker, &kinematics, &far),
            Err(KinematicsError::NotConverged {
                iterations: WARM_ITERATIONS,
                ..
            })
        ));
        track(&mut tracker, &kinematics, &far).unwrap();
    }

    #[test]
    fn calls_after_an_error_are_patient_and_cold_in_turn() {
        let kinematics = Kinematics::new(&Robot::new(presets::f1()).unwrap());
        let q = kinematics.inverse(&at(0.0, 0.3), None).unwrap().value;
        for wild in [f64::NAN, f64::INFINITY, 1e6] {
            let mut tracker = PoseTracker::default();
            let pose = tracker.track(&kinematics, &q).unwrap().value;
            let mut lost = q;
            lost[0] = wild;
            let warm = kinematics.forward_from(&lost, &pose, WARM_ITERATIONS);
            let patient = kinematics.forward_from(&lost, &pose, COLD_ITERATIONS);
            let cold = kinematics.forward(&lost);
            for attempt in [warm, patient, cold, patient, cold] {
                assert!(attempt.is_err());
                assert_eq!(tracker.track(&kinematics, &lost), attempt);
                assert_eq!(tracker.last, Some(pose), "an error leaves the last pose");
            }
            assert_eq!(
                tracker.track(&kinematics, &q).map(|found| found.value),
                Ok(pose)
            );
        }
    }

    #[test]
    fn a_cold_call_needs_no_last_pose_nearby() {
        let kinematics = Kinematics::new(&Robot::new(presets::f1()).unwrap());
        let q = kinematics.inverse(&at(-0.2, 0.6), None).unwrap().value;
        let mut tracker = PoseTracker {
            last: Some(at(0.0, 0.3)),
            attempt: Attempt::Cold,
        };
        let found = tracker.track(&kinematics, &q);
        assert_eq!(found, kinematics.forward(&q));
        assert_eq!(
            tracker,
            PoseTracker {
                last: Some(found.unwrap().value),
                attempt: Attempt::Warm
            }
        );
    }

    #[test]
    fn without_a_synchronised_form_it_needs_no_seed_but_the_first() {
        let mut geometry = presets::f1();
        geometry.lengths_m[2] += 1e-3;
        let kinematics = Kinematics::new(&Robot::new(geometry).unwrap());
        let q = kinematics.inverse(&at(0.0, 0.3), None).unwrap().value;
        let mut tracker = PoseTracker::default();
        assert_eq!(
            tracker.track(&kinematics, &q),
            Err(KinematicsError::SeedRequired)
        );
        tracker.last = Some(at(0.0, 0.3));
        let pose = tracker.track(&kinematics, &q).unwrap().value;
        assert!((pose.position_m - at(0.0, 0.3).position_m).amax() < 1e-9);
        // Every call has a seed, so none says that one is required: warm, patient, and patient in
        // place of cold.
        let mut lost = q;
        lost[0] = 1e6;
        let attempts = [
            WARM_ITERATIONS,
            COLD_ITERATIONS,
            COLD_ITERATIONS,
            COLD_ITERATIONS,
        ];
        for iterations in attempts {
            let found = tracker.track(&kinematics, &lost);
            assert!(
                !matches!(found, Ok(_) | Err(KinematicsError::SeedRequired)),
                "{found:?}"
            );
            assert_eq!(found, kinematics.forward_from(&lost, &pose, iterations));
        }
    }
}
