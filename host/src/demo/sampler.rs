//! Samples of the server's rows, kept for the results.

use std::time::Duration;

use gantry_tau_core::control::message::{Cause, Phase};
use gantry_tau_core::units::Tick;

use crate::server::cycle::Row;

/// Pause when no row is waiting.
const REST: Duration = Duration::from_millis(1);
/// Time without a row after which the server counts as stuck.
const PATIENCE: Duration = Duration::from_secs(10);

/// Values of one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sample<const N: usize> {
    pub(super) tick: u64,
    pub(super) phase: Phase,
    pub(super) step: u32,
    pub(super) force_n: [f64; 3],
    pub(super) offset_nm: [i32; N],
    pub(super) reference_nm: [i64; N],
    pub(super) displacement_um: [f64; 3],
    pub(super) turn_urad: [f64; 3],
    pub(super) gauges_um: [f64; 3],
    pub(super) missed: u32,
    pub(super) longest_miss_run: u16,
    pub(super) round_trip_us: Option<u32>,
    pub(super) ended: Option<Cause>,
    pub(super) refused: u8,
    pub(super) welcomed: bool,
}

impl<const N: usize> Sample<N> {
    fn of(row: &Row<N>) -> Self {
        let tool = row.tool;
        let [fx, fy, fz, ..] = tool.map_or([f64::NAN; 6], |tool| tool.load);
        let millionths = |values: [f64; 3]| values.map(|value| value * 1e6);
        Self {
            tick: row.state.tick.0,
            phase: row.state.phase,
            step: tool.map_or(0, |tool| tool.step),
            force_n: [fx, fy, fz],
            offset_nm: row.state.axes.map(|axis| axis.offsets.position.0),
            reference_nm: row.references.map(|reference| reference.position.0),
            displacement_um: tool.map_or([f64::NAN; 3], |tool| millionths(tool.displacement_m)),
            turn_urad: tool.map_or([f64::NAN; 3], |tool| millionths(tool.turn_rad)),
            gauges_um: tool.map_or([f64::NAN; 3], |tool| millionths(tool.gauges_m)),
            missed: row.state.counters.missed,
            longest_miss_run: row.state.counters.longest_miss_run,
            round_trip_us: row.round_trip_us,
            ended: row.ended,
            refused: row.refused,
            welcomed: row.welcomed,
        }
    }
}

/// End of a session that the demo did not cause.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Lost {
    pub(super) tick: Tick,
    pub(super) cause: Cause,
}

/// Reason why waiting failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Waiting {
    /// The session ended by itself.
    Lost(Lost),
    /// The server delivers no more rows.
    Stuck,
}

/// Collects every row.
pub(super) struct Sampler<const N: usize> {
    rows: rtrb::Consumer<Row<N>>,
    pub(super) samples: Vec<Sample<N>>,
}

impl<const N: usize> Sampler<N> {
    pub(super) const fn new(rows: rtrb::Consumer<Row<N>>) -> Self {
        Self {
            rows,
            samples: Vec::new(),
        }
    }

    /// Waits for the next row that satisfies `found`; every row is kept and passed to `each`.
    /// With `may_end`, the session may end meanwhile.
    pub(super) fn until(
        &mut self,
        may_end: bool,
        mut each: impl FnMut(&Sample<N>),
        mut found: impl FnMut(&Sample<N>) -> bool,
    ) -> Result<Sample<N>, Waiting> {
        let mut idle = Duration::ZERO;
        loop {
            let Ok(row) = self.rows.pop() else {
                if idle >= PATIENCE || self.rows.is_abandoned() {
                    return Err(Waiting::Stuck);
                }
                std::thread::sleep(REST);
                idle += REST;
                continue;
            };
            idle = Duration::ZERO;
            let sample = Sample::of(&row);
            self.samples.push(sample);
            each(&sample);
            if let (Some(cause), false) = (sample.ended, may_end) {
                let tick = row.state.tick;
                return Err(Waiting::Lost(Lost { tick, cause }));
            }
            if found(&sample) {
                return Ok(sample);
            }
        }
    }
}
