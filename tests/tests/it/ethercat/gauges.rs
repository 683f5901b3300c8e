//! Gauges on the bus of the drives: their lengths reach `experiment`'s link, and the drives go on without
//! them.

use gantry_tau::ethercat::{EmulatedBus, emulated_bus};
use gantry_tau_ethercat::emulation::Instrument;
use gantry_tau_machine::robot_file::{Ethercat, EthercatGauge, RobotFile};
use gantry_tau_server::links::gauges::{GaugePublisher, GaugeReader, Lengths};
use gantry_tau_sim::load_generator::load_generator;
use gantry_tau_system::dial::NEVER;
use gantry_tau_tests::server_fixture::LOOPBACK;
use gantry_tau_tests::wait_for;

use super::force::with_sensor;
use super::{Server, open, parse_bus};

const EL5101: u32 = 0x13ED_3052;
const EL5151: u32 = 0x141F_3052;

fn gauge(name: &str, position: u16, product: u32, sign: i8) -> EthercatGauge {
    EthercatGauge {
        name: name.to_owned(),
        alias: None,
        position: Some(position),
        product,
        um_per_count: 0.5,
        sign,
    }
}

/// Drives, a force sensor, and two gauges behind it.
fn section<K, const N: usize>(robot: &RobotFile<K, N>) -> Ethercat {
    let section = with_sensor(robot);
    let behind = u16::try_from(section.drives.len()).unwrap() + 1;
    Ethercat {
        gauges: vec![
            gauge("x", behind + 1, EL5151, -1),
            gauge("y", behind, EL5101, 1),
        ],
        ..section
    }
}

/// Moves the gauge at a position.
fn show(bus: &EmulatedBus<3, 3>, position: usize, counts: i64) {
    let mut bench = bus.bench();
    match bench.chain.instrument_mut(position).unwrap().device_mut() {
        Instrument::Encoder(terminal) => terminal.set_counts(counts),
        Instrument::Plain(_) | Instrument::Force(_) => panic!("no gauge"),
    }
}

#[test]
fn their_lengths_are_published_in_every_cycle() {
    let robot = RobotFile::builtin_l2().unwrap();
    let section = section(&robot);
    let (_hand, tool) = load_generator();
    let bus = emulated_bus::<_, 3, 3>(&robot, &section, tool).unwrap();
    let mut plant = open::<_, 3, 3>(&robot, &section, &bus, 0.0).unwrap();
    let link = GaugePublisher::bind(LOOPBACK).unwrap();
    let address = link.address().unwrap();
    plant.publish_gauges(link);
    let mut server = Server::of(&robot, &bus, plant);
    let mut reader = GaugeReader::connect(address, &NEVER).unwrap();
    // A start takes longer than the watchdogs of the terminals.
    for _ in 0..60 {
        let _row = server.tick();
    }
    server.counts_allocations = true;
    let mut last = None;
    let mut read = |server: &mut Server<3, 3>, is_it: &dyn Fn(&Lengths) -> bool| {
        wait_for("the lengths", || {
            let row = server.tick();
            assert!(!row.plant_failed);
            let latest = reader.latest().unwrap();
            if let Some(latest) = latest.filter(|latest| last != Some(latest.tick)) {
                assert!(last.is_none_or(|last| latest.tick > last), "ticks grow");
                last = Some(latest.tick);
                return is_it(&latest);
            }
            false
        });
    };
    read(&mut server, &|lengths| lengths.lengths_m() == [0.0, 0.0]);
    for count in [3_i32, -40_000, 2_000_000] {
        show(&bus, 4, count.into());
        show(&bus, 5, count.into());
        let length_m = f64::from(count) * 0.5e-6;
        read(&mut server, &|lengths| {
            let errors = lengths.lengths_m().iter().zip([-length_m, length_m]);
            errors
                .map(|(found, expected)| (found - expected).abs())
                .all(|error| error < 1e-12)
        });
    }
    // The last terminal is pulled off.
    bus.bench().chain.bypass(Some(5));
    read(&mut server, &|lengths| {
        let [x, y] = lengths.lengths_m() else {
            panic!("two gauges")
        };
        x.is_nan() && (y - 1.0).abs() < 1e-12
    });
    assert!(server.tick().tool.unwrap().sensor[0].is_finite());
}

/// Each wrong key, by its name; and a gauge that is not where the emulated bus has it.
#[test]
fn gauges_that_cannot_be_are_refused_by_their_keys() {
    let parse = |gauges: &str| {
        parse_bus(&format!(
            "[ethercat.force_sensor]\nposition = 3\nvendor = 0x732\nproduct = 0x26483052\nkind = \"ati\"\n{gauges}"
        ))
    };
    let good = "[[ethercat.gauges]]\nname = \"x\"\nposition = 4\nproduct = 0x13ED3052\num_per_count = 0.5\n";
    let second = good.replace("\"x\"", "\"y\"").replace("= 4", "= 5");
    assert!(parse(&format!("{good}{second}")).is_ok());
    for (from, to, said) in [
        ("position = 4", "", "gauges[0].position: missing"),
        ("position = 4", "alias = 0", "gauges[0].alias: 0 is that"),
        (
            "= 4",
            "= 4\nalias = 3",
            "gauges[0].alias: there is a position",
        ),
        ("= 4", "= 1", "gauges[0].position: names a drive"),
        (
            "= 4",
            "= 3",
            "gauges[0].position: names a drive or the force sensor",
        ),
        ("= 0.5", "= 0.0", "gauges[0].um_per_count: is 0"),
        ("= 0.5", "= nan", "gauges[0].um_per_count: is NaN"),
        ("= 0.5", "= -0.5", "gauges[0].um_per_count: is -0.5"),
        ("= 0.5", "= 0.5\nsign = 2", "gauges[0].sign: is 2"),
        ("\"x\"", "\"a b\"", "gauges[0].name: expected letters"),
        ("= 0.5", "= 0.5\nzero = 1", "unknown field `zero`"),
    ] {
        let error = parse(&good.replace(from, to)).unwrap_err();
        assert!(error.contains(said), "{to}: {error}");
    }
    for (second, said) in [
        (
            second.replace("\"y\"", "\"x\""),
            "name: \"x\" is named twice",
        ),
        (
            second.replace("= 5", "= 4"),
            "position: names the terminal of another",
        ),
    ] {
        let error = parse(&format!("{good}{second}")).unwrap_err();
        assert!(error.contains(&format!("gauges[1].{said}")), "{error}");
    }
    let robot = RobotFile::builtin_l2().unwrap();
    let mut section = section(&robot);
    section.gauges[0].position = Some(7);
    let (_hand, tool) = load_generator();
    let error = emulated_bus::<_, 3, 3>(&robot, &section, tool).unwrap_err();
    assert!(
        error.to_string().contains("ethercat.gauges[0].position"),
        "{error}"
    );
}
