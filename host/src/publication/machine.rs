//! Sample of the machine's identity, which a reader gets once, behind the definitions.

use gantry_tau_labcomm::{Sample, Text, structure};

use crate::model::MachineKind;
use crate::robot_file::RobotFile;

structure! {
    /// The machine of a server.
    pub struct Machine {
        /// Checksum of its kinematic parameters, as in the Welcome, 0 to 2^32 - 1.
        pub kinematics: i64,
        /// Name of its robot file, UTF-8.
        pub name: Text<256>,
        /// 1 if its server runs in lock-step, so that ticks are no time of any clock; otherwise 0.
        pub lockstep: u8,
    }
}

impl Sample for Machine {
    const NAME: &'static str = "machine";
}

impl Machine {
    /// Returns the identity of a robot file's machine, in real time.
    #[must_use]
    pub fn of<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>) -> Self {
        Self { kinematics: i64::from(robot.checksum()), name: Text::cut(&robot.name), lockstep: 0 }
    }
}
