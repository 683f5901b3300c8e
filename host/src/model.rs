//! Kinds of machines: the part of a machine that server, client and simulation depend on.

use std::fmt;

use gantry_tau_core::model::compensation::{CompensatorConfig, Correction};
use gantry_tau_core::model::kinematics::{KinematicsError, Pose};
use gantry_tau_core::model::robot::Compliances;
use gantry_tau_core::model::statics::{LineMatrix, Wrench};
use gantry_tau_core::model::{f1, l2};
use gantry_tau_core::units::PositionNm;
use nalgebra::Vector3;

/// Motors of the L2: one on each cart.
pub const L2_MOTORS: usize = 3;
/// Motors of the F1: two on each cart `[T 1.2.2]`, one for each of `q_4`, `q_5`, `q_6`.
pub const F1_MOTORS: usize = 9;
/// Largest difference between an entry of a rotation and that of a platform which does not turn.
const ORIENTATION_TOLERANCE: f64 = 1e-6;

/// Kind of machine with `N` axes.
pub trait MachineKind<const N: usize>: Clone + fmt::Debug + Send + Sync + 'static {
    /// Name of the kind, as files have it under `model`.
    const NAME: &'static str;

    /// Returns the CRC-32 of the parameters that decide the kinematics; the client compares it with the server's.
    fn checksum(&self) -> u32;

    /// Returns the geometry, link by link.
    fn geometry(&self) -> f1::Geometry;

    /// Returns the positions (q-units) that put the tool centre point of the unloaded machine at `tool_m` (world axes, metres), with the
    /// platform in the orientation of the world.
    ///
    /// # Errors
    /// [`KinematicsError`]: the point is out of reach or outside the travel.
    fn axes_at(&self, tool_m: &Vector3<f64>) -> Result<[f64; N], KinematicsError>;

    /// As [`axes_at`](Self::axes_at), in an orientation of the platform.
    ///
    /// # Errors
    /// [`KinematicsError`]; [`KinematicsError::Unreachable`] with `arm` 0 for a platform that does not turn, and should.
    fn axes_for(&self, pose: &Pose) -> Result<[f64; N], KinematicsError>;

    /// Returns the line matrix with the tool centre point at `tool_m` and the axes at `q`.
    ///
    /// # Errors
    /// [`KinematicsError::Singular`] where the links cannot carry every load.
    fn lines(&self, tool_m: &Vector3<f64>, q: &[f64; N]) -> Result<LineMatrix<N>, KinematicsError>;

    /// Creates a compensator. Offsets may leave the nominal travel; the server checks the machine's.
    ///
    /// # Errors
    /// A sentence that names the parameter.
    fn compensator(
        &self,
        compliances: &Compliances<N>,
        config: CompensatorConfig<N>,
    ) -> Result<Box<dyn Compensator<N>>, String>;
}

/// A compensator, used once per cycle: it locates the platform, with which a force sensor's reading becomes a load, and then corrects for
/// the load.
pub trait Compensator<const N: usize>: Send {
    /// Returns the pose that the nominal positions stand for.
    ///
    /// # Errors
    /// [`KinematicsError`]. It leaves the compensator usable; an F1 finds its pose again by the third call.
    fn locate(&mut self, nominal: &[PositionNm; N]) -> Result<Pose, KinematicsError>;

    /// Returns the offsets that hold the tool where the nominal positions put it, in `pose`, under a load.
    ///
    /// # Errors
    /// [`KinematicsError`].
    fn correct(&self, pose: &Pose, nominal: &[PositionNm; N], load: &Wrench) -> Result<Correction<N>, KinematicsError>;
}

impl Compensator<{ l2::AXES }> for l2::Compensator {
    fn locate(&mut self, nominal: &[PositionNm; l2::AXES]) -> Result<Pose, KinematicsError> {
        let kinematics = self.machine().kinematics();
        Ok(kinematics.pose(kinematics.forward(&self.config().q_of(nominal))?))
    }

