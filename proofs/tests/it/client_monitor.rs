//! T24 on stable Rust: single steps over their whole domain, and sequences.

use gantry_tau_core::control::client::{Ignored, Requirements};
use gantry_tau_core::control::message::{
    AxisState, Capabilities, Counters, ServerMessage, Welcome,
};
use gantry_tau_core::control::session::{Input, Reading};
use gantry_tau_core::units::{
    Epoch, OffsetNm, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS,
};
use gantry_tau_core::verification::control::{
    Accepted, Diagnostics, Dialogue, Granted, Internals, Last, Motion, Stage, Trace,
};
use gantry_tau_core::{
    AxisLimits, Cause, Config, Connection, EpochRange, Limits, Mode, Offsets, Parameters, Phase,
    Reference, Refusal, Session, Start, State, TickInput, Transport, Travel,
};
use gantry_tau_proofs::properties::{client, monitor};
use proptest::array::{uniform2, uniform3};
use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;
use proptest::sample::select;

use crate::any;

const N: usize = 2;

/// Small numbers, where comparisons turn, and all others.
fn count(small: i32) -> impl Strategy<Value = i32> {
    prop_oneof![8 => -small..=small, 1 => any::<i32>(), 1 => select(vec![i32::MIN, i32::MAX])]
}

fn tick() -> impl Strategy<Value = Tick> {
    prop_oneof![6 => 0..6_u64, 1 => any::<u64>(), 1 => Just(u64::MAX)].prop_map(Tick)
}

fn limits<U: std::fmt::Debug>(most: i32) -> impl Strategy<Value = Limits<U>> {
    any::limits_of(prop_oneof![4 => 0..=most.min(40), 1 => 0..=most], most)
}

prop_compose! {
    /// A server's torque is `i16`; a Welcome can state other limits.
    fn axis_limits(most_torque: i32)(
        position in limits(i32::MAX), velocity in limits(i32::MAX), torque in limits(most_torque),
    ) -> AxisLimits {
        AxisLimits { position, velocity, torque }
    }
}

prop_compose! {
    fn offsets()(
        position in count(40), velocity in count(40),
        torque in prop_oneof![4 => -40..=40_i16, 1 => any::<i16>(), 1 => Just(i16::MIN)],
    ) -> Offsets {
        Offsets { position: OffsetNm(position), velocity: VelocityUmS(velocity), torque: TorquePermille(torque) }
    }
}

prop_compose! {
    /// Zero often enough that it can be right.
    fn axis_state()(
        offsets in prop_oneof![3 => Just(Offsets::ZERO), 1 => offsets()],
        shadow in prop_oneof![3 => Just(Offsets::ZERO), 1 => offsets()],
    ) -> AxisState {
        AxisState { offsets, shadow, ..AxisState::default() }
    }
}

prop_compose! {
    fn state()(
        tick in tick(), epoch in 0..2_u64, accepted in 0..2_u64, phase in select(Phase::ALL), axes in uniform2(axis_state()),
    ) -> State<N> {
        State {
            tick,
            epoch: Epoch(epoch),
            accepted: Sequence(accepted),
            phase,
            cause: Cause::None,
            on_time_of_100: 100,
            arrival_us: 0,
            ramp_ticks_left: 0,
            counters: Counters::default(),
            sensor: None,
            axes,
        }
    }
}

/// A value one ramp step nearer to zero.
fn ramped(value: i32, ramp: u32) -> i32 {
    let ramp = i32::try_from(value.unsigned_abs().min(ramp)).unwrap_or(i32::MAX);
    value.saturating_sub(value.signum().saturating_mul(ramp))
}

/// Value after a step: of a ramp, for kind 1, or a hold; and off by some.
fn next(kind: u8, value: i32, ramp: u32, off: i32) -> i32 {
    let value = if kind == 1 {
        ramped(value, ramp)
    } else {
        value
    };
    value.saturating_add(off)
}

prop_compose! {
    /// Limits and two States, the second often one step of ramp or hold after the first, or almost.
    fn two_states()(
        limits in uniform2(axis_limits(i32::MAX)), first in state(), mut second in state(), kind in 0..3_u8,
        off in uniform2(uniform3(prop_oneof![12 => Just(0), 1 => -1..=1_i32])),
    ) -> ([AxisLimits; N], State<N>, State<N>) {
        for index in 0..N {
            let (limits, old) = (&limits[index], first.axes[index].offsets);
            let [position, velocity, torque] = off[index];
            if kind > 0 {
                let torque = next(kind, old.torque.0.into(), limits.torque.ramp(), torque);
                second.axes[index].offsets = Offsets {
                    position: OffsetNm(next(kind, old.position.0, limits.position.ramp(), position)),
                    velocity: VelocityUmS(next(kind, old.velocity.0, limits.velocity.ramp(), velocity)),
                    torque: TorquePermille(torque.try_into().unwrap_or(i16::MAX)),
                };
            }
        }
        (limits, first, second)
    }
}

