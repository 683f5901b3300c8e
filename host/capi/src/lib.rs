//! C interface of gantry-tau-core. cbindgen writes `include/gantry_tau.h`, its reference for C
//! programmers, from these files.
//!
//! | module | contents |
//! |---|---|
//! | [`code`] | one code per error |
//! | [`error`] | core's errors as codes with their fields |
//! | [`memory`] | pointers from C, and objects in the caller's memory |
//! | `padding` | bytes of results that no field has |
//! | [`server`] | the session: bytes in, references out, then bytes out |
//! | [`black_box`] | the recorded ticks as parts of a file |
//! | [`machine`] | poses, loads and springs |
//! | [`l2`], [`f1`] | kinematics and statics of three axes and of six |
//! | [`compensation`] | offsets from a load |
//! | [`sensor`] | loads from raw readings |
//! | [`copies`] | states saved and restored |
//!
//! A C interface needs unsafe code; core forbids it. Every function takes its arguments through
//! [`memory`], which refuses null and misaligned pointers, and handles without a live object of
//! their type. The rest is the caller's promise, at the head of the header.
#![cfg_attr(not(any(test, feature = "verification")), no_std)]
#![cfg_attr(
    test,
    allow(
        clippy::arithmetic_side_effects,
        reason = "a test that overflows must panic"
    )
)]
#![allow(
    non_camel_case_types,
    reason = "types have the names they have in C, so that both sides are found by one search"
)]
#![allow(
    clippy::missing_safety_doc,
    reason = "the rules for pointers are the same for every function and stand once, at the head of the header"
)]

/// Converts an enum of core to that of C: by the same names, and what has no name there to `else`.
macro_rules! by_name {
    ($core:ident => $c:ident { $($name:ident)+ $(; else $other:ident)? }) => {
        impl From<$core> for $c {
            fn from(value: $core) -> Self {
                match value {
                    $($core::$name => Self::$name,)+
                    $(_ => Self::$other,)?
                }
            }
        }
    };
}

pub mod black_box;
pub mod code;
pub mod compensation;
pub mod copies;
pub mod error;
pub mod f1;
pub mod l2;
pub mod machine;
pub mod memory;
mod padding;
pub mod sensor;
pub mod server;
#[cfg(feature = "verification")]
pub mod verification;

/// Version of this interface. It changes with every change to a type, a constant or the meaning of
/// a function.
pub const GT_ABI_VERSION: u32 = 9;

/// Returns GT_ABI_VERSION of the linked library. Compare it with the header's before any other
/// call.
#[unsafe(no_mangle)]
pub extern "C" fn gt_abi_version() -> u32 {
    GT_ABI_VERSION
}

/// Returns the version of the library, such as "0.1.0": a static string, not to be freed.
#[unsafe(no_mangle)]
pub extern "C" fn gt_version() -> *const core::ffi::c_char {
    const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), "\0");
    VERSION.as_ptr().cast()
}

// The proofs and the tests bring the standard library, which has a panic handler.
#[cfg(not(any(test, feature = "verification")))]
unsafe extern "C" {
    fn gantry_tau_panic() -> !;
}

/// Never called: the function that it calls does not exist, so a library with a panic path does not
/// link into any program.
#[cfg(not(any(test, feature = "verification")))]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    // SAFETY: never called; the symbol only marks that a panic is reachable.
    unsafe { gantry_tau_panic() }
}
