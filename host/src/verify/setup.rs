//! How far the set-up of a campaign may be off, in readings: columns of unit variance, from the standard deviations of `[setup]`.

use nalgebra::{DMatrix, Matrix3, Matrix6, Vector3, Vector6};

use crate::elastic::{ElasticMachine, Equilibrium};
use crate::measurements::springs::SetupNoise;
use crate::springs::gauge::Gauge;

/// Constants of the sensor, the same in all windows: three of its lever, three of its axes, six gains.
pub(super) const SENSOR: usize = 12;
/// Constants of a gauge, the same in a mounting: three of its point, two of its direction.
pub(super) const GAUGE: usize = 5;

/// Returns by how much a load (world axes) may differ from the one that the sensor shows, by standard deviations of its constants.
pub(super) fn of_sensor(setup: &SetupNoise, rotation: &Matrix3<f64>, load: &Vector6<f64>) -> DMatrix<f64> {
    let sd = |value: Option<f64>, unit: f64| value.unwrap_or(0.0) * unit;
    let (lever_m, axes_rad) = (sd(setup.sensor_lever_mm, 1e-3), sd(setup.sensor_axes_mrad, 1e-3));
    let (force, moment) = (load.fixed_rows::<3>(0).into_owned(), load.fixed_rows::<3>(3).into_owned());
    let mut columns = DMatrix::zeros(6, SENSOR);
    let mut set = |column: usize, force: Vector3<f64>, moment: Vector3<f64>| {
        columns.view_mut((0, column), (3, 1)).copy_from(&force);
        columns.view_mut((3, column), (3, 1)).copy_from(&moment);
    };
    for (axis, unit) in [Vector3::x(), Vector3::y(), Vector3::z()].into_iter().enumerate() {
        set(axis, Vector3::zeros(), unit.cross(&force) * lever_m);
        set(3 + axis, unit.cross(&force) * axes_rad, unit.cross(&moment) * axes_rad);
        let (own, gain) = (rotation * unit, setup.sensor_gain.unwrap_or(0.0));
        set(6 + axis, own * (own.dot(&force) * gain), Vector3::zeros());
        set(9 + axis, Vector3::zeros(), own * (own.dot(&moment) * gain));
    }
    columns
}

/// Returns by how much the reading of a gauge changes with its constants, per standard deviation. By the formula of the reading only: the
/// machine stands where it stood.
pub(super) fn of_gauge<const N: usize>(
    setup: &SetupNoise,
    gauge: &Gauge,
    machine: &ElasticMachine<N>,
    began: &Equilibrium<N>,
    now: &Equilibrium<N>,
) -> [f64; GAUGE] {
    let Gauge::Platform { point_m, axis } = *gauge else { return [0.0; GAUGE] };
    let (point_sd_m, turn_sd) =
        (setup.gauge_point_mm.unwrap_or(0.0) * 1e-3, setup.gauge_axis_mrad.unwrap_or(0.0) * 1e-3);
    let read = |gauge: Gauge| gauge.read(machine, &began.pose, now).length_m;
    let here = read(*gauge);
    let moved = |way: Vector3<f64>| read(Gauge::Platform { point_m: point_m + way * point_sd_m, axis }) - here;
    let turned = |way: Vector3<f64>| read(Gauge::Platform { point_m, axis: (axis + way * turn_sd).normalize() }) - here;
    let one = axis.cross(&Vector3::ith(axis.iamin(), 1.0)).normalize();
    let other = axis.cross(&one);
    [moved(Vector3::x()), moved(Vector3::y()), moved(Vector3::z()), turned(one), turned(other)]
}

/// Covariance of the noise of a load.
pub(super) fn load_noise(force_n: f64, moment_nm: f64) -> Matrix6<f64> {
    let (force, moment) = (force_n.powi(2), moment_nm.powi(2));
    Matrix6::from_diagonal(&Vector6::new(force, force, force, moment, moment, moment))
}
