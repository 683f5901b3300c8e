//! Compensation of all six degrees of freedom: from a wrench to bounded offsets of the axes.

use super::{AXES, Elastic, Kinematics, PoseTracker};
use crate::model::compensation::{CompensatorConfig, CompensatorError, Correction};
use crate::model::kinematics::{KinematicsError, Pose, Solution};
use crate::model::robot::Compliances;
use crate::model::statics::{LineMatrix, Wrench};
use crate::units::PositionNm;

/// Compensator of an F1, with gain, limits and units; tracks the pose of the nominal positions from
/// cycle to cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compensator {
    machine: Elastic,
    config: CompensatorConfig<AXES>,
    tracker: PoseTracker,
}

impl Compensator {
    /// Checks the configuration. The travel of `kinematics` bounds corrected positions too; see
    /// [`Kinematics::without_travel`].
    ///
    /// # Errors
    /// [`CompensatorError`], naming the parameter and its axis.
    pub fn new(
        kinematics: &Kinematics,
        compliances: &Compliances<AXES>,
        config: CompensatorConfig<AXES>,
    ) -> Result<Self, CompensatorError> {
        config.check()?;
        Ok(Self {
            machine: Elastic::new(kinematics, compliances),
            config,
            tracker: PoseTracker::default(),
        })
    }

    /// The machine and its springs.
    #[must_use]
    pub const fn machine(&self) -> &Elastic {
        &self.machine
    }

    /// The configuration.
    #[must_use]
    pub const fn config(&self) -> &CompensatorConfig<AXES> {
        &self.config
    }

    /// Returns the offsets of one cycle, which hold the pose of the nominal positions under `load`;
    /// to first order. The pose is tracked as by a [`PoseTracker`], which an error leaves as its
    /// text says. For any load the offsets are within the limits.
    ///
    /// # Errors
    /// As [`PoseTracker::track`] and [`Elastic::command`].
    ///
    /// # Examples
    /// ```
    /// use gantry_tau_core::model::compensation::CompensatorConfig;
    /// use gantry_tau_core::model::kinematics::Pose;
    /// use gantry_tau_core::model::statics::Wrench;
    /// use gantry_tau_core::model::{f1, nalgebra::Vector3, presets};
    /// use gantry_tau_core::units::{Metres, OffsetNm, PositionNm};
    ///
    /// let kinematics = f1::Kinematics::new(&f1::Robot::new(presets::f1())?);
    /// let metres_per_q = [1.0, 1.0, 1.0, 0.1, 0.1, 0.1];
    /// let mut compensator = f1::Compensator::new(
    ///     &kinematics.without_travel(),
    ///     &presets::f1_compliances(),
    ///     CompensatorConfig { gain: 1.0, limits: [OffsetNm(2_000_000); 6], metres_per_q },
    /// )?;
    /// let q = kinematics.inverse(&Pose::at(Vector3::new(0.0, 0.0, 0.3)), None)?.value;
    /// let mut nominal = [PositionNm(0); 6];
    /// for axis in 0..6 {
    ///     nominal[axis] = PositionNm::from_metres(Metres(q[axis] * metres_per_q[axis]))?;
    /// }
    /// let load = Wrench::from_array([0.0, 0.0, -200.0, 0.0, 0.0, 0.0]);
    /// let correction = compensator.correct(&nominal, &load)?;
    /// assert!(correction.offsets[0].0 > 0, "the carts lift the load");
    /// # Ok::<(), Box<dyn core::error::Error>>(())
    /// ```
    pub fn correct(
        &mut self,
        nominal: &[PositionNm; AXES],
        load: &Wrench,
    ) -> Result<Correction<AXES>, KinematicsError> {
        let q = self.config.q_of(nominal);
        let pose = self.track(&q)?.value;
        self.correct_at(&pose, &q, load)
    }

    /// Returns the pose for positions `q` (q-units), tracked from that of the last call.
    ///
    /// # Errors
    /// As [`PoseTracker::track`].
    pub fn track(&mut self, q: &[f64; AXES]) -> Result<Solution<Pose>, KinematicsError> {
        self.tracker.track(self.machine.kinematics(), q)
    }

    /// As [`correct`](Self::correct), for a known pose and its positions in q-units.
    ///
    /// # Errors
    /// As [`Elastic::command`].
    pub fn correct_at(
        &self,
        pose: &Pose,
        q: &[f64; AXES],
        load: &Wrench,
    ) -> Result<Correction<AXES>, KinematicsError> {
        let command = self.machine.command(pose, q, load, self.config.gain)?;
        self.config.bounded(q, &command)
    }

    /// As [`correct_at`](Self::correct_at), where the line matrix at the pose is known: for a cycle
    /// that computes forces as well.
    ///
    /// # Errors
    /// As [`Elastic::command_of`].
    pub fn correct_of(
        &self,
        lines: &LineMatrix<AXES>,
        pose: &Pose,
        q: &[f64; AXES],
        load: &Wrench,
    ) -> Result<Correction<AXES>, KinematicsError> {
        let command = self
            .machine
            .command_of(lines, pose, q, load, self.config.gain)?;
        self.config.bounded(q, &command)
    }

    /// As [`correct_at`](Self::correct_at) by the exact map, which costs up to ten inverses; the
    /// share `gain` of its offsets.
    ///
    /// # Errors
    /// As [`Elastic::exact_command`].
    pub fn correct_exact_at(
        &self,
        pose: &Pose,
        q: &[f64; AXES],
        load: &Wrench,
    ) -> Result<Correction<AXES>, KinematicsError> {
        let exact = self.machine.exact_command(pose, q, load)?;
        self.config.bounded_share(q, &exact.value)
    }
}
