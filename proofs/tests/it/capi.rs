//! T26 on stable Rust: the C interface's pointers and fields.

use gantry_tau_capi::server::{
    GT_MAX_AXES, GT_MAX_MOTORS, gt_actual, gt_axis_config, gt_in_force, gt_limits, gt_offsets,
    gt_server_config,
};
use gantry_tau_capi::server::{gt_start, gt_tick_input, gt_wrench_sample};
use gantry_tau_capi::verification::Room;
use gantry_tau_core::EpochRange;
use gantry_tau_core::control::channel::Limits;
use gantry_tau_core::control::session::Input;
use gantry_tau_proofs::properties::capi;
use proptest::array::{uniform6, uniform12};
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::{collection, option};

use crate::any;

/// Places in a room and beyond it.
fn place() -> impl Strategy<Value = Option<usize>> {
    option::of(prop_oneof![
        (0..8_usize).prop_map(|words| words * 8),
        0..60_usize
    ])
}

prop_compose! {
    fn offsets()(position_nm: i32, velocity_um_s: i32, torque_permille: i16) -> gt_offsets {
        gt_offsets { position_nm, velocity_um_s, torque_permille }
    }
}

prop_compose! {
    fn in_force()(nominal_nm: i64, offsets in prop_oneof![Just(gt_offsets::default()), offsets()]) -> gt_in_force {
        gt_in_force { nominal_nm, offsets }
    }
}

prop_compose! {
    fn actual()(position_nm: i64, velocity_um_s: i32, torque_permille: i16) -> gt_actual {
        gt_actual { position_nm, velocity_um_s, torque_permille }
    }
}

prop_compose! {
    fn sample()(
        status in prop_oneof![20 => 0..=2_u8, 1 => any::<u8>()], age: u8, force_mn: [i32; 3], moment_unm: [i32; 3],
    ) -> gt_wrench_sample {
        gt_wrench_sample { status, age, force_mn, moment_unm }
    }
}

prop_compose! {
    /// Codes that are none are rare.
    fn tick_input()(
        (elapsed_cycles, quit) in (any::<u32>(), 0..3_u8),
        [reading, stop, rearm] in [0..30_u8, 0..30, 0..30].prop_map(|codes| codes.map(|code| if code == 0 { 0 } else { 1 + code % 2 })),
        nominal_nm in uniform6(any::<i64>()),
        actual in uniform6(actual()), sensor in sample(),
    ) -> gt_tick_input {
        gt_tick_input { elapsed_cycles, reading, sensor, stop, quit, rearm, nominal_nm, actual }
    }
}

prop_compose! {
    /// Limits that core accepts, the smallest of every kind among them.
    fn accepted_limits()(max in 0..3_i32, ramp in 1..4_i32, above_ramp in 0..4_i32, above_both in 0..4_i32) -> gt_limits {
        let step = ramp + above_ramp;
        gt_limits { max, step, accel: step + ramp + above_both, ramp }
    }
}

fn any_limits() -> impl Strategy<Value = gt_limits> {
    let any = any::<[i32; 4]>().prop_map(|[max, step, accel, ramp]| gt_limits {
        max,
        step,
        accel,
        ramp,
    });
    prop_oneof![4 => accepted_limits(), 1 => any]
}

prop_compose! {
    fn axis()(
        [position, velocity, torque] in [any_limits(), any_limits(), any_limits()],
        [nominal_lower_nm, nominal_upper_nm, machine_lower_nm, machine_upper_nm] in any::<[i64; 4]>(),
        nominal_step_nm: u32, nominal_accel_nm in prop_oneof![Just(0), any::<u32>()], nominal_accel_is_fault: u8,
        agitation_nm_per_tick in prop_oneof![Just(0), 0..2_000_000_u32, any::<u32>()],
    ) -> gt_axis_config {
        gt_axis_config {
            position, velocity, torque, nominal_lower_nm, nominal_upper_nm, machine_lower_nm, machine_upper_nm, nominal_step_nm,
            nominal_accel_nm, agitation_nm_per_tick, nominal_accel_is_fault,
        }
    }
}

fn limits<U>(limits: &Limits<U>) -> gt_limits {
    let values = limits.values();
    gt_limits {
        max: values.max,
        step: values.step,
        accel: values.accel,
        ramp: values.ramp,
    }
}

