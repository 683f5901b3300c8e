//! Machines that a robot file allows: as far off it as it says of itself.

use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::robot::RobotError;
use gantry_tau_core::model::{f1, l2};
use gantry_tau_machine::model::{F1, L2, MachineKind};
use nalgebra::Vector3;

use super::f1::forward;
use super::l2::{Nominal, PredictionError};

/// Reason why a geometry that is off a robot file's is not that of a machine.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DeviationError {
    /// That of an L2.
    #[error(transparent)]
    L2(#[from] PredictionError),
    /// That of an F1.
    #[error(transparent)]
    F1(#[from] RobotError),
}

/// Kind of machine whose geometry may be a little off.
pub trait Deviating<const N: usize>: MachineKind<N> {
    /// Returns a machine that is a little off this one: each number of its geometry by `draw` times
    /// `off_m`.
    ///
    /// # Errors
    /// [`DeviationError`].
    fn off(&self, off_m: f64, draw: &mut dyn FnMut() -> f64) -> Result<Self, DeviationError>;

    /// Returns the pose with the axes at `q`, near another; `None` where the links do not meet.
    fn stand(&self, q: &[f64; N], near: &Pose) -> Option<Pose>;
}

impl Deviating<{ l2::AXES }> for L2 {
    fn off(&self, off_m: f64, draw: &mut dyn FnMut() -> f64) -> Result<Self, DeviationError> {
        let geometry = self.robot().geometry();
        let file = Nominal::of(geometry);
        let truth = Nominal {
            origins_m: file.origins_m.map(|origin| origin + drawn(off_m, draw)),
            guideways: file.guideways.map(|guideway| guideway + drawn(off_m, draw)),
            lengths_m: file.lengths_m.map(|length| length + drawn(off_m, draw).x),
        };
        Ok(truth.kinematics(geometry.configuration)?)
    }

    fn stand(&self, q: &[f64; l2::AXES], _: &Pose) -> Option<Pose> {
        self.forward(q).ok().map(Pose::at)
    }
}

impl Deviating<{ f1::AXES }> for F1 {
    fn off(&self, off_m: f64, draw: &mut dyn FnMut() -> f64) -> Result<Self, DeviationError> {
        let file = *self.robot().geometry();
        let truth = f1::Geometry {
            carts_m: file.carts_m.map(|joint| joint + drawn(off_m, draw)),
            guideways: file.guideways.map(|guideway| guideway + drawn(off_m, draw)),
            plate_joints_m: file.plate_joints_m.map(|joint| joint + drawn(off_m, draw)),
            platform_joints_m: file
                .platform_joints_m
                .map(|joint| joint + drawn(off_m, draw)),
            lengths_m: file.lengths_m.map(|length| length + drawn(off_m, draw).x),
            turn_axis: (file.turn_axis + drawn(off_m, draw)).normalize(),
            tilt_axis: (file.tilt_axis + drawn(off_m, draw)).normalize(),
            travel: None,
            ..file
        };
        Ok(Self::new(&f1::Robot::new(truth)?))
    }

    fn stand(&self, q: &[f64; f1::AXES], near: &Pose) -> Option<Pose> {
        forward(self, q, near).ok()
    }
}

/// Vector of three draws, times `off_m`.
fn drawn(off_m: f64, draw: &mut dyn FnMut() -> f64) -> Vector3<f64> {
    Vector3::new(draw(), draw(), draw()) * off_m
}

#[cfg(test)]
mod tests {
    use super::*;
    use gantry_tau_machine::robot_file::RobotFile;

    const OFF_M: f64 = 1e-3;

    fn is_off(is: &Vector3<f64>, file: &Vector3<f64>) -> bool {
        (is - file - Vector3::repeat(OFF_M)).amax() < 1e-12
    }

    #[test]
    fn each_number_of_an_l2_is_off_by_its_draw() {
        let model = RobotFile::builtin_l2().unwrap().model;
        let [file, off] = [&model, &model.off(OFF_M, &mut || 1.0).unwrap()]
            .map(|model| Nominal::of(model.robot().geometry()));
        assert!((0..3).all(|arm| is_off(&off.origins_m[arm], &file.origins_m[arm])));
        assert!((0..3).all(|arm| is_off(&off.guideways[arm], &file.guideways[arm])));
        assert!((0..3).all(|arm| (off.lengths_m[arm] - file.lengths_m[arm] - OFF_M).abs() < 1e-12));
    }

    #[test]
    fn each_number_of_an_f1_is_off_by_its_draw() {
        let model = RobotFile::builtin_f1().unwrap().model;
        let [file, off] = [&model, &model.off(OFF_M, &mut || 1.0).unwrap()]
            .map(|model| *model.robot().geometry());
        assert!((0..3).all(|arm| is_off(&off.carts_m[arm], &file.carts_m[arm])));
        assert!((0..3).all(|arm| is_off(&off.guideways[arm], &file.guideways[arm])));
        assert!(
            off.plate_joints_m
                .iter()
                .zip(&file.plate_joints_m)
                .all(|(off, file)| is_off(off, file))
        );
        assert!(
            off.platform_joints_m
                .iter()
                .zip(&file.platform_joints_m)
                .all(|(off, file)| is_off(off, file))
        );
        assert!(
            off.lengths_m
                .iter()
                .zip(&file.lengths_m)
                .all(|(off, file)| (off - file - OFF_M).abs() < 1e-12)
        );
        for (off, file) in [
            (off.turn_axis, file.turn_axis),
            (off.tilt_axis, file.tilt_axis),
        ] {
            let turned = (file + Vector3::repeat(OFF_M)).normalize();
            assert!((off - turned).amax() < 1e-12);
        }
    }
}
