//! The complete core on a Cortex-M, driven by a timer interrupt at 1 kHz.
//!
//! The emulator's command line says what to do: `firmware replay` or `firmware link`.
#![no_std]
#![no_main]

mod board;
#[cfg(feature = "link")]
mod link;
mod machine;
#[cfg(feature = "link")]
mod net;

use board::host::{self, CommandLine};
use board::timer::Ticks;
use cortex_m_rt::entry;

#[entry]
fn main() -> ! {
    let ticks = Ticks::start();
    host::exit(run(ticks))
}

/// Does what the command line says; whether it went well.
fn run(ticks: Ticks) -> bool {
    match CommandLine::read().words().nth(1) {
        Some(b"idle") => idle(ticks),
        #[cfg(feature = "link")]
        Some(b"link") => link::run(ticks, CommandLine::read().words().nth(2)),
        _ => {
            defmt::error!("usage: firmware idle | replay | link");
            false
        }
    }
}

/// Ten ticks of nothing: the board is alive.
fn idle(mut ticks: Ticks) -> bool {
    for _ in 0..10 {
        let elapsed = ticks.wait();
        let now = board::clock::instructions(board::clock::now());
        defmt::info!(
            "{=u32} ticks later, after {=u32} instructions",
            elapsed,
            now
        );
    }
    defmt::info!("stack {=usize} bytes", board::stack::high_water());
    true
}
