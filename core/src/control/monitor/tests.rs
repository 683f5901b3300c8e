//! A monitor beside a real session: no alarm on anything that the session does, and an alarm by
//! name on everything that it must not do.

use std::format;
use std::string::ToString;
use std::vec::Vec as StdVec;

use proptest::array::{uniform2, uniform3};
use proptest::prelude::*;

use super::*;
use crate::control::axis::Offsets;
use crate::control::fixture::{self, axis, limits};
use crate::control::message::Mode;
use crate::control::session::LastWrite;
use crate::control::session::bench::{Bench, Move, REARM, STOP};
use crate::control::session::config::{AxisConfig, Parameters};
use crate::units::{OffsetNm, TorquePermille, VelocityUmS};

/// Two axes with different limits; the ramp is long enough to be seen.
fn parameters() -> Parameters<2> {
    Parameters::thesis([1, 2].map(|scale| {
        let limits = AxisLimits {
            position: limits(3_000 * scale, 500 * scale, 700 * scale, 90 * scale),
            velocity: limits(900 * scale, 200 * scale, 230 * scale, 30 * scale),
            torque: limits(90 * scale, 20 * scale, 23 * scale, 3 * scale),
        };
        AxisConfig {
            limits,
            ..axis(limits.position, 10_000, 40_000)
        }
    }))
}

fn axis_limits() -> [AxisLimits; 2] {
    parameters().axes.map(|axis| axis.limits)
}

fn travel() -> [Travel; 2] {
    parameters().axes.map(|axis| axis.machine_travel)
}

fn monitor() -> Monitor<2> {
    let mut monitor = Monitor::new(axis_limits(), Some(travel()));
    monitor.rebase(&[InForce::at(PositionNm(0)); 2]).unwrap();
    monitor
}

/// Offsets within the limits.
fn offsets() -> impl Strategy<Value = [Offsets; 2]> {
    uniform2(uniform3(-100..=100_i32)).prop_map(|percents| {
        let mut limits = axis_limits().into_iter();
        percents.map(|[position, velocity, torque]| {
            let limits = limits.next().unwrap();
            Offsets {
                position: OffsetNm(limits.position.max() * position / 100),
                velocity: VelocityUmS(limits.velocity.max() * velocity / 100),
                torque: TorquePermille((limits.torque.max() * torque / 100).try_into().unwrap()),
            }
        })
    })
}

/// A move, and the nominal position at which it happens.
fn moves() -> impl Strategy<Value = (Move, i64)> {
    let mode = prop_oneof![1 => Just(Mode::Submit), 6 => Just(Mode::Obtain)];
    let refused = (offsets(), -9_000..9_000_i64).prop_map(|(offsets, nominal)| {
        let in_force = offsets.map(|offsets| InForce {
            nominal: PositionNm(nominal),
            offsets,
        });
        Move::Written(LastWrite::Refused { in_force })
    });
    let one = prop_oneof![
        8 => Just(Move::Hello),
        60 => (mode, offsets()).prop_map(|(mode, targets)| Move::Answer(mode, targets)),
        4 => Just(Move::Silence),
        2 => (0..4_u32).prop_map(|cycles| Move::Late(cycles, [Offsets::ZERO; 2])),
        1 => Just(Move::Goodbye),
        1 => Just(STOP),
        6 => Just(REARM),
        1 => refused,
        1 => Just(Move::Written(LastWrite::Unknown)),
    ];
    // Now and then the nominal reference leaves its travel, and the machine travel clamps.
    let nominal = prop_oneof![6 => Just(0), 6 => -9_000..9_000_i64, 1 => 9_000..18_000_i64];
    (one, nominal)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    #[test]
    fn no_alarm_on_a_session(play in proptest::collection::vec((moves(), 0..4_usize), 1..200)) {
        // The bench has a monitor that receives every State and every reference.
        let mut bench = Bench::new(parameters());
        let mut bus = monitor();
        let mut lossy = Monitor::lossy(axis_limits(), Some(travel()));
        for ((one, nominal), fate) in play {
            let output = bench.play_at(&one, [PositionNm(nominal), PositionNm(-nominal)]);
            if let Move::Written(LastWrite::Refused { in_force }) = &one {
                prop_assert_eq!(bus.rebase(in_force), Ok(()));
                prop_assert_eq!(lossy.rebase(in_force), Ok(()));
            }
            let state = &output.state;
            if !output.withheld {
                let nominal = state.axes.map(|axis| axis.nominal);
                prop_assert_eq!(bus.check_references(&nominal, &output.references), Ok(()));
            }
            // Lost, doubled, or in order.
            for _ in 0..[0, 2, 1, 1][fate] {
                prop_assert_eq!(lossy.check_state(state), Ok(()), "{:?}", state);
            }
        }
    }
}

