//! What of core stands in a black-box file: every field of the configuration, the session, the inputs and the outputs.

use gantry_tau_core::axis::{Actual, Offsets, Reference};
use gantry_tau_core::channel::{Channel, Limits};
use gantry_tau_core::message::{
    AxisFlags, AxisLimits, AxisState, Capabilities, Cause, ClientMessage, Command, Counters, Hello,
    Mode, Phase, Refusal, State,
};
use gantry_tau_core::session::act::Axis;
use gantry_tau_core::session::channels::AxisChannels;
use gantry_tau_core::session::config::{AxisConfig, MissBudget, Parameters, Travel};
use gantry_tau_core::session::decide::{Connection, Discrete};
use gantry_tau_core::session::{Cycle, Entry, Event, Events, Input, Output, Parts, Refusals};
use gantry_tau_core::units::{
    Epoch, OffsetNm, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS,
};
use gantry_tau_core::wire::{ContentError, FrameError};

use super::text::{Line, Text, choices, newtypes, records};

newtypes!(
    Capabilities,
    Connection,
    Epoch,
    OffsetNm,
    PositionNm,
    Sequence,
    Tick,
    TorquePermille,
    VelocityUmS,
);

records! {
    Actual { position, velocity, torque }
    Axis { channels, shadow, nominal }
    AxisChannels { position, velocity, torque }
    AxisConfig { limits, nominal_travel, machine_travel, nominal_step_nm }
    AxisLimits { position, velocity, torque }
    AxisState { nominal, offsets, shadow, actual, flags }
    const N: Command<N> { epoch, sequence, echo, mode, targets }
    Counters {
        received, missed, late, duplicate, stale, malformed, out_of_range, limited, clamped,
        strangers, longest_miss_run,
    }
    const N: Cycle<N> { elapsed, nominal, actual, stop, rearm, next_epoch, arrival_us }
    Discrete {
        phase, owner, epoch, accepted, tick, misses, history, waited, rearm_released,
    }
    const N: Entry<N> { input, output }
    Hello { axes, capabilities }
    const N: Input<N> { cycle, events }
    MissBudget { window, allowed }
    Offsets { position, velocity, torque }
    const N: Output<N> { references, state, owner, welcome, refusals, close, ended }
    const N: Parameters<N> {
        cycle_us, echo_window, handshake_ticks, budget, capabilities, kinematics_checksum, axes,
    }
    const N: Parts<N> { discrete, axes, cause, late, counters }
    Reference { position, velocity_offset, torque_offset }
    const N: State<N> {
        tick, epoch, accepted, phase, cause, on_time_of_100, arrival_us, ramp_ticks_left,
        counters, axes,
    }
    Travel { lower, upper }
}

choices! {
    Cause {
        nothing [
            None, ClientLate, NetworkLate, ServerLate, Malformed, Closed, Goodbye, Budget, Stop,
            Nominal, Flood, HandshakeTimeout, Restart
        ]
        value []
        fields []
    }
    const N: ClientMessage<N> {
        nothing []
        value [Hello, Command, Goodbye, Stop]
        fields []
    }
    ContentError {
        nothing [Reserved, Limits]
        value []
        fields [
            Kind { received }, Length { expected, received }, Axes { expected, received },
            Code { received }
        ]
    }
    const N: Event<N> {
        nothing [Flood, Closed]
        value [Message, Malformed, Dropped, Broken]
        fields []
    }
    FrameError {
        nothing [Magic, Length, Checksum]
        value []
        fields [Version { received }, TooLong { length }]
    }
    Mode {
        nothing [Submit, Obtain]
        value []
        fields []
    }
    Phase {
        nothing [Listening, Handshake, Submit, Obtain, SafeDisconnect, Fault]
        value []
        fields []
    }
    Refusal {
        nothing [Busy, Unavailable]
        value []
        fields [
            Ramping { ticks_left }, Faulted { ticks_left }, Version { supported },
            Axes { expected }, Capability { needed }
        ]
    }
}

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
