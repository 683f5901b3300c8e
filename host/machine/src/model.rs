//! Kinds of machines: the part of a machine that server, client and simulation depend on.

mod f1;
mod l2;
mod wrist;

use std::fmt;

use gantry_tau_core::model::compensation::{CompensatorConfig, CompensatorError, Correction};
use gantry_tau_core::model::f1::Geometry;
use gantry_tau_core::model::kinematics::{KinematicsError, Pose};
use gantry_tau_core::model::robot::Compliances;
use gantry_tau_core::model::statics::{LineMatrix, Wrench};
use gantry_tau_core::units::{Metres, PositionNm};
use nalgebra::Vector3;

pub use f1::{F1, pose_at};
pub use l2::L2;
use serde::Deserialize;
pub use wrist::{Wrist, WristJoint};

/// Motors of the L2: one on each cart.
pub const L2_MOTORS: usize = 3;
/// Motors of the F1: two on each cart `[T 1.2.2]`, one for each of `q_4`, `q_5`, `q_6`.
pub const F1_MOTORS: usize = 9;

/// Computation of a correction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CorrectionKind {
    /// By the compliance at the unloaded pose; a few instructions less, some 2 % of the
    /// displacement left.
    FirstOrder,
    /// In the pose under load.
    Exact,
}

/// Kind of machine with `N` axes.
pub trait MachineKind<const N: usize>: Clone + fmt::Debug + Send + Sync + 'static {
    /// `model` of its robot files and set-ups.
    const MODEL: &'static str;

    /// Returns the CRC-32 of the parameters that decide the kinematics, and of the length of one
    /// unit of each `q`, m.
    fn checksum(&self, metres_per_q: &[f64; N]) -> u32;

    /// Returns the geometry, link by link.
    fn geometry(&self) -> Geometry;

    /// Returns the positions (q-units) that put the tool centre point of the unloaded machine at
    /// `tool_m` (world axes, metres), with the platform in the orientation of the world.
    ///
    /// # Errors
    /// [`KinematicsError`]: the point is out of reach or outside the travel.
    fn axes_at(&self, tool_m: &Vector3<f64>) -> Result<[f64; N], KinematicsError>;

    /// As [`axes_at`](Self::axes_at), in an orientation of the platform.
    ///
    /// # Errors
    /// [`KinematicsError`]; [`KinematicsError::Unreachable`] with `arm` 0 for a platform that does
    /// not turn, and should.
    fn axes_for(&self, pose: &Pose) -> Result<[f64; N], KinematicsError>;

    /// Returns the pose for positions `q` (q-units). An F1 is followed from its `last` pose, or
    /// else from home (world axes, m).
    ///
    /// # Errors
    /// [`KinematicsError`].
    fn pose_of(
        &self,
        q: &[f64; N],
        home_m: &Vector3<f64>,
        last: Option<&Pose>,
    ) -> Result<Pose, KinematicsError>;

    /// Returns the line matrix with the tool centre point at `tool_m` and the axes at `q`.
    ///
    /// # Errors
    /// [`KinematicsError::Singular`] where the links cannot carry every load.
    fn lines(&self, tool_m: &Vector3<f64>, q: &[f64; N]) -> Result<LineMatrix<N>, KinematicsError>;

    /// Creates a compensator. Offsets may leave the nominal travel; the server checks that of the
    /// machine.
    ///
    /// # Errors
    /// [`CompensatorError`].
    fn compensator(
        &self,
        setup: &CompensatorSetup<'_, N>,
    ) -> Result<Box<dyn Compensate<N>>, CompensatorError>;
}

/// Parameters of a compensator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CompensatorSetup<'a, const N: usize> {
    /// Compliances of links and axes.
    pub compliances: &'a Compliances<N>,
    /// Gain, limits and units.
    pub config: CompensatorConfig<N>,
    /// Computation of the correction for links and axes.
    pub correction: CorrectionKind,
    /// Joints between platform and tool; empty where they are rigid.
    pub wrist: &'a [WristJoint],
    /// Home of the tool centre point, world axes, m: an F1 without a synchronised form is followed
    /// from there.
    pub home_m: Vector3<f64>,
}

