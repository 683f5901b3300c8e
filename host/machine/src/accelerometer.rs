//! Accelerometer on the platform, which takes the tool's inertia out of the measured load.
//!
//! The force sensor reads the load on the tool less what the tool's motion takes
//! ([`RigidBody::inertial_load`]). An accelerometer measures that motion, so that a share of it can
//! be added again before the filter of the load: the loop of the compensation then feels a smaller
//! tool, and its filter may be faster. `[T 4.2.5]` wished for it.

use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector3, Vector6};

use crate::halves::{halves, joined};
use crate::masses::{GRAVITY_M_PER_S2, RigidBody};

/// Components that an accelerometer measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeasuredAxes {
    /// The linear acceleration of its place. It is taken for that of the tool's centre: place it
    /// there.
    Three,
    /// The angular acceleration as well.
    Six,
}

impl MeasuredAxes {
    /// Returns their number.
    #[must_use]
    pub const fn count(self) -> u8 {
        match self {
            Self::Three => 3,
            Self::Six => 6,
        }
    }
}

/// An accelerometer, and the share of the tool's inertia that is taken out by it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accelerometer {
    /// Platform axes from its axes.
    pub rotation: Matrix3<f64>,
    /// From the tool centre point to its place, platform axes, m.
    pub place_m: Vector3<f64>,
    /// Measured components.
    pub axes: MeasuredAxes,
    /// Share of the inertia that is taken out, 0 to 1. All of it would leave no margin for a tool
    /// that is lighter than in the file.
    pub share: f64,
    /// True for one that shows gravity: +9.81 m/s^2 upwards, at rest.
    pub shows_gravity: bool,
}

impl Accelerometer {
    /// Returns what it shows, in its own axes: linear (m/s^2), then angular acceleration (rad/s^2);
    /// the latter is zero for one of three axes.
    ///
    /// `acceleration` is that of the tool centre point and of the orientation, `omega` the angular
    /// velocity (rad/s), world axes; `platform` turns from platform to world.
    #[must_use]
    pub fn seen(
        &self,
        acceleration: &Vector6<f64>,
        omega: &Vector3<f64>,
        platform: &UnitQuaternion<f64>,
    ) -> Vector6<f64> {
        let [linear, angular] = halves(acceleration);
        let place_m = platform * self.place_m;
        let of_place = linear + angular.cross(&place_m) + omega.cross(&omega.cross(&place_m));
        let to_own = self.rotation.transpose();
        let linear = to_own * (platform.inverse() * (of_place + self.at_rest()));
        match self.axes {
            MeasuredAxes::Three => joined(&linear, &Vector3::zeros()),
            MeasuredAxes::Six => joined(&linear, &(to_own * (platform.inverse() * angular))),
        }
    }

    /// Returns what the tool's motion takes by a sample without a zero error: force, and moment about
    /// the tool centre point, world axes; the share of it. Centripetal parts are left out.
    #[must_use]
    pub fn tool_load(
        &self,
        tool: &RigidBody,
        sample: &Vector6<f64>,
        platform: &UnitQuaternion<f64>,
    ) -> Vector6<f64> {
        let [linear, angular] = halves(sample).map(|own| platform * (self.rotation * own));
        let measured = joined(&(linear - self.at_rest()), &angular);
        self.load_by_measured(tool, platform) * measured
    }

