//! `[drives]` of a robot file.

use gantry_tau_machine::robot_file::AnyRobotFile;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_sim::drive::Settings;
use gantry_tau_sim::drive::supervision::Limits;

use super::{F1, L2, without_drives};
use crate::process::Folder;

/// A robot file with these keys of its drives, and no others.
fn with(robot: &str, drives: &str) -> String {
    without_drives(robot).replacen(
        "[simulation]",
        &format!("[drives]\n{drives}\n[simulation]"),
        1,
    )
}

fn settings(text: &str) -> Settings {
    match AnyRobotFile::parse("x.toml", text).unwrap() {
        AnyRobotFile::L2(robot) => Settings::from(&robot.drives.unwrap()),
        AnyRobotFile::F1(robot) => Settings::from(&robot.drives.unwrap()),
    }
}

#[test]
fn without_it_drives_are_ideal_and_with_it_every_key_has_a_default() {
    assert_eq!(RobotFile::builtin_l2().unwrap().drives, None);
    let AnyRobotFile::F1(f1) = AnyRobotFile::parse("x.toml", &without_drives(F1)).unwrap() else {
        panic!("an F1")
    };
    assert_eq!(f1.drives, None);
    let ax5000 = settings(&with(L2, ""));
    let limits = Limits {
        watchdog_cycles: 3,
        window_nm: 2_000_000,
        window_cycles: 10,
    };
    assert_eq!(ax5000.limits, Some(limits));
    assert_eq!(
        (ax5000.command_delay_cycles, ax5000.actual_delay_cycles),
        (1, 1)
    );
    assert_eq!(
        (ax5000.position_integral_s, ax5000.peak_s),
        (None, Some(7.0))
    );
    assert!((ax5000.encoder.unwrap().step_m() - 0.01 / 1_048_576.0).abs() < 1e-18);
    let ax2000 = settings(&with(
        &L2.replace("max_um_s = [5000, 5000, 5000]", "max_um_s = [0, 0, 0]"),
        "profile = \"ax2000\"",
    ));
    assert_eq!(
        (ax2000.position_integral_s, ax2000.peak_s),
        (Some(0.05), Some(5.0))
    );
}

#[test]
fn bad_drives_are_refused_by_key_and_reason() {
    for (drives, key, reason) in [
        ("profile = \"ax9000\"", "drives.profile", "unknown variant"),
        (
            "interface = \"torque\"",
            "drives.interface",
            "unknown variant",
        ),
        ("watchdog = 3", "drives.watchdog", "unknown field"),
        (
            "watchdog_cycles = 0",
            "drives.watchdog_cycles",
            "is 0; expected from 1 to 1000",
        ),
        (
            "watchdog_cycles = -1",
            "drives.watchdog_cycles",
            "invalid value",
        ),
        (
            "watchdog_cycles = \"3\"",
            "drives.watchdog_cycles",
            "invalid type",
        ),
        (
            "command_delay_cycles = 6",
            "drives.command_delay_cycles",
            "is 6; expected from 0 to 5",
        ),
        (
            "actual_delay_cycles = 6",
            "drives.actual_delay_cycles",
            "is 6; expected from 0 to 5",
        ),
        (
            "quick_stop_m_per_s2 = nan",
            "drives.quick_stop_m_per_s2",
            "is NaN",
        ),
        (
            "following_error_um = 0.0",
            "drives.following_error_um",
            "expected from 1 to",
        ),
        (
            "following_error_ms = 0",
            "drives.following_error_ms",
            "expected from 1 to",
        ),
        (
            "encoder_counts_per_turn = 0",
            "drives.encoder_counts_per_turn",
            "expected from 256 to",
        ),
        (
            "metres_per_turn = -0.01",
            "drives.metres_per_turn",
            "is -0.01",
        ),
        ("backlash_um = inf", "drives.backlash_um", "is inf"),
        ("friction_n = -1.0", "drives.friction_n", "is -1"),
        (
            "friction_n = 50.0\nstiction_n = 40.0",
            "drives.stiction_n",
            "is 40; expected from 50",
        ),
        (
            "velocity_feed_forward_percent = 121.0",
            "drives.velocity_feed_forward_percent",
            "from 0 to 120",
        ),
        ("peak_seconds = 61.0", "drives.peak_seconds", "is 61"),
        (
            "position_integral_ms = 50.0",
            "drives.position_integral_ms",
            "AX5000 has no integral",
        ),
        (
            "bias_permille = 100",
            "drives.bias_permille",
            "no such pair",
        ),
        (
            "profile = \"ax2000\"",
            "axes.velocity.max_um_s[0]",
            "AX2000 (drives.profile) takes no velocity offsets",
        ),
    ] {
        let error = AnyRobotFile::parse("x.toml", &with(L2, drives)).unwrap_err();
        let text = error.to_string();
        assert_eq!(
            (&*error.file, &*error.key),
            ("x.toml", key),
            "{drives}: {text}"
        );
        assert!(
            error.reason.contains(reason) && text.lines().count() == 1,
            "{drives}: {text}"
        );
    }
    let torque = L2.replace("max_permille = [50", "max_permille = [1001");
    assert!(
        AnyRobotFile::parse("x.toml", &torque).is_ok(),
        "ideal drives take it"
    );
    let error = AnyRobotFile::parse("x.toml", &with(&torque, "")).unwrap_err();
    assert_eq!(error.key, "axes.torque.max_permille[0]");
    // The F1 has pairs.
    assert!((settings(&with(F1, "bias_permille = 100")).bias - 0.1).abs() < 1e-12);
}

