//! What of core stands in a black-box file: every field of the configuration, the session, the inputs and the outputs.

use gantry_tau_core::control::axis::{Actual, Offsets, Reference};
use gantry_tau_core::control::channel::{Channel, Limits};
use gantry_tau_core::control::message::{
    AxisFlags, AxisLimits, AxisState, Capabilities, Cause, ClientMessage, Command, Counters, Hello,
    Mode, Phase, Refusal, State,
};
use gantry_tau_core::control::session::act::Axis;
use gantry_tau_core::control::session::channels::AxisChannels;
use gantry_tau_core::control::session::config::{AxisConfig, MissBudget, Parameters, Travel};
use gantry_tau_core::control::session::fsm::{Connection, FsmState};
use gantry_tau_core::control::session::{Cycle, Entry, Event, Events, Input, Output, Parts, Refusals};
use gantry_tau_core::units::{
    Epoch, OffsetNm, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS,
};
use gantry_tau_core::control::wire::{ContentError, FrameError};

use super::text::{Line, Text, choices, newtypes, records};

include!("../../../src/black_box/types.rs");

impl Text for AxisFlags {
    fn write(&self, line: &mut Line<'_>) {
        self.bits().write(line);
    }
}

impl Text for Limits {
    fn write(&self, line: &mut Line<'_>) {
        line.object(&[
            ("max", &self.max()),
            ("step", &self.step()),
            ("accel", &self.accel()),
            ("ramp", &self.ramp()),
        ]);
    }
}

impl Text for Channel {
    fn write(&self, line: &mut Line<'_>) {
        line.object(&[("value", &self.value()), ("change", &self.change())]);
    }
}

impl<const N: usize> Text for Events<N> {
    fn write(&self, line: &mut Line<'_>) {
        line.array(self);
    }
}

impl Text for Refusals {
    fn write(&self, line: &mut Line<'_>) {
        line.array(self);
    }
}
