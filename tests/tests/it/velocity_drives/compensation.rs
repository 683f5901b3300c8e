//! The demo with position loops outside the drives: the same limits as inside.

use gantry_tau_tests::short_demo;

use super::*;

#[test]
fn the_demo_ends_within_its_tolerance() {
    for drives in ["command_delay_cycles = 0\nactual_delay_cycles = 0", ""] {
        let complaints = short_demo::complaints(robot(drives), |robot, tool| {
            robot.simulated_machine::<L2_MOTORS>(tool, Motion::Hold)
        });
        assert_eq!(complaints, Vec::<String>::new(), "{drives}");
    }
}
