//! T17 to T20 on stable Rust: single ticks of any loop, and sequences of a loop in front of a drive
//! that moves by its velocity.

use std::collections::VecDeque;

use gantry_tau_core::Reference;
use gantry_tau_core::control::channel::{Channel, Limits};
use gantry_tau_core::control::position_loop::config::{
    LoopConfig, LoopValues, MAX_GAIN, MAX_GAIN_TIMES_LAG, MAX_LAG, MAX_TORQUE_WEIGHT, MAX_WEIGHT,
    MAX_WINDOW_NM,
};
use gantry_tau_core::control::position_loop::{
    Enable, LoopInput, LoopParts, LoopStop, PositionLoop,
};
use gantry_tau_core::units::{PositionNm, TorquePermille, VelocityUmS};
use gantry_tau_core::verification::position_loop::product;
use gantry_tau_proofs::properties::position_loop::{self as loops, Before, MAX_WEIGHTED};
use proptest::array::{uniform, uniform11};
use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;
use proptest::sample::select;

use crate::any;

/// Number of axes of the properties of several; the proofs are of three.
const N: usize = 6;

/// Limits where things happen, and all others.
fn limits<U: std::fmt::Debug>(most: i32) -> impl Strategy<Value = Limits<U>> {
    any::limits_of(prop_oneof![4 => 0..=most.min(40_000), 1 => 0..=most], most)
}

/// A weight at its ends, and any.
fn weight(most: u16) -> impl Strategy<Value = u16> {
    prop_oneof![1 => Just(0), 1 => Just(most), 6 => 0..=most]
}

prop_compose! {
    fn config()(
        gain in weight(MAX_GAIN), feed_forward in weight(MAX_WEIGHT), torque_feed_forward in weight(MAX_TORQUE_WEIGHT),
        // Often without integral or torque, and at times without both: these ticks end early.
        integral in prop_oneof![1 => Just(0), 2 => weight(MAX_WEIGHT)], integral_max in prop_oneof![3 => 0..50_000, 1 => 0..=i32::MAX],
        lag in 0..=MAX_LAG, window_nm in prop_oneof![3 => 1..10_000, 1 => 1..=MAX_WINDOW_NM],
        window_ticks in prop_oneof![6 => 1..6_u16, 1 => 1..=u16::MAX],
        velocity in limits(i32::MAX), torque in prop_oneof![1 => Just(Limits::DISABLED), 2 => limits(i16::MAX.into())],
    ) -> LoopConfig {
        let most = MAX_GAIN_TIMES_LAG / (u32::from(lag.max(1)) + 1);
        let gain = gain.min(u16::try_from(most).unwrap());
        let values = LoopValues {
            gain, velocity_feed_forward: feed_forward, torque_feed_forward, integral, integral_max, lag, window_nm, window_ticks,
            velocity, torque,
        };
        LoopConfig::new(values).unwrap()
    }
}

/// Positions near each other, as far apart as positions can be, and at the ends.
fn position() -> impl Strategy<Value = PositionNm> {
    prop_oneof![6 => -20_000..20_000_i64, 1 => any::<i64>(), 1 => select(vec![i64::MIN, i64::MAX])]
        .prop_map(PositionNm)
}

fn permit() -> impl Strategy<Value = Enable> {
    prop_oneof![1 => Just(Enable::Stop), 2 => Just(Enable::Rearm), 4 => Just(Enable::Run)]
}

prop_compose! {
    fn reference()(
        position in position(), velocity in prop_oneof![3 => -1_000..1_000, 1 => any::<i32>()], torque: i16,
    ) -> Reference {
        Reference { position, velocity_offset: VelocityUmS(velocity), torque_offset: TorquePermille(torque) }
    }
}

prop_compose! {
    fn input()(reference in reference(), actual in option::weighted(0.9, position()), permit in permit()) -> LoopInput {
        LoopInput { reference, actual, permit }
    }
}

fn stop() -> impl Strategy<Value = Option<LoopStop>> {
    let stops = vec![
        LoopStop::NotPermitted,
        LoopStop::NoActual,
        LoopStop::FollowingError,
        LoopStop::Limited,
        LoopStop::OtherAxis,
        LoopStop::Refused,
    ];
    prop_oneof![2 => Just(None), 1 => select(stops).prop_map(Some)]
}

/// Any loop that is valid under a configuration; at rest often enough that it can be released.
fn loop_of(config: LoopConfig) -> BoxedStrategy<PositionLoop> {
    let values = *config.values();
    let most = i64::from(values.integral_max) << 10;
    let velocity = prop_oneof![1 => Just(Channel::ZERO), 3 => any::channel(values.velocity)];
    let outside = prop_oneof![0..values.window_ticks, Just(values.window_ticks - 1)];
    let limited = prop_oneof![3 => 0..values.window_ticks, 1 => Just(values.window_ticks)];
    let counts = (outside, limited);
    let parts = (
        uniform11(position()),
        -most..=most,
        velocity,
        any::channel(values.torque),
        counts,
        stop(),
    );
    parts
        .prop_map(
            move |(history, integral, velocity, torque, (outside, limited), stop)| {
                let parts = LoopParts {
                    history,
                    integral,
                    velocity,
                    torque,
                    outside,
                    limited,
                    stop,
                };
                PositionLoop::from_parts(parts, &config).unwrap()
            },
        )
        .boxed()
}

/// Loops that run together, or have stopped together.
fn loops_of(config: [LoopConfig; N]) -> BoxedStrategy<[PositionLoop; N]> {
    (config.map(loop_of), stop())
        .prop_map(move |(axes, stop)| {
            std::array::from_fn(|axis| {
                PositionLoop::from_parts(
                    LoopParts {
                        stop,
                        ..*axes[axis].parts()
                    },
                    &config[axis],
                )
                .unwrap()
            })
        })
        .boxed()
}

