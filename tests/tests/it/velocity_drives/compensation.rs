//! The demo with position loops outside the drives: the same limits as inside.

use gantry_tau_sim::machine::SimulatedMachine;
use gantry_tau_tests::short_demo;

use super::*;

#[test]
fn the_demo_ends_within_its_tolerance() {
    for drives in ["command_delay_cycles = 0\nactual_delay_cycles = 0", ""] {
        let folder = tempfile::tempdir().unwrap();
        let complaints = short_demo::complaints(
            folder.path(),
            robot(drives),
            |robot, tool| SimulatedMachine::<3, L2_MOTORS>::from_robot(robot, tool, Motion::Hold),
            Cycle::with_position_loops,
        );
        assert_eq!(complaints, Vec::<String>::new(), "{drives}");
    }
}
