//! Sample of the machine's identity, which a reader gets once, behind the definitions.

use gantry_tau_labcomm::{Sample, Text, structure};

/// Longest robot file that is published, bytes.
pub const MAX_ROBOT_FILE: usize = 16_384;

structure! {
    /// The machine of a server, and what it is drawn by.
    pub struct MachineIdentity {
        /// Checksum of its kinematic parameters, as in the Welcome, 0 to 2^32 - 1.
        pub kinematics: i64,
        /// Name of its robot file, UTF-8.
        pub name: Text<256>,
        /// 1 if its server runs in lock-step, so that ticks are no time of any clock; otherwise 0.
        pub lockstep: u8,
        /// Text of its robot file, UTF-8; empty if it is longer than the sample has room for.
        pub robot_file: Text<MAX_ROBOT_FILE>,
    }
}

impl Sample for MachineIdentity {
    const NAME: &'static str = "machine";
}
