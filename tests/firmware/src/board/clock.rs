//! Time as the emulator counts it, which is instructions: with `-icount shift=5` each takes 32 ns.

use core::ptr::without_provenance_mut;

/// Frequency of the boards' clock.
pub(crate) const HZ: u32 = 25_000_000;

/// First timer of the CMSDK: control, value, reload.
const CONTROL: *mut u32 = without_provenance_mut(0x4000_0000);
const VALUE: *mut u32 = without_provenance_mut(0x4000_0004);
const RELOAD: *mut u32 = without_provenance_mut(0x4000_0008);

/// Lets the timer run, downwards and round.
pub(super) fn start() {
    // SAFETY: registers of the board's timer, which nothing else touches; every value of them is
    // allowed.
    unsafe {
        RELOAD.write_volatile(u32::MAX);
        VALUE.write_volatile(u32::MAX);
        CONTROL.write_volatile(1);
    }
}

/// Cycles of the clock since the start; round after 171 s.
pub(crate) fn now() -> u32 {
    // SAFETY: reading the timer's value has no effect.
    let left = unsafe { VALUE.read_volatile() };
    u32::MAX.wrapping_sub(left)
}