/// A compensator, used once per cycle: it locates the platform, with which a force sensor's reading
/// becomes a load, and then corrects for the load.
pub trait Compensate<const N: usize>: Send {
    /// Returns a copy, which goes on from the same state.
    fn copy(&self) -> Box<dyn Compensate<N>>;

    /// Returns the pose that the nominal positions stand for.
    ///
    /// # Errors
    /// [`KinematicsError`]. It leaves the compensator usable; an F1 finds its pose again by the
    /// third call.
    fn locate(&mut self, nominal: &[PositionNm; N]) -> Result<Pose, KinematicsError>;

    /// Returns how a load turns the platform away from `pose`, world axes, rad, to first order: a
    /// force sensor on it turns along. Zero where the turning is compensated.
    ///
    /// # Errors
    /// [`KinematicsError`].
    fn turned_rad(
        &self,
        pose: &Pose,
        nominal: &[PositionNm; N],
        load: &Wrench,
    ) -> Result<Vector3<f64>, KinematicsError>;

    /// Returns the offsets that hold the tool where the nominal positions put it, in `pose`, under
    /// a load.
    ///
    /// # Errors
    /// [`KinematicsError`].
    fn correct(
        &self,
        pose: &Pose,
        nominal: &[PositionNm; N],
        load: &Wrench,
    ) -> Result<Correction<N>, KinematicsError>;

    /// Sets the share of the correction, 0 to 1.
    ///
    /// # Errors
    /// [`CompensatorError::Gain`]; the share before stays.
    fn set_gain(&mut self, gain: f64) -> Result<(), CompensatorError>;
}

impl<const N: usize> Clone for Box<dyn Compensate<N>> {
    fn clone(&self) -> Self {
        self.as_ref().copy()
    }
}

/// Returns positions in q-units, of axes of `metres_per_q`, as the reference path has them.
///
/// # Errors
/// `NotFinite` for positions beyond it.
pub fn on_path<const N: usize>(
    q: &[f64; N],
    metres_per_q: &[f64; N],
) -> Result<[PositionNm; N], KinematicsError> {
    let mut path = [PositionNm(0); N];
    for ((position, q), metres) in path.iter_mut().zip(q).zip(metres_per_q) {
        *position =
            PositionNm::from_metres(Metres(q * metres)).map_err(|_| KinematicsError::NotFinite)?;
    }
    Ok(path)
}

/// Positions of the axes for a pose under a load, q-units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CorrectedPose<const N: usize> {
    /// Without correction, rounded as the reference path is.
    pub nominal: [f64; N],
    /// With the correction.
    pub corrected: [f64; N],
    /// True where a limit cuts the correction.
    pub is_saturated: bool,
}

impl<const N: usize> CorrectedPose<N> {
    /// Corrects the positions `q` of a pose for a load, with axes of `metres_per_q`.
    ///
    /// # Errors
    /// [`KinematicsError`] of the correction; `NotFinite` for positions beyond the reference path.
    pub fn new(
        compensator: &dyn Compensate<N>,
        metres_per_q: &[f64; N],
        pose: &Pose,
        q: &[f64; N],
        load: &Wrench,
    ) -> Result<Self, KinematicsError> {
        let path = on_path(q, metres_per_q)?;
        let correction = compensator.correct(pose, &path, load)?;
        let (mut nominal, mut corrected) = (*q, *q);
        let both = nominal
            .iter_mut()
            .zip(&mut corrected)
            .zip(path)
            .zip(correction.offsets);
        for ((((nominal, corrected), position), offset), metres) in both.zip(metres_per_q) {
            *nominal = position.to_metres().0 / metres;
            *corrected = *nominal + offset.to_metres().0 / metres;
        }
        Ok(Self {
            nominal,
            corrected,
            is_saturated: correction.saturated.contains(&true),
        })
    }
}

#[cfg(test)]
#[allow(
    clippy::indexing_slicing,
    reason = "the tests walk axes by their number"
)]
mod tests;
