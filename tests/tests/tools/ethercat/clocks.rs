//! SOEM sets up the distributed clocks of the emulated chain.

use std::path::Path;

use gantry_tau::ethercat::emulated_bus;
use gantry_tau_machine::robot_file::{Clocks, Ethercat, RobotFile};
use gantry_tau_sim::load_generator::load_generator;
use serde_json::json;

use super::{FarEnd, connect, judged};

/// Time from one emulated SubDevice to the next, ns.
const HOP_NS: i64 = 310;
/// The chain's clock is slow, so that three intervals of SYNC0 without a frame, with which a drive
/// leaves OP, are 150 ms of a busy computer.
const SLOWNESS: u32 = 50;

pub(super) fn soem_agrees(python: &Path) {
    connect();
    let robot = RobotFile::builtin_l2().unwrap();
    let (_hand, tool) = load_generator();
    let section = Ethercat {
        clocks: Clocks::Sync0,
        ..Ethercat::emulated(&robot.motors.axis_of_motor, &robot.metres_per_q)
    };
    let bus = emulated_bus::<_, 3, 3>(&robot, &section, tool).unwrap();
    let far = FarEnd::start(bus, Some(SLOWNESS));
    let saw = judged(python, "clocks.py");
    drop(far);
    assert_eq!(
        (&saw["found"], &saw["has_clock"]),
        (&json!(3), &json!(true))
    );
    assert_eq!(saw["safe_op"], 4);
    for drive in 0..3 {
        let delay = saw["delays"][drive].as_i64().unwrap();
        let expected = HOP_NS * i64::try_from(drive).unwrap();
        assert!((delay - expected).abs() <= 1, "{saw}");
        // Clocks of 20, -35 and 50 ppm.
        assert!(saw["differences"][drive].as_i64().unwrap() <= 20, "{saw}");
        // SAFE-OP with an error: no SYNC0.
        assert_eq!(saw["without"][drive], json!([0x14, 0x002D]), "{saw}");
        let registers = json!({
            "activation": 3,
            "owner": 0,
            "start_is_whole": true,
            "periods": [1_000_000, 0],
        });
        assert_eq!(saw["registers"][drive], registers);
        assert_eq!(saw["with"][drive], json!([8, 0]), "{saw}");
        assert_eq!(saw["at_the_end"][drive], json!([8, 0]), "{saw}");
    }
    assert_eq!(saw["counter"], json!([9, 9]));
}
