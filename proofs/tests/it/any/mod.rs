//! Strategies: any value of a type, small and huge alike.

use std::num::NonZeroU32;

use gantry_tau_core::control::agitation::{Agitation, AgitationBudget};
use gantry_tau_core::control::axis::{Actual, InForce, Offsets, Reference};
use gantry_tau_core::control::channel::{Channel, LimitValues, Limits};
use gantry_tau_core::control::message::{
    AxisFlags, AxisLimits, Capabilities, Cause, ClientMessage, Command, Counters, Hello, Mode,
    Phase,
};
use gantry_tau_core::control::session::config::{
    AxisConfig, Config, MissBudget, NominalAccel, Parameters, Travel,
};
use gantry_tau_core::control::session::{
    Connection, Event, LastWrite, Reading, Session, TickInput,
};
use gantry_tau_core::control::wire::{ContentError, FrameError};
use gantry_tau_core::units::{
    ChannelUnit, Epoch, EpochRange, ForceMn, MomentUnm, OffsetNm, PositionNm, Sequence, Tick,
    TorquePermille, VelocityUmS, WrenchSample,
};
use gantry_tau_core::verification::control::{
    Action, Axis, AxisChannels, AxisCommand, FsmInput, FsmState, Internals, Order, Parts, Rules,
};
use gantry_tau_proofs::properties::drive::Fate;
use gantry_tau_proofs::properties::endpoint::Told;
use proptest::array::{uniform, uniform4};
use proptest::option;
use proptest::prelude::*;
use proptest::sample::select;

/// Small numbers, where things happen, and all others.
pub(crate) fn number() -> impl Strategy<Value = u64> {
    prop_oneof![3 => 0..5_u64, 1 => any::<u64>(), 1 => Just(u64::MAX)]
}

/// Limits from M, S, A and rho.
pub(crate) fn checked<U>(max: i32, step: i32, accel: i32, ramp: i32) -> Limits<U> {
    Limits::new(LimitValues {
        max,
        step,
        accel,
        ramp,
    })
    .unwrap()
}

pub(crate) fn limits<U: std::fmt::Debug>() -> impl Strategy<Value = Limits<U>> {
    limits_up_to(i32::MAX)
}

fn limits_up_to<U: std::fmt::Debug>(most: i32) -> impl Strategy<Value = Limits<U>> {
    limits_of(
        prop_oneof![0..1_000_i32, any::<i32>().prop_map(i32::saturating_abs)],
        most,
    )
}

/// Limits that validation accepts, made of four numbers, with `M` of at most `most`.
pub(crate) fn limits_of<U: std::fmt::Debug>(
    number: impl Strategy<Value = i32>,
    most: i32,
) -> impl Strategy<Value = Limits<U>> {
    uniform4(number).prop_map(move |[m, a, b, c]| {
        let ramp = (a / 4).max(1);
        let step = ramp.saturating_add(b / 4);
        let accel = step.saturating_add(ramp).saturating_add(c / 4);
        checked(m.min(most), step, accel, ramp)
    })
}

/// Any channel that is valid under the limits.
pub(crate) fn channel<U: ChannelUnit + std::fmt::Debug>(
    limits: Limits<U>,
) -> impl Strategy<Value = Channel<U>> {
    let (max, step) = (limits.max(), limits.step());
    (-max..=max, -step..=step).prop_map(move |(value, change)| {
        Channel::from_parts(U::saturating_from(value), change, &limits).unwrap()
    })
}

prop_compose! {
    pub(crate) fn axis_limits()(
        position in limits(), velocity in limits(), torque in limits_up_to(i16::MAX.into()),
    ) -> AxisLimits {
        AxisLimits { position, velocity, torque }
    }
}

prop_compose! {
    pub(crate) fn axis_channels(limits: AxisLimits)(
        position in channel(limits.position), velocity in channel(limits.velocity), torque in channel(limits.torque),
    ) -> AxisChannels {
        AxisChannels { position, velocity, torque }
    }
}

/// An axis with these limits.
pub(crate) fn axis_of(limits: AxisLimits, reach: u32, nominal_step_nm: u32) -> AxisConfig {
    AxisConfig {
        limits,
        ..AxisConfig::position_only(limits.position, Travel::around_zero(reach), nominal_step_nm)
    }
}

