//! Gauges of a bus of their own, for other programs: read once per millisecond, published,
//! recorded.

mod file;
mod outputs;
mod shown;

use std::sync::atomic::{AtomicBool, Ordering};

use gantry_tau_ethercat::gauges::{Gauges, GaugesError};
use gantry_tau_ethercat::{CounterMap, NoReading, Wire};
use gantry_tau_server::links::gauges::Lengths;
use gantry_tau_server::realtime::{CycleTimer, raise_priority};

use super::told::Told;
use crate::terminal::say;
pub use file::GaugesFile;
pub(crate) use outputs::GaugeOutputs;
pub(super) use shown::terminal;
pub use shown::{ShownGauges, shown_bus};

/// Length of a cycle, and the longest wait for an answer, µs.
const CYCLE_US: u32 = 1_000;
const ANSWER_US: u32 = 400;

/// Error of `gauges`.
#[derive(Debug, thiserror::Error)]
pub(crate) enum GaugesCommandError {
    /// The bus cannot be read.
    #[error("{what}: {error}")]
    Bus {
        /// The file, with the gauge if it is about one.
        what: String,
        /// The error.
        error: GaugesError,
    },
    /// The recording was not written to its end.
    #[error("{0}")]
    Recording(String),
}

/// Reads the gauges and publishes their lengths until `quit`.
///
/// # Errors
/// [`GaugesCommandError`]: the bus cannot be brought up, or the recording has failed.
pub(crate) fn run<W: Wire>(
    wire: W,
    file: &GaugesFile,
    mut outputs: GaugeOutputs,
    quit: &AtomicBool,
) -> Result<(), GaugesCommandError> {
    let mut gauges = Gauges::bring_up(wire, &file.configs(), CYCLE_US, ANSWER_US)
        .map_err(|error| bus_error(file, error))?;
    for (map, gauge) in gauges.maps().zip(&file.gauges) {
        match map {
            CounterMap::Bits32 => {}
            CounterMap::Bits16 => tracing::info!("{}: a counter of 16 bits", gauge.name),
            CounterMap::Old => tracing::warn!(
                "{}: a terminal of old firmware: that a wire is open, or a value old, is not seen",
                gauge.name
            ),
        }
    }
    say(format_args!("{}; Ctrl-C ends", outputs.description(file)));
    // The socket of the bus is open: nothing else needs a privilege.
    set_up_thread();
    let mut told: Vec<Told<Option<NoReading>>> = Vec::new();
    told.resize_with(file.gauges.len(), Told::default);
    let mut timer = CycleTimer::starting_now(u64::from(CYCLE_US) * 1_000);
    let mut tick = 0_u64;
    while !quit.load(Ordering::Relaxed) {
        let elapsed = timer.wait();
        tick = tick.saturating_add(elapsed.into());
        let wire = gauges.wire_mut();
        wire.begin_cycles(elapsed.into(), CYCLE_US.into());
        gauges.cycle();
        let lengths_m = file.lengths_m(gauges.counts());
        outputs.put(&Lengths::new(tick, lengths_m), gauges.counts());
        for (told, (count, gauge)) in told.iter_mut().zip(gauges.counts().zip(&file.gauges)) {
            match told.news(Some(count.err())) {
                Some(Some(reason)) => tracing::warn!("{}: no count: {reason}", gauge.name),
                Some(None) => tracing::info!("{}: counts", gauge.name),
                None => {}
            }
        }
    }
    outputs.finish().map_err(GaugesCommandError::Recording)
}

/// Sets up the thread of the cycles: real-time priority, then no privileges.
fn set_up_thread() {
    if let Err(denied) = raise_priority() {
        tracing::warn!("no {}: {}", denied.privilege, denied.reason);
    }
    if let Err(error) = gantry_tau_system::privileges::give_up(&[]) {
        tracing::warn!("the privileges cannot be given up: {error}");
    }
}

fn bus_error(file: &GaugesFile, error: GaugesError) -> GaugesCommandError {
    let name = match error {
        GaugesError::Gauge { gauge, .. } => file.gauges.get(gauge).map(|gauge| &gauge.name),
        _ => None,
    };
    let what = name.map_or_else(
        || file.path.clone(),
        |name| format!("{}: {name}", file.path),
    );
    GaugesCommandError::Bus { what, error }
}
