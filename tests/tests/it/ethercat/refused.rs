//! Robot files and buses that do not fit each other: refused by file, key and reason.

use gantry_tau::ethercat::EthercatError;
use gantry_tau::robot_file::{AnyRobotFile, Ethercat, RobotFile, text_of};
use gantry_tau_ethercat::BringUpError;

use super::{bus, open, section};

/// The L2's file with a bus.
fn file(change: impl Fn(&str) -> String) -> Result<AnyRobotFile, String> {
    let drive = |index: u16| {
        format!(
            "[[ethercat.drives]]\nalias = {}\nvendor = 0x0A11\nproduct = 1\ncounts_per_q = 104857600.0\nsign = 1\n\
             zero_counts = 0\ncounts_per_turn = 1048576\n",
            1_001 + index
        )
    };
    let drives: String = (0..3).map(drive).collect();
    let bus = format!("[ethercat]\ncycle_us = 1000\nwatchdog_cycles = 5\n{drives}");
    let text = format!("{}\n{}", text_of("l2").unwrap(), change(&bus));
    AnyRobotFile::parse("bus.toml", &text).map_err(|error| error.to_string())
}

#[test]
fn a_section_is_read() {
    let Ok(AnyRobotFile::L2(robot)) = file(str::to_owned) else { panic!("refused") };
    let section = robot.ethercat.unwrap();
    assert_eq!((section.watchdog_cycles, section.drives.len()), (5, 3));
    assert_eq!(section.drives[2].alias, Some(1_003));
    assert_eq!(section.drives[0].velocity_unit_counts_per_s.to_bits(), 1.0_f64.to_bits());
}

#[test]
fn sections_are_refused_by_key_and_reason() {
    for (from, to, key, reason) in [
        ("cycle_us = 1000", "cycle_us = 500", "ethercat.cycle_us", "is 500"),
        ("watchdog_cycles = 5", "watchdog_cycles = 100", "ethercat.watchdog_cycles", "from 1 to 10"),
        ("watchdog_cycles = 5", "watchdog_cycles = 0", "ethercat.watchdog_cycles", "from 1 to 10"),
        ("alias = 1002", "", "ethercat.drives[1].alias", "either alias or position"),
        ("alias = 1002", "alias = 1001", "ethercat.drives[0].alias", "another motor"),
        ("alias = 1003", "alias = 0", "ethercat.drives[2].alias", "no alias"),
        ("sign = 1", "sign = 2", "ethercat.drives[0].sign", "1 or -1"),
        ("counts_per_q = 104857600.0", "counts_per_q = 100.0", "ethercat.drives[0].counts_per_q", "10^6 to 10^12"),
        ("counts_per_q = 104857600.0", "counts_per_q = nan", "ethercat.drives[0].counts_per_q", "10^6 to 10^12"),
        ("counts_per_q = 104857600.0", "counts_per_q = 1e10", "ethercat.drives[0].counts_per_q", "32 bits"),
        ("vendor = 0x0A11", "", "vendor", "missing field"),
        ("sign = 1", "sign = 1\nsing = 1", "sing", "unknown field"),
    ] {
        let error = file(|bus| bus.replacen(from, to, 1)).unwrap_err();
        assert!(error.starts_with("bus.toml: ") && error.contains(key) && error.contains(reason), "{key}: {error}");
    }
    let error = file(|bus| bus.rsplit_once("[[ethercat.drives]]").unwrap().0.to_owned()).unwrap_err();
    assert!(error.contains("lists 2 drives, [motors] has 3 motors"), "{error}");
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
        assert!(text.contains("ethercat.drives[0]") && text.contains("outside the travel"), "{text}");
    }
    let robot = RobotFile::builtin_f1().unwrap();
    let bus = bus::<_, 6, 9>(&robot);
    let mut section = section(&robot);
    section.drives[3].zero_counts = 104_858;
    let text = open(&robot, &section, &bus, 0.0).unwrap_err().to_string();
    assert!(text.contains("the motors of axis 1 stand 1000 um apart"), "{text}");
}

#[test]
fn another_bus_is_refused_with_the_file_and_the_motor() {
    let error = refusal(|section| section.drives[1].product = 2);
    assert!(matches!(error, EthercatError::BringUp { error: BringUpError::Identity { motor: 1, .. }, .. }));
    assert!(error.to_string().starts_with("robots/l2.toml (built in): [ethercat]: motor 1: at alias 1002"), "{error}");
    let error = refusal(|section| section.drives[2].counts_per_turn = Some(1 << 17));
    assert!(matches!(error, EthercatError::BringUp { error: BringUpError::Encoder { motor: 2, .. }, .. }));
    let robot = RobotFile::builtin_l2().unwrap();
    let bus = bus::<_, 3, 3>(&robot);
    bus.bench().chain.drives_mut().for_each(|drive| drive.remove_object(0x60B1));
    let text = open(&robot, &section(&robot), &bus, 0.0).unwrap_err().to_string();
    assert!(text.contains("60B1h") && text.contains("axes.velocity.max_um_s"), "{text}");
    // With the channel off, the drive will do.
    let Ok(AnyRobotFile::L2(robot)) = file(|bus| bus.to_owned()).map_err(|_| ()) else { panic!() };
    let quiet = text_of("l2").unwrap().replace("max_um_s = [5000, 5000, 5000]", "max_um_s = [0, 0, 0]");
    let AnyRobotFile::L2(quiet) = AnyRobotFile::parse("quiet.toml", &quiet).unwrap() else { panic!() };
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
        matches!(error, EthercatError::BringUp { error: BringUpError::SoftwareLimits { motor: 0, .. }, .. }),
        "{error}"
    );
}