prop_compose! {
    pub(crate) fn axis_config()(
        limits in axis_limits(), reach in prop_oneof![0..1_000_000_u32, any::<u32>()], step in 0..5_000_u32,
        nominal_accel in option::of(nominal_accel()), agitation in option::of(agitation_budget()),
    ) -> AxisConfig {
        AxisConfig { nominal_accel, agitation, ..axis_of(limits, reach, step) }
    }
}

pub(crate) fn nominal_accel() -> impl Strategy<Value = NominalAccel> {
    let nm = prop_oneof![1..5_000_u32, 1..=u32::MAX];
    (nm, any::<bool>()).prop_map(|(nm, is_fault)| NominalAccel {
        nm: NonZeroU32::new(nm).unwrap(),
        is_fault,
    })
}

pub(crate) fn agitation_budget() -> impl Strategy<Value = AgitationBudget> {
    let rate = prop_oneof![1..200_u32, 1..=AgitationBudget::MAX_NM_PER_TICK];
    rate.prop_map(|nm_per_tick| AgitationBudget::new(nm_per_tick).unwrap())
}

/// Sums about the limits of the budgets, and all others.
pub(crate) fn agitation() -> impl Strategy<Value = Agitation> {
    prop_oneof![Just(0), 0..200_000_u32, any::<u32>()].prop_map(Agitation)
}

pub(crate) fn budget() -> impl Strategy<Value = Option<MissBudget>> {
    option::of((1..=128_u8, 0..20_u8).prop_map(|(window, allowed)| MissBudget { window, allowed }))
}

pub(crate) fn config<const N: usize>() -> impl Strategy<Value = Config<N>> {
    let axes = uniform::<_, N>(axis_config());
    (axes, budget(), 0..3_u8, 1..20_u32).prop_map(|(axes, budget, echo_window, handshake_ticks)| {
        let parameters = Parameters {
            budget,
            echo_window,
            handshake_ticks,
            ..Parameters::thesis(axes)
        };
        Config::new(parameters).unwrap()
    })
}

prop_compose! {
    pub(crate) fn rules()(handshake_ticks in 1..20_u32, budget in budget()) -> Rules {
        Rules { handshake_ticks, budget }
    }
}

pub(crate) fn connection() -> impl Strategy<Value = Connection> {
    prop_oneof![4 => 0..3_u64, 1 => any::<u64>()].prop_map(Connection)
}

prop_compose! {
    /// Any valid discrete state; fields that the phase excludes are corrected.
    pub(crate) fn discrete(handshake_ticks: u32)(
        phase in select(Phase::ALL), connection in connection(), owned: bool, epoch in number(), accepted in number(),
        tick in number(), history: u128, waited in 0..handshake_ticks, released: bool, latched: bool,
    ) -> FsmState {
        let running = matches!(phase, Phase::Submit | Phase::Obtain);
        let live = running || phase == Phase::Handshake;
        let owned = (owned || live) && phase != Phase::Listening;
        let history = if phase == Phase::Handshake { 0 } else { history };
        FsmState {
            phase,
            owner: owned.then_some(connection),
            epoch: Epoch(epoch),
            accepted: Sequence(accepted),
            tick: Tick(tick),
            misses: u8::from(running && history & 1 == 1),
            history,
            waited: if phase == Phase::Handshake { waited } else { 0 },
            rearm_released: released && phase == Phase::Fault,
            latched: latched && phase == Phase::Fault,
        }
    }
}

pub(crate) fn mode() -> impl Strategy<Value = Mode> {
    select(Mode::ALL)
}

/// Rare, or a miss would never be seen.
fn rare() -> impl Strategy<Value = bool> {
    prop::bool::weighted(0.1)
}

prop_compose! {
    pub(crate) fn fsm()(
        stop in rare(), nominal_fault in rare(), framing in rare(), flood in rare(), closed in rare(), goodbye in rare(),
        command in option::of((number().prop_map(Sequence), mode())),
        hello in option::of((connection(), number().prop_map(Epoch))),
        skipped in prop_oneof![6 => Just(0), 1 => 1..3_u32, 1 => any::<u32>()],
        (rearm, all_zero) in any::<(bool, bool)>(), quit in rare(), agitated in rare(),
    ) -> FsmInput {
        FsmInput { stop, quit, rearm, nominal_fault, framing, flood, closed, goodbye, agitated, command, hello, skipped, all_zero }
    }
}

pub(crate) fn offsets() -> impl Strategy<Value = Offsets> {
    let small = (-9_000..9_000_i32, -900..900_i32, -90..90_i16);
    let any = (any::<i32>(), any::<i32>(), any::<i16>());
    prop_oneof![small, any].prop_map(|(position, velocity, torque)| Offsets {
        position: OffsetNm(position),
        velocity: VelocityUmS(velocity),
        torque: TorquePermille(torque),
    })
}

