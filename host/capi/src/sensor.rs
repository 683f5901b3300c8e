//! The force sensor: tare, frame, low-pass.

use core::ffi::c_void;
use core::ptr::null_mut;

use gantry_tau_core::model::load_filter::Notch;
use gantry_tau_core::model::sensor::{ForceSensor, LowPass, Reading, SensorConfig, Tool};
use gantry_tau_core::model::statics::Wrench;

use crate::code::gt_code;
use crate::error::{gt_error, gt_parameter};
use crate::machine::{gt_pose, gt_wrench, matrix};
use crate::memory::{Object, Reply, answer, checked, create, object_mut, read, reply, tag};

/// Bytes of a gt_sensor.
pub const GT_SENSOR_SIZE: usize = 1536;

/// Mounting and filter of a sensor.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct gt_sensor_config {
    /// R_s: platform axes from sensor axes, row by row.
    pub rotation: [[f64; 3]; 3],
    /// p: from the tool centre point to the sensor's origin, platform axes, m; at most 10.
    pub lever_m: [f64; 3],
    /// G: weight of what the sensor carries, a force, world axes, N; at most 1e5. Zero where it is
    /// not known, and so is tared.
    pub tool_weight_n: [f64; 3],
    /// c: from the tool centre point to its centre of gravity, platform axes, m; at most 10.
    pub tool_centre_m: [f64; 3],
    /// Cut-off frequency of the low-pass, Hz, 1e-3 to 1e5, or to 0.45 / cycle_s of second order.
    pub cutoff_hz: f64,
    /// Time between two samples, s, 1e-6 to 10.
    pub cycle_s: f64,
    /// Samples of the tare, 1 to 1e6; the tool must be unloaded meanwhile.
    pub tare_samples: u32,
    /// Order of the low-pass: 1, or 2 (Butterworth), which can have notches.
    pub order: u32,
}

/// A force sensor.
pub struct gt_sensor(());

impl Object for ForceSensor {
    type Handle = gt_sensor;
    const BYTES: usize = GT_SENSOR_SIZE;
    const TAG: u64 = tag(b"gtsenso", 0);
}

/// Makes a sensor in `memory`; it starts with its tare.
///
/// `memory`, `size`: aligned to GT_ALIGN, at least GT_SENSOR_SIZE bytes. `sensor`: receives the
/// handle.
///
/// Errors: GT_CODE_MEMORY_TOO_SMALL, GT_CODE_SENSOR_NOT_ROTATION, GT_CODE_SENSOR_OUT_OF_RANGE: the
/// first found.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_sensor_init(
    memory: *mut c_void,
    size: usize,
    config: *const gt_sensor_config,
    sensor: *mut *mut gt_sensor,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        create(memory, size, sensor, error, || {
            let config = read(config)?;
            Ok(ForceSensor::new(SensorConfig {
                rotation: matrix(&config.rotation),
                lever_m: config.lever_m.into(),
                tool: Tool {
                    weight_n: config.tool_weight_n.into(),
                    centre_m: config.tool_centre_m.into(),
                },
                low_pass: low_pass(config.order)?,
                cutoff_hz: config.cutoff_hz,
                cycle_s: config.cycle_s,
                tare_samples: config.tare_samples,
            })?)
        })
    }
}

/// Returns the low-pass of this order.
fn low_pass(order: u32) -> Reply<LowPass> {
    match order {
        1 => Ok(LowPass::FirstOrder),
        2 => Ok(LowPass::SecondOrder),
        _ => Err(gt_error::new(gt_code::SensorOutOfRange)
            .of(gt_parameter::Order)
            .range(1.0, 2.0)),
    }
}

/// Moves the notches behind a low-pass of second order, within 50 cycles, or at once while it is
/// tared. A machine swings least with them at its natural frequencies where it is.
///
/// `hz`: three frequencies, 1e-3 to 0.45 / cycle_s; 0: no notch. Each has its place: a notch that
/// moves stays where it is among them. `q`: of all three, 0.1 to 10; 0.7 is wide enough for
/// frequencies that are 20 % wrong.
///
/// Errors: GT_CODE_SENSOR_OUT_OF_RANGE, also for a notch behind a low-pass of first order; the
/// sensor is then unchanged.
///
/// cbindgen:ptrs-as-arrays=[[hz;3]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_sensor_set_notches(
    sensor: *mut gt_sensor,
    hz: *const f64,
    q: f64,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        reply(error, || {
            let hz: [f64; 3] = read(hz.cast())?;
            let sensor = object_mut::<ForceSensor>(sensor)?;
            sensor.set_notches(&hz.map(|hz| (hz != 0.0).then_some(Notch { hz, q })))?;
            Ok(())
        })
    }
}

/// Takes one raw sample (sensor axes, about the sensor's origin), once per cycle, with the platform
/// in `pose`, of which only the rotation is read: of an L2 it is constant, of an F1 see
/// gt_f1_tracker_pose. `taring` receives the samples that the tare still needs; when it is 0,
/// `load` receives the load on the platform, world axes, about the tool centre point, filtered,
/// otherwise zeros. Constant cost.
///
/// Errors: GT_CODE_SENSOR_BAD_READING, GT_CODE_SENSOR_PLATFORM_NOT_ROTATION; the sensor is then
/// unchanged.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_sensor_update(
    sensor: *mut gt_sensor,
    raw: *const gt_wrench,
    pose: *const gt_pose,
    load: *mut gt_wrench,
    taring: *mut u32,
) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        answer(load, null_mut(), || {
            let (taring, raw, sensor) = (
                checked(taring)?,
                read(raw)?,
                object_mut::<ForceSensor>(sensor)?,
            );
            let rotation = matrix(&read(pose)?.rotation);
            let (wrench, remaining) = match sensor.update(&raw.into(), &rotation)? {
                Reading::Taring { remaining } => (Wrench::zero(), remaining),
                Reading::Load(wrench) => (wrench, 0),
            };
            taring.write(remaining);
            Ok(wrench.into())
        })
    }
}

/// Starts again with the tare, the filter at zero. The tool must be unloaded.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_sensor_restart(sensor: *mut gt_sensor) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        reply(null_mut(), || {
            object_mut::<ForceSensor>(sensor)?.restart_tare();
            Ok(())
        })
    }
}
