//! Every public error, state, event and counter can be logged on a target. The compiler checks
//! this: `cargo clippy -p gantry-tau-core --all-targets --all-features`.
#![cfg(feature = "defmt")]

use defmt::Format;
use gantry_tau_core::control::agitation::{Agitation, AgitationBudget};
use gantry_tau_core::control::axis::{Actual, InForce, Offsets, Reference};
use gantry_tau_core::control::channel::{Channel, LimitValues, Limits, LimitsError};
use gantry_tau_core::control::endpoint::{Full, MotorMap, MotorMapError, Transport};
use gantry_tau_core::control::message::{
    AxisFlags, AxisLimits, AxisState, Capabilities, Cause, ClientMessage, Command, ContentError,
    Counters, FrameError, Hello, Mode, Phase, Refusal, ServerMessage, State, Welcome,
};
use gantry_tau_core::control::session::config::{
    AxisConfig, Config, ConfigError, MissBudget, Parameters, Travel,
};
use gantry_tau_core::control::session::recorder::Entry;
use gantry_tau_core::control::session::{
    Connection, Event, Input, LastWrite, Output, Replayed, Session, Start, StartError, TickInput,
};
use gantry_tau_core::control::wire::{Collector, Deframer, Feed, Frame, Kind, Short, Stage};
use gantry_tau_core::model::compensation::{CompensatorError, Correction};
use gantry_tau_core::model::kinematics::{KinematicsError, Solution};
use gantry_tau_core::model::l2;
use gantry_tau_core::model::robot::{Branch, Parameter, RobotError};
use gantry_tau_core::model::sensor::{Reading, SensorError, SensorState};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::{
    CrossingError, Epoch, EpochRange, Metres, OffsetNm, PositionNm, Sequence, Tick, TorquePermille,
    VelocityUmS,
};

/// Compiles for what can be logged.
const fn formats<T: Format>() {}

macro_rules! all {
    ($($name:ty),* $(,)?) => {
        #[test]
        fn everything_can_be_logged() {
            $(formats::<$name>();)*
        }
    };
}

all! {
    // Errors and refusals.
    CompensatorError, ConfigError, ContentError, CrossingError, FrameError, Full, KinematicsError, LimitsError,
    MotorMapError, l2::OrientationError, Refusal, RobotError, SensorError, Short, StartError,
    // States, and what they are made of.
    AxisState, Channel<OffsetNm>, Collector, Deframer, Phase, SensorState, Session<6>, Stage, State<6>,
    // Events, inputs, outputs.
    Cause, ClientMessage<6>, Command<6>, Entry<Input<6>, Output<6>>, Event<6>, Feed<Frame<'static>>, Frame<'static>, Hello, Input<6>, Kind,
    LastWrite<6>, Mode, Output<6>, Reading, Replayed<6>, ServerMessage<6>, Solution<[f64; 6]>, Start<6>, TickInput<6>,
    Transport, Welcome<6>,
    // Counters and flags.
    AxisFlags, Counters,
    // Numbers and configuration.
    Actual, Agitation, AgitationBudget, AxisConfig, AxisLimits, Branch, Capabilities, Config<6>, Connection, Correction<6>, Epoch, EpochRange, InForce, LimitValues,
    Limits<OffsetNm>, Metres, MissBudget, MotorMap<6, 9>, OffsetNm, Offsets, Parameter, Parameters<6>, PositionNm, Reference, Sequence,
    Tick, TorquePermille, Travel, VelocityUmS, Wrench,
}
