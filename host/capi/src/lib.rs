//! The C interface of gantry-tau-core. What a C programmer reads is `include/gantry_tau.h`, which cbindgen writes from these files.
//!
//! | module | what it holds |
//! |---|---|
//! | [`code`] | one code per error |
//! | [`error`] | from core's errors to codes with their fields |
//! | [`memory`] | pointers that come from C, and objects in the caller's memory |
//! | [`server`] | the session, bytes in and references out |
//! | [`black_box`] | the evidence as lines of text |
//! | [`machine`] | poses, loads and springs |
//! | [`l2`], [`f1`] | kinematics and statics of three axes and of six |
//! | [`compensation`] | from a load to offsets |
//! | [`sensor`] | from a raw reading to a load |
//!
//! Unsafe code is what a C interface is made of, and it is only here: core forbids it. Every function of the interface takes what it
//! needs through [`memory`], which refuses null and misaligned pointers and objects that are none; what cannot be seen from a pointer
//! is the caller's promise, written at the head of the header.
#![cfg_attr(not(test), no_std)]
#![allow(
    non_camel_case_types,
    reason = "types have the names they have in C, so that both sides are found by one search"
)]
#![allow(
    clippy::missing_safety_doc,
    reason = "the rules for pointers are the same for every function and stand once, at the head of the header"
)]

pub mod black_box;
pub mod code;
pub mod compensation;
pub mod error;
pub mod f1;
pub mod l2;
pub mod machine;
pub mod memory;
pub mod sensor;
pub mod server;

/// Version of this interface. It changes with every change to a type, a constant or the meaning of a function.
pub const GT_ABI_VERSION: u32 = 2;

/// GT_ABI_VERSION of the library that is linked: compare it with the header's before anything else.
#[unsafe(no_mangle)]
pub extern "C" fn gt_abi_version() -> u32 {
    GT_ABI_VERSION
}

/// Version of the library, such as "0.1.0". Static, never to be freed.
#[unsafe(no_mangle)]
pub extern "C" fn gt_version() -> *const core::ffi::c_char {
    const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), "\0");
    VERSION.as_ptr().cast()
}

#[cfg(not(test))]
unsafe extern "C" {
    fn gantry_tau_panic() -> !;
}

/// No path leads here: the function it calls does not exist, so a library that could panic would not link into any program.
#[cfg(not(test))]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    // SAFETY: never called; the symbol only marks that a panic is reachable.
    unsafe { gantry_tau_panic() }
}
