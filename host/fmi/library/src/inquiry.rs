//! Versions of the interface.

use crate::types::fmi2String;

/// Returns the platform of the types.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2GetTypesPlatform() -> fmi2String {
    c"default".as_ptr()
}

/// Returns the version of the standard.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2GetVersion() -> fmi2String {
    c"2.0".as_ptr()
}
