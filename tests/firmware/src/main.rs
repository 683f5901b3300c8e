//! The complete core on a Cortex-M, driven by a timer interrupt at 1 kHz.
//!
//! The emulator's command line says what to do: `firmware replay`. (What serves a real client is `bin/link.rs`.)
#![no_std]
#![no_main]

mod board;
mod machine;
mod reading;
mod recording;
mod replay;

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
        Some(b"replay") => replay::run(ticks),
        _ => {
            defmt::error!("usage: firmware replay");
            false
        }
    }
}
