//! The F1: six axes, which hold the tool in place and in orientation.

use gantry_tau_core::model::compensation::{CompensatorConfig, CompensatorError, Correction};
use gantry_tau_core::model::f1::{AXES, Compensator as Springs, Geometry, Kinematics, PoseTracker};
use gantry_tau_core::model::kinematics::{COLD_ITERATIONS, KinematicsError, Pose};
use gantry_tau_core::model::statics::{LineMatrix, Wrench};
use gantry_tau_core::units::{OffsetNm, PositionNm};
use nalgebra::Vector3;

use super::wrist::{UNLIMITED, Wrist, sum};
use super::{Compensate, CompensatorSetup, CorrectionKind, MachineKind};

/// Longest step of the way from home to a pose, q-units: 20 mm of a cart, 20 mrad of a plate.
const WALK_STEP: f64 = 0.02;
/// Largest number of these steps.
const MAX_STEPS: f64 = 1e3;

/// An F1.
pub type F1 = Kinematics;

impl MachineKind<AXES> for F1 {
    const MODEL: &'static str = "f1";

    fn checksum(&self, metres_per_q: &[f64; AXES]) -> u32 {
        Self::checksum(self, metres_per_q)
    }

    fn geometry(&self) -> Geometry {
        *self.robot().geometry()
    }

    fn axes_at(&self, tool_m: &Vector3<f64>) -> Result<[f64; AXES], KinematicsError> {
        self.axes_for(&Pose::at(*tool_m))
    }

    fn axes_for(&self, pose: &Pose) -> Result<[f64; AXES], KinematicsError> {
        let solution = self.inverse_in_assembly(pose, None)?;
        Ok(solution.value)
    }

    fn pose_of(
        &self,
        q: &[f64; AXES],
        home_m: &Vector3<f64>,
        last: Option<&Pose>,
    ) -> Result<Pose, KinematicsError> {
        match last {
            Some(last) => Ok(self.forward_from(q, last, COLD_ITERATIONS)?.value),
            None => pose_at(self, home_m, q),
        }
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
            home_m,
        } = *setup;
        let unlimited = CompensatorConfig {
            limits: [UNLIMITED; AXES],
            ..config
        };
        let springs = Springs::new(&self.without_travel(), compliances, unlimited)?;
        Ok(Box::new(F1Compensator {
            springs,
            tracker: PoseTracker::default(),
            home_m,
            correction,
            wrist: Wrist::new(wrist),
            limits: config.limits,
        }))
    }
}

/// Returns the pose for positions `q` (q-units) of any F1: without a seed where the machine has a
/// synchronised form, else by following the straight way of the axes from home, where the platform
/// is unturned and the tool centre point at `home_m`. A calibrated machine has no such form.
///
/// # Errors
/// [`KinematicsError`], of home or of a pose on the way.
pub fn pose_at(
    kinematics: &F1,
    home_m: &Vector3<f64>,
    q: &[f64; AXES],
) -> Result<Pose, KinematicsError> {
    match kinematics.forward(q) {
        Err(KinematicsError::SeedRequired) => walk(kinematics, home_m, q),
        found => Ok(found?.value),
    }
}

fn walk(kinematics: &F1, home_m: &Vector3<f64>, q: &[f64; AXES]) -> Result<Pose, KinematicsError> {
    let home = kinematics.axes_at(home_m)?;
    let farthest = home
        .iter()
        .zip(q)
        .map(|(home, q)| (q - home).abs())
        .fold(0.0, f64::max);
    let steps = (farthest / WALK_STEP).ceil().clamp(1.0, MAX_STEPS);
    let mut pose = Pose::at(*home_m);
    let mut made = 0.0;
    while made < steps {
        made += 1.0;
        let mut on_the_way = *q;
        for (value, home) in on_the_way.iter_mut().zip(home) {
            *value = home + (*value - home) * (made / steps);
        }
        pose = kinematics
            .forward_from(&on_the_way, &pose, COLD_ITERATIONS)?
            .value;
    }
    Ok(pose)
}

/// Compensator of an F1 for the pose of its tool: links and axes, then the wrist. It follows the
/// nominal pose from cycle to cycle.
#[derive(Clone)]
struct F1Compensator {
    springs: Springs,
    tracker: PoseTracker,
    home_m: Vector3<f64>,
    correction: CorrectionKind,
    wrist: Wrist,
    limits: [OffsetNm; AXES],
}

impl Compensate<AXES> for F1Compensator {
    fn copy(&self) -> Box<dyn Compensate<AXES>> {
        Box::new(self.clone())
    }

    fn locate(&mut self, nominal: &[PositionNm; AXES]) -> Result<Pose, KinematicsError> {
        let kinematics = self.springs.machine().kinematics();
        let q = self.springs.config().q_of(nominal);
        match self.tracker.track(kinematics, &q) {
            // The first cycle of a machine without a synchronised form; later ones have the last
            // pose.
            Err(KinematicsError::SeedRequired) => {
                let pose = walk(kinematics, &self.home_m, &q)?;
                self.tracker = PoseTracker::default();
                self.tracker.last = Some(pose);
                Ok(pose)
            }
            found => Ok(found?.value),
        }
    }

    /// Six axes hold the orientation as well; what a gain below one leaves of the turning is not
    /// followed.
    fn turned_rad(
        &self,
        _: &Pose,
        _: &[PositionNm; AXES],
        _: &Wrench,
    ) -> Result<Vector3<f64>, KinematicsError> {
        Ok(Vector3::zeros())
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
            CorrectionKind::FirstOrder => self.springs.correct_at(pose, &q, load),
            CorrectionKind::Exact => self.springs.correct_exact_at(pose, &q, load),
        }?;
        let held = if self.wrist.is_rigid() {
            q
        } else {
            let [.., q4, q5, q6] = q;
            let target = self.wrist.held(pose, load, *gain)?;
            self.springs
                .machine()
                .kinematics()
                .inverse(&target, Some([q4, q5, q6]))?
                .value
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
