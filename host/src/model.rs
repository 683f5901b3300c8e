//! Kinds of machines: what server, client and simulation need to know of one, and nothing else.

use std::fmt;

use gantry_tau_core::model::compensation::{
    Compensator, CompensatorConfig, Correction, SixLinkCompensator, SixLinkElastic,
};
use gantry_tau_core::model::kinematics::{
    COLD_ITERATIONS, KinematicsError, Nominal, NominalError, Pose, SixLinkKinematics,
    WARM_ITERATIONS,
};
use gantry_tau_core::model::robot::{
    ARMS, AXES, Compliances, Robot, RobotError, SixLink, SixLinkGeometry,
};
use gantry_tau_core::model::statics::{LineMatrix, Wrench};
use nalgebra::{Matrix3, Vector3};

/// Motors of the 3-DOF machine: one on each cart.
pub const L2_MOTORS: usize = 3;
/// Motors of the 6-DOF machine: two on each cart `[T 1.2.2]`, one for each of `q_4`, `q_5`, `q_6`.
pub const F1_MOTORS: usize = 9;

/// A kind of machine with `N` axes.
pub trait Model<const N: usize>: Clone + fmt::Debug + Send + Sync + 'static {
    /// CRC-32 over what decides the kinematics; the client compares it with the server's.
    fn checksum(&self) -> u32;

    /// The geometry, link by link.
    fn geometry(&self) -> SixLinkGeometry;

    /// Positions (q-units) that put the tool centre point of the unloaded machine at `tool_m` (world axes, metres), platform unturned.
    ///
    /// # Errors
    /// [`KinematicsError`]: that place cannot be reached, or not within the travel.
    fn axes_at(&self, tool_m: &Vector3<f64>) -> Result<[f64; N], KinematicsError>;

    /// The six links there.
    ///
    /// # Errors
    /// [`KinematicsError::Singular`] where the links cannot carry every load.
    fn lines(&self, tool_m: &Vector3<f64>, q: &[f64; N]) -> Result<LineMatrix<N>, KinematicsError>;

    /// From loads to bounded offsets. Offsets may leave the nominal travel; the server has the machine's.
    ///
    /// # Errors
    /// A sentence that names the parameter.
    fn correction(
        &self,
        compliances: &Compliances<N>,
        config: CompensatorConfig<N>,
    ) -> Result<Box<dyn Correct<N>>, String>;
}

/// A compensation, once per cycle.
pub trait Correct<const N: usize>: Send {
    /// Offsets that hold the tool where the nominal positions `q` (q-units) put it, under `load`.
    ///
    /// # Errors
    /// [`KinematicsError`]; the next call works.
    fn correct(&mut self, q: &[f64; N], load: &Wrench) -> Result<Correction<N>, KinematicsError>;
}

/// The 3-DOF machine with the platform unturned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct L2 {
    robot: Robot,
    nominal: Nominal,
}

impl L2 {
    /// The machine of a robot.
    ///
    /// # Errors
    /// [`NominalError`] without the Tau property.
    pub fn new(robot: Robot) -> Result<Self, NominalError> {
        let nominal = Nominal::new(&robot, &Matrix3::identity())?;
        Ok(Self { robot, nominal })
    }

    /// The machine as it is described.
    #[must_use]
    pub const fn robot(&self) -> &Robot {
        &self.robot
    }
}

impl Model<ARMS> for L2 {
    fn checksum(&self) -> u32 {
        self.robot.kinematics_checksum()
    }

    fn geometry(&self) -> SixLinkGeometry {
        self.robot.geometry().into()
    }

    fn axes_at(&self, tool_m: &Vector3<f64>) -> Result<[f64; ARMS], KinematicsError> {
        self.nominal.inverse_in_assembly(tool_m)
    }

    fn lines(
        &self,
        tool_m: &Vector3<f64>,
        q: &[f64; ARMS],
    ) -> Result<LineMatrix<ARMS>, KinematicsError> {
        LineMatrix::new(&self.robot, &Pose::at(*tool_m), q)
    }

