//! States saved and restored, for simulations that go back: an object is copied, and goes on from its
//! copy. A machine or a compensator has no state.

use core::ffi::c_void;

use gantry_tau_core::model::sensor::ForceSensor;

use crate::code::gt_code;
use crate::error::gt_error;
use crate::f1::{Tracker, gt_f1_tracker};
use crate::memory::{answer, duplicate};
use crate::sensor::gt_sensor;
use crate::server::{duplicate_server, gt_server};

/// Copies a server with its session, connections and black box: a saved state. To restore it, copy
/// it back to where the first one is, or go on with the copy. Both have the same epochs and keys, so
/// one machine must never be led by both.
///
/// `memory`, `size`: aligned to GT_ALIGN, at least as many bytes as gt_server_config_check has
/// returned, apart from the server. `copy`: receives the handle.
///
/// Errors: GT_CODE_MEMORY_TOO_SMALL, GT_CODE_OVERLAP.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_copy(
    server: *const gt_server,
    memory: *mut c_void,
    size: usize,
    copy: *mut *mut gt_server,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe { answer(copy, error, || duplicate_server(server, memory, size)) }
}

/// Copies a sensor with its tare and its filter; as gt_server_copy.
///
/// `memory`, `size`: aligned to GT_ALIGN, at least GT_SENSOR_SIZE bytes, apart from the sensor.
/// `copy`: receives the handle.
///
/// Errors: GT_CODE_MEMORY_TOO_SMALL, GT_CODE_OVERLAP.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_sensor_copy(
    sensor: *const gt_sensor,
    memory: *mut c_void,
    size: usize,
    copy: *mut *mut gt_sensor,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        answer(copy, error, || {
            duplicate::<ForceSensor>(sensor, memory, size)
        })
    }
}

/// Copies a tracker with its last pose; as gt_server_copy.
///
/// `memory`, `size`: aligned to GT_ALIGN, at least GT_F1_TRACKER_SIZE bytes, apart from the tracker.
/// `copy`: receives the handle.
///
/// Errors: GT_CODE_MEMORY_TOO_SMALL, GT_CODE_OVERLAP.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_f1_tracker_copy(
    tracker: *const gt_f1_tracker,
    memory: *mut c_void,
    size: usize,
    copy: *mut *mut gt_f1_tracker,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe { answer(copy, error, || duplicate::<Tracker>(tracker, memory, size)) }
}
