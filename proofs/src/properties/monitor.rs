//! The run-time monitor: T24. It flags exactly the samples that break a limit, and raises no alarm
//! on anything that a session does.

use gantry_tau_core::control::channel::{LimitValues, Limits};
use gantry_tau_core::control::message::{AxisLimits, Phase, State};
use gantry_tau_core::control::session::{Session, TickInput};
use gantry_tau_core::units::OffsetNm;
use gantry_tau_core::verification::control::{
    Accepted, Bounds, Diagnostics, Internals, Motion, Seen, Trace, drive_reference,
    monitor_from_parts, monitor_parts,
};
use gantry_tau_core::{Monitor, PositionNm, Reference, Travel};

use crate::properties::axis;

/// Change that one ramp step demands: towards zero, never past it.
fn ramp_change(value: i128, ramp: i128) -> i128 {
    -value.signum() * value.abs().min(ramp)
}

/// True if a sample breaks a limit, from its definition.
fn breaks(
    before: Option<&Trace>,
    value: i64,
    steps: u64,
    motion: Motion,
    limits: LimitValues,
) -> bool {
    let (max, step) = (i128::from(limits.max), i128::from(limits.step));
    let (accel, ramp) = (i128::from(limits.accel), i128::from(limits.ramp));
    let value = i128::from(value);
    if value < -max || value > max {
        return true;
    }
    let Some(before) = before else { return false };
    let last = i128::from(before.value);
    let change = value - last;
    let far = i128::from(steps) * step;
    if change < -far || change > far {
        return true;
    }
    let jerks = before
        .change
        .is_some_and(|earlier| (change - i128::from(earlier)).abs() > accel);
    let strays = match motion {
        Motion::Free => false,
        Motion::Hold => change != 0,
        Motion::Ramp => change != ramp_change(last, ramp),
    };
    steps == 1 && (jerks || strays)
}

/// T24, one channel: a sample is flagged exactly if it breaks `M`, `S` times the steps, and, after
/// one step, `A` or the motion that the phase demands; flagged or not, the monitor goes on from it.
///
/// Values are those of a channel, `i32`; changes are differences of two of them.
pub fn sample_is_flagged_exactly(
    before: Option<Trace>,
    value: i32,
    steps: u64,
    motion: Motion,
    limits: &Limits<OffsetNm>,
) {
    let mut trace = before;
    let value = i64::from(value);
    let result = Trace::advance(&mut trace, value, steps, motion, &Bounds::of(limits));
    let broken = breaks(before.as_ref(), value, steps, motion, limits.values());
    assert!(
        result.is_err() == broken,
        "T24: exactly what breaks a limit"
    );
    let Some(now) = trace else {
        panic!("T24: a sample was taken")
    };
    assert!(now.value == value, "T24: the monitor goes on");
    if let (1, Some(before)) = (steps, before) {
        assert!(
            now.change == Some(value - before.value),
            "T24: the change of one step is known"
        );
    }
}

/// T24, a whole State: it is flagged exactly if an offset breaks the rule of its phase, or a shadow
/// its own, given the State before it.
pub fn state_is_flagged_exactly<const N: usize>(
    limits: &[AxisLimits; N],
    before: &State<N>,
    state: &State<N>,
) {
    let mut monitor = Monitor::new(*limits, None);
    let _ = monitor.check_state(before);
    let flagged = monitor.check_state(state).is_err();
    let fresh = (before.epoch, before.accepted) != (state.epoch, state.accepted);
    let mut broken = false;
    for index in 0..N {
        let (old, new) = (&before.axes[index], &state.axes[index]);
        let (was, is, shadow) = (
            axis::counts(&old.offsets),
            axis::counts(&new.offsets),
            axis::counts(&new.shadow),
        );
        let limits = axis::limit_values(&limits[index]);
        for channel in 0..3 {
            let motion = match state.phase {
                Phase::Listening | Phase::Handshake | Phase::Submit => Motion::Hold,
                Phase::SafeDisconnect | Phase::Fault => Motion::Ramp,
                Phase::Obtain if fresh => Motion::Free,
                Phase::Obtain if channel == 0 => Motion::Hold,
                Phase::Obtain => Motion::Ramp,
            };
            let last = Trace {
                value: was[channel],
                change: None,
            };
            let before_obtain = matches!(
                state.phase,
                Phase::Listening | Phase::Handshake | Phase::Submit
            );
            let reach = if state.phase == Phase::Submit {
                i64::from(limits[channel].max)
            } else {
                0
            };
            broken |= breaks(Some(&last), is[channel], 1, motion, limits[channel])
                || (before_obtain && is[channel] != 0)
                || shadow[channel].abs() > reach;
        }
    }
    assert!(
        flagged == broken,
        "T24: exactly the States that break a limit"
    );
}

