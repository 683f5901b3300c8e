//! Two position loops of any configuration along any path, with errors, gaps, stops, re-arms and
//! refused references: in every tick T17 to T20, of each axis by itself and of both together.

use gantry_tau_core::control::axis::Reference;
use gantry_tau_core::control::channel::{LimitValues, Limits};
use gantry_tau_core::control::position_loop::config::{LoopConfig, LoopConfigError, LoopValues};
use gantry_tau_core::control::position_loop::{Enable, LoopInput, LoopStop, PositionLoop};
use gantry_tau_core::units::{PositionNm, TorquePermille, VelocityUmS};
use gantry_tau_proofs::properties::position_loop::{
    Before, axes_run_together, axis_of_many_acts_alone, axis_of_many_is_bounded, follows_its_terms,
    is_released_by_a_rearm, references_are_bounded, refused_references_are_not_in_force,
    stops_with_its_ramp, trips_in_its_tick,
};

/// Bytes of a configuration, and of a tick.
pub const CONFIG: usize = 24;
/// Bytes of a tick.
pub const TICK: usize = 16;
/// Number of axes.
const AXES: usize = 2;

/// The first [`CONFIG`] bytes are the configuration of both axes, each [`TICK`] of the next a tick;
/// a part of one is left out.
pub fn position_loop(data: &[u8]) {
    let Some((head, ticks)) = data.split_first_chunk::<CONFIG>() else {
        return;
    };
    let config = match config(head) {
        Ok(config) => config,
        Err(error) => return assert!(error.to_string().contains(" is "), "{error}"),
    };
    let mut before = start(config);
    for tick in ticks.chunks_exact(TICK) {
        let Ok(bytes) = tick.try_into() else { return };
        step(&mut before, bytes);
    }
}

fn word(bytes: &[u8; CONFIG], place: usize) -> u16 {
    u16::from_le_bytes([bytes[place], bytes[place + 1]])
}

/// Little-endian words, in the order of [`LoopValues`]; of both channels M, S and rho, with the
/// smallest A there is.
fn config(bytes: &[u8; CONFIG]) -> Result<LoopConfig, LoopConfigError> {
    LoopConfig::new(LoopValues {
        gain: word(bytes, 0),
        velocity_feed_forward: word(bytes, 2),
        torque_feed_forward: word(bytes, 4),
        integral: word(bytes, 6),
        integral_max: i32::from(word(bytes, 8)) * 16,
        lag: bytes[10],
        window_nm: i32::from(word(bytes, 11)) * 256 + 1,
        window_ticks: bytes[13].into(),
        velocity: limits(
            i32::from(word(bytes, 14)) * 32,
            word(bytes, 16),
            word(bytes, 18),
        ),
        torque: limits(
            i32::from(bytes[20]) * 8,
            u16::from(bytes[21]) + 1,
            u16::from(bytes[22]) + 1,
        ),
    })
}

fn limits<U>(max: i32, step: u16, ramp: u16) -> Limits<U> {
    let (step, ramp) = (i32::from(step), i32::from(ramp));
    Limits::new(LimitValues {
        max,
        step,
        accel: step + ramp,
        ramp,
    })
    .unwrap_or(Limits::DISABLED)
}

/// Loops at rest at zero.
fn start(config: LoopConfig) -> Before<AXES> {
    let axes = [PositionLoop::at_rest(PositionNm(0)); AXES];
    let inputs = [input(PositionNm(0), None, 0, 0, Enable::Stop); AXES];
    Before {
        config: [config; AXES],
        axes,
        earlier: axes,
        inputs,
        accepted: true,
    }
}

const fn input(
    position: PositionNm,
    actual: Option<PositionNm>,
    velocity: i32,
    torque: i16,
    permit: Enable,
) -> LoopInput {
    let (velocity_offset, torque_offset) = (VelocityUmS(velocity), TorquePermille(torque));
    LoopInput {
        reference: Reference {
            position,
            velocity_offset,
            torque_offset,
        },
        actual,
        permit,
    }
}

/// One tick: permit and switches, how far the reference moves, how far the actual position is from
/// the oldest reference, offsets, and numbers for the properties.
fn step(before: &mut Before<AXES>, bytes: &[u8; TICK]) {
    let [
        kind,
        switches,
        a,
        b,
        c,
        d,
        e,
        f,
        g,
        h,
        velocity,
        more,
        torque,
        place,
        bound,
        scale,
    ] = *bytes;
    let permit = match kind % 4 {
        0 => Enable::Stop,
        1 => Enable::Rearm,
        _ => Enable::Run,
    };
    before.accepted = switches & 1 == 0;
    let (moved, off) = (
        i32::from_le_bytes([a, b, c, d]) >> (scale % 24),
        i32::from_le_bytes([e, f, g, h]) >> (scale % 24),
    );
    for (axis, given) in before.inputs.iter_mut().enumerate() {
        let position = match switches & 6 {
            6 if axis == 0 => PositionNm(i64::MAX),
            4 if axis == 0 => PositionNm(i64::MIN),
            _ => PositionNm(given.reference.position.0.saturating_add(moved.into())),
        };
        let oldest = before.axes[axis].parts().history[usize::from(place % 11)];
        let is_known = switches & 8 == 0 || axis == 1;
        let actual = is_known.then(|| PositionNm(oldest.0.saturating_sub(off.into())));
        let velocity = i32::from(i16::from_le_bytes([velocity, more])) << (scale % 16);
        *given = input(
            position,
            actual,
            velocity,
            i16::from(i8::from_le_bytes([torque])) << (scale % 9),
            permit,
        );
    }
    check(
        before,
        usize::from(place % 11),
        u32::from(bound) << (scale % 24),
    );
    let Some(mut loops) = before.loops() else {
        panic!("the loops are valid: {before:?}")
    };
    let _ = loops.tick(&before.inputs, before.accepted);
    before.earlier = if before.accepted {
        before.axes
    } else {
        before.earlier.map(|axis| refused(axis, before))
    };
    before.axes = *loops.axes();
    assert_eq!(
        before.loops(),
        Some(loops),
        "these are the loops before the last tick"
    );
}

/// A loop after refused references.
fn refused(axis: PositionLoop, before: &Before<AXES>) -> PositionLoop {
    let mut parts = *axis.parts();
    parts.stop = parts.stop.or(Some(LoopStop::Refused));
    PositionLoop::from_parts(parts, &before.config[0]).unwrap_or(axis)
}

fn check(before: &Before<AXES>, place: usize, bound: u32) {
    for axis in 0..AXES {
        let (state, config, input) = (
            &before.axes[axis],
            &before.config[axis],
            &before.inputs[axis],
        );
        references_are_bounded(state, config, input);
        stops_with_its_ramp(state, config, input, bound);
        trips_in_its_tick(state, config, input, place);
        is_released_by_a_rearm(state, config, input);
        follows_its_terms(state, config, input);
        axis_of_many_is_bounded(before, axis);
        axis_of_many_acts_alone(before, axis);
        refused_references_are_not_in_force(before, axis, &before.inputs);
    }
    axes_run_together(before);
}