    fn correct(
        &self,
        _: &Pose,
        nominal: &[PositionNm; l2::AXES],
        load: &Wrench,
    ) -> Result<Correction<{ l2::AXES }>, KinematicsError> {
        self.correct(nominal, load)
    }
}

impl Compensator<{ f1::AXES }> for f1::Compensator {
    fn locate(&mut self, nominal: &[PositionNm; f1::AXES]) -> Result<Pose, KinematicsError> {
        let q = self.config().q_of(nominal);
        Ok(self.track(&q)?.value)
    }

    fn correct(
        &self,
        pose: &Pose,
        nominal: &[PositionNm; f1::AXES],
        load: &Wrench,
    ) -> Result<Correction<{ f1::AXES }>, KinematicsError> {
        self.correct_at(pose, &self.config().q_of(nominal), load)
    }
}

/// An L2; of a robot file, in the orientation of the world.
pub type L2 = l2::Kinematics;
/// An F1.
pub type F1 = f1::Kinematics;

impl MachineKind<{ l2::AXES }> for L2 {
    const NAME: &'static str = "l2";

    fn checksum(&self) -> u32 {
        self.robot().kinematics_checksum()
    }

    fn geometry(&self) -> f1::Geometry {
        self.robot().geometry().into()
    }

    fn axes_at(&self, tool_m: &Vector3<f64>) -> Result<[f64; l2::AXES], KinematicsError> {
        self.inverse_in_assembly(tool_m)
    }

    fn axes_for(&self, pose: &Pose) -> Result<[f64; l2::AXES], KinematicsError> {
        let off = (self.pose(pose.position_m).rotation - pose.rotation).amax();
        if off > ORIENTATION_TOLERANCE {
            return Err(KinematicsError::Unreachable { arm: 0 });
        }
        self.inverse_in_assembly(&pose.position_m)
    }

    fn lines(&self, tool_m: &Vector3<f64>, q: &[f64; l2::AXES]) -> Result<LineMatrix<{ l2::AXES }>, KinematicsError> {
        self.line_matrix(&Pose::at(*tool_m), q)
    }

    fn compensator(
        &self,
        compliances: &Compliances<{ l2::AXES }>,
        config: CompensatorConfig<{ l2::AXES }>,
    ) -> Result<Box<dyn Compensator<{ l2::AXES }>>, String> {
        let compensator = l2::Compensator::new(self, compliances, config).map_err(|error| error.to_string())?;
        Ok(Box::new(compensator))
    }
}

impl MachineKind<{ f1::AXES }> for F1 {
    const NAME: &'static str = "f1";

    fn checksum(&self) -> u32 {
        self.robot().kinematics_checksum()
    }

    fn geometry(&self) -> f1::Geometry {
        *self.robot().geometry()
    }

    fn axes_at(&self, tool_m: &Vector3<f64>) -> Result<[f64; f1::AXES], KinematicsError> {
        self.axes_for(&Pose::at(*tool_m))
    }

    fn axes_for(&self, pose: &Pose) -> Result<[f64; f1::AXES], KinematicsError> {
        let solution = self.inverse_in_assembly(pose, None)?;
        Ok(solution.value)
    }

    fn lines(&self, tool_m: &Vector3<f64>, q: &[f64; f1::AXES]) -> Result<LineMatrix<{ f1::AXES }>, KinematicsError> {
        self.line_matrix(&Pose::at(*tool_m), q)
    }

    fn compensator(
        &self,
        compliances: &Compliances<{ f1::AXES }>,
        config: CompensatorConfig<{ f1::AXES }>,
    ) -> Result<Box<dyn Compensator<{ f1::AXES }>>, String> {
        let kinematics = self.without_travel();
        let compensator = f1::Compensator::new(&kinematics, compliances, config).map_err(|error| error.to_string())?;
        Ok(Box::new(compensator))
    }
}