pub(crate) fn command<const N: usize>() -> impl Strategy<Value = Command<N>> {
    let targets = uniform::<_, N>(offsets());
    (number(), number(), number(), mode(), targets).prop_map(
        |(epoch, sequence, echo, mode, targets)| Command {
            epoch: Epoch(epoch),
            sequence: Sequence(sequence),
            echo: Tick(echo),
            mode,
            targets,
        },
    )
}

pub(crate) fn event<const N: usize>() -> impl Strategy<Value = Event<N>> {
    let hello = (any::<u8>(), any::<u16>()).prop_map(|(axes, bits)| Hello {
        axes: if axes < 200 { 3 } else { axes },
        capabilities: Capabilities(bits),
    });
    prop_oneof![
        6 => command().prop_map(|command| Event::Message(ClientMessage::Command(command))),
        2 => hello.prop_map(|hello| Event::Message(ClientMessage::Hello(hello))),
        1 => number().prop_map(|epoch| Event::Message(ClientMessage::Goodbye(Epoch(epoch)))),
        1 => number().prop_map(|epoch| Event::Message(ClientMessage::Stop(Epoch(epoch)))),
        1 => Just(Event::Malformed(ContentError::Reserved)),
        1 => Just(Event::Dropped(FrameError::Checksum)),
        1 => Just(Event::Broken(FrameError::Magic)),
        1 => Just(Event::Flood),
        1 => Just(Event::Closed),
    ]
}

/// Any sum under a budget, and none without.
fn agitation_of(config: &AxisConfig) -> impl Strategy<Value = Agitation> + use<> {
    let counts = config.agitation.is_some();
    agitation().prop_map(move |sum| if counts { sum } else { Agitation::ZERO })
}

/// An axis whose channels and shadow are within their limits.
fn axis_within(
    config: AxisConfig,
    nominal: impl Strategy<Value = i64>,
) -> impl Strategy<Value = Axis> {
    (
        axis_channels(config.limits),
        axis_channels(config.limits),
        nominal.prop_map(PositionNm),
        prop_oneof![8 => -2_000..2_000_i64, 1 => any::<i64>()].prop_map(PositionNm),
        actual(),
        agitation_of(&config),
    )
        .prop_map(
            |(channels, shadow, nominal, nominal_before, actual, agitation)| Axis {
                channels,
                shadow,
                nominal,
                nominal_before,
                actual,
                agitation,
            },
        )
}

prop_compose! {
    fn actual()(position: i64, velocity: i32, torque: i16) -> Actual {
        Actual { position: PositionNm(position), velocity: VelocityUmS(velocity), torque: TorquePermille(torque) }
    }
}

/// A session in any valid state.
pub(crate) fn session<const N: usize>() -> impl Strategy<Value = Session<N>> {
    config::<N>().prop_flat_map(|config| {
        let discrete = discrete(config.parameters().handshake_ticks);
        let axes = config
            .parameters()
            .axes
            .map(|axis| axis_within(axis, -2_000..2_000_i64));
        let flags = (
            any::<bool>(),
            prop::bool::weighted(0.2),
            prop::bool::weighted(0.3),
            prop::bool::weighted(0.8),
        );
        (discrete, axes, uniform(in_force()), flags).prop_map(
            move |(discrete, axes, in_force, (late, withheld, off_path, paced))| {
                let resting = matches!(
                    discrete.phase,
                    Phase::Listening | Phase::Handshake | Phase::Submit
                );
                let parts = Parts {
                    discrete,
                    axes: axes.map(|axis| Axis {
                        channels: if resting {
                            AxisChannels::ZERO
                        } else {
                            axis.channels
                        },
                        shadow: if discrete.phase == Phase::Submit {
                            axis.shadow
                        } else {
                            AxisChannels::ZERO
                        },
                        agitation: if discrete.phase == Phase::Obtain {
                            axis.agitation
                        } else {
                            Agitation::ZERO
                        },
                        ..axis
                    }),
                    withheld: withheld
                        && matches!(discrete.phase, Phase::SafeDisconnect | Phase::Fault),
                    off_path,
                    paced,
                    in_force,
                    cause: Cause::None,
                    late,
                    counters: Counters::default(),
                };
                Session::from_parts(config, parts).unwrap()
            },
        )
    })
}