    fn correction(
        &self,
        compliances: &Compliances<ARMS>,
        config: CompensatorConfig<ARMS>,
    ) -> Result<Box<dyn Correct<ARMS>>, String> {
        let compensator = Compensator::new(&self.nominal, compliances, config);
        Ok(Box::new(compensator.map_err(|error| error.to_string())?))
    }
}

impl Correct<ARMS> for Compensator {
    fn correct(
        &mut self,
        q: &[f64; ARMS],
        load: &Wrench,
    ) -> Result<Correction<ARMS>, KinematicsError> {
        self.correction(q, load)
    }
}

/// The 6-DOF machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct F1 {
    kinematics: SixLinkKinematics,
}

impl F1 {
    /// The machine of a robot.
    #[must_use]
    pub fn new(robot: &SixLink) -> Self {
        Self {
            kinematics: SixLinkKinematics::new(robot),
        }
    }

    /// The machine as it is described, ready to be solved.
    #[must_use]
    pub const fn kinematics(&self) -> &SixLinkKinematics {
        &self.kinematics
    }

    fn without_travel(&self) -> Result<SixLinkKinematics, RobotError> {
        let travel = None;
        let geometry = *self.kinematics.robot().geometry();
        let robot = SixLink::new(SixLinkGeometry { travel, ..geometry })?;
        Ok(SixLinkKinematics::new(&robot))
    }
}

impl Model<AXES> for F1 {
    fn checksum(&self) -> u32 {
        self.kinematics.robot().kinematics_checksum()
    }

    fn geometry(&self) -> SixLinkGeometry {
        *self.kinematics.robot().geometry()
    }

    fn axes_at(&self, tool_m: &Vector3<f64>) -> Result<[f64; AXES], KinematicsError> {
        let solved = (self.kinematics).inverse_in_assembly(&Pose::at(*tool_m), None)?;
        Ok(solved.answer)
    }

    fn lines(
        &self,
        tool_m: &Vector3<f64>,
        q: &[f64; AXES],
    ) -> Result<LineMatrix<AXES>, KinematicsError> {
        LineMatrix::of_six_link(&self.kinematics, &Pose::at(*tool_m), q)
    }

    fn correction(
        &self,
        compliances: &Compliances<AXES>,
        config: CompensatorConfig<AXES>,
    ) -> Result<Box<dyn Correct<AXES>>, String> {
        let kinematics = self.without_travel().map_err(|error| error.to_string())?;
        let elastic = SixLinkElastic::new(kinematics, *compliances);
        let compensator = SixLinkCompensator::new(elastic, config);
        Ok(Box::new(Followed {
            kinematics,
            compensator: compensator.map_err(|error| error.to_string())?,
            pose: None,
        }))
    }
}

/// The compensator of six axes and the pose of its last cycle, from which the next one's is two steps away.
struct Followed {
    kinematics: SixLinkKinematics,
    compensator: SixLinkCompensator,
    pose: Option<Pose>,
}

impl Followed {
    /// Warm, then from the last pose with patience, then from nothing.
    fn pose_at(&self, q: &[f64; AXES]) -> Result<Pose, KinematicsError> {
        if let Some(seed) = &self.pose {
            for iterations in [WARM_ITERATIONS, COLD_ITERATIONS] {
                if let Ok(solved) = self.kinematics.forward_from(q, seed, iterations) {
                    return Ok(solved.answer);
                }
            }
        }
        Ok(self.kinematics.forward(q)?.answer)
    }
}

impl Correct<AXES> for Followed {
    fn correct(
        &mut self,
        q: &[f64; AXES],
        load: &Wrench,
    ) -> Result<Correction<AXES>, KinematicsError> {
        let pose = self.pose_at(q)?;
        self.pose = Some(pose);
        self.compensator.correction(&pose, q, load)
    }
}
