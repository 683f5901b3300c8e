//! The emulated boards mps2-an500 (Cortex-M7) and mps2-an386 (Cortex-M4F): a timer interrupt, a
//! clock, a console.
#![allow(
    unsafe_code,
    reason = "registers, linker's symbols, an interrupt and copying in assembly; each block says why it is sound"
)]

pub(crate) mod clock;
pub(crate) mod copy;
pub(crate) mod host;
mod log;
pub(crate) mod stack;
pub(crate) mod timer;

use core::panic::PanicInfo;

use cortex_m_rt::{ExceptionFrame, exception};

/// Required by the compiler. The test looks that the image has no call of it.
#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    host::exit(false)
}

/// A bad address or instruction, a stack that ran out of memory.
#[exception]
unsafe fn HardFault(_: &ExceptionFrame) -> ! {
    host::exit(false)
}
