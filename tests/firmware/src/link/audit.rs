//! What no traffic may do to the references, looked at from outside of core in every tick.

use gantry_tau_core::control::axis::{Offsets, Reference};
use gantry_tau_core::control::channel::Limits;
use gantry_tau_core::control::endpoint::Turn;
use gantry_tau_core::control::message::{AxisLimits, AxisState, Phase};
use gantry_tau_core::units::PositionNm;

use crate::machine::{AXES, MOTORS};

/// Which axis each motor drives `[T 1.2.2]`: two on each cart, one on each screw.
const AXIS_OF_MOTOR: [usize; MOTORS] = [0, 0, 1, 1, 2, 2, 3, 4, 5];

/// What is broken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
pub(super) enum Broken {
    /// An offset is beyond M, its change beyond S, or the change of that beyond A.
    Bound,
    /// In SafeDisconnect or Fault a channel did not move by exactly min(rho, |offset|) towards zero.
    Ramp,
    /// Offsets act without Obtain.
    Authority,
    /// A reference changed by more than its nominal position did and S.
    Step,
    /// Motors of one axis have different references.
    Pair,
}

/// The references of the tick before, how they got there, and the largest changes so far.
#[derive(Clone, Copy, Debug)]
pub(super) struct Audit {
    limits: [AxisLimits; AXES],
    offsets: [Offsets; AXES],
    changes: [[i64; 3]; AXES],
    nominal: [PositionNm; AXES],
    motors: [Reference; MOTORS],
    /// Largest change of each position offset in a tick, nm.
    pub(super) largest_offset_nm: [u64; AXES],
    /// Largest change of each axis' reference in a tick, nm.
    pub(super) largest_reference_nm: [u64; AXES],
    /// Ticks in which something was broken.
    pub(super) broken_ticks: u32,
}

impl Audit {
    /// Goes on from a tick in which the machine was at rest, without offsets.
    pub(super) fn new(limits: [AxisLimits; AXES], turn: &Turn<AXES, MOTORS>) -> Self {
        Self {
            limits,
            offsets: [Offsets::default(); AXES],
            changes: [[0; 3]; AXES],
            nominal: turn.output.state.axes.map(|axis| axis.nominal),
            motors: turn.motors,
            largest_offset_nm: [0; AXES],
            largest_reference_nm: [0; AXES],
            broken_ticks: 0,
        }
    }

    /// Looks at one tick.
    pub(super) fn check(&mut self, turn: &Turn<AXES, MOTORS>) -> Result<(), Broken> {
        let state = &turn.output.state;
        let result =
            (self.check_motors(turn)).and_then(|()| self.check_offsets(state.phase, &state.axes));
        for (seen, axis) in self.offsets.iter_mut().zip(&state.axes) {
            *seen = axis.offsets;
        }
        for (seen, axis) in self.nominal.iter_mut().zip(&state.axes) {
            *seen = axis.nominal;
        }
        self.motors = turn.motors;
        if result.is_err() {
            self.broken_ticks = self.broken_ticks.saturating_add(1);
        }
        result
    }

    fn check_offsets(&mut self, phase: Phase, axes: &[AxisState; AXES]) -> Result<(), Broken> {
        let mut result = Ok(());
        let before = self.offsets.iter().zip(&mut self.changes);
        let rows = before.zip(&self.limits).zip(axes);
        let largest = self.largest_offset_nm.iter_mut();
        for ((((before, changes), limits), axis), largest) in rows.zip(largest) {
            let limits = [limits.position, limits.velocity, limits.torque];
            let channels = channels(before).into_iter().zip(channels(&axis.offsets));
            for (((old, new), limits), last) in channels.zip(limits).zip(changes.iter_mut()) {
                let change = new.saturating_sub(old);
                let one = check_channel(phase, old, change, *last, &limits);
                result = result.and(one);
                *last = change;
            }
            let [position, ..] = changes;
            *largest = (*largest).max(position.unsigned_abs());
        }
        result
    }

    fn check_motors(&mut self, turn: &Turn<AXES, MOTORS>) -> Result<(), Broken> {
        let state = &turn.output.state;
        let mut result = Ok(());
        for (motor, axis) in AXIS_OF_MOTOR.into_iter().enumerate() {
            let now = turn.motors.get(motor);
            if now != turn.output.references.get(axis) {
                result = Err(Broken::Pair);
            }
            let seen = (self.motors.get(motor).zip(now))
                .zip(self.nominal.get(axis).zip(state.axes.get(axis)))
                .zip(self.limits.get(axis));
            let Some((((old, new), (nominal, moved)), limits)) = seen else {
                continue;
            };
            let change = new.position.0.abs_diff(old.position.0);
            let own = moved.nominal.0.abs_diff(nominal.0);
            let step = u64::from(limits.position.step().unsigned_abs());
            if change > own.saturating_add(step) {
                result = result.and(Err(Broken::Step));
            }
            if let Some(largest) = self.largest_reference_nm.get_mut(axis) {
                *largest = (*largest).max(change);
            }
        }
        result
    }
}

/// One channel: `old` moved by `change`, the tick before by `last`.
fn check_channel(
    phase: Phase,
    old: i64,
    change: i64,
    last: i64,
    limits: &Limits,
) -> Result<(), Broken> {
    let [max, step, accel] = [limits.max(), limits.step(), limits.accel()].map(i64::from);
    let ramp = i64::from(limits.ramp());
    let new = old.saturating_add(change);
    if new.abs() > max || change.abs() > step || change.saturating_sub(last).abs() > accel {
        return Err(Broken::Bound);
    }
    match phase {
        Phase::SafeDisconnect | Phase::Fault => {
            let towards_zero = old.signum().saturating_neg();
            let exact = towards_zero.saturating_mul(ramp.min(old.abs()));
            (change == exact).then_some(()).ok_or(Broken::Ramp)
        }
        Phase::Listening | Phase::Handshake | Phase::Submit => {
            (new == 0).then_some(()).ok_or(Broken::Authority)
        }
        Phase::Obtain => Ok(()),
    }
}

fn channels(offsets: &Offsets) -> [i64; 3] {
    [
        offsets.position.0.into(),
        offsets.velocity.0.into(),
        offsets.torque.0.into(),
    ]
}
