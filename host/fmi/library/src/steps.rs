//! Communication steps.

use std::ffi::c_int;

use gantry_tau_fmi::instance::CallRefused;

use crate::arguments::fill;
use crate::registry::call;
use crate::types::{
    LAST_SUCCESSFUL_TIME, fmi2Boolean, fmi2Component, fmi2Integer, fmi2Real, fmi2Status,
    fmi2String, fmi2ValueReference,
};

/// Computes a step: a whole multiple of the cycle.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2DoStep(
    component: fmi2Component,
    current_communication_point: fmi2Real,
    communication_step_size: fmi2Real,
    _no_set_fmu_state_prior_to_current_point: fmi2Boolean,
) -> fmi2Status {
    call(component, |component| {
        let (time, length) = (current_communication_point, communication_step_size);
        component.instance.step(time, length)
    })
}

fn refuse(component: fmi2Component, reason: &str) -> fmi2Status {
    call(component, |_| Err(CallRefused::because(reason)))
}

/// No step is ever under way.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2CancelStep(component: fmi2Component) -> fmi2Status {
    refuse(component, "no step is under way")
}

/// Inputs stand during a step.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2SetRealInputDerivatives(
    component: fmi2Component,
    _references: *const fmi2ValueReference,
    _count: usize,
    _orders: *const fmi2Integer,
    _values: *const fmi2Real,
) -> fmi2Status {
    refuse(
        component,
        "inputs are not interpolated (canInterpolateInputs)",
    )
}

/// Outputs have no derivatives.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2GetRealOutputDerivatives(
    component: fmi2Component,
    _references: *const fmi2ValueReference,
    _count: usize,
    _orders: *const fmi2Integer,
    _values: *mut fmi2Real,
) -> fmi2Status {
    refuse(
        component,
        "outputs have no derivatives (maxOutputDerivativeOrder)",
    )
}

/// Outputs have no derivatives.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2GetDirectionalDerivative(
    component: fmi2Component,
    _unknowns: *const fmi2ValueReference,
    _n_unknowns: usize,
    _knowns: *const fmi2ValueReference,
    _n_knowns: usize,
    _dv_known: *const fmi2Real,
    _dv_unknown: *mut fmi2Real,
) -> fmi2Status {
    refuse(
        component,
        "there are no derivatives (providesDirectionalDerivative)",
    )
}

/// Returns the time to which the last step came.
///
/// # Safety
/// `value` is null or points to a place for a Real.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn fmi2GetRealStatus(
    component: fmi2Component,
    kind: c_int,
    value: *mut fmi2Real,
) -> fmi2Status {
    call(component, |component| {
        if kind != LAST_SUCCESSFUL_TIME {
            return Err(CallRefused::because(
                "status: expected fmi2LastSuccessfulTime",
            ));
        }
        // SAFETY: the caller's promise.
        Ok(unsafe { fill("value", value, &[component.instance.time()]) }?)
    })
}

/// No step is ever pending.
const NOT_PENDING: &str = "status: a step is never pending";

/// No step is ever pending.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2GetStatus(
    component: fmi2Component,
    _kind: c_int,
    _value: *mut c_int,
) -> fmi2Status {
    refuse(component, NOT_PENDING)
}

/// No step is ever pending.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2GetIntegerStatus(
    component: fmi2Component,
    _kind: c_int,
    _value: *mut fmi2Integer,
) -> fmi2Status {
    refuse(component, NOT_PENDING)
}

/// No step is ever pending.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2GetBooleanStatus(
    component: fmi2Component,
    _kind: c_int,
    _value: *mut fmi2Boolean,
) -> fmi2Status {
    refuse(component, NOT_PENDING)
}

/// No step is ever pending.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2GetStringStatus(
    component: fmi2Component,
    _kind: c_int,
    _value: *mut fmi2String,
) -> fmi2Status {
    refuse(component, NOT_PENDING)
}
