//! Robot files and buses that do not fit each other: refused by file, key and reason.

use gantry_tau::ethercat::{EmulatedMachine, EthercatError};
use gantry_tau_ethercat::BringUpError;
use gantry_tau_ethercat::emulation::{Chain, Drive};
use gantry_tau_machine::model::{L2, MachineKind};
use gantry_tau_machine::robot_file::{AnyRobotFile, Ethercat, RobotFile, text_of};
use gantry_tau_sim::machine::SimulatedMachine;

use super::{bus, open, section};

/// The L2's file with a bus.
fn file(change: impl Fn(&str) -> String) -> Result<AnyRobotFile, String> {
    let mut bus = "[ethercat]\ncycle_us = 1000\nwatchdog_cycles = 5\n".to_owned();
    for alias in 1_001..1_004 {
        bus += &format!(
            "[[ethercat.drives]]\nalias = {alias}\nvendor = 0x0A11\nproduct = 1\ncounts_per_q = 104857600.0\nsign = 1\n\
             zero_counts = 0\ncounts_per_turn = 1048576\n"
        );
    }
    let text = format!("{}\n{}", text_of("l2").unwrap(), change(&bus));
    AnyRobotFile::parse("bus.toml", &text).map_err(|error| error.to_string())
}

#[test]
fn a_section_is_read() {
    let Ok(AnyRobotFile::L2(robot)) = file(str::to_owned) else {
        panic!("refused")
    };
    let section = robot.ethercat.unwrap();
    assert_eq!((section.watchdog_cycles, section.drives.len()), (5, 3));
    assert_eq!(section.drives[2].alias, Some(1_003));
    assert_eq!(
        section.drives[0].velocity_unit_counts_per_s.to_bits(),
        1.0_f64.to_bits()
    );
}

#[test]
fn sections_are_refused_by_key_and_reason() {
    for (from, to, key, reason) in [
        (
            "cycle_us = 1000",
            "cycle_us = 500",
            "ethercat.cycle_us",
            "is 500",
        ),
        (
            "watchdog_cycles = 5",
            "watchdog_cycles = 100",
            "ethercat.watchdog_cycles",
            "from 1 to 10",
        ),
        (
            "watchdog_cycles = 5",
            "watchdog_cycles = 0",
            "ethercat.watchdog_cycles",
            "from 1 to 10",
        ),
        (
            "alias = 1002",
            "",
            "ethercat.drives[1].alias",
            "either alias or position",
        ),
        (
            "alias = 1002",
            "alias = 1001",
            "ethercat.drives[0].alias",
            "another motor",
        ),
        (
            "alias = 1003",
            "alias = 0",
            "ethercat.drives[2].alias",
            "no alias",
        ),
        ("sign = 1", "sign = 2", "ethercat.drives[0].sign", "1 or -1"),
        (
            "counts_per_q = 104857600.0",
            "counts_per_q = 100.0",
            "ethercat.drives[0].counts_per_q",
            "10^6 to 10^12",
        ),
        (
            "counts_per_q = 104857600.0",
            "counts_per_q = nan",
            "ethercat.drives[0].counts_per_q",
            "10^6 to 10^12",
        ),
        (
            "counts_per_q = 104857600.0",
            "counts_per_q = 1e10",
            "ethercat.drives[0].counts_per_q",
            "32 bits",
        ),
        (
            "sign = 1",
            "sign = 1\nvelocity_unit_counts_per_s = 0.0",
            "ethercat.drives[0].velocity_unit_counts_per_s",
            "from 0.000001 to 1000000",
        ),
        (
            "sign = 1",
            "sign = 1\nvelocity_unit_counts_per_s = 2e6",
            "ethercat.drives[0].velocity_unit_counts_per_s",
            "from 0.000001 to 1000000",
        ),
        ("vendor = 0x0A11", "", "vendor", "missing field"),
        ("sign = 1", "sign = 1\nsing = 1", "sing", "unknown field"),
    ] {
        let error = file(|bus| bus.replacen(from, to, 1)).unwrap_err();
        assert!(
            error.starts_with("bus.toml: ") && error.contains(key) && error.contains(reason),
            "{key}: {error}"
        );
    }
    let error =
        file(|bus| bus.rsplit_once("[[ethercat.drives]]").unwrap().0.to_owned()).unwrap_err();
    assert!(
        error.contains("lists 2 drives, [motors] has 3 motors"),
        "{error}"
    );
}

/// Changes the file's section against the bus, and returns the error of opening it.
fn refusal(change: impl FnOnce(&mut Ethercat)) -> EthercatError {
    let robot = RobotFile::builtin_l2().unwrap();
    let bus = bus::<_, 3, 3>(&robot);
    let mut section = section(&robot);
    change(&mut section);
    open(&robot, &section, &bus, 0.0).unwrap_err()
}

