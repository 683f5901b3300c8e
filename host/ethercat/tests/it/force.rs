//! A force sensor behind drives: its units, each reason to have no reading, and drives that go on.

use gantry_tau_ethercat::emulation::{
    Chain, Drive, EmulatedWire, ForceTerminal, ForceUnits, Identity, Instrument, Kinematic, Node,
    SubDevice,
};
use gantry_tau_ethercat::{
    BringUpError, Condition, DevicePlace, Drives, Extras, ForceSensorConfig, InstrumentRefusal,
    NoReading, Wire as _,
};

use crate::bench::{CYCLE_US, Lossy, SETTINGS, Server, Wire, configs, setup, standing};

const UNITS: ForceUnits = ForceUnits {
    force: 2,
    torque: 4,
    counts_per_force: 1_000_000,
    counts_per_torque: 1_000,
};
const COUNTS: [i32; 6] = [5_000_000, -250_000, 7, 2_000_000, -1_000, 3];
/// Position of the sensor, behind three drives.
const POSITION: usize = 3;

fn config() -> ForceSensorConfig {
    ForceSensorConfig {
        place: DevicePlace::Position(POSITION as u16),
        vendor: ForceTerminal::IDENTITY.vendor,
        product: ForceTerminal::IDENTITY.product,
        calibration: 3,
    }
}

fn bus_with(identity: Identity, units: ForceUnits) -> Wire {
    let mut nodes: Vec<Node> = (0..3)
        .map(|index| Node::Drive(SubDevice::of(Drive::new(&setup(index)))))
        .collect();
    let sensor = Instrument::Force(ForceTerminal::new(identity, units));
    nodes.push(Node::Instrument(SubDevice::of(sensor)));
    EmulatedWire::new(Chain::of(nodes, Kinematic))
}

fn bring_up<W: gantry_tau_ethercat::Wire>(
    wire: W,
    sensor: ForceSensorConfig,
) -> Result<Drives<W, 3>, BringUpError> {
    let extras = Extras {
        clocks: None,
        force_sensor: Some(sensor),
        gauges: &[],
    };
    Drives::bring_up_with(wire, &configs(), SETTINGS, extras)
}

fn running() -> Server<3> {
    let wire = bus_with(ForceTerminal::IDENTITY, UNITS);
    let mut drives = bring_up(wire.clone(), config()).unwrap();
    assert!(
        drives.force().unwrap().is_err(),
        "nothing was read in a cycle"
    );
    let offsets = drives.initial().map(|initial| initial.offset);
    drives.start(|inputs| standing(inputs, &offsets));
    assert!(
        drives.force().unwrap().is_err(),
        "what was read during the start is old"
    );
    let targets = standing(drives.inputs(), &offsets);
    let mut server = Server {
        wire,
        drives,
        targets,
    };
    load(&server.wire, COUNTS);
    // A start takes longer than the sensor's watchdog.
    (0..60).for_each(|_| server.cycle().unwrap());
    assert!(force(&server).is_ok());
    server
}

fn force(server: &Server<3>) -> Result<[f64; 6], NoReading> {
    server.drives.force().unwrap()
}

fn sensor<T>(wire: &Wire, change: impl FnOnce(&mut SubDevice<Instrument>) -> T) -> T {
    change(wire.bench().chain.instrument_mut(POSITION).unwrap())
}

fn terminal<T>(wire: &Wire, change: impl FnOnce(&mut ForceTerminal) -> T) -> T {
    sensor(wire, |subdevice| match subdevice.device_mut() {
        Instrument::Force(terminal) => change(terminal),
        Instrument::Plain(_) | Instrument::Encoder(_) => panic!("no force sensor"),
    })
}

fn load(wire: &Wire, counts: [i32; 6]) {
    terminal(wire, |terminal| terminal.set_counts(counts));
}

