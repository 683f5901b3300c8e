//! Every public error, state, event and counter can be logged on a target. It is the compiler that checks this:
//! `cargo clippy -p gantry-tau-core --all-targets --all-features`.
#![cfg(feature = "defmt")]

use defmt::Format;
use gantry_tau_core::control::axis::{Actual, Offsets, Reference};
use gantry_tau_core::control::channel::{Channel, Limits, LimitsError};
use gantry_tau_core::control::endpoint::{Full, MotorMap, MotorMapError, Transport, Turn};
use gantry_tau_core::control::message::{
    AxisFlags, AxisLimits, AxisState, Capabilities, Cause, ClientMessage, Command, Counters, Hello,
    Mode, Phase, Refusal, ServerMessage, State, Welcome,
};
use gantry_tau_core::control::session::act::{Axis, AxisCommand};
use gantry_tau_core::control::session::channels::AxisChannels;
use gantry_tau_core::control::session::config::{
    AxisConfig, Config, ConfigError, MissBudget, Parameters, Travel,
};
use gantry_tau_core::control::session::fsm::{
    Action, Connection, Decision, End, FsmInput, FsmState, Rules,
};
use gantry_tau_core::control::session::ingress::{Accepted, Diagnostics, Verdict};
use gantry_tau_core::control::session::recorder::Entry;
use gantry_tau_core::control::session::{
    Cycle, Event, Input, Output, Parts, Replayed, Session, StartError,
};
use gantry_tau_core::control::wire::{
    Collector, ContentError, Deframer, Feed, Frame, FrameError, Kind, Short, Stage,
};
use gantry_tau_core::model::compensation::{CompensatorError, Correction};
use gantry_tau_core::model::kinematics::{KinematicsError, Solution};
use gantry_tau_core::model::l2;
use gantry_tau_core::model::linalg::LinearError;
use gantry_tau_core::model::robot::{Branch, Parameter, RobotError};
use gantry_tau_core::model::sensor::{Reading, SensorError, SensorState};
use gantry_tau_core::model::statics::{TauFormError, Wrench};
use gantry_tau_core::units::{
    CrossingError, Epoch, Metres, OffsetNm, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS,
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
    CompensatorError, ConfigError, ContentError, CrossingError, FrameError, Full, KinematicsError, LimitsError, LinearError,
    MotorMapError, l2::OrientationError, Refusal, RobotError, SensorError, Short, StartError, TauFormError,
    // States, and what they are made of.
    AxisChannels, Axis, AxisState, Channel, Collector, Deframer, FsmState, Parts<6>, Phase, SensorState, Session<6>, Stage, State<6>,
    // Events, decisions, outputs.
    Action, FsmInput, Cause, ClientMessage<6>, Command<6>, Cycle<6>, Decision, End, Entry<Input<6>, Output<6>>, Event<6>,
    Feed<'static>, Frame<'static>, Accepted<6>, Hello, Input<6>, Kind, Mode, AxisCommand, Output<6>, Reading, Replayed<6>, Rules,
    ServerMessage<6>, Solution<[f64; 6]>, Transport, Turn<6, 9>, Verdict, Welcome<6>,
    // Counters and flags.
    AxisFlags, Counters, Diagnostics,
    // Numbers and configuration.
    Actual, AxisConfig, AxisLimits, Branch, Capabilities, Config<6>, Connection, Correction<6>, Epoch, Limits, Metres, MissBudget,
    MotorMap<6, 9>, OffsetNm, Offsets, Parameter, Parameters<6>, PositionNm, Reference, Sequence, Tick, TorquePermille, Travel,
    VelocityUmS, Wrench,
}
