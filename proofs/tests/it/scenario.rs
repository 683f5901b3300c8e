//! Sequences with two hostile clients on stable Rust: every tick is right, and is what the model
//! says.

use gantry_tau_proofs::scenario::{
    Circumstances, ClientAction, Machine, Op, Peer, Rates, Scenario, Shares, endpoint_is_right,
    every_tick_is_right,
};
use proptest::array::{uniform2, uniform3};
use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;

/// Hundredths, most of them within the limits.
fn shares() -> impl Strategy<Value = Shares> {
    let share = prop_oneof![8 => -100..=100_i8, 4 => Just(0), 1 => any::<i8>()];
    uniform2(uniform3(share))
}

prop_compose! {
    fn rates()(
        max in 0..5_000_u16, ramp: u8, step: u8, accel: u8, scale in prop_oneof![4 => Just(0), 1 => any::<u8>()],
    ) -> Rates {
        Rates { max, ramp, step, accel, scale }
    }
}

prop_compose! {
    fn machine()(
        rates in uniform2(uniform3(rates())), reach in uniform2(uniform2(prop_oneof![0..1_000_000_u32, any::<u32>()])), nominal_step in uniform2(any::<u16>()),
        nominal_accel in uniform2(option::of((prop_oneof![0..200_u16, any::<u16>()], any::<bool>()))),
        agitation in uniform2(option::of(prop_oneof![0..9_u16, any::<u16>()])),
        budget in option::of((any::<u8>(), 0..20_u8)), echo_window in 0..3_u8,
        handshake_ticks in prop_oneof![0..20_u8, any::<u8>()], lockstep in prop::bool::weighted(0.1),
    ) -> Machine {
        Machine { rates, reach, nominal_step, nominal_accel, agitation, budget, echo_window, handshake_ticks, lockstep }
    }
}

/// Nought most of the time, or the session would hardly ever get anywhere.
fn off() -> impl Strategy<Value = i8> {
    prop_oneof![8 => Just(0_i8), 1 => -2..3_i8, 1 => any::<i8>()]
}

fn action() -> impl Strategy<Value = ClientAction> {
    let hello = (
        prop_oneof![9 => Just(0), 1 => any::<u8>()],
        prop_oneof![4 => Just(1), 1 => any::<u16>()],
    )
        .prop_map(|(axes, capabilities)| ClientAction::Hello { axes, capabilities });
    let ahead =
        prop_oneof![6 => 1..4_i32, 2 => -2..2_i32, 1 => 65_534..65_540_i32, 1 => any::<i32>()];
    let command = (off(), ahead, off(), any::<bool>(), shares()).prop_map(
        |(epoch, ahead, behind, obtain, targets)| ClientAction::Command {
            epoch,
            ahead,
            behind,
            obtain,
            targets,
        },
    );
    prop_oneof![
        8 => hello,
        12 => command,
        2 => off().prop_map(|epoch| ClientAction::Goodbye { epoch }),
        1 => off().prop_map(|epoch| ClientAction::Stop { epoch }),
        1 => Just(ClientAction::Malformed),
        1 => Just(ClientAction::Dropped),
        1 => Just(ClientAction::Broken),
        1 => Just(ClientAction::Flood),
        1 => Just(ClientAction::Closed),
    ]
}

prop_compose! {
    fn circumstances()(
        elapsed in prop_oneof![8 => Just(1), 4 => 0..4_u32, 1 => any::<u32>()], stop in prop::bool::weighted(0.1), rearm: bool,
        unread in prop::bool::weighted(0.05), jump in option::weighted(0.05, any::<i64>()), epoch in off(),
        quit in prop::bool::weighted(0.05),
    ) -> Circumstances {
        Circumstances { elapsed, stop, rearm, unread, jump, epoch, quit }
    }
}

fn one_move() -> impl Strategy<Value = Op> {
    let peer = prop_oneof![6 => Just(Peer::Owner), 1 => Just(Peer::One), 1 => Just(Peer::Other)];
    let answer =
        (any::<bool>(), shares(), 1..20_u8).prop_map(|(obtain, targets, times)| Op::Answer {
            obtain,
            targets,
            times,
        });
    prop_oneof![
        8 => answer,
        2 => prop_oneof![4 => Just(1_u8), 1 => 0..50_u8].prop_map(Op::Silence),
        8 => (peer, action()).prop_map(|(peer, action)| Op::Say(peer, action)),
        6 => circumstances().prop_map(Op::Tick),
        1 => uniform2(prop_oneof![8 => -100..=100_i8, 1 => any::<i8>()]).prop_map(Op::Drift),
        1 => shares().prop_map(Op::RefusedWrite),
    ]
}

prop_compose! {
    /// A scenario; half of them begin with a handshake.
    fn scenario()(
        machine in machine(), in_force in prop_oneof![4 => Just([[0; 3]; 2]), 1 => shares()],
        late_in_life in prop::bool::weighted(0.1), mut ops in vec(one_move(), 0..40), greeted: bool,
    ) -> Scenario {
        if greeted {
            let hello = ClientAction::Hello { axes: 0, capabilities: 1 };
            ops.splice(..0, [Op::Say(Peer::One, hello), Op::Silence(1)]);
        }
        Scenario { machine, in_force, late_in_life, ops }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    #[test]
    fn every_tick_of_a_play_is_right(scenario in scenario()) {
        every_tick_is_right(&scenario);
    }

    #[test]
    fn a_play_by_bytes_is_right(scenario in scenario()) {
        endpoint_is_right(&scenario);
    }
}