fn configs() -> BoxedStrategy<[LoopConfig; N]> {
    // On the heap: the strategies of several loops do not fit a test's stack.
    uniform(config().boxed()).boxed()
}

/// Inputs of all axes: any, or those of a machine that follows closely under one permit.
fn inputs() -> BoxedStrategy<[LoopInput; N]> {
    let close = (
        uniform::<_, N>(reference().boxed()),
        permit(),
        -100..100_i64,
    )
        .prop_map(|(references, permit, off)| {
            references.map(|reference| {
                let actual = Some(PositionNm(reference.position.0.saturating_add(off)));
                LoopInput {
                    reference,
                    actual,
                    permit,
                }
            })
        });
    prop_oneof![1 => uniform::<_, N>(input().boxed()), 1 => close.boxed()].boxed()
}

prop_compose! {
    fn before()(config in configs())(
        config in Just(config), axes in loops_of(config), earlier in loops_of(config), inputs in inputs(), accepted in any::<bool>(),
    ) -> Before<N> {
        Before { config, axes, earlier, inputs, accepted }
    }
}

fn value() -> impl Strategy<Value = i64> {
    prop_oneof![-100..100_i64, -MAX_WEIGHTED..=MAX_WEIGHTED]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8_000))]

    #[test]
    fn one_tick(
        (config, axis) in config().prop_flat_map(|config| (Just(config), loop_of(config))), input in input(),
        bound in prop_oneof![0..60_000_u32, any::<u32>()], place in 0..=usize::from(MAX_LAG),
    ) {
        loops::references_are_bounded(&axis, &config, &input);
        loops::stops_with_its_ramp(&axis, &config, &input, bound);
        loops::trips_in_its_tick(&axis, &config, &input, place);
        loops::is_released_by_a_rearm(&axis, &config, &input);
        loops::follows_its_terms(&axis, &config, &input);
    }

    #[test]
    fn one_tick_of_all_axes(before in before(), next in inputs(), axis in 0..N) {
        loops::axes_run_together(&before);
        loops::axis_of_many_is_bounded(&before, axis);
        loops::axis_of_many_acts_alone(&before, axis);
        loops::refused_references_are_not_in_force(&before, axis, &next);
    }

    #[test]
    fn one_term(value in value(), other in value(), weight: u16, from in position(), to in position()) {
        loops::error_is_exact(from, to);
        loops::product_is_bounded(value, weight);
        prop_assert_eq!(i128::from(product(value, weight)), i128::from(value) * i128::from(weight));
        loops::term_is_exact(value, weight);
        loops::term_is_monotone(value, other, weight);
        loops::feed_forward_is_exact(value, weight);
        loops::feed_forward_is_monotone(value, other, weight);
    }

    #[test]
    fn one_step_of_the_integral(
        most in prop_oneof![0..100_i32, 0..=i32::MAX], share in -1.0..=1.0_f64, growth in prop_oneof![value(), any::<i64>()],
        short in prop_oneof![Just(0), -10..10_i64, any::<i64>()],
    ) {
        #[expect(clippy::as_conversions, clippy::cast_possible_truncation, reason = "a share of an integral that is an f64")]
        let integral = (f64::from(most) * 1_024.0 * share) as i64;
        loops::integral_is_bounded(integral, growth, short, most);
    }
}

/// One event of a ride.
#[derive(Clone, Copy, Debug)]
struct Event {
    /// Change of the reference, nm.
    moved: i64,
    /// Disturbance of the drive's velocity, µm/s.
    pushed: i64,
    is_measured: bool,
    permit: Enable,
}

prop_compose! {
    fn event()(
        moved in prop_oneof![8 => -3_000..3_000_i64, 1 => -1_000_000..1_000_000_i64], pushed in -2_000..2_000_i64,
        is_measured in prop::bool::weighted(0.98), permit in prop_oneof![1 => Just(Enable::Stop), 9 => Just(Enable::Rearm), 30 => Just(Enable::Run)],
    ) -> Event {
        Event { moved, pushed, is_measured, permit }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// From rest, in front of a drive with latency: every tick of every ride, and not one of them
    /// is out of what one step says.
    #[test]
    fn a_ride(config in config(), latency in 0..=usize::from(MAX_LAG), events in vec(event(), 1..200)) {
        let mut axis = PositionLoop::at_rest(PositionNm(0));
        let (mut reference, mut position) = (0_i64, 0_i64);
        let mut reports: VecDeque<i64> = std::iter::repeat_n(0, latency + 1).collect();
        for event in events {
            reference += event.moved;
            let actual = event.is_measured.then(|| PositionNm(reports[0]));
            let given = Reference {
                position: PositionNm(reference), velocity_offset: VelocityUmS(0), torque_offset: TorquePermille(0),
            };
            let input = LoopInput { reference: given, actual, permit: event.permit };
            loops::references_are_bounded(&axis, &config, &input);
            loops::stops_with_its_ramp(&axis, &config, &input, 1_000);
            loops::trips_in_its_tick(&axis, &config, &input, usize::from(config.values().lag));
            loops::is_released_by_a_rearm(&axis, &config, &input);
            loops::follows_its_terms(&axis, &config, &input);
            let velocity = axis.tick(&config, &input).velocity;
            position = position.saturating_add(i64::from(velocity.0)).saturating_add(event.pushed);
            reports.push_back(position);
            reports.pop_front();
        }
    }
}