prop_compose! {
    fn welcome()(
        epoch in 0..2_u64, tick in tick(), cycle_us in 0..2_u32, kinematics_checksum in 0..2_u32, bits in 0..2_u16,
        limits in uniform2(axis_limits(i32::MAX)),
    ) -> Welcome<N> {
        let (epoch, capabilities) = (Epoch(epoch), Capabilities(bits));
        Welcome { epoch, tick, cycle_us, echo_window: 0, capabilities, kinematics_checksum, limits }
    }
}

fn message() -> impl Strategy<Value = ServerMessage<N>> {
    prop_oneof![
        6 => state().prop_map(ServerMessage::State),
        2 => welcome().prop_map(ServerMessage::Welcome),
        1 => Just(ServerMessage::Refusal(Refusal::Busy)),
    ]
}

prop_compose! {
    fn requirements()(
        bits in 0..2_u16, cycle_us in option::of(0..2_u32), kinematics_checksum in option::of(0..2_u32),
    ) -> Requirements {
        Requirements { capabilities: Capabilities(bits), cycle_us, kinematics_checksum }
    }
}

fn transport() -> impl Strategy<Value = Transport> {
    select(vec![Transport::Stream, Transport::Datagram])
}

prop_compose! {
    fn granted()(
        welcome in welcome(), sequence in prop_oneof![Just(0), Just(1), any::<u64>(), Just(u64::MAX)],
        last in option::weighted(0.9, (tick(), select(Phase::ALL))), unanswered: bool, leaving in option::of(0..=100_u8), ended: bool,
    ) -> Granted<N> {
        let last = last.map(|(tick, phase)| Last { tick, phase });
        Granted { welcome, sequence: Sequence(sequence), last, unanswered, leaving, ended }
    }
}

/// A dialogue in any valid state.
pub(crate) fn dialogue() -> impl Strategy<Value = Dialogue<N>> {
    let stage = prop_oneof![
        1 => any::<bool>().prop_map(|said| Stage::Greeting { said }),
        10 => granted().prop_map(Stage::Granted),
        1 => Just(Stage::Refused),
    ];
    let ignored = Ignored::default();
    (transport(), requirements(), stage)
        .prop_map(move |(transport, requirements, stage)| Dialogue {
            transport,
            requirements,
            stage,
            ignored,
        })
        .prop_filter("a valid dialogue", Dialogue::is_valid)
}

fn motion() -> impl Strategy<Value = Motion> {
    select(vec![Motion::Free, Motion::Hold, Motion::Ramp])
}

fn references() -> impl Strategy<Value = ([PositionNm; N], [Reference; N])> {
    let near = prop_oneof![Just(Offsets::ZERO), offsets()];
    let ends = prop_oneof![6 => Just(50), 1 => 40..60_i64];
    let axis = (-60..60_i64, near, ends).prop_map(|(nominal, offsets, end)| {
        let reference = Reference {
            position: PositionNm(
                nominal
                    .saturating_add(offsets.position.0.into())
                    .clamp(-end, end),
            ),
            velocity_offset: offsets.velocity,
            torque_offset: offsets.torque,
        };
        (PositionNm(nominal), reference)
    });
    uniform2(axis).prop_map(|axes| (axes.map(|axis| axis.0), axes.map(|axis| axis.1)))
}

/// A configuration whose ramps take some ticks.
fn config() -> impl Strategy<Value = Config<N>> {
    let axis = (axis_limits(1_000), 0..500_u32)
        .prop_map(|(limits, reach)| any::axis_of(limits, reach, 2_000));
    uniform2(axis).prop_map(|axes| Config::new(Parameters::thesis(axes)).unwrap())
}

