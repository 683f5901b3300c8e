//! Clock behind ethercrab's timers: that of the wire, as the pump has set it last.
//!
//! A timer of ethercrab asks this clock whenever it is polled, and the pump polls all the time; so
//! no timer need wake anybody, and there is neither a thread nor a lock nor a queue behind them.
//! The clock belongs to the thread that pumps.

use std::cell::Cell;
use std::task::Waker;

use embassy_time_driver::Driver;

thread_local! {
    static NOW_US: Cell<u64> = const { Cell::new(0) };
}

/// Tells the clock of this thread the time, µs.
pub(crate) fn set_us(now: u64) {
    NOW_US.set(now);
}

#[derive(Debug)]
struct WireClock;

impl Driver for WireClock {
    fn now(&self) -> u64 {
        // Ticks of 1 µs.
        NOW_US.get()
    }

    fn schedule_wake(&self, _at: u64, _waker: &Waker) {}
}

embassy_time_driver::time_driver_impl!(static CLOCK: WireClock = WireClock);
