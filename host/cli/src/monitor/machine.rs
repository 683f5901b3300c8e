//! The machine of a server: the name that its port gives, and the robot file that it is drawn by.

use std::fmt;

use gantry_tau_machine::robot_file::AnyRobotFile;
use serde::{Serialize, Serializer};

/// Name of a server's machine.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct MachineName {
    /// Name of its robot file; bytes that are not UTF-8 are replaced, control characters removed.
    pub name: String,
    /// Checksum of its kinematic parameters, in JSON as eight hexadecimal digits.
    #[serde(serialize_with = "hexadecimal")]
    pub kinematics: u32,
    /// Its server runs in lock-step: ticks are no time of any clock.
    pub lockstep: bool,
}

impl fmt::Display for MachineName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} (kinematics {:08x})", self.name, self.kinematics)
    }
}

fn hexadecimal<S: Serializer>(checksum: &u32, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&format_args!("{checksum:08x}"))
}

/// Machine of a server, as its sample `machine` has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServerMachine {
    /// Its name.
    pub name: MachineName,
    /// Text of its robot file; empty if the server does not send it.
    pub robot_file: String,
}

impl ServerMachine {
    /// Returns the robot file of the machine: the one that the server sends, or a built-in one,
    /// whichever has the kinematics that the server names. `None`: which machine it is remains
    /// unknown.
    #[must_use]
    pub fn robot(&self) -> Option<AnyRobotFile> {
        let sent = AnyRobotFile::parse(&self.name.name, &self.robot_file);
        let built_in = ["l2", "f1"].map(AnyRobotFile::named);
        std::iter::once(sent)
            .chain(built_in)
            .flatten()
            .find(|robot| name_of(robot).kinematics == self.name.kinematics)
    }
}

/// Returns the name of a robot file's machine, in real time.
pub(super) fn name_of(robot: &AnyRobotFile) -> MachineName {
    let (name, kinematics) = match robot {
        AnyRobotFile::L2(robot) => (&robot.name, robot.checksum()),
        AnyRobotFile::F1(robot) => (&robot.name, robot.checksum()),
    };
    MachineName {
        name: name.clone(),
        kinematics,
        lockstep: false,
    }
}

#[cfg(test)]
mod tests {
    use gantry_tau_machine::robot_file::{RobotFile, text_of};

    use super::*;

    fn machine(kinematics: u32, robot_file: &str) -> ServerMachine {
        ServerMachine {
            name: MachineName {
                name: "small.toml".to_owned(),
                kinematics,
                lockstep: false,
            },
            robot_file: robot_file.to_owned(),
        }
    }

    /// The text of the built-in L2 with one longer link: another machine.
    fn other_text() -> String {
        let text = text_of("l2").unwrap();
        let other = text.replace("L = [1.0, 1.1, 1.0]", "L = [1.0, 1.1, 1.01]");
        assert_ne!(text, other);
        other
    }

    #[test]
    fn the_robot_file_that_is_sent_is_taken_only_with_the_kinematics_that_are_named() {
        let l2 = RobotFile::builtin_l2().unwrap().checksum();
        let f1 = RobotFile::builtin_f1().unwrap().checksum();
        let text = text_of("l2").unwrap();
        let sent = machine(l2, &text).robot().unwrap();
        let AnyRobotFile::L2(sent) = sent else {
            panic!("an L2")
        };
        assert_eq!(sent.name, "small.toml");
        // What is built in stands for a text that is missing, wrong, or of another machine.
        for robot_file in ["", "model = \"l2\"", &other_text(), &text_of("f1").unwrap()] {
            let robot = machine(l2, robot_file).robot();
            assert!(matches!(robot, Some(AnyRobotFile::L2(_))), "{robot_file}");
        }
        assert!(matches!(machine(f1, "").robot(), Some(AnyRobotFile::F1(_))));
        assert_eq!(machine(0x0bad_cafe, &text).robot(), None);
        let other = AnyRobotFile::parse("small.toml", &other_text()).unwrap();
        let robot = machine(name_of(&other).kinematics, &other_text()).robot();
        assert_eq!(robot, Some(other));
    }
}
