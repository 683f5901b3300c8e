//! `[drives]` of a robot file.

use gantry_tau::robot_file::AnyRobotFile;
use gantry_tau::robot_file::RobotFile;
use gantry_tau::sim::drive::Settings;
use gantry_tau::sim::drive::supervision::Limits;

use super::{F1, L2};

fn with(robot: &str, drives: &str) -> String {
    robot.replacen("[simulation]", &format!("[drives]\n{drives}\n[simulation]"), 1)
}

fn settings(text: &str) -> Settings {
    match AnyRobotFile::parse("x.toml", text).unwrap() {
        AnyRobotFile::L2(robot) => robot.drives.unwrap().settings(),
        AnyRobotFile::F1(robot) => robot.drives.unwrap().settings(),
    }
}

#[test]
fn without_it_drives_are_ideal_and_with_it_every_key_has_a_default() {
    assert_eq!(RobotFile::builtin_l2().unwrap().drives, None);
    assert_eq!(RobotFile::builtin_f1().unwrap().drives, None);
    let ax5000 = settings(&with(L2, ""));
    let limits = Limits { watchdog_cycles: 3, window_nm: 2_000_000, window_cycles: 10 };
    assert_eq!(ax5000.limits, Some(limits));
    assert_eq!((ax5000.command_delay_cycles, ax5000.actual_delay_cycles), (1, 1));
    assert_eq!((ax5000.position_integral_s, ax5000.peak_s), (None, Some(7.0)));
    assert!((ax5000.encoder.unwrap().step_m() - 0.01 / 1_048_576.0).abs() < 1e-18);
    let ax2000 =
        settings(&with(&L2.replace("max_um_s = [5000, 5000, 5000]", "max_um_s = [0, 0, 0]"), "profile = \"ax2000\""));
    assert_eq!((ax2000.position_integral_s, ax2000.peak_s), (Some(0.05), Some(5.0)));
}

#[test]
fn bad_drives_are_refused_by_key_and_reason() {
    for (drives, key, reason) in [
        ("profile = \"ax9000\"", "drives.profile", "unknown variant"),
        ("interface = \"torque\"", "drives.interface", "unknown variant"),
        ("interface = \"velocity\"", "drives.interface", "use \"position\""),
        ("watchdog = 3", "drives.watchdog", "unknown field"),
        ("watchdog_cycles = 0", "drives.watchdog_cycles", "is 0; expected from 1 to 1000"),
        ("watchdog_cycles = -1", "drives.watchdog_cycles", "invalid value"),
        ("watchdog_cycles = \"3\"", "drives.watchdog_cycles", "invalid type"),
        ("command_delay_cycles = 6", "drives.command_delay_cycles", "is 6; expected from 0 to 5"),
        ("actual_delay_cycles = 6", "drives.actual_delay_cycles", "is 6; expected from 0 to 5"),
        ("quick_stop_m_per_s2 = nan", "drives.quick_stop_m_per_s2", "is NaN"),
        ("following_error_um = 0.0", "drives.following_error_um", "expected from 1 to"),
        ("following_error_ms = 0", "drives.following_error_ms", "expected from 1 to"),
        ("encoder_counts_per_turn = 0", "drives.encoder_counts_per_turn", "expected from 256 to"),
        ("metres_per_turn = -0.01", "drives.metres_per_turn", "is -0.01"),
        ("backlash_um = inf", "drives.backlash_um", "is inf"),
        ("friction_n = -1.0", "drives.friction_n", "is -1"),
        ("friction_n = 50.0\nstiction_n = 40.0", "drives.stiction_n", "is 40; expected from 50"),
        ("velocity_feed_forward_percent = 121.0", "drives.velocity_feed_forward_percent", "from 0 to 120"),
        ("peak_seconds = 61.0", "drives.peak_seconds", "is 61"),
        ("position_integral_ms = 50.0", "drives.position_integral_ms", "AX5000 has no integral"),
        ("bias_permille = 100", "drives.bias_permille", "no such pair"),
        ("profile = \"ax2000\"", "axes.velocity.max_um_s[0]", "AX2000 (drives.profile) takes no velocity offsets"),
    ] {
        let error = AnyRobotFile::parse("x.toml", &with(L2, drives)).unwrap_err();
        let text = error.to_string();
        assert_eq!((&*error.file, &*error.key), ("x.toml", key), "{drives}: {text}");
        assert!(error.reason.contains(reason) && text.lines().count() == 1, "{drives}: {text}");
    }
    let torque = L2.replace("max_permille = [50", "max_permille = [1001");
    assert!(AnyRobotFile::parse("x.toml", &torque).is_ok(), "ideal drives take it");
    let error = AnyRobotFile::parse("x.toml", &with(&torque, "")).unwrap_err();
    assert_eq!(error.key, "axes.torque.max_permille[0]");
    // The F1 has pairs.
    assert!((settings(&with(F1, "bias_permille = 100")).bias - 0.1).abs() < 1e-12);
}
