//! Samples of a stream, put together tick by tick.

use gantry_tau_core::control::message::{MAX_AXES, Phase};
use gantry_tau_labcomm::Field;
use gantry_tau_labcomm::samples::{Axes, Axis, State, Tool};
use gantry_tau_server::plant::DriveState;
use gantry_tau_server::publication::DriveStates;

use super::snapshot::{AxisSnapshot, Snapshot};
use super::stream::StreamError;

/// Ticks after the failure of the machine in which the server may still be in its old phase.
const UNTIL_FAULT: i64 = 2;

/// Axes of a tick.
#[derive(Clone, Copy, Debug)]
pub(super) struct AxesOf {
    tick: i64,
    pub(super) axis: [Axis; MAX_AXES],
    pub(super) count: usize,
}

/// Drives of a tick: the codes of their states.
#[derive(Clone, Copy, Debug)]
pub(super) struct DrivesOf {
    tick: i64,
    state: [u8; MAX_AXES],
    count: usize,
}

impl DrivesOf {
    /// Returns the states, axis order.
    ///
    /// # Errors
    /// [`StreamError::UnknownCode`].
    pub(super) fn states(&self) -> Result<Vec<DriveState>, StreamError> {
        let codes = self.state.iter().take(self.count);
        codes
            .map(|&code| {
                DriveState::from_code(code).ok_or(StreamError::UnknownCode {
                    field: "drive",
                    code,
                })
            })
            .collect()
    }
}

/// One tick, as it was received.
#[derive(Clone, Copy, Debug)]
pub struct ReceivedTick {
    pub(super) state: State,
    pub(super) axes: AxesOf,
    pub(super) tool: Option<Tool>,
    pub(super) drives: Option<DrivesOf>,
}

/// The latest whole tick, and what has come of the next.
///
/// A tick is whole when its state and axes have come, and tool and drives if the server sends them;
/// or when a sample of a later tick comes.
#[derive(Clone, Debug, Default)]
pub(super) struct Assembly {
    sends_tool: bool,
    sends_drives: bool,
    state: Option<State>,
    axes: Option<AxesOf>,
    tool: Option<Tool>,
    drives: Option<DrivesOf>,
    latest: Option<ReceivedTick>,
    /// The latest has not been taken.
    is_new: bool,
    /// Tick before the latest.
    before: Option<AxesOf>,
    /// Tick in which the machine failed.
    failed: Option<i64>,
    rows_lost: bool,
}

impl Assembly {
    /// The server sends the sample of the tool, or does not.
    pub(super) const fn expect_tool(&mut self, sends_tool: bool) {
        self.sends_tool = sends_tool;
    }

    /// The server sends the sample of the drives, or does not.
    pub(super) const fn expect_drives(&mut self, sends_drives: bool) {
        self.sends_drives = sends_drives;
    }

    pub(super) fn state(&mut self, state: State) {
        self.begin(state.tick);
        self.state = Some(state);
        self.end(false);
    }

    pub(super) fn axes<const N: usize>(&mut self, axes: &Axes<N>) {
        self.begin(axes.tick);
        let mut all = AxesOf {
            tick: axes.tick,
            axis: [Axis::ZERO; MAX_AXES],
            count: N,
        };
        for (place, axis) in all.axis.iter_mut().zip(&axes.axis) {
            *place = *axis;
        }
        self.axes = Some(all);
        self.end(false);
    }

    pub(super) fn tool(&mut self, tool: Tool) {
        self.begin(tool.tick);
        self.tool = Some(tool);
        self.end(false);
    }

    pub(super) fn drives<const N: usize>(&mut self, drives: &DriveStates<N>) {
        self.begin(drives.tick);
        let mut state = [0; MAX_AXES];
        for (place, code) in state.iter_mut().zip(&drives.state) {
            *place = *code;
        }
        self.drives = Some(DrivesOf {
            tick: drives.tick,
            state,
            count: N,
        });
        self.end(false);
    }