/// N, lbf, klbf, kN and kg; N m and N mm.
#[test]
fn readings_are_in_newtons_and_newton_metres_for_each_unit_of_the_sensor() {
    for (code, newtons) in [
        (1, 4.448_221_615),
        (2, 1.0),
        (3, 4_448.221_615),
        (4, 1e3),
        (5, 9.806_65),
    ] {
        for (torque, newton_metres) in [(3, 1.0), (4, 1e-3)] {
            let units = ForceUnits {
                force: code,
                torque,
                counts_per_force: 1_000_000,
                counts_per_torque: 2_000,
            };
            let wire = bus_with(ForceTerminal::IDENTITY, units);
            load(&wire, COUNTS);
            let mut drives = bring_up(wire.clone(), config()).unwrap();
            wire.clone().begin_cycles(1, CYCLE_US);
            let standing = standing(drives.inputs(), &[Default::default(); 3]);
            let _prepared = drives.cycle(&standing);
            let read = drives.force().unwrap().unwrap();
            let per_count = [newtons / 1e6, newton_metres / 2e3];
            for (index, (read, counts)) in read.iter().zip(COUNTS).enumerate() {
                let expected = f64::from(counts) * per_count[index / 3];
                assert!(
                    (read - expected).abs() <= 1e-9 * expected.abs(),
                    "{read}, {expected}"
                );
            }
            // The number of the calibration, and no bias.
            assert_eq!(terminal(&wire, |terminal| terminal.control()), [0x300, 0]);
        }
    }
}

#[test]
fn a_sensor_that_cannot_be_used_is_refused_at_the_start() {
    let refusal = |wire: Wire, config: ForceSensorConfig| match bring_up(wire, config).map(drop) {
        Err(BringUpError::ForceSensor { reason }) => reason,
        other => panic!("{other:?}"),
    };
    for (units, sub) in [
        (ForceUnits { force: 7, ..UNITS }, 0x29),
        (ForceUnits { force: 0, ..UNITS }, 0x29),
        (ForceUnits { torque: 1, ..UNITS }, 0x2A),
        (
            ForceUnits {
                counts_per_force: 0,
                ..UNITS
            },
            0x31,
        ),
        (
            ForceUnits {
                counts_per_force: -5,
                ..UNITS
            },
            0x31,
        ),
        (
            ForceUnits {
                counts_per_torque: 0,
                ..UNITS
            },
            0x32,
        ),
    ] {
        let reason = refusal(bus_with(ForceTerminal::IDENTITY, units), config());
        let InstrumentRefusal::Value {
            object, sub: found, ..
        } = reason
        else {
            panic!("{reason}");
        };
        assert_eq!((object, found), (0x2040, sub));
    }
    // The product code is shared by devices of other vendors.
    let other = Identity {
        vendor: 0x0000_0999,
        ..ForceTerminal::IDENTITY
    };
    let reason = refusal(bus_with(other, UNITS), config());
    assert!(matches!(
        reason,
        InstrumentRefusal::Identity {
            found_vendor: 0x999,
            ..
        }
    ));
    let place = DevicePlace::Position(9);
    let reason = refusal(
        bus_with(ForceTerminal::IDENTITY, UNITS),
        ForceSensorConfig { place, ..config() },
    );
    assert_eq!(reason, InstrumentRefusal::Missing { place, found: 4 });
    let wire = bus_with(ForceTerminal::IDENTITY, UNITS);
    sensor(&wire, |sensor| sensor.refuse(8, 0x8001));
    let reason = refusal(wire, config());
    assert!(
        matches!(reason, InstrumentRefusal::NotOperational { state: 4, .. }),
        "{reason}"
    );
    // A drive's place is a drive's.
    let place = DevicePlace::Position(1);
    let reason = refusal(
        bus_with(ForceTerminal::IDENTITY, UNITS),
        ForceSensorConfig { place, ..config() },
    );
    assert!(
        matches!(reason, InstrumentRefusal::Identity { .. }),
        "{reason}"
    );
}

