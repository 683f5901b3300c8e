//! Types of the header `fmi2FunctionTypes.h`, under its names.
#![expect(
    non_camel_case_types,
    reason = "the names of the standard, in which the calls are looked up"
)]

use std::ffi::{c_char, c_int, c_uint, c_void};

pub(crate) type fmi2Component = *mut c_void;
pub(crate) type fmi2FMUstate = *mut c_void;
pub(crate) type fmi2ValueReference = c_uint;
pub(crate) type fmi2Real = f64;
pub(crate) type fmi2Integer = c_int;
pub(crate) type fmi2Boolean = c_int;
pub(crate) type fmi2String = *const c_char;
pub(crate) type fmi2Byte = c_char;

/// `fmi2False`.
pub(crate) const FALSE: fmi2Boolean = 0;

/// `fmi2Type` of co-simulation.
pub(crate) const CO_SIMULATION: c_int = 1;
/// `fmi2StatusKind` of the last successful time.
pub(crate) const LAST_SUCCESSFUL_TIME: c_int = 2;

/// `fmi2Status`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum fmi2Status {
    /// Done.
    Ok = 0,
    /// Done, and the logger was told something.
    Warning = 1,
    /// CallRefused, or failed; the logger was told the reason.
    Error = 3,
    /// The component cannot be used any more.
    Fatal = 4,
}

/// `fmi2CallbackLogger`, which is variadic like `printf`.
pub(crate) type fmi2CallbackLogger =
    unsafe extern "C" fn(*mut c_void, fmi2String, fmi2Status, fmi2String, fmi2String, ...);

/// `fmi2CallbackFunctions`.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct fmi2CallbackFunctions {
    pub(crate) logger: Option<fmi2CallbackLogger>,
    pub(crate) allocate_memory: *const c_void,
    pub(crate) free_memory: *const c_void,
    pub(crate) step_finished: *const c_void,
    pub(crate) component_environment: *mut c_void,
}
