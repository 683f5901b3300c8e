//! Values and messages for the tests of this module, all for two axes.

use crate::control::axis::Offsets;
use crate::control::channel::{LimitValues, Limits};
use crate::control::message::{
    AxisLimits, AxisState, Capabilities, Cause, ClientMessage, Command, Counters, Hello, Mode,
    Phase, Refusal, State,
};
use crate::control::session::config::{AxisConfig, Travel};
use crate::control::session::{Input, Session, TickInput};
use crate::units::{Epoch, EpochRange, OffsetNm, Sequence, Tick};

/// Every reason for a refusal, each number another one.
pub(crate) const REFUSALS: [Refusal; 7] = [
    Refusal::Busy,
    Refusal::Ramping {
        ticks_left: 0x0102_0304,
    },
    Refusal::Faulted {
        ticks_left: 0x0506_0708,
    },
    Refusal::Axes { expected: 10 },
    Refusal::Capability {
        needed: Capabilities(0x0b0c),
    },
    Refusal::Unavailable,
    Refusal::Role,
];

pub(crate) const HELLO: ClientMessage<2> = ClientMessage::Hello(Hello {
    axes: 2,
    capabilities: Capabilities::NONE,
});

/// Limits from M, S, A and rho.
pub(crate) fn limits<U>(max: i32, step: i32, accel: i32, ramp: i32) -> Limits<U> {
    Limits::new(LimitValues {
        max,
        step,
        accel,
        ramp,
    })
    .unwrap()
}

/// An axis with all three channels, whose machine travel is wider than its nominal travel by the
/// `M` of its positions.
pub(crate) fn axis(
    position: Limits<OffsetNm>,
    nominal_reach_nm: u32,
    nominal_step_nm: u32,
) -> AxisConfig {
    let (velocity, torque) = (limits(1_000, 100, 200, 10), limits(100, 10, 20, 1));
    let travel = Travel::around_zero(nominal_reach_nm);
    AxisConfig {
        limits: AxisLimits {
            position,
            velocity,
            torque,
        },
        ..AxisConfig::position_only(position, travel, nominal_step_nm)
    }
}

/// The same position offset at both axes.
pub(crate) fn at(position: i32) -> [Offsets; 2] {
    [Offsets::position(OffsetNm(position)); 2]
}

/// An answer to the last State of a session.
pub(crate) fn command(
    session: &Session<2>,
    sequence: u64,
    mode: Mode,
    targets: [Offsets; 2],
) -> Command<2> {
    Command {
        epoch: session.epoch(),
        sequence: Sequence(sequence),
        echo: session.last_tick(),
        mode,
        targets,
    }
}

/// A tick on time at nominal position zero, without a stop.
pub(crate) fn on_time() -> TickInput<2> {
    Input::empty(EpochRange::VOLATILE).tick
}

/// A State of both axes at this position offset.
pub(crate) fn state(epoch: Epoch, tick: u64, phase: Phase, position: i32) -> State<2> {
    State {
        tick: Tick(tick),
        epoch,
        accepted: Sequence(tick),
        phase,
        cause: Cause::None,
        on_time_of_100: 100,
        arrival_us: 0,
        ramp_ticks_left: 0,
        counters: Counters::default(),
        sensor: None,
        axes: at(position).map(|offsets| AxisState {
            offsets,
            ..AxisState::default()
        }),
    }
}