/// A State of both axes at these position offsets.
fn state(tick: u64, phase: Phase, position: i32) -> State<2> {
    fixture::state(Epoch(1), tick, phase, position)
}

fn references(state: &State<2>) -> [Reference; 2] {
    state.axes.map(|axis| Reference {
        position: PositionNm(axis.nominal.0 + i64::from(axis.offsets.position.0)),
        velocity_offset: axis.offsets.velocity,
        torque_offset: axis.offsets.torque,
    })
}

/// Both axes in Obtain, 500 nm further per tick: full speed for the first.
fn moved(mut monitor: Monitor<2>, ticks: u8) -> Monitor<2> {
    for tick in 1..=ticks {
        let state = state(tick.into(), Phase::Obtain, 500 * i32::from(tick));
        monitor.check_tick(&state, &references(&state)).unwrap();
    }
    monitor
}

/// A monitor that has seen 500, 1 000 and 1 500 nm.
fn moving() -> Monitor<2> {
    moved(monitor(), 3)
}

fn violation(rule: Rule, limit: i64, found: i64) -> Result<(), Violation> {
    Err(Violation {
        axis: 0,
        channel: ChannelKind::Position,
        rule,
        limit,
        found,
    })
}

/// State that has accepted no new Command.
fn unanswered(position: i32) -> State<2> {
    State {
        accepted: Sequence(3),
        ..state(4, Phase::Obtain, position)
    }
}

#[test]
fn each_rule_of_a_state_is_found() {
    let mut shadowed = state(4, Phase::Obtain, 1_500);
    shadowed.axes[0].shadow.position = OffsetNm(1);
    let cases = [
        (state(4, Phase::Obtain, 2_000), Ok(())),
        (state(4, Phase::Obtain, 1_300), Ok(())),
        (
            state(4, Phase::Obtain, 2_001),
            violation(Rule::Step, 500, 501),
        ),
        (
            state(4, Phase::Obtain, 1_299),
            violation(Rule::Accel, 700, -701),
        ),
        (
            state(4, Phase::Obtain, -3_001),
            violation(Rule::Max, 3_000, -3_001),
        ),
        (
            state(4, Phase::SafeDisconnect, 1_500),
            violation(Rule::Ramp, -90, 0),
        ),
        (
            state(4, Phase::Fault, 1_411),
            violation(Rule::Ramp, -90, -89),
        ),
        (
            state(4, Phase::Fault, 1_409),
            violation(Rule::Ramp, -90, -91),
        ),
        (
            state(4, Phase::Submit, 1_500),
            violation(Rule::Zero, 0, 1_500),
        ),
        (
            state(4, Phase::Listening, 0),
            violation(Rule::Step, 500, -1_500),
        ),
        (unanswered(1_500), Ok(())),
        (unanswered(1_501), violation(Rule::Hold, 0, 1)),
        (shadowed, violation(Rule::Shadow, 0, 1)),
    ];
    for (state, expected) in cases {
        let mut monitor = moving();
        // The second axis has twice the limits: its ramp is another one.
        let mut state = state;
        if matches!(state.phase, Phase::SafeDisconnect | Phase::Fault) {
            state.axes[1].offsets.position = OffsetNm(1_320);
        }
        assert_eq!(monitor.check_state(&state), expected, "{state:?}");
    }
    let ramp = State {
        axes: [1_410, 1_320].map(|nm| state(0, Phase::Fault, nm).axes[0]),
        ..state(4, Phase::Fault, 0)
    };
    assert_eq!(
        moving().check_state(&ramp),
        Ok(()),
        "the tick that enters the phase ramps"
    );
}

