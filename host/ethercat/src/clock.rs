//! Clock behind ethercrab's timers: that of the wire, as the pump has set it last.
//!
//! A timer of ethercrab asks this clock whenever it is polled, and the pump polls all the time; so
//! no timer need wake anybody, and there is neither a thread nor a lock nor a queue behind them.
//! The clock belongs to the thread that pumps.

use std::cell::Cell;
use std::task::Waker;

use embassy_time_driver::Driver;

thread_local! {
    static NOW_NS: Cell<u64> = const { Cell::new(0) };
}

/// Tells the clock of this thread the time, ns.
pub(crate) fn set_ns(now: u64) {
    NOW_NS.set(now);
}

/// Returns the time that this thread's clock was told last, µs.
pub(crate) fn now_us() -> u64 {
    now_ns() / 1_000
}

/// Returns the time that this thread's clock was told last, ns.
pub(crate) fn now_ns() -> u64 {
    NOW_NS.get()
}

/// Waits until a time, µs, within a future that a pump runs.
pub(crate) async fn wait_until(us: u64) {
    let is_over = |_: &mut std::task::Context<'_>| {
        if now_us() >= us {
            std::task::Poll::Ready(())
        } else {
            std::task::Poll::Pending
        }
    };
    std::future::poll_fn(is_over).await;
}

#[derive(Debug)]
struct WireClock;

impl Driver for WireClock {
    fn now(&self) -> u64 {
        // Ticks of 1 µs.
        now_us()
    }

    fn schedule_wake(&self, _at: u64, _waker: &Waker) {}
}

embassy_time_driver::time_driver_impl!(static CLOCK: WireClock = WireClock);
