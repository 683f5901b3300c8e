//! A black box in static memory: the compiler builds it, so that it never passes through a stack,
//! optimised or not.
//!
//! Firmware has `static_cell::ConstStaticCell` in the place of the mutex.

use std::sync::Mutex;
use std::thread;

use gantry_tau_core::control::channel::{LimitValues, Limits};
use gantry_tau_core::{
    Actual, AxisConfig, BlackBox, Config, Endpoint, EpochRange, Parameters, PositionNm, Reading,
    Session, Start, TickInput, Travel, Write,
};

/// More than half a megabyte.
static BLACK_BOX: Mutex<BlackBox<6, 64>> = Mutex::new(BlackBox::new());
/// Stack of the thread that ticks: a fraction of that.
const STACK: usize = 256 << 10;

fn endpoint() -> Option<Endpoint<6>> {
    let limits = Limits::new(LimitValues {
        max: 2_000_000,
        step: 5_000,
        accel: 10_000,
        ramp: 100,
    })
    .ok()?;
    let axis = AxisConfig::position_only(limits, Travel::around_zero(1_000_000_000), 1_000_000);
    let config = Config::new(Parameters::thesis([axis; 6])).ok()?;
    let session = Session::new(config, &Start::at_rest([PositionNm(0); 6])).ok()?;
    Some(Endpoint::new(session, EpochRange::VOLATILE))
}

/// Ticks, and returns the number of recorded ticks.
fn run() -> Option<usize> {
    let mut endpoint = endpoint()?;
    // Locked once: the cycle waits for nothing.
    let mut black_box = BLACK_BOX.try_lock().ok()?;
    let reading = Reading {
        nominal: [PositionNm(0); 6],
        actual: [Actual::ZERO; 6],
    };
    for _ in 0..200 {
        let tick = TickInput {
            elapsed_cycles: 1,
            reading: Some(reading),
            sensor: None,
            stop: false,
            quit: false,
            rearm: false,
        };
        match endpoint.tick_recorded(&tick, &mut *black_box) {
            Write::Due(write) => write.accepted(),
            Write::Withheld(_) => return None,
        }
    }
    Some(black_box.entries().count())
}

fn main() {
    let ticks = thread::Builder::new()
        .stack_size(STACK)
        .spawn(run)
        .ok()
        .and_then(|thread| thread.join().ok()?);
    println!(
        "{} bytes, recorded ticks: {ticks:?}",
        size_of_val(&BLACK_BOX)
    );
}