#[test]
fn every_channel_of_every_axis_is_seen() {
    for axis in 0..2 {
        for (channel, offsets) in [
            (ChannelKind::Position, Offsets::position(OffsetNm(1))),
            (
                ChannelKind::Velocity,
                Offsets {
                    velocity: VelocityUmS(1),
                    ..Offsets::ZERO
                },
            ),
            (
                ChannelKind::Torque,
                Offsets {
                    torque: TorquePermille(-1),
                    ..Offsets::ZERO
                },
            ),
        ] {
            let mut told = state(1, Phase::Submit, 0);
            told.axes[axis].offsets = offsets;
            let found = monitor().check_state(&told).unwrap_err();
            assert_eq!(
                (found.axis, found.channel, found.rule),
                (axis, channel, Rule::Zero)
            );
            let mut shadowed = state(1, Phase::Handshake, 0);
            shadowed.axes[axis].shadow = offsets;
            let found = monitor().check_state(&shadowed).unwrap_err();
            assert_eq!(
                (found.axis, found.channel, found.rule),
                (axis, channel, Rule::Shadow)
            );
            shadowed.phase = Phase::Submit;
            assert_eq!(monitor().check_state(&shadowed), Ok(()));
            // References that are not those of the State.
            let told = state(1, Phase::Submit, 0);
            let mut written = references(&told);
            written[axis].position.0 += i64::from(offsets.position.0);
            written[axis].velocity_offset = offsets.velocity;
            written[axis].torque_offset = offsets.torque;
            let found = monitor().check_tick(&told, &written).unwrap_err();
            assert_eq!(
                (found.axis, found.channel, found.rule),
                (axis, channel, Rule::Reference)
            );
        }
    }
    let mut shadowed = state(1, Phase::Submit, 0);
    shadowed.axes[1].shadow.torque = TorquePermille(181);
    let found = monitor().check_state(&shadowed).unwrap_err();
    assert_eq!(
        (found.rule, found.limit, found.found),
        (Rule::Shadow, 180, 181)
    );
}

#[test]
fn velocity_and_torque_ramp_over_a_miss() {
    for (change, rule) in [(-30, None), (0, Some(Rule::Ramp)), (-31, Some(Rule::Ramp))] {
        let mut monitor = monitor();
        let mut told = state(1, Phase::Obtain, 0);
        told.axes[0].offsets.velocity = VelocityUmS(100);
        monitor.check_state(&told).unwrap();
        told.tick = Tick(2);
        told.axes[0].offsets.velocity.0 += change;
        assert_eq!(
            monitor.check_state(&told).err().map(|found| found.rule),
            rule
        );
    }
}

/// Checks a reference of the first axis, with the nominal of both axes at `nm`.
fn check(monitor: &mut Monitor<2>, nm: i64, position: i64) -> Result<(), Violation> {
    let mut written = references(&state(0, Phase::Obtain, 0)).map(|reference| Reference {
        position: PositionNm(nm),
        ..reference
    });
    written[0].position = PositionNm(position);
    monitor.check_references(&[PositionNm(nm); 2], &written)
}

#[test]
fn each_rule_of_a_reference_is_found() {
    assert_eq!(check(&mut monitor(), 0, 500), Ok(()));
    assert_eq!(
        check(&mut monitor(), 0, 501),
        violation(Rule::ReferenceStep, 500, 501)
    );
    // The nominal moves by 300: the reference may move by 800, but its offset by 500.
    assert_eq!(
        check(&mut monitor(), 300, 801),
        violation(Rule::ReferenceStep, 800, 801)
    );
    assert_eq!(
        check(&mut monitor(), -300, 400),
        violation(Rule::Step, 500, 700)
    );
    assert_eq!(
        check(&mut monitor(), 0, 3_001),
        violation(Rule::Max, 3_000, 3_001)
    );
    // The travel ends at 13 000; a nominal beyond it is clamped.
    assert_eq!(check(&mut monitor(), 14_000, 13_000), Ok(()));
    assert_eq!(
        check(&mut monitor(), 14_000, 13_001),
        violation(Rule::Travel, 13_000, 13_001)
    );
    assert_eq!(
        check(&mut monitor(), -14_000, -13_001),
        violation(Rule::Travel, -13_000, -13_001)
    );
    assert_eq!(
        check(&mut monitor(), 17_000, 12_999),
        violation(Rule::Max, 3_000, -4_001)
    );
    assert_eq!(
        check(&mut monitor(), -17_000, -12_999),
        violation(Rule::Max, 3_000, 4_001)
    );
    let mut moving = monitor();
    assert_eq!(check(&mut moving, 0, 500), Ok(()));
    assert_eq!(
        check(&mut moving, 0, 299),
        violation(Rule::Accel, 700, -701)
    );
    for edit in [
        |written: &mut Reference| written.velocity_offset.0 = 201,
        |written: &mut Reference| written.torque_offset.0 = -21,
    ] {
        let mut written = references(&state(0, Phase::Obtain, 0));
        edit(&mut written[0]);
        let found = monitor()
            .check_references(&[PositionNm(0); 2], &written)
            .unwrap_err();
        assert_eq!(found.rule, Rule::Step);
    }
}

