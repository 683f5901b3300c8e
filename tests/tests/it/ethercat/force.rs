//! A force sensor on the bus of the drives: the client compensates what it measures, and leaves
//! when it falls silent, while the drives go on.

use std::sync::Arc;

use gantry_tau::ethercat::{EthercatPlant, MachineWire as _, emulated_bus};
use gantry_tau_client::{ClientControls, ClientError};
use gantry_tau_core::control::message::{Cause, Phase};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{
    Clocks, Ethercat, EthercatForceSensor, ForceSensorKind, RobotFile,
};
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::record::TickRecord;
use gantry_tau_sim::load_generator::{Load, load_generator};
use gantry_tau_tests::{client_session, short_demo};

use super::{Server, open, parse_bus, section};

/// Largest errors of the emulated sensor: half a count, N and N m, and rounding.
const HALF_A_COUNT: [f64; 2] = [0.5e-5 + 1e-9, 0.5e-6 + 1e-9];

/// A load whose compensation is some ten micrometres.
const PULL: Load = Load {
    step: 0,
    force_n: [100.0, 0.0, 0.0],
    moment_nm: [0.0; 3],
};

/// The emulated drives of a machine, and a force sensor behind them.
pub(super) fn with_sensor<K, const N: usize>(robot: &RobotFile<K, N>) -> Ethercat {
    let drives = section(robot);
    Ethercat {
        force_sensor: Some(EthercatForceSensor {
            alias: None,
            position: u16::try_from(drives.drives.len()).ok(),
            vendor: 0x732,
            product: 0x2648_3052,
            kind: ForceSensorKind::Ati,
            calibration: 1,
        }),
        ..drives
    }
}

pub(super) fn compensates<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: RobotFile<K, N>,
    clocks: Clocks,
) {
    let folder = tempfile::tempdir().unwrap();
    let complaints = short_demo::complaints(
        folder.path(),
        robot,
        |robot, tool| {
            let section = Ethercat {
                clocks,
                ..with_sensor(robot)
            };
            let bus = emulated_bus::<_, N, M>(robot, &section, tool)?;
            EthercatPlant::<_, N, M>::open(robot, &section, bus, |_| Motion::Hold)
        },
        |cycle, _| Ok(cycle),
    );
    assert_eq!(complaints, Vec::<String>::new());
}

#[test]
fn what_it_measures_is_compensated_within_the_demos_tolerance() {
    compensates::<_, 3, 3>(RobotFile::builtin_l2().unwrap(), Clocks::Free);
    compensates::<_, 6, 9>(RobotFile::builtin_f1().unwrap(), Clocks::Free);
}

#[test]
fn with_distributed_clocks_as_well() {
    compensates::<_, 3, 3>(RobotFile::builtin_l2().unwrap(), Clocks::Sync0);
}

/// A sample is that of the exchange before, or none: it has the age of the drives' values.
#[test]
fn a_sample_is_of_the_last_exchange() {
    let robot = RobotFile::builtin_l2().unwrap();
    let section = with_sensor(&robot);
    let (mut hand, tool) = load_generator();
    let bus = emulated_bus::<_, 3, 3>(&robot, &section, tool).unwrap();
    let mut server = Server::with(&robot, &section, &bus, 0.0);
    let first = server.tick().tool.unwrap();
    assert!(
        first.sensor.iter().all(|component| component.is_nan()),
        "nothing was read yet"
    );
    server.counts_allocations = true;
    let (mut read, mut without) = (0, 0);
    for tick in 0..500_u32 {
        hand.set(&Load {
            force_n: [f64::from(tick) / 10.0, 0.0, -3.0],
            moment_nm: [0.0, 0.5, 0.0],
            ..Load::default()
        })
        .unwrap();
        match tick % 50 {
            20 => bus.bench().chain.bypass(Some(3)),
            25 => bus.bench().chain.bypass(None),
            _ => {}
        }
        // What the sensor showed in the exchange that ended the last tick.
        let shown = bus.clone().tool().unwrap().sensor;
        let row = server.tick();
        let tool = row.tool.unwrap();
        assert!(!row.plant_failed, "{tick}");
        if tool.sensor.iter().any(|component| component.is_nan()) {
            without += 1;
            continue;
        }
        read += 1;
        assert_eq!(tool.sensor_age, 1);
        for (index, (found, shown)) in tool.sensor.iter().zip(shown).enumerate() {
            let limit = HALF_A_COUNT[index / 3];
            assert!((found - shown).abs() <= limit, "{tick}: {found}, {shown}");
        }
    }
    assert!(read > 300 && without >= 50, "{read}, {without}");
}

