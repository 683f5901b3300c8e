//! The L2: three axes, which hold the tool in place.

use gantry_tau_core::model::compensation::{CompensatorConfig, CompensatorError, Correction};
use gantry_tau_core::model::f1;
use gantry_tau_core::model::kinematics::{KinematicsError, Pose};
use gantry_tau_core::model::l2::{AXES, Compensator as Springs, Kinematics};
use gantry_tau_core::model::statics::{LineMatrix, Wrench};
use gantry_tau_core::units::{OffsetNm, PositionNm};
use nalgebra::Vector3;

use super::wrist::{UNLIMITED, Wrist, sum};
use super::{Compensate, CompensatorSetup, CorrectionKind, MachineKind};

/// Largest difference between an entry of a rotation and that of a platform which does not turn.
const ORIENTATION_TOLERANCE: f64 = 1e-6;

/// An L2; of a robot file, in the orientation of the world.
pub type L2 = Kinematics;

impl MachineKind<AXES> for L2 {
    const MODEL: &'static str = "l2";

    fn checksum(&self, metres_per_q: &[f64; AXES]) -> u32 {
        Self::checksum(self, metres_per_q)
    }

    fn geometry(&self) -> f1::Geometry {
        self.robot().geometry().into()
    }

    fn axes_at(&self, tool_m: &Vector3<f64>) -> Result<[f64; AXES], KinematicsError> {
        self.inverse_in_assembly(tool_m)
    }

    fn axes_for(&self, pose: &Pose) -> Result<[f64; AXES], KinematicsError> {
        let off = (self.pose(pose.position_m).rotation - pose.rotation).amax();
        if off > ORIENTATION_TOLERANCE {
            return Err(KinematicsError::Unreachable { arm: 0 });
        }
        self.inverse_in_assembly(&pose.position_m)
    }

    fn pose_of(
        &self,
        q: &[f64; AXES],
        _: &Vector3<f64>,
        _: Option<&Pose>,
    ) -> Result<Pose, KinematicsError> {
        Ok(self.pose(self.forward(q)?))
    }

    fn lines(
        &self,
        tool_m: &Vector3<f64>,
        q: &[f64; AXES],
    ) -> Result<LineMatrix<AXES>, KinematicsError> {
        self.line_matrix(&Pose::at(*tool_m), q)
    }

    fn compensator(
        &self,
        setup: &CompensatorSetup<'_, AXES>,
    ) -> Result<Box<dyn Compensate<AXES>>, CompensatorError> {
        let CompensatorSetup {
            compliances,
            config,
            correction,
            wrist,
            ..
        } = *setup;
        let unlimited = CompensatorConfig {
            limits: [UNLIMITED; AXES],
            ..config
        };
        let springs = Springs::new(self, compliances, unlimited)?;
        let reach = self.without_travel();
        Ok(Box::new(L2Compensator {
            springs,
            reach,
            correction,
            wrist: Wrist::new(wrist),
            limits: config.limits,
        }))
    }
}

/// Compensator of an L2 for the translation of its tool: links and axes, then the wrist.
#[derive(Clone)]
struct L2Compensator {
    springs: Springs,
    /// The machine without its nominal travel, which offsets may leave.
    reach: Kinematics,
    correction: CorrectionKind,
    wrist: Wrist,
    limits: [OffsetNm; AXES],
}

impl Compensate<AXES> for L2Compensator {
    fn copy(&self) -> Box<dyn Compensate<AXES>> {
        Box::new(self.clone())
    }

    fn locate(&mut self, nominal: &[PositionNm; AXES]) -> Result<Pose, KinematicsError> {
        let kinematics = self.springs.machine().kinematics();
        Ok(kinematics.pose(kinematics.forward(&self.springs.config().q_of(nominal))?))
    }

    fn turned_rad(
        &self,
        pose: &Pose,
        nominal: &[PositionNm; AXES],
        load: &Wrench,
    ) -> Result<Vector3<f64>, KinematicsError> {
        let machine = self.springs.machine();
        let lines = machine
            .kinematics()
            .line_matrix(pose, &self.springs.config().q_of(nominal))?;
        Ok(lines
            .deflection(machine.compliances(), load)?
            .total
            .rotation_rad)
    }

    fn correct(
        &self,
        pose: &Pose,
        nominal: &[PositionNm; AXES],
        load: &Wrench,
    ) -> Result<Correction<AXES>, KinematicsError> {
        let CompensatorConfig {
            gain, metres_per_q, ..
        } = self.springs.config();
        let q = self.springs.config().q_of(nominal);
        let correction = match self.correction {
            CorrectionKind::FirstOrder => self.springs.correct_q(&q, load),
            CorrectionKind::Exact => self.springs.correct_exact_at(pose, &q, load),
        }?;
        let held = if self.wrist.is_rigid() {
            q
        } else {
            self.reach
                .inverse(&self.wrist.held(pose, load, *gain)?.position_m)?
        };
        sum(&correction, [&q, &held], metres_per_q, &self.limits)
    }

    fn set_gain(&mut self, gain: f64) -> Result<(), CompensatorError> {
        let config = CompensatorConfig {
            gain,
            ..*self.springs.config()
        };
        let machine = self.springs.machine();
        self.springs = Springs::new(machine.kinematics(), machine.compliances(), config)?;
        Ok(())
    }
}