#[test]
fn without_a_travel_nothing_is_clamped() {
    let mut monitor = Monitor::new(axis_limits(), None);
    let mut told = state(1, Phase::Submit, 0);
    told.axes[0].nominal = PositionNm(14_000);
    let mut written = references(&told);
    assert_eq!(monitor.check_tick(&told, &written), Ok(()));
    written[0].position = PositionNm(13_000);
    assert!(monitor.check_tick(&told, &written).is_err());
}

/// A distance of up to 65 bits is reported as the nearest number of 64.
#[test]
fn the_furthest_references_are_reported_as_far_as_they_go() {
    for (nominal, position, reported) in [
        (i64::MIN, i64::MAX - 1, i64::MAX),
        (i64::MAX, i64::MIN + 1, i64::MIN),
        (0, i64::MIN + 1, i64::MIN + 1),
    ] {
        let mut told = state(1, Phase::Submit, 0);
        told.axes[0].nominal = PositionNm(nominal);
        let mut written = references(&told);
        written[0].position = PositionNm(position);
        let found = Monitor::new(axis_limits(), None).check_tick(&told, &written);
        assert_eq!(found, violation(Rule::Max, 3_000, reported));
    }
}

/// Only lost States widen the bounds: a server that was late takes one step all the same.
#[test]
fn a_late_server_takes_one_step() {
    assert_eq!(
        moving().check_state(&state(5, Phase::Obtain, 2_001)),
        violation(Rule::Step, 500, 501)
    );
}

#[test]
fn a_monitor_goes_on_after_a_violation() {
    let mut monitor = moving();
    let jump = state(4, Phase::Obtain, 2_900);
    assert_eq!(
        monitor.check_state(&jump),
        violation(Rule::Step, 500, 1_400)
    );
    let next = state(5, Phase::Obtain, 2_900);
    assert_eq!(
        monitor.check_state(&next),
        violation(Rule::Accel, 700, -1_400)
    );
    assert_eq!(monitor.check_state(&state(6, Phase::Obtain, 2_900)), Ok(()));
}

fn in_force(nm: i32) -> [InForce; 2] {
    [InForce {
        nominal: PositionNm(0),
        offsets: Offsets::position(OffsetNm(nm)),
    }; 2]
}

#[test]
fn values_read_back_are_checked_and_become_the_base() {
    let mut monitor = moving();
    assert_eq!(
        monitor.rebase(&in_force(3_001)),
        violation(Rule::Max, 3_000, 3_001)
    );
    let mut unchanged = monitor;
    let next = state(4, Phase::Obtain, 2_000);
    assert_eq!(unchanged.check_state(&next), Ok(()), "nothing changed");
    assert_eq!(monitor.rebase(&in_force(-1_000)), Ok(()));
    let mut ramp = state(4, Phase::SafeDisconnect, -910);
    ramp.axes[1].offsets.position = OffsetNm(-820);
    assert_eq!(monitor.check_tick(&ramp, &references(&ramp)), Ok(()));
}

/// As [`moving`], over a lossy link.
fn lossy() -> Monitor<2> {
    moved(Monitor::lossy(axis_limits(), Some(travel())), 2)
}