#[test]
fn wrong_counts_signs_and_zeros_are_found_by_the_position() {
    let changes: [fn(&mut Ethercat); 3] = [
        |section| section.drives[0].counts_per_q *= 0.2,
        |section| section.drives[0].sign = -1,
        |section| section.drives[0].zero_counts = 400_000_000,
    ];
    for change in changes {
        let text = refusal(change).to_string();
        assert!(
            text.contains("ethercat.drives[0]") && text.contains("outside the travel"),
            "{text}"
        );
    }
    let robot = RobotFile::builtin_f1().unwrap();
    let bus = bus::<_, 6, 9>(&robot);
    let mut section = section(&robot);
    section.drives[3].zero_counts = 104_858;
    let text = open(&robot, &section, &bus, 0.0).unwrap_err().to_string();
    assert!(
        text.contains("the motors of axis 1 stand 1000 um apart"),
        "{text}"
    );
}

/// Opens a bus whose drives were handled before; returns the error.
fn refused_bus<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    handle: impl Fn(&mut Chain<EmulatedMachine<SimulatedMachine<N, M>, N, M>>),
) -> EthercatError {
    let bus = bus::<K, N, M>(robot);
    handle(&mut bus.bench().chain);
    open(robot, &section(robot), &bus, 0.0).unwrap_err()
}

/// As [`refused_bus`], of the second drive of an L2.
fn refused_drive(robot: &RobotFile<L2, 3>, handle: impl Fn(&mut Drive)) -> EthercatError {
    refused_bus::<_, 3, 3>(robot, |chain| {
        handle(chain.subdevice_mut(1).unwrap().drive_mut());
    })
}

/// Every error of a bus names the file, the key to change and the reason.
#[test]
fn errors_of_the_bus_name_file_key_and_reason() {
    let l2 = RobotFile::builtin_l2().unwrap();
    let errors = [
        (
            refusal(|section| section.drives[1].product = 2),
            "ethercat.drives[1].product",
            "at alias 1002 is product 0x1",
        ),
        (
            refusal(|section| section.drives[2].vendor = 2),
            "ethercat.drives[2].vendor",
            "expected 0x1 of 0x2",
        ),
        (
            refusal(|section| section.drives[1].serial = Some(7)),
            "ethercat.drives[1].serial",
            "expected 7",
        ),
        (
            refusal(|section| section.drives[1].alias = Some(9)),
            "ethercat.drives[1].alias",
            "no drive at alias 9",
        ),
        (
            refusal(|section| {
                (section.drives[0].alias, section.drives[0].position) = (None, Some(5))
            }),
            "ethercat.drives[0].position",
            "no drive at position 5",
        ),
        (
            // Drive 1 by its position, which is that of the alias of another motor.
            refusal(|section| {
                (section.drives[0].alias, section.drives[0].position) = (None, Some(1))
            }),
            "ethercat.drives[0].position",
            "is not one drive for one motor",
        ),
        (
            refusal(|section| section.drives[2].counts_per_turn = Some(1 << 17)),
            "ethercat.drives[2].counts_per_turn",
            "1048576 counts per turn, expected 131072",
        ),
        (
            refusal(|section| section.watchdog_cycles = 100),
            "ethercat.watchdog_cycles",
            "expected 1 to 10",
        ),
        (
            refused_drive(&l2, |drive| drive.remove_object(0x608F)),
            "ethercat.drives[1].counts_per_turn",
            "lacks object 608Fh",
        ),
        (
            refused_drive(&l2, |drive| drive.remove_object(0x60B1)),
            "axes.velocity.max_um_s",
            "lacks object 60B1h",
        ),
        (
            refused_drive(&l2, |drive| drive.remove_object(0x60B2)),
            "axes.torque.max_permille",
            "lacks object 60B2h",
        ),
        (
            refused_drive(&l2, |drive| drive.remove_object(0x607A)),
            "ethercat.drives[1]",
            "lacks object 607Ah",
        ),
        (
            refused_drive(&l2, |drive| {
                drive.set_object(0x607D, 1, -1_000);
                drive.set_object(0x607D, 2, 1_000);
            }),
            "axes.machine_travel_m",
            "beyond the drive's software limits (607Dh)",
        ),
        (
            refused_drive(&l2, |drive| drive.set_object(0x60B0, 0, 1_000_000_000)),
            "ethercat.drives[1]",
            "its offsets are out of range",
        ),
        (
            refused_bus::<_, 3, 3>(&l2, |chain| {
                chain.subdevice_mut(2).unwrap().refuse(4, 0x0024)
            }),
            "ethercat.drives[2]",
            "motor 2: the drive refused to leave state 2: AL status code 0x0024",
        ),
        (
            refused_bus::<_, 3, 3>(&l2, |chain| chain.cut_behind(0)),
            "ethercat",
            "no SubDevice answers",
        ),
    ];
    for (error, key, reason) in errors {
        let text = error.to_string();
        let start = format!("robots/l2.toml (built in): {key}: ");
        assert!(
            text.starts_with(&start) && text.contains(reason),
            "{key}, {reason}: {text}"
        );
    }
}

