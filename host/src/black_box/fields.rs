//! What of core stands in a black-box file: every field of the configuration, the session, the inputs and the outputs.
//!
//! Whatever core checks is read through core's own constructors: limits, configuration, channels.

use gantry_tau_core::control::axis::{Actual, Offsets, Reference};
use gantry_tau_core::control::channel::{Channel, Limits};
use gantry_tau_core::control::message::{
    AxisFlags, AxisLimits, AxisState, Capabilities, Cause, ClientMessage, Command, Counters, Hello,
    Mode, Phase, Refusal, State,
};
use gantry_tau_core::control::session::act::Axis;
use gantry_tau_core::control::session::channels::AxisChannels;
use gantry_tau_core::control::session::config::{
    AxisConfig, Config, MissBudget, Parameters, Travel,
};
use gantry_tau_core::control::session::fsm::{Connection, FsmState};
use gantry_tau_core::control::session::{
    Cycle, EVENTS, Entry, Event, Events, Input, Output, Parts, Refusals,
};
use gantry_tau_core::control::wire::{ContentError, FrameError};
use gantry_tau_core::units::{
    Epoch, OffsetNm, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS,
};
use serde_json::Value;

use super::text::{
    Object, Problem, Text, choices, newtypes, read_array, read_variant, records, write_array,
    write_object,
};

include!("types.rs");

impl Text for AxisFlags {
    fn write(&self, text: &mut String) {
        self.bits().write(text);
    }

    fn read(value: Value) -> Result<Self, Problem> {
        let bits = Text::read(value)?;
        Self::from_bits(bits).ok_or_else(|| Problem::new(format!("{bits} has unknown flags")))
    }
}

impl Text for Limits {
    fn write(&self, text: &mut String) {
        let fields = [
            ("max", self.max().text()),
            ("step", self.step().text()),
            ("accel", self.accel().text()),
            ("ramp", self.ramp().text()),
        ];
        write_object(text, &fields);
    }

    fn read(value: Value) -> Result<Self, Problem> {
        let mut object = Object::of(value)?;
        let limits = Self::new(
            object.take("max")?,
            object.take("step")?,
            object.take("accel")?,
            object.take("ramp")?,
        );
        object.end()?;
        limits.map_err(Problem::new)
    }
}

/// The widest limits there are. A channel is read under these; whether it is valid under its own is seen when all is read.
fn widest() -> Result<Limits, Problem> {
    Limits::new(i32::MAX, i32::MAX - 1, i32::MAX, 1).map_err(Problem::new)
}

impl Text for Channel {
    fn write(&self, text: &mut String) {
        let fields = [
            ("value", self.value().text()),
            ("change", self.change().text()),
        ];
        write_object(text, &fields);
    }

    fn read(value: Value) -> Result<Self, Problem> {
        let mut object = Object::of(value)?;
        let (value, change) = (object.take("value")?, object.take("change")?);
        object.end()?;
        Self::from_parts(value, change, &widest()?)
            .ok_or_else(|| Problem::new("is no channel under any limits"))
    }
}

impl<const N: usize> Text for Config<N> {
    fn write(&self, text: &mut String) {
        self.parameters().write(text);
    }

    fn read(value: Value) -> Result<Self, Problem> {
        Self::new(Text::read(value)?).map_err(Problem::new)
    }
}

/// A list with room for [`EVENTS`] entries.
macro_rules! bounded {
    ($(const $n:ident:)? $type:ty) => {
        impl $(<const $n: usize>)? Text for $type {
            fn write(&self, text: &mut String) {
                write_array(text, self);
            }

            fn read(value: Value) -> Result<Self, Problem> {
                let items = read_array(value)?;
                let full = || Problem::new(format!("has {} entries, at most {EVENTS} are possible", items.len()));
                Self::from_slice(&items).map_err(|()| full())
            }
        }
    };
}

bounded!(const N: Events<N>);
bounded!(Refusals);

/// The first channel that is not valid under its limits.
pub(super) fn check_channels<const N: usize>(
    axes: &[Axis; N],
    config: &Config<N>,
) -> Result<(), Problem> {
    for (index, (axis, config)) in axes.iter().zip(&config.parameters().axes).enumerate() {
        let limits = &config.limits;
        for (set, channels) in [("channels", &axis.channels), ("shadow", &axis.shadow)] {
            let rows = [
                ("position", channels.position, limits.position),
                ("velocity", channels.velocity, limits.velocity),
                ("torque", channels.torque, limits.torque),
            ];
            for (name, channel, limits) in rows {
                if Channel::from_parts(channel.value(), channel.change(), &limits).is_none() {
                    return Err(Problem {
                        place: format!("axes[{index}].{set}.{name}"),
                        reason: format!(
                            "value {} and change {} are not within the limits, {} and {}",
                            channel.value(),
                            channel.change(),
                            limits.max(),
                            limits.step()
                        ),
                    });
                }
            }
        }
    }
    Ok(())
}