    /// Returns the tick that has become whole, once.
    pub(super) fn next_tick(&mut self) -> Option<ReceivedTick> {
        self.latest.filter(|_| std::mem::take(&mut self.is_new))
    }

    /// The machine failed in a tick.
    pub(super) const fn machine_failed(&mut self, tick: i64) {
        self.failed = Some(tick);
    }

    /// The server has lost rows.
    pub(super) const fn rows_lost(&mut self) {
        self.rows_lost = true;
    }

    /// Ends the last tick when a sample of another one comes.
    fn begin(&mut self, tick: i64) {
        let ticks = [
            self.state.as_ref().map(|state| state.tick),
            self.axes.as_ref().map(|axes| axes.tick),
            self.tool.as_ref().map(|tool| tool.tick),
            self.drives.as_ref().map(|drives| drives.tick),
        ];
        if ticks.into_iter().flatten().any(|other| other != tick) {
            self.end(true);
            (self.state, self.axes, self.tool, self.drives) = (None, None, None, None);
        }
    }

    fn end(&mut self, nothing_more_comes: bool) {
        let (Some(state), Some(axes)) = (self.state, self.axes) else {
            return;
        };
        let is_waiting =
            self.sends_tool && self.tool.is_none() || self.sends_drives && self.drives.is_none();
        if is_waiting && !nothing_more_comes {
            return;
        }
        if self
            .latest
            .is_none_or(|latest| latest.axes.tick != axes.tick)
        {
            self.before = self.latest.map(|latest| latest.axes);
            self.is_new = true;
        }
        self.latest = Some(ReceivedTick {
            state,
            axes,
            tool: self.tool,
            drives: self.drives,
        });
        let listens = state.phase == Phase::Listening.code();
        self.failed = self
            .failed
            .filter(|failed| !listens || state.tick <= failed.saturating_add(UNTIL_FAULT));
    }

    /// The latest whole tick; `None` before the first.
    ///
    /// # Errors
    /// [`StreamError::UnknownCode`].
    pub(super) fn snapshot(&self) -> Result<Option<Snapshot>, StreamError> {
        let Some(ReceivedTick {
            state,
            axes,
            tool,
            drives,
        }) = &self.latest
        else {
            return Ok(None);
        };
        let before = self
            .before
            .filter(|before| before.tick.checked_add(1) == Some(axes.tick));
        Ok(Some(Snapshot {
            tick: state.tick,
            phase: Phase::from_code(state.phase).ok_or(StreamError::UnknownCode {
                field: "phase",
                code: state.phase,
            })?,
            epoch: state.epoch,
            cause: super::cause(state.cause)?,
            sequence: state.sequence,
            on_time: state.on_time,
            ramp_ticks_left: state.ramp_ticks_left,
            counters: state.counters.into(),
            longest_miss_run: state.longest_miss_run,
            machine_failed: self.failed.is_some(),
            rows_lost: self.rows_lost,
            axes: axes
                .axis
                .iter()
                .take(axes.count)
                .enumerate()
                .map(|(number, axis)| {
                    let before = before.and_then(|before| before.axis.get(number).copied());
                    AxisSnapshot::new(axis, before.map(|before| before.reference_nm))
                })
                .collect(),
            drives: match drives {
                Some(drives) => Some(drives.states()?.into_iter().map(DriveState::name).collect()),
                None => None,
            },
            force: tool.and_then(|tool| known(tool.load)),
            gauges_m: tool.and_then(|tool| known(tool.gauges_m)),
            displacement_m: tool.and_then(|tool| known(tool.displacement_m)),
            turn_rad: tool.and_then(|tool| known(tool.turn_rad)),
            machine: None,
        }))
    }
}

/// Numbers of an instrument; `None` where a machine has none.
fn known<const L: usize>(numbers: [f64; L]) -> Option<[f64; L]> {
    numbers
        .iter()
        .all(|number| number.is_finite())
        .then_some(numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_a_number_is_not_known() {
        assert_eq!(known([0.0, -1.5]), Some([0.0, -1.5]));
        for number in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(known([0.0, number]), None);
        }
    }
}
