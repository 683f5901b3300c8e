//! Identity of a machine in streams and recordings.

use gantry_tau_labcomm::Text;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::publication::{MAX_ROBOT_FILE, MachineIdentity};

/// Returns the identity of a robot file's machine, in real time, with the text of the file; without
/// it if the text is too long.
#[must_use]
pub fn machine<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    text: &str,
) -> MachineIdentity {
    let is_sent = text.len() <= MAX_ROBOT_FILE;
    MachineIdentity {
        kinematics: i64::from(robot.checksum()),
        name: Text::cut(&robot.name),
        lockstep: 0,
        robot_file: Text::cut(if is_sent { text } else { "" }),
    }
}
