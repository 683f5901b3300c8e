//! A monitor beside a real session: no alarm on anything that the session does, and an alarm by name on everything that it must not do.

use std::string::ToString;
use std::vec::Vec as StdVec;

use proptest::prelude::*;

use super::*;
use crate::control::axis::Offsets;
use crate::control::channel::tests::limits;
use crate::control::message::{AxisState, Capabilities, Cause, ClientMessage, Command, Counters, Hello, Mode};
use crate::control::session::config::{AxisConfig, Config, Parameters};
use crate::control::session::{Connection, Event, Input, LastWrite, Output, Session, Start};
use crate::units::{EpochRange, OffsetNm, TorquePermille, VelocityUmS};

const OWNER: Connection = Connection(1);

/// Two axes with different limits; the ramp is long enough to be seen.
fn config() -> Config<2> {
    let axis = |scale: i32| {
        let limits = AxisLimits {
            position: limits(3_000 * scale, 500 * scale, 700 * scale, 90 * scale),
            velocity: limits(900 * scale, 200 * scale, 230 * scale, 30 * scale),
            torque: limits(90 * scale, 20 * scale, 23 * scale, 3 * scale),
        };
        let travel = Travel::around_zero(10_000);
        let axis = AxisConfig::position_only(limits.position, travel, 40_000);
        AxisConfig { limits, ..axis }
    };
    Config::new(Parameters::thesis([axis(1), axis(2)])).unwrap()
}

fn travel() -> [Travel; 2] {
    config().parameters().axes.map(|axis| axis.machine_travel)
}

fn monitor() -> Monitor<2> {
    let mut monitor = Monitor::new(config().parameters().axes.map(|axis| axis.limits), Some(travel()));
    monitor.rebase(&[InForce::at(PositionNm(0)); 2]).unwrap();
    monitor
}

/// One tick of a play.
#[derive(Clone, Debug)]
enum Move {
    Hello,
    Answer(Mode, [[i8; 3]; 2]),
    Silence,
    Late(u32),
    Goodbye,
    Stop,
    Rearm,
    /// Percent of each limit in force, nominal position.
    Refused([[i8; 3]; 2], i64),
    Unknown,
}

fn moves() -> impl Strategy<Value = (Move, i64)> {
    let share = || proptest::array::uniform2(proptest::array::uniform3(-100..=100_i8));
    let mode = prop_oneof![1 => Just(Mode::Submit), 6 => Just(Mode::Obtain)];
    let one = prop_oneof![
        8 => Just(Move::Hello),
        60 => (mode, share()).prop_map(|(mode, shares)| Move::Answer(mode, shares)),
        4 => Just(Move::Silence),
        2 => (0..4_u32).prop_map(Move::Late),
        1 => Just(Move::Goodbye),
        1 => Just(Move::Stop),
        6 => Just(Move::Rearm),
        1 => (share(), -9_000..9_000_i64).prop_map(|(shares, nominal)| Move::Refused(shares, nominal)),
        1 => Just(Move::Unknown),
    ];
    // Now and then the nominal reference leaves its travel, and the machine travel clamps.
    let nominal = prop_oneof![6 => Just(0), 6 => -9_000..9_000_i64, 1 => 9_000..18_000_i64];
    (one, nominal)
}

fn offsets(shares: [[i8; 3]; 2]) -> [Offsets; 2] {
    let mut limits = config().parameters().axes.map(|axis| axis.limits).into_iter();
    shares.map(|[position, velocity, torque]| {
        let limits = limits.next().unwrap();
        let part = |max: i32, share: i8| max * i32::from(share) / 100;
        Offsets {
            position: OffsetNm(part(limits.position.max(), position)),
            velocity: VelocityUmS(part(limits.velocity.max(), velocity)),
            torque: TorquePermille(part(limits.torque.max(), torque).try_into().unwrap()),
        }
    })
}

/// A session that is played with.
struct Stage {
    session: Session<2>,
    sequence: u64,
    /// Values read back, if the next tick begins with a refused write.
    in_force: Option<[InForce; 2]>,
}

impl Stage {
    fn new() -> Self {
        let start = Start::at_rest([PositionNm(0); 2]);
        Self { session: Session::new(config(), &start).unwrap(), sequence: 0, in_force: None }
    }