/// The L2 with drives that take velocities, slow enough and with room to stop.
fn velocity(keys: &str) -> String {
    let wide = L2
        .replacen(
            "nominal_step_um = [2000.0, 2000.0, 2000.0]",
            "nominal_step_um = [600.0, 600.0, 600.0]",
            1,
        )
        .replacen(
            "[[-0.51, 2.01], [-2.01, 0.51], [-0.51, 2.01]]",
            "[[-0.53, 2.03], [-2.03, 0.53], [-0.53, 2.03]]",
            1,
        );
    with(&wide, &format!("interface = \"velocity\"\n{keys}"))
}

#[test]
fn position_loops_are_made_for_the_latency_of_the_drives() {
    let AnyRobotFile::L2(robot) = AnyRobotFile::parse("x.toml", &velocity("")).unwrap() else {
        panic!("an L2")
    };
    let [loops, ..] = robot.position_loops.unwrap();
    let values = *loops.values();
    // 80.2 1/s, 100 %, 40 kg at 1 kN.
    assert_eq!(
        (
            values.gain,
            values.velocity_feed_forward,
            values.torque_feed_forward
        ),
        (5_259, 1_024, 2_621)
    );
    assert_eq!(
        (
            values.lag,
            values.window_nm,
            values.window_ticks,
            values.integral
        ),
        (3, 2_000_000, 10, 0)
    );
    let velocity_limits = (
        values.velocity.max(),
        values.velocity.step(),
        values.velocity.accel(),
        values.velocity.ramp(),
    );
    assert_eq!(velocity_limits, (600_000, 20_000, 40_000, 10_000));
    for (delay, gain, lag) in [(0, 9_287, 1), (2, 3_668, 5)] {
        let keys = format!("command_delay_cycles = {delay}\nactual_delay_cycles = {delay}");
        let AnyRobotFile::L2(robot) = AnyRobotFile::parse("x.toml", &velocity(&keys)).unwrap()
        else {
            panic!("an L2")
        };
        let values = *robot.position_loops.unwrap()[2].values();
        assert_eq!((values.gain, values.lag), (gain, lag));
    }
    // Velocity offsets are the loop's, for any drive.
    assert!(AnyRobotFile::parse("x.toml", &velocity("profile = \"ax2000\"")).is_ok());
    for robot in [RobotFile::builtin_l2().unwrap().position_loops, None] {
        assert_eq!(robot, None);
    }
}

/// The same with keys of `[position_loop]`.
fn with_loop(keys: &str) -> String {
    velocity(&format!("\n[position_loop]\n{keys}"))
}

