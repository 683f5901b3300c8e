//! Position loops outside the drives.

use std::hint::black_box;

use gantry_tau_core::control::axis::Reference;
use gantry_tau_core::control::channel::Limits;
use gantry_tau_core::control::position_loop::config::{LoopConfig, LoopValues};
use gantry_tau_core::control::position_loop::{Enable, LoopInput, PositionLoop, PositionLoops};
use gantry_tau_core::units::{PositionNm, TorquePermille, VelocityUmS};
use gantry_tau_tests::server_fixture;

use super::measured;

/// A position loop with every term, for a cycle of latency each way.
fn config() -> LoopConfig {
    LoopConfig::new(LoopValues {
        gain: 5_256,
        velocity_feed_forward: 1_024,
        torque_feed_forward: 2_621,
        integral: 20,
        integral_max: 10_000,
        lag: 3,
        window_nm: 2_000_000,
        window_ticks: 10,
        velocity: server_fixture::limits(600_000, 20_000, 40_000, 10_000),
        torque: server_fixture::limits(1_000, 500, 1_000, 100),
    })
    .unwrap()
}

/// The same without integral and torque: proportional term and velocity feed-forward.
fn config_of_velocity() -> LoopConfig {
    let values = *config().values();
    let (torque_feed_forward, integral, integral_max, torque) = (0, 0, 0, Limits::DISABLED);
    LoopConfig::new(LoopValues {
        torque_feed_forward,
        integral,
        integral_max,
        torque,
        ..values
    })
    .unwrap()
}

/// Input of a loop at a tick of a path of 0.1 m/s, some micrometres behind it.
fn input(tick: i64, permit: Enable) -> LoopInput {
    let position = PositionNm(tick * 100_000);
    let reference = Reference {
        position,
        velocity_offset: VelocityUmS(10),
        torque_offset: TorquePermille(1),
    };
    LoopInput {
        reference,
        actual: Some(PositionNm(position.0 - 305_000)),
        permit,
    }
}

/// An input after which no reference is where it was: further behind, and with another torque.
fn further_behind(input: LoopInput) -> LoopInput {
    let LoopInput {
        reference,
        actual,
        permit,
    } = input;
    let position = PositionNm(reference.position.0 + 1_000);
    let actual = actual.map(|actual| PositionNm(actual.0 - 70_000));
    LoopInput {
        reference: Reference {
            position,
            torque_offset: TorquePermille(5),
            ..reference
        },
        actual,
        permit,
    }
}

/// One axis that follows with every term, in motion.
pub(super) fn axis() {
    follow(config());
}

/// One axis that follows without integral and torque.
pub(super) fn axis_of_velocity() {
    follow(config_of_velocity());
}

fn follow(config: LoopConfig) {
    let mut axis = PositionLoop::at_rest(PositionNm(0));
    let mut given = input(0, Enable::Rearm);
    for tick in 0..20 {
        axis.tick(&config, &given);
        given = input(tick, Enable::Run);
    }
    let (mut axis, config, given) = black_box((axis, config, further_behind(given)));
    let reference = black_box(measured(|| axis.tick(&config, &given)));
    assert!(reference.velocity.0 > 0 && axis.stop().is_none());
}

/// Six axes that follow with every term.
pub(super) fn six_axes() {
    follow_six(config());
}

/// Six axes that follow without integral and torque.
pub(super) fn six_axes_of_velocity() {
    follow_six(config_of_velocity());
}

fn follow_six(config: LoopConfig) {
    let mut loops = PositionLoops::at_rest([config; 6], [PositionNm(0); 6]);
    let mut inputs = [input(0, Enable::Rearm); 6];
    for tick in 0..20 {
        loops.tick(&inputs, true);
        inputs = [input(tick, Enable::Run); 6];
    }
    let (mut loops, inputs) = black_box((loops, inputs.map(further_behind)));
    black_box(measured(|| loops.tick(&inputs, true)));
    assert!(loops.is_running());
}