prop_compose! {
    fn in_force()(nominal in -2_000..2_000_i64, offsets in prop_oneof![Just(Offsets::ZERO), offsets()]) -> InForce {
        InForce { nominal: PositionNm(nominal), offsets }
    }
}

pub(crate) fn axes_in_force<const N: usize>() -> impl Strategy<Value = [InForce; N]> {
    uniform(in_force())
}

fn flags() -> impl Strategy<Value = AxisFlags> {
    (0..=AxisFlags::ALL.bits()).prop_map(|bits| AxisFlags::from_bits(bits).unwrap())
}

pub(crate) fn order<const N: usize>() -> impl Strategy<Value = Order<N>> {
    (
        action(),
        any::<bool>(),
        option::of(action()),
        uniform::<_, N>(flags()),
        any::<[bool; 2]>(),
    )
        .prop_map(
            |(action, obtains, shadow, nominal_flags, [paced, holds])| Order {
                action,
                obtains,
                shadow,
                nominal_flags,
                paced,
                holds,
            },
        )
}

pub(crate) fn fate() -> impl Strategy<Value = Fate> {
    prop_oneof![4 => Just(Fate::Taken), 4 => Just(Fate::Refused), 1 => Just(Fate::Unread)]
}

pub(crate) fn last_write<const N: usize>() -> impl Strategy<Value = LastWrite<N>> {
    prop_oneof![
        8 => Just(LastWrite::Accepted),
        2 => uniform::<_, N>(in_force()).prop_map(|in_force| LastWrite::Refused { in_force }),
        1 => Just(LastWrite::Unknown),
    ]
}

/// Fates that are told of references.
pub(crate) fn told<const N: usize>() -> impl Strategy<Value = Told<N>> {
    prop_oneof![
        20 => Just(Told::Accepted),
        2 => uniform::<_, N>(in_force()).prop_map(Told::ReadBack),
        1 => Just(Told::Unknown),
        1 => Just(Told::Nothing),
    ]
}

pub(crate) fn epochs() -> impl Strategy<Value = EpochRange> {
    (number(), number()).prop_map(|(first, last)| EpochRange {
        first: Epoch(first),
        last: Epoch(last),
    })
}

fn sensor() -> impl Strategy<Value = Option<WrenchSample>> {
    let sample = any::<(u8, bool, [i32; 3], [i32; 3])>();
    option::of(sample).prop_map(|sample| {
        sample.map(|(age, is_cut, force, moment)| WrenchSample {
            age,
            is_cut,
            force: force.map(ForceMn),
            moment: moment.map(MomentUnm),
        })
    })
}

pub(crate) fn tick_input<const N: usize>() -> impl Strategy<Value = TickInput<N>> {
    let nominal = prop_oneof![8 => -2_000..2_000_i64, 1 => any::<i64>()].prop_map(PositionNm);
    let reading = (uniform::<_, N>(nominal), uniform::<_, N>(actual()))
        .prop_map(|(nominal, actual)| Reading { nominal, actual });
    let reading = option::weighted(0.95, reading);
    let elapsed = prop_oneof![8 => Just(1), 1 => 0..4_u32, 1 => any::<u32>()];
    let flags = (rare(), rare(), any::<bool>());
    let inputs = (reading, sensor(), elapsed, flags);
    inputs.prop_map(
        |(reading, sensor, elapsed_cycles, (stop, quit, rearm))| TickInput {
            elapsed_cycles,
            reading,
            sensor,
            stop,
            quit,
            rearm,
        },
    )
}

prop_compose! {
    pub(crate) fn reference()(position: i64, Offsets { velocity, torque, .. } in offsets()) -> Reference {
        Reference { position: PositionNm(position), velocity_offset: velocity, torque_offset: torque }
    }
}

/// An axis with its configuration.
pub(crate) fn axis() -> impl Strategy<Value = (AxisConfig, Axis)> {
    axis_config().prop_flat_map(|config| (Just(config), axis_within(config, any::<i64>())))
}

fn action() -> impl Strategy<Value = Action> {
    select(vec![
        Action::Hold,
        Action::Follow,
        Action::FollowZero,
        Action::Ramp,
    ])
}

prop_compose! {
    pub(crate) fn axis_command()(
        action in action(), obtains: bool, shadow in option::of(action()), target in offsets(), nominal: i64,
        nominal_flags in flags(),
    ) -> AxisCommand {
        AxisCommand { action, obtains, shadow, target, nominal: PositionNm(nominal), nominal_flags, actual: Actual::ZERO }
    }
}