/// Watchdogs that do not read back, or that the outputs do not trigger: emulated buses of a robot
/// file have none of them.
#[test]
fn errors_of_the_watchdog_name_its_key() {
    let robot = RobotFile::builtin_l2().unwrap();
    for (is_writable, has_watchdog, reason) in [
        (
            false,
            true,
            "motor 1: the watchdog reads 100000 us after 5000 us were written",
        ),
        (
            true,
            false,
            "motor 1: its outputs do not trigger the watchdog",
        ),
    ] {
        let bus = bus::<_, 3, 3>(&robot);
        bus.bench()
            .chain
            .subdevice_mut(1)
            .unwrap()
            .set_watchdog(is_writable, has_watchdog);
        let text = open(&robot, &section(&robot), &bus, 0.0)
            .unwrap_err()
            .to_string();
        let start = "robots/l2.toml (built in): ethercat.watchdog_cycles: ";
        assert!(text.starts_with(start) && text.contains(reason), "{text}");
    }
}

/// The drives of a pair, of which one has an offset in force: no nominal reference puts both where
/// they stand.
#[test]
fn a_pair_with_different_offsets_in_force() {
    let robot = RobotFile::builtin_f1().unwrap();
    let axis_of_motor = &robot.motors.axis_of_motor;
    let second = (1..9)
        .find(|motor| axis_of_motor[*motor] == axis_of_motor[motor - 1])
        .unwrap();
    for object in [0x60B0, 0x60B1, 0x60B2] {
        let refused = refused_bus::<_, 6, 9>(&robot, |chain| {
            chain
                .subdevice_mut(second)
                .unwrap()
                .drive_mut()
                .set_object(object, 0, 250_000);
        });
        let text = refused.to_string();
        let start = format!("robots/f1.toml (built in): ethercat.drives[{second}]: ");
        assert!(
            text.starts_with(&start) && text.contains("different offsets in force"),
            "{object:04X}h: {text}"
        );
    }
    // A difference as two roundings make it is none.
    let bus = bus::<_, 6, 9>(&robot);
    bus.bench()
        .chain
        .subdevice_mut(second)
        .unwrap()
        .drive_mut()
        .set_object(0x60B0, 0, 1);
    open(&robot, &section(&robot), &bus, 0.0).unwrap();
}

#[test]
fn another_bus_is_refused_by_the_motor() {
    let error = refusal(|section| section.drives[1].product = 2);
    assert!(matches!(
        error,
        EthercatError::BringUp {
            error: BringUpError::Identity { motor: 1, .. },
            ..
        }
    ));
    let error = refusal(|section| section.drives[2].counts_per_turn = Some(1 << 17));
    assert!(matches!(
        error,
        EthercatError::BringUp {
            error: BringUpError::Encoder { motor: 2, .. },
            ..
        }
    ));
    let robot = RobotFile::builtin_l2().unwrap();
    let bus = bus::<_, 3, 3>(&robot);
    bus.bench()
        .chain
        .drives_mut()
        .for_each(|drive| drive.remove_object(0x60B1));
    let text = open(&robot, &section(&robot), &bus, 0.0)
        .unwrap_err()
        .to_string();
    assert!(
        text.contains("60B1h") && text.contains("axes.velocity.max_um_s"),
        "{text}"
    );
    // With the channel off, the drive will do.
    let Ok(AnyRobotFile::L2(robot)) = file(|bus| bus.to_owned()).map_err(|_| ()) else {
        panic!()
    };
    let quiet = text_of("l2")
        .unwrap()
        .replace("max_um_s = [5000, 5000, 5000]", "max_um_s = [0, 0, 0]");
    let AnyRobotFile::L2(quiet) = AnyRobotFile::parse("quiet.toml", &quiet).unwrap() else {
        panic!()
    };
    assert!(robot.ethercat.is_some());
    open(&*quiet, &section(&*quiet), &bus, 0.0).unwrap();
}

#[test]
fn software_limits_that_are_narrower_than_the_travel() {
    let robot = RobotFile::builtin_l2().unwrap();
    let bus = bus::<_, 3, 3>(&robot);
    {
        let mut bench = bus.bench();
        let drive = bench.chain.subdevice_mut(0).unwrap().drive_mut();
        // -0.5 m to 2.01 m, of a machine that goes from -0.51 m.
        drive.set_object(0x607D, 1, -52_428_800);
        drive.set_object(0x607D, 2, 210_763_776);
    }
    let error = open(&robot, &section(&robot), &bus, 0.0).unwrap_err();
    assert!(
        matches!(
            error,
            EthercatError::BringUp {
                error: BringUpError::SoftwareLimits { motor: 0, .. },
                ..
            }
        ),
        "{error}"
    );
}