/// A configuration of C with the axes of one of core, and any numbers.
fn configuration<const N: usize>() -> impl Strategy<Value = gt_server_config> {
    let small = (
        any::<u8>(),
        prop_oneof![Just(0), 1..=128_u8, any::<u8>()],
        any::<u8>(),
    );
    let map = prop_oneof![8 => uniform12(0..3_u8), 1 => uniform12(0..7_u8)];
    let rest = (any::<[u32; 3]>(), any::<u16>(), small, 0..14_u32, map);
    (any::config::<N>(), rest).prop_map(
        |(config, ([cycle_us, handshake_ticks, checksum], capabilities, small, motors, map))| {
            let mut axis = config
                .parameters()
                .axes
                .iter()
                .cycle()
                .map(|axis| gt_axis_config {
                    position: limits(&axis.limits.position),
                    velocity: limits(&axis.limits.velocity),
                    torque: limits(&axis.limits.torque),
                    nominal_lower_nm: axis.nominal_travel.lower.0,
                    nominal_upper_nm: axis.nominal_travel.upper.0,
                    machine_lower_nm: axis.machine_travel.lower.0,
                    machine_upper_nm: axis.machine_travel.upper.0,
                    nominal_step_nm: axis.nominal_step_nm,
                    nominal_accel_nm: axis.nominal_accel.map_or(0, |limit| limit.nm.get()),
                    nominal_accel_is_fault: axis
                        .nominal_accel
                        .map_or(0, |limit| limit.is_fault.into()),
                    agitation_nm_per_tick: axis
                        .agitation
                        .map_or(0, |budget| budget.nm_per_tick.get()),
                });
            let (echo_window, budget_window, budget_allowed) = small;
            gt_server_config {
                axes: 0,
                motors,
                axis_of_motor: map,
                black_box_ticks: 0,
                cycle_us,
                handshake_ticks,
                kinematics_checksum: checksum,
                capabilities,
                echo_window,
                budget_window,
                budget_allowed,
                axis: std::array::from_fn(|_| axis.next().unwrap()),
            }
        },
    )
}

fn start() -> impl Strategy<Value = gt_start> {
    (uniform6(in_force()), any::<[u64; 2]>(), any::<u8>()).prop_map(
        |(in_force, [first_epoch, last_epoch], stop_latched)| gt_start {
            in_force,
            first_epoch,
            last_epoch,
            stop_latched,
        },
    )
}

proptest! {
    #[test]
    fn pointers(address in prop_oneof![any::<usize>(), 0..64_usize]) {
        capi::pointer_is_judged(address);
    }

    #[test]
    fn memory(
        bytes: [u8; Room::BYTES], is_tagged: bool, made in place(), sought in place(), value: Option<u32>,
        length in prop_oneof![0..60_usize, any::<usize>()], at in 0..Room::BYTES,
    ) {
        let mut room = Room(bytes);
        if is_tagged {
            room.0[16..24].copy_from_slice(&Room::TAG);
        }
        capi::object_is_found(&mut room, sought);
        capi::bytes_are_borrowed(&mut room, sought, length, at);
        capi::object_is_made(&mut room, made, value);
    }

    #[test]
    fn inputs(input in tick_input(), axis in 0..6_usize) {
        capi::input_arrives::<3>(&input, axis % 3);
        capi::input_arrives::<6>(&input, axis);
    }

    #[test]
    fn writes(
        session in any::session::<3>(), withheld: bool, fate in prop_oneof![20 => 1..=3_u8, 1 => any::<u8>()],
        in_force in option::weighted(0.9, [in_force(), in_force(), in_force()]), axis in 0..3_usize,
    ) {
        capi::write_is_judged(&session, withheld, (fate, in_force), axis);
    }

    #[test]
    fn outputs(
        session in any::session::<3>(), tick in any::tick_input::<3>(), used: bool,
        references in uniform12(any::reference()),
        events in collection::vec((any::connection(), any::event::<3>()), 0..6), motors in 0..=GT_MAX_MOTORS,
        axis in 0..GT_MAX_AXES, motor in 0..GT_MAX_MOTORS,
    ) {
        let mut input = Input { tick, ..Input::empty(EpochRange::VOLATILE) };
        input.events.extend(events);
        let mut session = session;
        // The cause of an end stays in the State; the end does not.
        for _ in 0..2 {
            let output = session.tick(&input);
            capi::output_arrives(used.then_some(&references), &output, motors, motor);
            capi::state_arrives(&output.state, axis);
        }
    }

    #[test]
    fn configurations(three in configuration::<3>(), six in configuration::<6>(), axis in 0..6_usize, motor in 0..GT_MAX_MOTORS) {
        capi::configuration_arrives::<3>(&three, axis % 3, motor);
        capi::configuration_arrives::<6>(&six, axis, motor);
    }

    #[test]
    fn axes(axis in axis()) {
        capi::axis_arrives(&axis);
    }

    #[test]
    fn starts(config in any::config::<3>(), start in start(), axis in 0..3_usize) {
        capi::start_arrives::<3>(config, &start, axis);
    }
}

/// Configurations that the C interface accepts are not too rare to be seen.
#[test]
fn some_configurations_are_accepted() {
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let all = (0..200).map(|_| {
        configuration::<3>()
            .new_tree(&mut runner)
            .unwrap()
            .current()
    });
    let accepted = all
        .filter(|config| gantry_tau_capi::verification::configure::<3>(config).is_ok())
        .count();
    assert!(accepted > 20, "{accepted} of 200");
}
