//! Compliance and stiffness about another point of the platform.
//!
//! At `P = T + d` the platform moves by `dx_P = X dx`, and a load there is `w = X^T w_P` at the tool centre point, with
//! `X = [I, -d x; 0, I]`. Hence `C_P = X C X^T` and `K_P = X^-T K X^-1`.

use nalgebra::{Matrix3, Matrix6, Vector3};

use super::{Compliance, Stiffness};
use crate::model::kinematics::KinematicsError;
use crate::model::linalg::{Lu, cross_matrix};
use crate::model::statics::finite;

/// `X`: motion of a point `d` from the reference.
fn shift(lever_m: &Vector3<f64>) -> Matrix6<f64> {
    let mut matrix = Matrix6::identity();
    matrix
        .fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&-cross_matrix(lever_m));
    matrix
}

impl Compliance {
    /// The compliance about the point `lever_m` (world axes, metres) from the present one.
    #[must_use]
    pub fn about(&self, lever_m: &Vector3<f64>) -> Self {
        let x = shift(lever_m);
        Self(x * self.0 * x.transpose())
    }

    /// `C_tt`: translation of the reference point per force at it, m/N. Not the inverse of the stiffness' block, which is that
    /// of a platform kept from turning.
    #[must_use]
    pub fn translation(&self) -> Matrix3<f64> {
        self.0.fixed_view::<3, 3>(0, 0).into_owned()
    }
}

impl Stiffness {
    /// The stiffness about the point `lever_m` (world axes, metres) from the present one.
    #[must_use]
    pub fn about(&self, lever_m: &Vector3<f64>) -> Self {
        let back = shift(&-lever_m);
        Self(back.transpose() * self.0 * back)
    }

    /// Translation (m, world axes) under a force (N) of a platform that is kept from turning, `dtheta = 0` `[T 3.13]`:
    /// `dT = K_tt^-1 F`. It is less than a free platform's.
    ///
    /// # Errors
    /// [`KinematicsError::Singular`], `NotFinite`.
    pub fn translation_without_rotation(
        &self,
        force_n: &Vector3<f64>,
    ) -> Result<Vector3<f64>, KinematicsError> {
        // Symmetric: columns are rows.
        let block: [[f64; 3]; 3] = self.0.fixed_view::<3, 3>(0, 0).into_owned().into();
        let translation = Lu::factor(&block)?.solve(&[force_n.x, force_n.y, force_n.z]);
        finite(translation).map(Vector3::from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::kinematics::Pose;
    use crate::model::l2::Robot;
    use crate::model::l2::tests::{close, compliances, geometry, l2};
    use crate::model::statics::Wrench;

    fn compliance() -> Compliance {
        let tcp = Vector3::new(0.0, 0.5, 0.65);
        let q = l2().inverse(&tcp).unwrap();
        let robot = Robot::new(geometry()).unwrap();
        let lines = robot.line_matrix(&Pose::at(tcp), &q).unwrap();
        lines.compliance(&compliances()).unwrap()
    }

    #[test]
    fn another_point_moves_as_the_platform_does() {
        let at_tool = compliance();
        let lever = Vector3::new(0.1, -0.2, 0.3);
        let there = at_tool.about(&lever);
        let (force, moment) = (
            Vector3::new(100.0, -50.0, 80.0),
            Vector3::new(3.0, 2.0, -1.0),
        );
        let load_there = Wrench {
            force_n: force,
            moment_nm: moment,
        };
        let load_at_tool = Wrench {
            force_n: force,
            moment_nm: moment + lever.cross(&force),
        };
        let moved = at_tool.displacement(&load_at_tool);
        let expected = moved.translation_m + moved.rotation_rad.cross(&lever);
        let found = there.displacement(&load_there);
        close(
            found.translation_m.as_slice(),
            expected.as_slice(),
            1e-12,
            "dT",
        );
        close(
            found.rotation_rad.as_slice(),
            moved.rotation_rad.as_slice(),
            1e-12,
            "dtheta",
        );
        let back = there
            .to_stiffness()
            .unwrap()
            .about(&-lever)
            .to_compliance()
            .unwrap();
        close(
            back.0.as_slice(),
            at_tool.0.as_slice(),
            1e-9,
            "there and back",
        );
    }

    #[test]
    fn a_platform_that_cannot_turn_yields_less() {
        let compliance = compliance();
        let stiffness = compliance.to_stiffness().unwrap();
        for force in [
            Vector3::x() * 300.0,
            Vector3::y() * 300.0,
            Vector3::z() * 300.0,
        ] {
            let held = stiffness.translation_without_rotation(&force).unwrap();
            let free = compliance.translation() * force;
            // Less work of the load, so less energy.
            assert!(held.dot(&force) < free.dot(&force), "{held} {free}");
            // What keeps it from turning is a moment: with it, the free platform stands the same.
            let held_all = nalgebra::Vector6::new(held.x, held.y, held.z, 0.0, 0.0, 0.0);
            let load = stiffness.0 * held_all;
            close(&load.as_slice()[..3], force.as_slice(), 1e-9, "K dx");
        }
        assert!(
            Stiffness(Matrix6::zeros())
                .translation_without_rotation(&Vector3::x())
                .is_err()
        );
    }
}