#[test]
fn velocities_are_refused_where_a_stop_would_take_too_long() {
    let narrow = velocity("").replacen("[-0.53, 2.03]", "[-0.51, 2.01]", 1);
    let fast = velocity("").replacen(
        "nominal_step_um = [600.0, 600.0,",
        "nominal_step_um = [600.0, 600.1,",
        1,
    );
    for (text, key, reason) in [
        (
            narrow,
            "axes.machine_travel_m[0]",
            "leaves 10.0 mm beyond nominal_travel_m; a stop by the drives takes 19.8 mm",
        ),
        (
            fast,
            "axes.nominal_step_um[1]",
            "lets the path move at 0.6001 m/s, faster than position_loop.max_m_per_s (0.6)",
        ),
        (
            velocity("watchdog_cycles = 11"),
            "drives.watchdog_cycles",
            "is 11; expected from 1 to 10 (drives.interface is \"velocity\")",
        ),
        (
            velocity("quick_stop_m_per_s2 = 5.0"),
            "axes.machine_travel_m[0]",
            "a stop by the drives takes 37.8 mm",
        ),
        (
            velocity("following_error_um = 16001.0"),
            "drives.following_error_um",
            "expected from 1 to 16000",
        ),
        (
            velocity("command_delay_cycles = 5\nactual_delay_cycles = 5"),
            "drives.actual_delay_cycles",
            "is 5, with drives.command_delay_cycles 10 together; a position loop outside bears 9",
        ),
        (
            with_loop("gain_per_s = 130.0"),
            "position_loop.gain_per_s",
            "is 130; with latencies of 1 and 1 cycles (drives) it must be at most 125.0",
        ),
        (
            with_loop("gain_per_s = 0.0"),
            "position_loop.gain_per_s",
            "is 0; expected from 0.1",
        ),
        (
            with_loop("gain = 80.0"),
            "position_loop.gain",
            "unknown field",
        ),
        (
            with_loop("velocity_feed_forward_percent = 120.0"),
            "position_loop.velocity_feed_forward_percent",
            "from 0 to 119",
        ),
        (
            with_loop("torque_feed_forward = -1.0"),
            "position_loop.torque_feed_forward",
            "is -1; expected from 0 to 499",
        ),
        (
            with_loop("integral_ms = 0.5"),
            "position_loop.integral_ms",
            "expected from 1 to",
        ),
        (
            with_loop("integral_max_mm_per_s = nan"),
            "position_loop.integral_max_mm_per_s",
            "is NaN",
        ),
        (
            with_loop("max_m_per_s = 0.0"),
            "position_loop.max_m_per_s",
            "expected from 0.001",
        ),
        (
            with_loop("max_m_per_s2 = 11.0"),
            "position_loop.max_m_per_s2",
            "it must be at least 12, 1.2 times position_loop.path_m_per_s2",
        ),
        (
            with_loop("stop_m_per_s2 = 21.0"),
            "position_loop.stop_m_per_s2",
            "is 21, above position_loop.max_m_per_s2 (20)",
        ),
        (
            with_loop("path_m_per_s2 = 0.0"),
            "position_loop.path_m_per_s2",
            "expected from 0.1",
        ),
        (
            with(L2, "\n[position_loop]"),
            "position_loop",
            "set drives.interface = \"velocity\", or remove it",
        ),
        (
            L2.replacen("[simulation]", "[position_loop]\n[simulation]", 1),
            "position_loop",
            "for drives that take velocities",
        ),
    ] {
        let error = AnyRobotFile::parse("x.toml", &text).unwrap_err();
        let all = error.to_string();
        assert_eq!((&*error.file, &*error.key), ("x.toml", key), "{all}");
        assert!(
            error.reason.contains(reason) && all.lines().count() == 1,
            "{all}"
        );
    }
}

#[test]
fn machines_that_take_positions_refuse_velocities_by_file_and_key() {
    let folder = Folder::new("velocity");
    folder.write("v.toml", &velocity(""));
    for (more, reason) in [
        (&["--plan", "plan.toml"][..], "--plan needs \"position\""),
        (
            &["--plant", "ethercat:emulated"],
            "drives over EtherCAT (--plant) take \"position\"",
        ),
        (
            &["--plant", "ethercat:eth9"],
            "drives over EtherCAT (--plant) take \"position\"",
        ),
        (
            &["--plant", "socket:127.0.0.1:1", "--pace", "lockstep"],
            "a simulator behind a socket (--plant) takes \"position\"",
        ),
    ] {
        let said = folder
            .run(&[&["serve", "--robot", "v.toml"], more].concat())
            .failure(1);
        assert!(
            said.contains(&format!(
                "v.toml: drives.interface: is \"velocity\"; {reason}"
            )),
            "{said}"
        );
    }
}
