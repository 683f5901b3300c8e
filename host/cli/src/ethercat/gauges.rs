//! Gauges of a bus of their own, for other programs: read once per millisecond, published,
//! recorded.

mod file;
mod outputs;
mod shown;

use std::sync::atomic::{AtomicBool, Ordering};

use gantry_tau_ethercat::Wire;
use gantry_tau_ethercat::gauges::{CounterMap, Gauges, GaugesError, NoReading};
use gantry_tau_server::links::gauges::Lengths;
use gantry_tau_server::realtime::{CycleTimer, raise_priority};

use crate::terminal::say;
pub use file::GaugesFile;
pub use outputs::GaugeOutputs;
pub use shown::{ShownGauges, shown_bus};

/// Length of a cycle, and the longest wait for an answer, µs.
const CYCLE_US: u32 = 1_000;
const ANSWER_US: u32 = 400;
/// Cycles between two reports of one gauge.
const CYCLES_PER_REPORT: u64 = 1_000;

/// Error of `gauges`.
#[derive(Debug, thiserror::Error)]
pub enum GaugesCommandError {
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
pub fn run<W: Wire>(
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
    if let Err(denied) = raise_priority() {
        tracing::warn!("no {}: {}", denied.privilege, denied.reason);
    }
    let mut reports = vec![GaugeReport::default(); file.gauges.len()];
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
        for (report, (count, gauge)) in reports.iter_mut().zip(gauges.counts().zip(&file.gauges)) {
            report.see(tick, &gauge.name, count.err());
        }
    }
    outputs.finish().map_err(GaugesCommandError::Recording)
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

/// State of a gauge, as it was logged last: at most once in a second.
#[derive(Clone, Debug, Default)]
struct GaugeReport {
    reason: Option<NoReading>,
    next_tick: u64,
}

impl GaugeReport {
    fn see(&mut self, tick: u64, name: &str, reason: Option<NoReading>) {
        if self.reason == reason || tick < self.next_tick {
            return;
        }
        (self.reason, self.next_tick) = (reason, tick.saturating_add(CYCLES_PER_REPORT));
        match reason {
            Some(reason) => tracing::warn!("{name}: no count: {reason}"),
            None => tracing::info!("{name}: counts again"),
        }
    }
}
