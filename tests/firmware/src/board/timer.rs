//! The interrupt that is the server's clock: SysTick, 1 kHz.

use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::exception;

use super::clock;

/// Cycles of the clock from one tick to the next, less one.
const RELOAD: u32 = clock::HZ / 1_000 - 1;

/// Interrupts so far.
static TICKS: AtomicU32 = AtomicU32::new(0);

/// The ticks of the timer, one by one.
pub(crate) struct Ticks {
    seen: u32,
}

impl Ticks {
    /// Starts the clock and the interrupt.
    pub(crate) fn start() -> Self {
        clock::start();
        // SAFETY: nothing else in this program touches the core's peripherals.
        let mut systick = unsafe { cortex_m::Peripherals::steal() }.SYST;
        systick.set_clock_source(SystClkSource::Core);
        systick.set_reload(RELOAD);
        systick.clear_current();
        systick.enable_interrupt();
        systick.enable_counter();
        Self { seen: 0 }
    }

    /// Sleeps until the next tick, if it has not come; returns how many came since the last call,
    /// at least 1.
    pub(crate) fn wait(&mut self) -> u32 {
        loop {
            // An interrupt between the look and the sleep would be slept through: it is held back
            // until then, and ends the sleep.
            let now = cortex_m::interrupt::free(|_| {
                let now = TICKS.load(Ordering::Relaxed);
                if now == self.seen {
                    cortex_m::asm::wfi();
                }
                now
            });
            let elapsed = now.wrapping_sub(self.seen);
            if elapsed > 0 {
                self.seen = now;
                return elapsed;
            }
        }
    }
}

#[exception]
fn SysTick() {
    TICKS.fetch_add(1, Ordering::Relaxed);
}