/// T24: references that the monitor accepts are inside the travel, at most `M` from a nominal
/// reference that is not clamped, and changed by at most the change of the nominal reference plus
/// `S`.
pub fn accepted_references_are_bounded<const N: usize>(
    limits: &[AxisLimits; N],
    travel: &[Travel; N],
    first: (&[PositionNm; N], &[Reference; N]),
    second: (&[PositionNm; N], &[Reference; N]),
) {
    let mut monitor = Monitor::new(*limits, Some(*travel));
    let _ = monitor.check_references(first.0, first.1);
    if monitor.check_references(second.0, second.1).is_err() {
        return;
    }
    for index in 0..N {
        let (was, is) = (&first.1[index], &second.1[index]);
        let position = is.position;
        let travel = &travel[index];
        assert!(
            travel.lower <= position && position <= travel.upper,
            "T24: inside the travel"
        );
        let step = i128::from(limits[index].position.step());
        let own = (wide(second.0[index]) - wide(first.0[index])).abs();
        let change = (wide(position) - wide(was.position)).abs();
        assert!(
            change <= own + step,
            "T24: |change| <= |change of nominal| + S"
        );
        let max = i128::from(limits[index].position.max());
        let nominal = wide(second.0[index]);
        assert!(
            clamped(nominal - max, travel) <= wide(position)
                && wide(position) <= clamped(nominal + max, travel),
            "T24: an offset within M, before the clamp to the travel"
        );
        offset_is_bounded(
            was.velocity_offset.0.into(),
            is.velocity_offset.0.into(),
            limits[index].velocity.values(),
        );
        offset_is_bounded(
            was.torque_offset.0.into(),
            is.torque_offset.0.into(),
            limits[index].torque.values(),
        );
    }
}

/// A position, nm.
fn wide(position: PositionNm) -> i128 {
    position.0.into()
}

/// A position that is clamped to the travel, nm.
fn clamped(position_nm: i128, travel: &Travel) -> i128 {
    position_nm.max(wide(travel.lower)).min(wide(travel.upper))
}

/// T24, one offset of velocity or torque from one tick to the next.
fn offset_is_bounded(was: i64, is: i64, limits: LimitValues) {
    let last = Trace {
        value: was,
        change: None,
    };
    assert!(
        !breaks(Some(&last), is, 1, Motion::Free, limits),
        "T24: velocity and torque within M and S"
    );
}

/// T24: one tick of any session raises no alarm in a monitor that has seen the ticks before. An
/// accepted command has a sequence above the accepted one, which the classification ensures.
pub fn session_raises_no_alarm<const N: usize>(
    session: &Session<N>,
    tick: &TickInput<N>,
    refused: bool,
    accepted: Accepted<N>,
) {
    let mut monitor = watching(session);
    let mut after = *session;
    let output = after.step(tick, refused, &accepted, &Diagnostics::default());
    let result = if output.withheld {
        monitor.check_state(&output.state)
    } else {
        monitor.check_tick(&output.state, &output.references)
    };
    assert!(result.is_ok(), "T24: no alarm on a session");
}

/// Trace of a channel with this value and change, in counts.
fn trace(value: i32, change: i32) -> Option<Trace> {
    Some(Trace {
        value: value.into(),
        change: Some(change.into()),
    })
}

/// A monitor that has seen every tick of a session.
fn watching<const N: usize>(session: &Session<N>) -> Monitor<N> {
    let axes = &session.config().parameters().axes;
    let monitor = Monitor::new(
        axes.map(|axis| axis.limits),
        Some(axes.map(|axis| axis.machine_travel)),
    );
    let mut seen = *monitor_parts(&monitor);
    let inside = session.parts();
    for (index, config) in axes.iter().enumerate() {
        let axis = &inside.axes[index];
        let channels = &axis.channels;
        let traces = [
            trace(channels.position.count(), channels.position.change()),
            trace(channels.velocity.count(), channels.velocity.change()),
            trace(channels.torque.count(), channels.torque.change()),
        ];
        let travel = &config.machine_travel;
        let (reference, _) = drive_reference(axis.nominal, &channels.offsets(), travel);
        let watched = &mut seen.axes[index];
        watched.offsets = traces;
        watched.written = traces;
        // At an end of the travel the offset cannot be read from the reference.
        if reference.position <= travel.lower || reference.position >= travel.upper {
            watched.written[0] = None;
        }
        watched.reference = Some((axis.nominal, reference.position));
    }
    seen.last = Some(Seen {
        tick: inside.discrete.tick,
        epoch: inside.discrete.epoch,
        accepted: inside.discrete.accepted,
    });
    monitor_from_parts(seen)
}

/// T24, a lossy link: samples of a channel that keeps its limits raise no alarm, whichever of them
/// are lost.
pub fn gaps_raise_no_alarm(limits: &Limits<OffsetNm>, samples: &[(i32, Motion, bool)]) {
    let bounds = Bounds::of(limits);
    let mut every = Some(Trace::at_rest(0));
    let mut some = every;
    let mut gap = 0;
    for (value, motion, arrives) in samples {
        let value = i64::from(*value);
        let kept = every;
        gap += 1;
        if Trace::advance(&mut every, value, 1, *motion, &bounds).is_err() {
            // Not a sample of such a channel: as if it had not been.
            (every, gap) = (kept, gap - 1);
            continue;
        }
        if *arrives {
            let result = Trace::advance(&mut some, value, gap, *motion, &bounds);
            assert!(result.is_ok(), "T24: a loss raises no alarm");
            gap = 0;
        }
    }
}