    fn play(&mut self, one: &Move, nominal: i64) -> Output<2> {
        let mut input = Input::empty(EpochRange::VOLATILE);
        input.tick.nominal = [PositionNm(nominal), PositionNm(-nominal)];
        self.in_force = None;
        let epoch = self.session.epoch();
        let message = match one {
            Move::Hello => Some(ClientMessage::Hello(Hello { axes: 2, capabilities: Capabilities::NONE })),
            Move::Answer(mode, shares) => Some(self.command(*mode, offsets(*shares))),
            Move::Goodbye => Some(ClientMessage::Goodbye(epoch)),
            Move::Silence => None,
            Move::Late(elapsed) => {
                input.tick.elapsed_cycles = *elapsed;
                Some(self.command(Mode::Obtain, [Offsets::ZERO; 2]))
            }
            Move::Stop => {
                input.tick.stop = true;
                None
            }
            Move::Rearm => {
                input.tick.rearm = true;
                None
            }
            Move::Refused(shares, at) => {
                let in_force = offsets(*shares).map(|offsets| InForce { nominal: PositionNm(*at), offsets });
                input.tick.last_write = LastWrite::Refused { in_force };
                self.in_force = Some(in_force);
                None
            }
            Move::Unknown => {
                input.tick.last_write = LastWrite::Unknown;
                None
            }
        };
        if let Some(message) = message {
            input.events.push((OWNER, Event::Message(message))).unwrap();
        }
        self.session.tick(&input)
    }

