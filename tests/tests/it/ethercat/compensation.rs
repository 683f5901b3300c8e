//! The demo's compensation over the emulated bus: the same limits as without it.

use gantry_tau::ethercat::{EthercatPlant, emulated_bus};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_tests::short_demo;

use super::section;

fn compensates<K: MachineKind<N>, const N: usize, const M: usize>(robot: RobotFile<K, N>) {
    let folder = tempfile::tempdir().unwrap();
    let complaints = short_demo::complaints(
        folder.path(),
        robot,
        |robot, tool| {
            let bus = emulated_bus::<_, N, M>(robot, &section(robot), tool)?;
            EthercatPlant::<_, N, M>::open(robot, &section(robot), bus, |_| Motion::Hold)
        },
        |cycle, _| Ok(cycle),
    );
    assert_eq!(complaints, Vec::<String>::new());
}

#[test]
fn the_demo_ends_within_its_tolerance_on_three_axes() {
    compensates::<_, 3, 3>(RobotFile::builtin_l2().unwrap());
}

#[test]
fn the_demo_ends_within_its_tolerance_on_six_axes() {
    compensates::<_, 6, 9>(RobotFile::builtin_f1().unwrap());
}
