//! Every public error, state, event and counter can be logged on a target. It is the compiler that checks this:
//! `cargo clippy -p gantry-tau-core --all-targets --all-features`.
#![cfg(feature = "defmt")]

use defmt::Format;
use gantry_tau_core::axis::{Actual, Offsets, Reference};
use gantry_tau_core::channel::{Channel, Limits, LimitsError};
use gantry_tau_core::compensation::{CompensatorError, Correction};
use gantry_tau_core::endpoint::{Full, MotorMap, MotorMapError, Transport, Turn};
use gantry_tau_core::kinematics::{KinematicsError, NominalError, Solved};
use gantry_tau_core::linalg::LinearError;
use gantry_tau_core::message::{
    AxisFlags, AxisLimits, AxisState, Capabilities, Cause, ClientMessage, Command, Counters, Hello,
    Mode, Phase, Refusal, ServerMessage, State, Welcome,
};
use gantry_tau_core::robot::{Branch, Parameter, RobotError};
use gantry_tau_core::sensor::{Reading, SensorError, SensorState};
use gantry_tau_core::session::act::{Axis, Order};
use gantry_tau_core::session::channels::AxisChannels;
use gantry_tau_core::session::config::{
    AxisConfig, Config, ConfigError, MissBudget, Parameters, Travel,
};
use gantry_tau_core::session::decide::{
    Action, Arrivals, Connection, Decision, Discrete, End, Rules,
};
use gantry_tau_core::session::recorder::Entry;
use gantry_tau_core::session::sift::{Heard, Noted, Verdict};
use gantry_tau_core::session::{Cycle, Event, Input, Output, Parts, Replayed, Session, StartError};
use gantry_tau_core::statics::{TauFormError, Wrench};
use gantry_tau_core::units::{
    CrossingError, Epoch, Metres, OffsetNm, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS,
};
use gantry_tau_core::wire::{
    Collector, ContentError, Deframer, Feed, Frame, FrameError, Kind, Short, Stage,
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
    MotorMapError, NominalError, Refusal, RobotError, SensorError, Short, StartError, TauFormError,
    // States, and what they are made of.
    AxisChannels, Axis, AxisState, Channel, Collector, Deframer, Discrete, Parts<6>, Phase, SensorState, Session<6>, Stage, State<6>,
    // Events, decisions, outputs.
    Action, Arrivals, Cause, ClientMessage<6>, Command<6>, Cycle<6>, Decision, End, Entry<Input<6>, Output<6>>, Event<6>,
    Feed<'static>, Frame<'static>, Heard<6>, Hello, Input<6>, Kind, Mode, Order, Output<6>, Reading, Replayed<6>, Rules,
    ServerMessage<6>, Solved<[f64; 6]>, Transport, Turn<6, 9>, Verdict, Welcome<6>,
    // Counters and flags.
    AxisFlags, Counters, Noted,
    // Numbers and configuration.
    Actual, AxisConfig, AxisLimits, Branch, Capabilities, Config<6>, Connection, Correction<6>, Epoch, Limits, Metres, MissBudget,
    MotorMap<6, 9>, OffsetNm, Offsets, Parameter, Parameters<6>, PositionNm, Reference, Sequence, Tick, TorquePermille, Travel,
    VelocityUmS, Wrench,
}
