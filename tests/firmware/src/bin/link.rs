//! The firmware with a network: it serves a real client. An image of its own, because the TCP crate
//! is not free of panics.
#![no_std]
#![no_main]
#![allow(
    dead_code,
    reason = "board and machine are those of the firmware, which uses all of them"
)]

#[path = "../board/mod.rs"]
mod board;
#[path = "../command_line.rs"]
mod command_line;
#[path = "../ingress_budget.rs"]
mod ingress_budget;
#[cfg_attr(feature = "keyed", path = "../keys.rs")]
#[cfg_attr(not(feature = "keyed"), path = "../no_keys.rs")]
mod keys;
#[path = "../link.rs"]
mod link;
#[path = "../machine/mod.rs"]
mod machine;
#[path = "../net/mod.rs"]
mod net;
#[path = "../session_log.rs"]
mod session_log;

use board::host;
use board::timer::Ticks;
use command_line::CommandLine;
use cortex_m_rt::entry;

/// The emulator's command line gives the number of sessions: `link 2`.
#[entry]
fn main() -> ! {
    let ticks = Ticks::start();
    host::exit(link::run(ticks, CommandLine::read().words().nth(1)))
}
