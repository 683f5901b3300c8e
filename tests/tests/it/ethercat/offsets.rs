//! Offsets of a client reach the drives' objects, without an allocation in the cycle.

use gantry_tau_core::control::message::{Mode, Phase};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;

use super::{Server, bus};

/// Counts of 20 µm at 2^20 counts per 10 mm.
const COUNTS: i32 = 2_097;

fn offsets_reach_the_drives<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    sum: bool,
) {
    let bus = bus::<K, N, M>(robot);
    if sum {
        bus.bench()
            .chain
            .drives_mut()
            .for_each(|drive| drive.remove_object(0x60B0));
    }
    let start: Vec<i64> = bus
        .bench()
        .chain
        .drives()
        .map(|drive| drive.motor().position)
        .collect();
    let mut server = Server::on(robot, &bus, 0.0);
    let mut client = server.client();
    server.counts_allocations = true;
    for _ in 0..300 {
        let row = server.answered(&mut client, Mode::Obtain, 20_000);
        assert_eq!((row.state.phase, row.failure), (Phase::Obtain, None));
        // Rounded to counts of 9.5 nm at both ends.
        assert!(server.largest_step_nm() <= i64::from(robot.limits[0].limits.position.step()) + 20);
    }
    let bench = bus.bench();
    for (motor, drive) in bench.chain.drives().enumerate() {
        // Every other drive counts backwards.
        let sign = if motor % 2 == 0 { 1 } else { -1 };
        let [target, offset] = [0x607A, 0x60B0].map(|object| i64::from(drive.object(object, 0)));
        let away = sign * i64::from(COUNTS);
        let expected = if sum {
            (start[motor] + away, 0)
        } else {
            (start[motor], away)
        };
        assert!(
            (target - expected.0).abs() <= 1 && offset == expected.1,
            "{motor}: {target} {offset} {expected:?}"
        );
        // The drive follows, and its position comes back with the axis' sign.
        assert!(
            (drive.motor().position - start[motor] - away).abs() < 110,
            "{motor}"
        );
    }
    drop(bench);
    let state = server.answered(&mut client, Mode::Obtain, 20_000).state;
    for axis in state.axes {
        let off = axis.actual.position.0 - axis.nominal.0;
        assert!((off - 20_000).abs() < 1_000, "{off}");
    }
}

#[test]
fn with_60b0_on_three_axes() {
    offsets_reach_the_drives::<_, 3, 3>(&RobotFile::builtin_l2().unwrap(), false);
}

#[test]
fn with_60b0_on_six_axes_and_nine_motors() {
    offsets_reach_the_drives::<_, 6, 9>(&RobotFile::builtin_f1().unwrap(), false);
}

#[test]
fn without_60b0_the_sum_reaches_607a() {
    offsets_reach_the_drives::<_, 3, 3>(&RobotFile::builtin_l2().unwrap(), true);
    offsets_reach_the_drives::<_, 6, 9>(&RobotFile::builtin_f1().unwrap(), true);
}

/// The nominal path of the plant, through the drives, with the offsets of a client on it.
#[test]
fn a_moving_path_is_followed() {
    let robot = RobotFile::builtin_l2().unwrap();
    let bus = bus::<_, 3, 3>(&robot);
    let mut server = Server::on(&robot, &bus, 0.02);
    let before = server.positions();
    let mut client = server.client();
    let mut most = 0;
    for _ in 0..400 {
        let row = server.answered(&mut client, Mode::Obtain, 50_000);
        assert_eq!(row.failure, None);
        most = most.max(server.largest_step_nm());
    }
    // 0.1 m/s is 100 µm a cycle; the offset adds 5 µm while it grows.
    assert!((90_000..=106_000).contains(&most), "{most}");
    let way: Vec<i64> = server
        .positions()
        .iter()
        .zip(before)
        .map(|(now, then)| (now - then).abs())
        .collect();
    assert!(
        way.iter().all(|counts| *counts > 1_900_000),
        "20 mm are 2.1 million counts: {way:?}"
    );
}