prop_compose! {
    /// Anything that can happen to a session in a tick; a command is the next in sequence.
    fn tick_of_session()(
        [stop, goodbye, closed] in uniform3(prop::bool::weighted(0.03)), rearm: bool, targets in uniform2(offsets()),
        command in option::weighted(0.9, prop_oneof![1 => Just(Mode::Submit), 6 => Just(Mode::Obtain)]),
        nominal in uniform2(-900..900_i64), elapsed_cycles in prop_oneof![20 => Just(1), 1 => 0..4_u32],
    ) -> (TickInput<N>, Accepted<N>) {
        let reading = Some(Reading::unmeasured(nominal.map(PositionNm)));
        let tick = TickInput { elapsed_cycles, reading, stop, rearm, ..Input::empty(EpochRange::VOLATILE).tick };
        let mut accepted = Accepted::nothing();
        accepted.fsm.goodbye = goodbye;
        accepted.fsm.closed = closed;
        accepted.fsm.command = command.map(|mode| (Sequence(0), mode));
        accepted.fsm.hello = Some((Connection(0), Epoch(0)));
        accepted.targets = targets;
        (tick, accepted)
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4_000))]

    #[test]
    fn one_answer_is_right(dialogue in dialogue(), mode in any::mode(), targets in uniform2(offsets())) {
        client::answer_is_right(&dialogue, mode, &targets);
        client::goodbye_is_right(&dialogue, mode, &targets);
    }

    #[test]
    fn one_message_is_right(dialogue in dialogue(), message in message()) {
        client::message_is_right(&dialogue, message);
    }

    #[test]
    fn every_turn_of_a_dialogue_is_right(
        transport in transport(),
        requirements in requirements(),
        turns in vec((any::<bool>(), option::of(message()), option::of((any::mode(), uniform2(offsets()))), 0..20_u8), 0..40),
    ) {
        let mut dialogue = Dialogue::<N>::new(transport, requirements);
        prop_assert!(dialogue.is_valid());
        for (greets, message, answer, leaves) in turns {
            if greets {
                let _ = dialogue.hello();
            }
            if let Some(message) = message {
                client::message_is_right(&dialogue, message);
                let _ = dialogue.receive(message);
            }
            if let Some((mode, targets)) = answer {
                client::answer_is_right(&dialogue, mode, &targets);
                let _ = dialogue.answer(mode, &targets);
            }
            if leaves == 0 {
                client::goodbye_is_right(&dialogue, Mode::Submit, &[Offsets::ZERO; N]);
                let _ = dialogue.goodbye();
            }
        }
    }

    #[test]
    fn one_sample_is_flagged_exactly(
        limits in limits(i32::MAX),
        (earlier, value, next) in (count(40), count(40), count(40)),
        (first, known) in (prop::bool::weighted(0.1), any::<bool>()),
        near in 0..4_u8,
        steps in prop_oneof![0..4_u64, any::<u64>()],
        motion in motion(),
    ) {
        let before = Trace {
            value: value.into(),
            change: known.then_some(i64::from(value) - i64::from(earlier)),
        };
        let next = match near {
            0 => next,
            1 => value.saturating_add(next % 4),
            2 => ramped(value, limits.ramp()),
            _ => ramped(value, limits.ramp()).saturating_add(next % 2),
        };
        monitor::sample_is_flagged_exactly((!first).then_some(before), next, steps, motion, &limits);
    }

    #[test]
    fn one_state_is_flagged_exactly((limits, first, second) in two_states()) {
        monitor::state_is_flagged_exactly(&limits, &first, &second);
    }

    #[test]
    fn accepted_references_are_bounded(
        limits in uniform2(axis_limits(i32::MAX)),
        first in references(),
        second in references(),
    ) {
        let travel = [Travel::around_zero(50); N];
        let (first, second) = ((&first.0, &first.1), (&second.0, &second.1));
        monitor::accepted_references_are_bounded(&limits, &travel, first, second);
    }

    #[test]
    fn a_session_raises_no_alarm(config in config(), ticks in vec((tick_of_session(), prop::bool::weighted(0.1)), 1..60)) {
        let start = Start::at_rest([PositionNm(0); N]);
        let mut session = Session::new(config, &start).unwrap();
        for ((tick, mut accepted), refused) in ticks {
            let discrete = session.parts().discrete;
            if let Some((sequence, _)) = &mut accepted.fsm.command {
                *sequence = Sequence(discrete.accepted.0 + 1);
            }
            if let Some((_, epoch)) = &mut accepted.fsm.hello {
                *epoch = Epoch(discrete.epoch.0 + 1);
            }
            monitor::session_raises_no_alarm(&session, &tick, refused, accepted);
            let _ = session.step(&tick, refused, &accepted, &Diagnostics::default());
        }
    }

    #[test]
    fn lost_samples_raise_no_alarm(
        limits in limits(40),
        samples in vec((-40..=40_i32, motion(), any::<bool>()), 0..60),
    ) {
        monitor::gaps_raise_no_alarm(&limits, &samples);
    }
}