#[test]
fn lost_states_widen_the_bounds_and_nothing_else() {
    let cases = [
        (state(4, Phase::Obtain, 2_000), Ok(())),
        (state(4, Phase::Obtain, 0), Ok(())),
        (
            state(4, Phase::Obtain, 2_001),
            violation(Rule::Step, 1_000, 1_001),
        ),
        (
            state(3, Phase::Obtain, 1_501),
            violation(Rule::Step, 500, 501),
        ),
        (
            state(3, Phase::Obtain, 799),
            violation(Rule::Accel, 700, -701),
        ),
        (
            state(9, Phase::Obtain, 3_001),
            violation(Rule::Max, 3_000, 3_001),
        ),
        (
            state(9, Phase::Submit, 1_000),
            violation(Rule::Zero, 0, 1_000),
        ),
        (state(2, Phase::Obtain, 1_000), Ok(())),
        (state(2, Phase::Obtain, 1_001), violation(Rule::Step, 0, 1)),
        (state(1, Phase::Obtain, 500), violation(Rule::Step, 0, -500)),
    ];
    for (state, expected) in cases {
        assert_eq!(lossy().check_state(&state), expected, "{state:?}");
    }
    // After a gap the change is unknown, after a duplicate it is not.
    let mut monitor = lossy();
    assert_eq!(monitor.check_state(&state(4, Phase::Obtain, 2_000)), Ok(()));
    assert_eq!(monitor.check_state(&state(5, Phase::Obtain, 1_500)), Ok(()));
    let mut monitor = lossy();
    assert_eq!(monitor.check_state(&state(2, Phase::Obtain, 1_000)), Ok(()));
    assert_eq!(
        monitor.check_state(&state(3, Phase::Obtain, 799)),
        violation(Rule::Accel, 700, -701)
    );
}

#[test]
fn violations_say_where_and_how_much() {
    let texts: StdVec<_> = [
        violation(Rule::Step, 500, -501),
        violation(Rule::Ramp, -90, 0),
        violation(Rule::Travel, 13_000, 13_001),
    ]
    .map(|found| found.unwrap_err().to_string())
    .into();
    assert_eq!(
        texts,
        [
            "axis 0, position: offset changed by -501 nm; expected at most 500 nm",
            "axis 0, position: offset changed on its ramp by 0 nm; expected exactly -90 nm",
            "axis 0, position: reference is 13001 nm; expected inside the travel, which ends at 13000 nm",
        ]
    );
}

#[test]
fn a_violation_names_axis_channel_rule_and_both_numbers() {
    let cases = [
        (
            ChannelKind::Position,
            Rule::Max,
            "position: offset is -9 nm; expected at most 8 nm",
        ),
        (
            ChannelKind::Velocity,
            Rule::Step,
            "velocity: offset changed by -9 um/s; expected at most 8 um/s",
        ),
        (
            ChannelKind::Torque,
            Rule::Accel,
            "torque: change of the offset changed by -9 per mille; expected at most 8 per mille",
        ),
        (
            ChannelKind::Position,
            Rule::Ramp,
            "position: offset changed on its ramp by -9 nm; expected exactly 8 nm",
        ),
        (
            ChannelKind::Position,
            Rule::Hold,
            "position: held offset changed by -9 nm; expected exactly 8 nm",
        ),
        (
            ChannelKind::Position,
            Rule::Zero,
            "position: offset before Obtain is -9 nm; expected exactly 8 nm",
        ),
        (
            ChannelKind::Position,
            Rule::Shadow,
            "position: shadow is -9 nm; expected at most 8 nm",
        ),
        (
            ChannelKind::Position,
            Rule::Reference,
            "position: reference is -9 nm; expected exactly 8 nm",
        ),
        (
            ChannelKind::Position,
            Rule::Travel,
            "position: reference is -9 nm; expected inside the travel, which ends at 8 nm",
        ),
        (
            ChannelKind::Position,
            Rule::ReferenceStep,
            "position: reference changed by -9 nm; expected at most 8 nm",
        ),
    ];
    for (channel, rule, text) in cases {
        let violation = Violation {
            axis: 2,
            channel,
            rule,
            limit: 8,
            found: -9,
        };
        assert_eq!(violation.to_string(), format!("axis 2, {text}"));
    }
}