    fn command(&mut self, mode: Mode, targets: [Offsets; 2]) -> ClientMessage<2> {
        self.sequence = self.session.parts().discrete.accepted.0 + 1;
        ClientMessage::Command(Command {
            epoch: self.session.epoch(),
            sequence: Sequence(self.sequence),
            echo: self.session.last_tick(),
            mode,
            targets,
        })
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    #[test]
    fn no_alarm_on_a_session(play in proptest::collection::vec((moves(), 0..4_u8), 1..200)) {
        let mut stage = Stage::new();
        let mut every = monitor();
        let mut bus = monitor();
        let limits = config().parameters().axes.map(|axis| axis.limits);
        let mut lossy = Monitor::lossy(limits, Some(travel()));
        for ((one, nominal), fate) in play {
            let output = stage.play(&one, nominal);
            if let Some(in_force) = &stage.in_force {
                for monitor in [&mut every, &mut bus, &mut lossy] {
                    prop_assert_eq!(monitor.rebase(in_force), Ok(()));
                }
            }
            let state = &output.state;
            if output.withheld {
                prop_assert_eq!(every.check_state(state), Ok(()));
            } else {
                prop_assert_eq!(every.check_tick(state, &output.references), Ok(()));
                let nominal = state.axes.map(|axis| axis.nominal);
                prop_assert_eq!(bus.check_references(&nominal, &output.references), Ok(()));
            }
            if fate > 0 {
                prop_assert_eq!(lossy.check_state(state), Ok(()), "{:?}", state);
            }
            if fate == 1 {
                prop_assert_eq!(lossy.check_state(state), Ok(()), "a duplicate");
            }
        }
    }
}

/// A State of both axes at these position offsets.
fn state(tick: u64, phase: Phase, position: i32) -> State<2> {
    let axis = AxisState { offsets: Offsets::position(OffsetNm(position)), ..AxisState::default() };
    State {
        tick: Tick(tick),
        epoch: Epoch(1),
        accepted: Sequence(tick),
        phase,
        cause: Cause::None,
        on_time_of_100: 100,
        arrival_us: 0,
        ramp_ticks_left: 0,
        counters: Counters::default(),
        axes: [axis; 2],
    }
}

fn references(state: &State<2>) -> [Reference; 2] {
    state.axes.map(|axis| Reference {
        position: PositionNm(axis.nominal.0 + i64::from(axis.offsets.position.0)),
        velocity_offset: axis.offsets.velocity,
        torque_offset: axis.offsets.torque,
    })
}

/// Axis 0 in Obtain: 500, 1 000 and 1 500 nm, at full speed.
fn moving() -> Monitor<2> {
    let mut monitor = monitor();
    for tick in 1..=3_u8 {
        let state = state(tick.into(), Phase::Obtain, 500 * i32::from(tick));
        monitor.check_tick(&state, &references(&state)).unwrap();
    }
    monitor
}

fn violation(rule: Rule, limit: i64, found: i64) -> Result<(), Violation> {
    Err(Violation { axis: 0, channel: ChannelKind::Position, rule, limit, found })
}

#[test]
fn each_rule_of_a_state_is_found() {
    let cases: [(State<2>, Result<(), Violation>); 13] = [
        (state(4, Phase::Obtain, 2_000), Ok(())),
        (state(4, Phase::Obtain, 1_300), Ok(())),
        (state(4, Phase::Obtain, 2_001), violation(Rule::Step, 500, 501)),
        (state(4, Phase::Obtain, 1_299), violation(Rule::Accel, 700, -701)),
        (state(4, Phase::Obtain, -3_001), violation(Rule::Max, 3_000, -3_001)),
        (state(4, Phase::SafeDisconnect, 1_500), violation(Rule::Ramp, -90, 0)),
        (state(4, Phase::Fault, 1_411), violation(Rule::Ramp, -90, -89)),
        (state(4, Phase::Fault, 1_409), violation(Rule::Ramp, -90, -91)),
        (state(4, Phase::Submit, 1_500), violation(Rule::Zero, 0, 1_500)),
        (state(4, Phase::Listening, 0), violation(Rule::Step, 500, -1_500)),
        (
            // Not a fresh command: held.
            State { accepted: Sequence(3), ..state(4, Phase::Obtain, 1_500) },
            Ok(()),
        ),
        (State { accepted: Sequence(3), ..state(4, Phase::Obtain, 1_501) }, violation(Rule::Hold, 0, 1)),
        (
            State {
                axes: [AxisState { shadow: Offsets::position(OffsetNm(1)), ..state(4, Phase::Obtain, 1_500).axes[0] };
                    2],
                ..state(4, Phase::Obtain, 1_500)
            },
            violation(Rule::Shadow, 0, 1),
        ),
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
    let ramp = State { axes: [1_410, 1_320].map(|nm| state(0, Phase::Fault, nm).axes[0]), ..state(4, Phase::Fault, 0) };
    assert_eq!(moving().check_state(&ramp), Ok(()), "the tick that enters the phase ramps");
}

#[test]
fn every_channel_of_every_axis_is_seen() {
    for axis in 0..2 {
        for (channel, offsets) in [
            (ChannelKind::Position, Offsets::position(OffsetNm(1))),
            (ChannelKind::Velocity, Offsets { velocity: VelocityUmS(1), ..Offsets::ZERO }),
            (ChannelKind::Torque, Offsets { torque: TorquePermille(-1), ..Offsets::ZERO }),
        ] {
            let mut told = state(1, Phase::Submit, 0);
            told.axes[axis].offsets = offsets;
            let found = monitor().check_state(&told).unwrap_err();
            assert_eq!((found.axis, found.channel, found.rule), (axis, channel, Rule::Zero));
            let mut shadowed = state(1, Phase::Handshake, 0);
            shadowed.axes[axis].shadow = offsets;
            let found = monitor().check_state(&shadowed).unwrap_err();
            assert_eq!((found.axis, found.channel, found.rule), (axis, channel, Rule::Shadow));
            shadowed.phase = Phase::Submit;
            assert_eq!(monitor().check_state(&shadowed), Ok(()));
            // References that are not those of the State.
            let told = state(1, Phase::Submit, 0);
            let mut written = references(&told);
            written[axis].position.0 += i64::from(offsets.position.0);
            written[axis].velocity_offset = offsets.velocity;
            written[axis].torque_offset = offsets.torque;
            let found = monitor().check_tick(&told, &written).unwrap_err();
            assert_eq!((found.axis, found.channel, found.rule), (axis, channel, Rule::Reference));
        }
    }
    let mut shadowed = state(1, Phase::Submit, 0);
    shadowed.axes[1].shadow.torque = TorquePermille(181);
    let found = monitor().check_state(&shadowed).unwrap_err();
    assert_eq!((found.rule, found.limit, found.found), (Rule::Shadow, 180, 181));
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
        assert_eq!(monitor.check_state(&told).err().map(|found| found.rule), rule);
    }
}

#[test]
fn each_rule_of_a_reference_is_found() {
    let nominal = |nm| [PositionNm(nm); 2];
    let check = |monitor: &mut Monitor<2>, nm: i64, position: i64| {
        let mut written = references(&state(0, Phase::Obtain, 0))
            .map(|reference| Reference { position: PositionNm(nm), ..reference });
        written[0].position = PositionNm(position);
        monitor.check_references(&nominal(nm), &written)
    };
    assert_eq!(check(&mut monitor(), 0, 500), Ok(()));
    assert_eq!(check(&mut monitor(), 0, 501), violation(Rule::ReferenceStep, 500, 501));
    // The nominal moves by 300: the reference may move by 800, but its offset by 500.
    assert_eq!(check(&mut monitor(), 300, 801), violation(Rule::ReferenceStep, 800, 801));
    assert_eq!(check(&mut monitor(), -300, 400), violation(Rule::Step, 500, 700));
    assert_eq!(check(&mut monitor(), 0, 3_001), violation(Rule::Max, 3_000, 3_001));
    // The travel ends at 13 000; a nominal beyond it is clamped.
    assert_eq!(check(&mut monitor(), 14_000, 13_000), Ok(()));
    assert_eq!(check(&mut monitor(), 14_000, 13_001), violation(Rule::Travel, 13_000, 13_001));
    assert_eq!(check(&mut monitor(), -14_000, -13_001), violation(Rule::Travel, -13_000, -13_001));
    assert_eq!(check(&mut monitor(), 17_000, 12_999), violation(Rule::Max, 3_000, -4_001));
    assert_eq!(check(&mut monitor(), -17_000, -12_999), violation(Rule::Max, 3_000, 4_001));
    let mut moving = monitor();
    assert_eq!(check(&mut moving, 0, 500), Ok(()));
    assert_eq!(check(&mut moving, 0, 299), violation(Rule::Accel, 700, -701));
    for edit in [
        |written: &mut Reference| written.velocity_offset.0 = 201,
        |written: &mut Reference| written.torque_offset.0 = -21,
    ] {
        let mut written = references(&state(0, Phase::Obtain, 0));
        edit(&mut written[0]);
        let found = monitor().check_references(&nominal(0), &written).unwrap_err();
        assert_eq!(found.rule, Rule::Step);
    }
}

#[test]
fn without_a_travel_nothing_is_clamped() {
    let mut monitor = Monitor::new(config().parameters().axes.map(|axis| axis.limits), None);
    let mut told = state(1, Phase::Submit, 0);
    told.axes[0].nominal = PositionNm(14_000);
    let mut written = references(&told);
    assert_eq!(monitor.check_tick(&told, &written), Ok(()));
    written[0].position = PositionNm(13_000);
    assert!(monitor.check_tick(&told, &written).is_err());
}

#[test]
fn a_monitor_goes_on_after_a_violation() {
    let mut monitor = moving();
    let jump = state(4, Phase::Obtain, 2_900);
    assert_eq!(monitor.check_state(&jump), violation(Rule::Step, 500, 1_400));
    let next = state(5, Phase::Obtain, 2_900);
    assert_eq!(monitor.check_state(&next), violation(Rule::Accel, 700, -1_400));
    assert_eq!(monitor.check_state(&state(6, Phase::Obtain, 2_900)), Ok(()));
}

#[test]
fn values_read_back_are_checked_and_become_the_base() {
    let mut monitor = moving();
    let in_force = |nm| [InForce { nominal: PositionNm(0), offsets: Offsets::position(OffsetNm(nm)) }; 2];
    assert_eq!(monitor.rebase(&in_force(3_001)), violation(Rule::Max, 3_000, 3_001));
    let mut unchanged = monitor;
    let next = state(4, Phase::Obtain, 2_000);
    assert_eq!(unchanged.check_state(&next), Ok(()), "nothing changed");
    assert_eq!(monitor.rebase(&in_force(-1_000)), Ok(()));
    let mut ramp = state(4, Phase::SafeDisconnect, -910);
    ramp.axes[1].offsets.position = OffsetNm(-820);
    assert_eq!(monitor.check_tick(&ramp, &references(&ramp)), Ok(()));
}

#[test]
fn lost_states_widen_the_bounds_and_nothing_else() {
    let lossy = || {
        let limits = config().parameters().axes.map(|axis| axis.limits);
        let mut monitor = Monitor::lossy(limits, Some(travel()));
        for tick in 1..=2_u8 {
            let state = state(tick.into(), Phase::Obtain, 500 * i32::from(tick));
            monitor.check_state(&state).unwrap();
        }
        monitor
    };
    let cases = [
        (state(4, Phase::Obtain, 2_000), Ok(())),
        (state(4, Phase::Obtain, 0), Ok(())),
        (state(4, Phase::Obtain, 2_001), violation(Rule::Step, 1_000, 1_001)),
        (state(3, Phase::Obtain, 1_501), violation(Rule::Step, 500, 501)),
        (state(3, Phase::Obtain, 799), violation(Rule::Accel, 700, -701)),
        (state(9, Phase::Obtain, 3_001), violation(Rule::Max, 3_000, 3_001)),
        (state(9, Phase::Submit, 1_000), violation(Rule::Zero, 0, 1_000)),
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
    assert_eq!(monitor.check_state(&state(3, Phase::Obtain, 799)), violation(Rule::Accel, 700, -701));
}

#[test]
fn violations_say_where_and_how_much() {
    let texts: StdVec<_> =
        [violation(Rule::Step, 500, -501), violation(Rule::Ramp, -90, 0), violation(Rule::Travel, 13_000, 13_001)]
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
