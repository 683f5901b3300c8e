//! The firmware with a network: it serves a real client. An image of its own, for TCP is another's code and not free of panics.
#![no_std]
#![no_main]
#![allow(
    dead_code,
    reason = "board and machine are those of the firmware, which uses all of them"
)]

#[path = "../board/mod.rs"]
mod board;
#[path = "../link/mod.rs"]
mod link;
#[path = "../machine/mod.rs"]
mod machine;
#[path = "../net/mod.rs"]
mod net;
#[path = "../reading.rs"]
mod reading;

use board::host::{self, CommandLine};
use board::timer::Ticks;
use cortex_m_rt::entry;

/// The emulator's command line says how many sessions there will be: `link 2`.
#[entry]
fn main() -> ! {
    let ticks = Ticks::start();
    host::exit(link::run(ticks, CommandLine::read().words().nth(1)))
}
