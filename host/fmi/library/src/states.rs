//! Saved states.

use gantry_tau_fmi::instance::CallRefused;

use crate::arguments::{fill, one};
use crate::registry::call;
use crate::types::{fmi2Byte, fmi2Component, fmi2FMUstate, fmi2Status};

/// Saves the state of a component.
///
/// # Safety
/// `state` is null or points to a state of this component, or to null.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn fmi2GetFMUstate(
    component: fmi2Component,
    state: *mut fmi2FMUstate,
) -> fmi2Status {
    call(component, |component| {
        // SAFETY: the caller's promise.
        let before = unsafe { one("state", state) }?;
        let number = component.save(Some(before.addr()));
        let saved = std::ptr::without_provenance_mut(number);
        // SAFETY: the caller's promise.
        Ok(unsafe { fill("state", state, &[saved]) }?)
    })
}

/// Goes on from a saved state.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2SetFMUstate(
    component: fmi2Component,
    state: fmi2FMUstate,
) -> fmi2Status {
    call(component, |component| component.restore(state.addr()))
}

/// Frees a saved state.
///
/// # Safety
/// `state` is null or points to a state.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn fmi2FreeFMUstate(
    component: fmi2Component,
    state: *mut fmi2FMUstate,
) -> fmi2Status {
    call(component, |component| {
        // SAFETY: the caller's promise.
        let saved = unsafe { one("state", state) }?;
        // One that is null is freed already.
        if saved.is_null() {
            return Ok(());
        }
        component.forget(saved.addr())?;
        // SAFETY: the caller's promise.
        Ok(unsafe { fill("state", state, &[std::ptr::null_mut()]) }?)
    })
}

fn not_serialized(component: fmi2Component) -> fmi2Status {
    call(component, |_| {
        Err(CallRefused::because(
            "states cannot be serialized (canSerializeFMUstate)",
        ))
    })
}

/// States cannot be serialized.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2SerializedFMUstateSize(
    component: fmi2Component,
    _state: fmi2FMUstate,
    _size: *mut usize,
) -> fmi2Status {
    not_serialized(component)
}

/// States cannot be serialized.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2SerializeFMUstate(
    component: fmi2Component,
    _state: fmi2FMUstate,
    _bytes: *mut fmi2Byte,
    _size: usize,
) -> fmi2Status {
    not_serialized(component)
}

/// States cannot be serialized.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2DeSerializeFMUstate(
    component: fmi2Component,
    _bytes: *const fmi2Byte,
    _size: usize,
    _state: *mut fmi2FMUstate,
) -> fmi2Status {
    not_serialized(component)
}
