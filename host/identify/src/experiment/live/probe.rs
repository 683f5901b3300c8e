//! The instruments in each cycle of the client: one tick per force sample, handed to the campaign.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};

use gantry_tau_client::force_sensor::Sample;
use gantry_tau_client::{ClientControls, ClientError, Observer};
use gantry_tau_core::control::message::{Capabilities, State, Welcome};
use gantry_tau_core::units::PositionNm;
use gantry_tau_server::links::gauges::MAX_GAUGES;
use gantry_tau_server::links::gauges::{GaugeReader, Lengths};

use crate::experiment::windows::InstrumentSample;

/// States that the last record of the gauges may serve.
const RECORD_STATES: u64 = 100;
/// Pause while a server in lock-step waits for the campaign.
const REST: std::time::Duration = std::time::Duration::from_micros(200);

/// One tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ProbeTick<const N: usize> {
    /// Instruments; gauges that are away, or silent, are NaN.
    pub(super) sample: InstrumentSample<N>,
    /// Nominal positions.
    pub(super) nominal: [PositionNm; N],
}

/// Observer of the client.
pub(super) struct Probe<'a, const N: usize> {
    /// Order to leave, which the thread of the campaign passes on only if its table does not hang.
    quit: &'a AtomicBool,
    controls: &'a ClientControls,
    gauges: Option<GaugeReader>,
    count: usize,
    metres_per_q: [f64; N],
    queue: rtrb::Producer<ProbeTick<N>>,
    is_granted: bool,
    is_lockstep: bool,
    latest: Option<Lengths>,
    states_without_record: u64,
}

impl<'a, const N: usize> Probe<'a, N> {
    pub(super) const fn new(
        quit: &'a AtomicBool,
        controls: &'a ClientControls,
        gauges: Option<GaugeReader>,
        count: usize,
        metres_per_q: [f64; N],
        queue: rtrb::Producer<ProbeTick<N>>,
    ) -> Self {
        Self {
            quit,
            controls,
            gauges,
            count,
            metres_per_q,
            queue,
            is_granted: false,
            is_lockstep: false,
            latest: None,
            states_without_record: 0,
        }
    }

    /// True if the session was granted.
    pub(super) const fn was_granted(&self) -> bool {
        self.is_granted
    }

    /// Returns the gauges, NaN where they are silent.
    fn lengths_m(&mut self) -> Result<[f64; MAX_GAUGES], ClientError> {
        let mut lengths_m = [f64::NAN; MAX_GAUGES];
        let Some(gauges) = &mut self.gauges else {
            return Ok(lengths_m);
        };
        let latest = gauges.latest().map_err(|error| match error.kind() {
            io::ErrorKind::InvalidData => ClientError::Setup(format!("gauges: {error}")),
            _ => ClientError::GaugesSilent(error.to_string()),
        })?;
        let is_new = latest.map(|latest| latest.tick) != self.latest.map(|last| last.tick);
        self.states_without_record = if is_new {
            0
        } else {
            self.states_without_record + 1
        };
        self.latest = latest;
        let Some(latest) = latest.filter(|_| self.states_without_record <= RECORD_STATES) else {
            return Ok(lengths_m);
        };
        if latest.lengths_m().len() != self.count {
            return Err(ClientError::Setup(format!(
                "gauges: a record has {} lengths; the plan has {} gauges",
                latest.lengths_m().len(),
                self.count
            )));
        }
        for (place, length_m) in lengths_m.iter_mut().zip(latest.lengths_m()) {
            *place = *length_m;
        }
        Ok(lengths_m)
    }
}

impl<const N: usize> Observer<N> for Probe<'_, N> {
    fn welcomed(&mut self, welcome: &Welcome<N>) {
        self.is_granted = true;
        self.is_lockstep = welcome.capabilities.contains(Capabilities::LOCKSTEP);
    }

    fn answered(&mut self, state: &State<N>, sample: Option<&Sample>) -> Result<(), ClientError> {
        let is_leaving = self.quit.load(Ordering::Relaxed);
        if is_leaving {
            self.controls.quit.store(true, Ordering::Relaxed);
        }
        let lengths_m = self.lengths_m()?;
        let Some(force) = sample else { return Ok(()) };
        let q = std::array::from_fn(|axis| {
            state.axes[axis].actual.position.to_metres().0 / self.metres_per_q[axis]
        });
        let sample = InstrumentSample {
            tick: state.tick.0,
            q,
            wrench: force.wrench,
            lengths_m,
            gauges: self.count,
        };
        let tick = ProbeTick {
            sample,
            nominal: state.axes.map(|axis| axis.nominal),
        };
        while self.queue.push(tick).is_err() {
            // By the clock an answer must not wait; the gap makes the campaign take its window
            // again.
            if !self.is_lockstep || is_leaving || self.queue.is_abandoned() {
                break;
            }
            std::thread::sleep(REST);
        }
        Ok(())
    }
}
