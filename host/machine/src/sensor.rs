//! Mounting of the six-axis force sensor `[T 4.2.5]`.

use gantry_tau_core::model::sensor::{SensorConfig, Tool};
use nalgebra::{Matrix3, UnitQuaternion, Vector3, Vector6};

use crate::halves::{halves, joined};
use crate::robot_file::{CYCLE_US, RobotFile, Sensor};
use crate::stability::FilterKind;

/// Mounting of a sensor on the platform, at `p` from the tool centre point with axes `R_s` (sensor
/// to platform). It shows the load on the tool, and the tool's weight, with their sign:
/// `F_s = R_s^T R^T F`, `M_s = R_s^T (R^T M - p x R^T F)`, with `R` of the platform under load.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mounting {
    /// `R_s`: platform axes from sensor axes.
    pub rotation: Matrix3<f64>,
    /// `p`: from the tool centre point to the sensor's origin, platform axes, m.
    pub lever_m: Vector3<f64>,
    /// Weight of what the sensor carries, world axes, N.
    pub weight_n: Vector3<f64>,
    /// From the tool centre point to its centre of gravity, platform axes, m.
    pub centre_m: Vector3<f64>,
}

impl From<&Sensor> for Mounting {
    fn from(sensor: &Sensor) -> Self {
        Self {
            rotation: sensor.rotation_matrix(),
            lever_m: sensor.lever_m.into(),
            weight_n: sensor.tool.weight_n.into(),
            centre_m: sensor.tool.centre_m.into(),
        }
    }
}

/// Returns mounting, filter and tare of the force sensor of a machine, one sample per cycle.
#[must_use]
pub fn config<K, const N: usize>(robot: &RobotFile<K, N>) -> SensorConfig {
    let filter = FilterKind::of(robot);
    SensorConfig {
        rotation: robot.sensor.rotation_matrix(),
        lever_m: robot.sensor.lever_m.into(),
        tool: robot.sensor.tool.into(),
        low_pass: filter.low_pass(),
        cutoff_hz: filter.cutoff_hz(),
        cycle_s: f64::from(CYCLE_US) * 1e-6,
        tare_samples: robot.sensor.tare_samples,
    }
}

impl Mounting {
    /// Returns load (force N, moment N m about the tool centre point, world axes) and weight in the
    /// sensor's axes, about its origin, with the platform turned by `platform` (platform to world).
    #[must_use]
    pub fn seen(&self, load: &Vector6<f64>, platform: &UnitQuaternion<f64>) -> Vector6<f64> {
        let [load_n, load_nm] = halves(load).map(|half| platform.inverse() * half);
        let weight_n = platform.inverse() * self.weight_n;
        let force = load_n + weight_n;
        let moment = load_nm + self.centre_m.cross(&weight_n);
        let force_seen = self.rotation.transpose() * force;
        let moment_seen = self.rotation.transpose() * (moment - self.lever_m.cross(&force));
        joined(&force_seen, &moment_seen)
    }

    /// Returns what a tool of this weight and centre shows alone, in the sensor's axes, about its
    /// origin: `R_s^T R^T G`, `R_s^T ((c - p) x R^T G)`, with the platform turned by `platform`
    /// (platform to world).
    #[must_use]
    pub fn tool_seen(&self, tool: &Tool, platform: &Matrix3<f64>) -> Vector6<f64> {
        let in_sensor = self.rotation.transpose();
        let weight_n = platform.transpose() * tool.weight_n;
        let arm_m = tool.centre_m - self.lever_m;
        joined(
            &(in_sensor * weight_n),
            &(in_sensor * arm_m.cross(&weight_n)),
        )
    }

    /// Returns the load whose sight, with the weight, is `seen`: the inverse of
    /// [`seen`](Self::seen).
    #[must_use]
    pub fn load(&self, seen: &Vector6<f64>, platform: &UnitQuaternion<f64>) -> Vector6<f64> {
        let [force, moment] = halves(seen).map(|half| self.rotation * half);
        let weight_n = platform.inverse() * self.weight_n;
        let load_nm = moment + self.lever_m.cross(&force) - self.centre_m.cross(&weight_n);
        joined(&(platform * (force - weight_n)), &(platform * load_nm))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    fn mounted() -> Mounting {
        Mounting {
            rotation: Rotation3::from_euler_angles(0.3, -1.1, 2.0).into_inner(),
            lever_m: Vector3::new(0.02, -0.05, 0.11),
            weight_n: Vector3::zeros(),
            centre_m: Vector3::zeros(),
        }
    }

    #[test]
    fn the_load_can_be_got_back() {
        let sensor = mounted();
        let load = Vector6::new(100.0, -50.0, 20.0, 3.0, 4.0, -5.0);
        let platform = UnitQuaternion::from_euler_angles(0.3, 0.2, -0.1);
        let seen = sensor.seen(&load, &platform);
        assert!((sensor.load(&seen, &platform) - load).amax() < 1e-12);
        let weighted = Mounting {
            weight_n: Vector3::new(1.0, 2.0, -49.0),
            centre_m: Vector3::new(0.1, 0.02, -0.3),
            ..sensor
        };
        assert!((weighted.load(&weighted.seen(&load, &platform), &platform) - load).amax() < 1e-12);
    }

    #[test]
    fn a_weight_is_a_load_at_its_centre() {
        let centre_m = Vector3::new(0.1, 0.02, -0.3);
        let sensor = Mounting {
            weight_n: Vector3::new(0.0, 0.0, -49.0),
            centre_m,
            ..mounted()
        };
        let platform = UnitQuaternion::from_euler_angles(0.3, 0.2, -0.1);
        let moment = (platform * centre_m).cross(&sensor.weight_n);
        let load = Vector6::new(0.0, 0.0, -49.0, moment.x, moment.y, moment.z);
        let off = sensor.seen(&Vector6::zeros(), &platform) - mounted().seen(&load, &platform);
        assert!(off.amax() < 1e-12, "{off}");
    }

    #[test]
    fn a_tool_alone_shows_its_weight() {
        let tool = Tool {
            weight_n: Vector3::new(1.0, 2.0, -49.0),
            centre_m: Vector3::new(0.1, 0.02, -0.3),
        };
        let sensor = Mounting {
            weight_n: tool.weight_n,
            centre_m: tool.centre_m,
            ..mounted()
        };
        let platform = UnitQuaternion::from_euler_angles(0.3, 0.2, -0.1);
        let seen = sensor.tool_seen(&tool, &platform.to_rotation_matrix().into_inner());
        assert!((seen - sensor.seen(&Vector6::zeros(), &platform)).amax() < 1e-12);
    }

    #[test]
    fn a_force_at_the_sensor_gives_it_no_moment() {
        let sensor = mounted();
        let force = Vector3::new(10.0, 20.0, -30.0);
        let moment = sensor.lever_m.cross(&force);
        let load = Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z);
        assert!(
            sensor
                .seen(&load, &UnitQuaternion::identity())
                .fixed_rows::<3>(3)
                .amax()
                < 1e-12
        );
    }
}