    /// Returns what the tool's motion takes by the acceleration of the tool centre point and of the
    /// orientation, as this accelerometer finds it, 6 x 6: the share of the mass matrix of the tool
    /// for one of six axes.
    #[must_use]
    pub fn found_mass(&self, tool: &RigidBody, platform: &UnitQuaternion<f64>) -> Matrix6<f64> {
        let place_m = platform * self.place_m;
        let mut measured = Matrix6::identity();
        measured
            .fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&-place_m.cross_matrix());
        self.load_by_measured(tool, platform) * measured
    }

    /// Load of the tool's motion by the linear acceleration of the place and the angular one, world
    /// axes; the share of it.
    fn load_by_measured(&self, tool: &RigidBody, platform: &UnitQuaternion<f64>) -> Matrix6<f64> {
        // The mass matrix about the tool centre point, with the acceleration of the point taken from
        // that of the place.
        let at_point = match self.axes {
            MeasuredAxes::Six => platform * self.place_m,
            // Of an accelerometer at the centre the angular acceleration is not needed for the force.
            MeasuredAxes::Three => Vector3::zeros(),
        };
        let mut to_point = Matrix6::identity();
        to_point
            .fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&at_point.cross_matrix());
        let mut load = tool.mass_matrix(platform) * to_point * self.share;
        if self.axes == MeasuredAxes::Three {
            load.fixed_columns_mut::<3>(3).fill(0.0);
        }
        load
    }

    /// Acceleration that it shows at rest, world axes.
    fn at_rest(&self) -> Vector3<f64> {
        match self.shows_gravity {
            true => Vector3::new(0.0, 0.0, GRAVITY_M_PER_S2),
            false => Vector3::zeros(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    fn tool() -> RigidBody {
        RigidBody {
            mass_kg: 5.0,
            centre_m: Vector3::new(0.01, -0.02, -0.12),
            inertia_kgm2: Matrix3::from_diagonal(&Vector3::new(0.02, 0.03, 0.04)),
        }
    }

    fn mounted(axes: MeasuredAxes) -> Accelerometer {
        Accelerometer {
            rotation: Rotation3::from_euler_angles(0.3, -1.1, 2.0).into_inner(),
            place_m: Vector3::new(0.05, 0.02, -0.03),
            axes,
            share: 1.0,
            shows_gravity: true,
        }
    }

    const MOTION: [f64; 6] = [3.0, -2.0, 1.0, 4.0, -6.0, 5.0];

    #[test]
    fn six_axes_at_any_place_find_all_of_the_inertia() {
        let platform = UnitQuaternion::from_euler_angles(0.3, 0.2, -0.1);
        let motion = Vector6::from(MOTION);
        let still = Vector3::zeros();
        for shows_gravity in [true, false] {
            let accelerometer = Accelerometer {
                shows_gravity,
                ..mounted(MeasuredAxes::Six)
            };
            let sample = accelerometer.seen(&motion, &still, &platform);
            let found = accelerometer.tool_load(&tool(), &sample, &platform);
            let taken = tool().inertial_load(&platform, &motion, &still);
            assert!((found - taken).amax() < 1e-12, "{found} {taken}");
            let mass = accelerometer.found_mass(&tool(), &platform);
            assert!((mass * motion - taken).amax() < 1e-12);
        }
    }

    #[test]
    fn three_axes_at_the_centre_find_the_force_and_its_moment() {
        let platform = UnitQuaternion::from_euler_angles(0.3, 0.2, -0.1);
        let motion = Vector6::from(MOTION);
        let accelerometer = Accelerometer {
            place_m: tool().centre_m,
            share: 0.5,
            ..mounted(MeasuredAxes::Three)
        };
        let sample = accelerometer.seen(&motion, &Vector3::zeros(), &platform);
        assert_eq!(sample.fixed_rows::<3>(3), Vector3::zeros());
        let found = accelerometer.tool_load(&tool(), &sample, &platform);
        let point = RigidBody {
            inertia_kgm2: Matrix3::zeros(),
            ..tool()
        };
        let taken = point.inertial_load(&platform, &motion, &Vector3::zeros());
        assert!((found - taken * 0.5).amax() < 1e-12, "{found} {taken}");
        let mass = accelerometer.found_mass(&tool(), &platform);
        assert!((mass * motion - found).amax() < 1e-12);
    }

    /// On a circle of 0.1 m at 2 rad/s: 0.4 m/s^2 towards its centre.
    #[test]
    fn a_place_beside_the_axis_of_a_turn_is_pulled_to_it() {
        let beside = Accelerometer {
            rotation: Matrix3::identity(),
            place_m: Vector3::new(0.1, 0.0, 0.3),
            shows_gravity: false,
            ..mounted(MeasuredAxes::Six)
        };
        let shown = beside.seen(
            &Vector6::zeros(),
            &Vector3::new(0.0, 0.0, 2.0),
            &UnitQuaternion::identity(),
        );
        assert!((shown - Vector6::new(-0.4, 0.0, 0.0, 0.0, 0.0, 0.0)).amax() < 1e-12);
    }

    #[test]
    fn gravity_is_shown_upwards_at_rest() {
        let level = Accelerometer {
            rotation: Matrix3::identity(),
            ..mounted(MeasuredAxes::Three)
        };
        let shown = level.seen(
            &Vector6::zeros(),
            &Vector3::zeros(),
            &UnitQuaternion::identity(),
        );
        assert_eq!(
            shown,
            Vector6::new(0.0, 0.0, GRAVITY_M_PER_S2, 0.0, 0.0, 0.0)
        );
    }
}