/// The silence rule of the client ends the session, with offsets in force; the drives run, and no
/// reference steps.
#[test]
fn an_unplugged_sensor_ends_the_session_and_no_drive() {
    let mut robot = RobotFile::builtin_l2().unwrap();
    robot.sensor.tare_samples = 50;
    let step_nm = i64::from(robot.limits[0].limits.position.step());
    let section = with_sensor(&robot);
    let (mut hand, tool) = load_generator();
    let bus = emulated_bus::<_, 3, 3>(&robot, &section, tool).unwrap();
    let plant = open::<_, 3, 3>(&robot, &section, &bus, 0.0).unwrap();
    let cycle = client_session::cycle::<_, 3, 3, _>(&robot, plant);
    let controls: Arc<ClientControls> = Arc::default();
    let handle = bus.clone();
    let mut obtained = 0_u32;
    let (result, rows) = client_session::play(robot, cycle, None, &controls, |row| {
        obtained += u32::from(row.state.phase == Phase::Obtain);
        match obtained {
            10 => hand.set(&PULL).unwrap(),
            1_500 => handle.bench().chain.bypass(Some(3)),
            _ => {}
        }
    });
    match result {
        Err(ClientError::SensorSilent(reason)) => {
            assert!(reason.contains("none has come for too long"), "{reason}");
        }
        other => panic!("{other:?}"),
    }
    let last = rows.last().unwrap();
    assert_eq!(last.ended, Some(Cause::Goodbye), "it leaves in good order");
    assert!(rows.iter().all(|row| !row.plant_failed), "the drives go on");
    let largest_nm = |row: &TickRecord<3>| {
        let offsets = row
            .state
            .axes
            .iter()
            .map(|axis| axis.offsets.position.0.abs());
        offsets.max().unwrap()
    };
    assert!(largest_nm(last) > 20_000, "{}", largest_nm(last));
    for pair in rows.windows(2) {
        for (now, before) in pair[1].references.iter().zip(&pair[0].references) {
            let way_nm = now.position.0 - before.position.0;
            assert!(
                way_nm.abs() <= step_nm,
                "{:?}: {way_nm}",
                pair[1].state.tick
            );
        }
    }
}

/// Each wrong key of the section, by its name; and a sensor that is not where the emulated bus has
/// it.
#[test]
fn a_section_that_cannot_be_is_refused_by_its_key() {
    let parse = |sensor: &str| {
        parse_bus(&format!(
            "[ethercat.force_sensor]\nvendor = 0x732\nproduct = 0x26483052\nkind = \"ati\"\n{sensor}"
        ))
    };
    assert!(parse("position = 3\ncalibration = 15").is_ok());
    for (sensor, said) in [
        ("", "force_sensor.alias: expected either alias or position"),
        (
            "position = 3\nalias = 7",
            "force_sensor.alias: expected either",
        ),
        ("alias = 0", "force_sensor.alias: is 0"),
        (
            "position = 1",
            "force_sensor.alias: names the drive of a motor",
        ),
        (
            "position = 3\ncalibration = 16",
            "force_sensor.calibration: is 16",
        ),
        ("position = 3\nbias = 1", "unknown field `bias`"),
    ] {
        let error = parse(sensor).unwrap_err();
        assert!(error.contains(said), "{sensor}: {error}");
    }
    let robot = RobotFile::builtin_l2().unwrap();
    let mut section = with_sensor(&robot);
    if let Some(sensor) = &mut section.force_sensor {
        sensor.position = Some(0);
    }
    let (_hand, tool) = load_generator();
    let error = emulated_bus::<_, 3, 3>(&robot, &section, tool).unwrap_err();
    assert!(
        error.to_string().contains("ethercat.force_sensor.position"),
        "{error}"
    );
}
