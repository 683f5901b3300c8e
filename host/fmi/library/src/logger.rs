//! The master's logger.

use std::ffi::{CStr, CString, c_void};

use crate::types::{fmi2CallbackFunctions, fmi2CallbackLogger, fmi2Status};

/// Logger of a component.
#[derive(Clone)]
pub(crate) struct Logger {
    name: CString,
    callback: Option<fmi2CallbackLogger>,
    environment: *mut c_void,
}

// SAFETY: the environment is passed back to the master and not touched here; the standard lets a master
// use a component from any thread, one at a time, and with it the logger that it gave.
unsafe impl Send for Logger {}

impl Logger {
    pub(crate) fn new(name: &str, functions: Option<&fmi2CallbackFunctions>) -> Self {
        Self {
            name: c_text(name),
            callback: functions.and_then(|functions| functions.logger),
            environment: functions.map_or(std::ptr::null_mut(), |functions| {
                functions.component_environment
            }),
        }
    }

    /// Tells the master a sentence.
    pub(crate) fn say(&self, status: fmi2Status, sentence: &str) {
        let Some(callback) = self.callback else {
            return;
        };
        let category: &CStr = match status {
            fmi2Status::Ok => c"logAll",
            fmi2Status::Warning => c"logStatusWarning",
            fmi2Status::Error => c"logStatusError",
            fmi2Status::Fatal => c"logStatusFatal",
        };
        // It is a format of `printf`: without an escape a % would read an argument that is not there.
        let message = c_text(&sentence.replace('%', "%%"));
        // SAFETY: the master gave a logger with this signature; every text ends with a zero, and lives
        // until the call returns. No lock is held: the logger may call this library.
        unsafe {
            callback(
                self.environment,
                self.name.as_ptr(),
                status,
                category.as_ptr(),
                message.as_ptr(),
            );
        }
    }
}

/// Returns a text for C: one with a zero in it ends there.
fn c_text(text: &str) -> CString {
    let until_zero = text.split('\0').next().unwrap_or_default();
    CString::new(until_zero).unwrap_or_default()
}
