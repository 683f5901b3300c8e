//! The negative control of the test that looks for panics: an image that has one.
#![no_std]
#![no_main]

use core::hint::black_box;
use core::panic::PanicInfo;

use cortex_m_rt::entry;

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {
        cortex_m::asm::wfi();
    }
}

#[entry]
#[expect(clippy::indexing_slicing, reason = "the panic that shall be seen")]
fn main() -> ! {
    let values = black_box([1, 2, 3]);
    loop {
        black_box(values[black_box(3)]);
    }
}
