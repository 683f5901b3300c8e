//! Samples of gantry-tau: two of the thesis' measuring programs, and what the server publishes.

use crate::sample::{Sample, Text};
use crate::structure;

structure! {
    /// Gauges, counts of the gauge's resolution (0.5 µm). `sample int data[3];` of the thesis,
    /// 4.2.3 and 4.2.6.
    pub struct Data(pub [i32; 3]);
    /// Force sensor, raw, in sensor axes: force x, y, z, N, and moment x, y, z, N m.
    /// `sample float forcesensor[6];` of the thesis, 4.2.3 and 4.2.5.
    pub struct ForceSensor(pub [f32; 6]);
}

structure! {
    /// State of the server after a tick. Codes are those of the server's own wire format.
    pub struct State {
        /// Number of the tick.
        pub tick: i64,
        /// Epoch of the session.
        pub epoch: i64,
        /// Sequence number of the last command that was accepted.
        pub sequence: i64,
        /// Code of the phase.
        pub phase: u8,
        /// Code of the cause of the last end of a session.
        pub cause: u8,
        /// Commands on time among the last 100.
        pub on_time: u8,
        /// Ticks until the ramp ends.
        pub ramp_ticks_left: i32,
        /// Counters, in the order of the wire format; at most 2^31 - 1.
        pub counters: [i32; 10],
        /// Longest run of missed ticks.
        pub longest_miss_run: i16,
    }

    /// One axis in [`Axes`].
    pub struct Axis {
        /// Nominal position, nm.
        pub nominal_nm: i64,
        /// Reference written to the drive, nm.
        pub reference_nm: i64,
        /// Offset of the position, nm.
        pub position_offset_nm: i32,
        /// Offset of the velocity, µm/s.
        pub velocity_offset_um_s: i32,
        /// Offset of the torque, per mille of rated torque.
        pub torque_offset_permille: i16,
        /// Offset of the position that would be in force in Obtain, nm; 0 outside Submit.
        pub shadow_nm: i32,
        /// Actual position, nm.
        pub actual_nm: i64,
        /// Actual velocity, µm/s.
        pub actual_velocity_um_s: i32,
        /// Actual torque, per mille of rated torque.
        pub actual_torque_permille: i16,
        /// Flags of the wire format.
        pub flags: u8,
    }

    /// `N` axes after a tick.
    pub struct Axes<const N: usize> {
        /// Number of the tick.
        pub tick: i64,
        /// The axes.
        pub axis: [Axis; N],
    }

    /// True load and displacement of the simulated tool.
    pub struct Tool {
        /// Number of the tick.
        pub tick: i64,
        /// Step of the experiment.
        pub step: i32,
        /// Force x, y, z, N, and moment x, y, z, N m, on the platform, world axes.
        pub load: [f64; 6],
        /// Displacement from the nominal position, m.
        pub displacement_m: [f64; 3],
        /// Displacement from the nominal orientation, rotation vector, rad.
        pub turn_rad: [f64; 3],
        /// Readings of the gauges, m.
        pub gauges_m: [f64; 3],
    }

    /// Something that happened to a session.
    pub struct SessionEvent {
        /// Number of the tick.
        pub tick: i64,
        /// Kind of event: 0 granted, 1 refused, 2 ended, 3 phase changed, 4 machine failed.
        pub kind: u8,
        /// Code of the cause, or of the phase.
        pub cause: u8,
        /// The same in words, UTF-8.
        pub text: Text<256>,
    }
}

impl Sample for Data {
    const NAME: &'static str = "data";
}

impl Sample for ForceSensor {
    const NAME: &'static str = "forcesensor";
}

impl Sample for State {
    const NAME: &'static str = "state";
}

impl<const N: usize> Sample for Axes<N> {
    const NAME: &'static str = "axes";
}

impl Sample for Tool {
    const NAME: &'static str = "tool";
}

impl Sample for SessionEvent {
    const NAME: &'static str = "session_event";
}
