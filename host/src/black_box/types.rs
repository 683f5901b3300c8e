// Core's types in a black-box file, field by field and variant by variant: the one list, which the host (to write and to read) and the
// C interface (`host/capi`, to write) include. `newtypes`, `records` and `choices` are macros of whoever includes it; types that
// core checks itself (limits, channels, flags) are not here.

newtypes!(
    Capabilities,
    Connection,
    Epoch,
    OffsetNm,
    PositionNm,
    Sequence,
    Tick,
    TorquePermille,
    VelocityUmS
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
    FsmState {
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