#[test]
fn no_fault_of_the_sensor_is_one_of_the_drives() {
    let mut server = running();
    let wire = server.wire.clone();
    for status in [0x8000_0000, 0x4000_0000, 0x2000_0000] {
        terminal(&wire, |terminal| terminal.set_status(status));
        assert_eq!(server.cycle(), Ok(()));
        assert_eq!(force(&server), Err(NoReading::SensorFault { status }));
    }
    terminal(&wire, |terminal| terminal.set_status(1));
    assert_eq!(server.cycle(), Ok(()));
    assert!(force(&server).is_ok());
    terminal(&wire, |terminal| terminal.set_samples_per_reading(0));
    let frozen = [false, false, true, true].map(|is_frozen| {
        assert_eq!(server.cycle(), Ok(()));
        (is_frozen, force(&server).is_err())
    });
    assert!(
        frozen.iter().all(|(expected, found)| expected == found),
        "{frozen:?}"
    );
    terminal(&wire, |terminal| terminal.set_samples_per_reading(2));
    assert_eq!(server.cycle(), Ok(()));
    assert!(force(&server).is_ok());
    // It leaves OP, and is led back.
    sensor(&wire, |sensor| sensor.fail(0x001B));
    assert_eq!(server.cycle(), Ok(()));
    assert_eq!(force(&server), Err(NoReading::State { state: 4 }));
    (0..30).for_each(|_| assert_eq!(server.cycle(), Ok(())));
    assert!(force(&server).is_ok());
    // Its plug is pulled, and put back.
    wire.bench().chain.bypass(Some(POSITION));
    for _ in 0..500 {
        assert_eq!(server.cycle(), Ok(()));
        assert_eq!(force(&server), Err(NoReading::State { state: 0 }));
    }
    wire.bench().chain.bypass(None);
    (0..60).for_each(|_| assert_eq!(server.cycle(), Ok(())));
    assert!(force(&server).is_ok());
    // After a loss of power it does not answer to its address.
    sensor(&wire, SubDevice::power_cycle);
    (0..500).for_each(|_| assert_eq!(server.cycle(), Ok(())));
    assert_eq!(force(&server), Err(NoReading::State { state: 0 }));
    assert_eq!(server.drives.condition(), Condition::Running);
    assert_eq!(server.largest_step(), 0);
}

/// Frames of drives and sensor are lost in turn: a reading is of its cycle, or none.
#[test]
fn a_reading_is_never_old() {
    let wire = bus_with(ForceTerminal::IDENTITY, UNITS);
    let lossy = Lossy::new(wire.clone(), 0);
    let mut drives = bring_up(lossy.clone(), config()).unwrap();
    drives.start(|inputs| standing(inputs, &[Default::default(); 3]));
    let (mut read, mut alone, mut faults) = (0, 0, 0);
    for cycle in 0..2_000 {
        // One in seven is the drives' always, one in six the sensor's.
        lossy.lose(if cycle % 200 < 100 { 7 } else { 6 });
        load(&wire, [cycle; 6]);
        lossy.clone().begin_cycles(1, CYCLE_US);
        let targets = *drives.sent();
        let outcome = drives.cycle(&targets);
        match (drives.force().unwrap(), outcome) {
            (Ok(reading), _) => {
                read += 1;
                let newtons = f64::from(cycle) / 1e6;
                assert!((reading[0] - newtons).abs() < 1e-12, "{cycle}: {reading:?}");
            }
            (Err(_), Ok(())) => alone += 1,
            (Err(_), Err(_)) => faults += 1,
        }
    }
    assert_eq!(drives.condition(), Condition::Running);
    assert!(
        read > 1_000 && alone > 100 && faults > 100,
        "{read}, {alone}, {faults}"
    );
}

/// The drives come first: what they need is not there for the sensor.
#[test]
fn a_cycle_whose_drives_answer_late_skips_the_sensor() {
    let mut server = running();
    let mut bench = server.wire.bench();
    (bench.faults.delay_us, bench.faults.delayed) = (350, 1);
    drop(bench);
    assert_eq!(server.cycle(), Ok(()));
    assert_eq!(force(&server), Err(NoReading::Skipped));
    assert_eq!(server.cycle(), Ok(()));
    assert!(force(&server).is_ok());
}
