//! The complete core on a Cortex-M, driven by a timer interrupt at 1 kHz: plays the recording
//! `replay.in`. (`bin/link.rs` serves a real client.)
#![no_std]
#![no_main]

mod board;
mod ingress_budget;
#[cfg_attr(not(feature = "keyed"), path = "no_keys.rs")]
mod keys;
mod machine;
mod recording;
mod replay;

use board::host;
use board::timer::Ticks;
use cortex_m_rt::entry;

#[entry]
fn main() -> ! {
    let ticks = Ticks::start();
    host::exit(replay::run(ticks))
}
