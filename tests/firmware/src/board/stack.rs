//! Largest use of the stack so far: before main, cortex-m-rt filled it with a pattern.

use core::ptr::addr_of;

/// Pattern that cortex-m-rt fills the stack with.
const PATTERN: u32 = 0xcccc_cccc;

unsafe extern "C" {
    /// Lower end of what the stack may use; the linker's script says where.
    static _stack_end: u32;
    /// Upper end of the stack, which grows downwards.
    static _stack_start: u32;
}

/// Fills what is not in use with the pattern once more, so that what follows is measured by itself.
#[inline(never)]
pub(crate) fn forget() {
    let here = 0_u32;
    // Below this function's own frame nothing is in use; an interrupt's frame would come and go,
    // and be seen.
    let top = addr_of!(here).wrapping_sub(64);
    let mut word = addr_of!(_stack_end).cast_mut();
    while word.cast_const() < top {
        // SAFETY: memory of the stack below everything that is in use.
        unsafe { word.write_volatile(PATTERN) };
        word = word.wrapping_add(1);
    }
}

/// Bytes between the beginning of the stack and the lowest word that was written.
pub(crate) fn high_water() -> usize {
    let (lowest, highest) = (addr_of!(_stack_end), addr_of!(_stack_start));
    let mut word = lowest;
    // SAFETY: all words between the two symbols are memory, which nothing but the stack uses; the
    // reads are volatile because the compiler does not know of the filling.
    while word < highest && unsafe { word.read_volatile() } == PATTERN {
        // SAFETY: at most one past the last.
        word = unsafe { word.add(1) };
    }
    highest.addr().saturating_sub(word.addr())
}
