//! Gauges and a force sensor behind drives: each in its place, and none a reason for the drives to stop.

use gantry_tau_ethercat::emulation::{
    Chain, Drive, EmulatedWire, EncoderModel, EncoderTerminal, ForceTerminal, ForceUnits,
    Instrument, Kinematic, Node, SubDevice,
};
use gantry_tau_ethercat::{
    BringUpError, Condition, CounterMap, DevicePlace, Drives, Extras, ForceSensorConfig,
    GaugeConfig, InstrumentRefusal, NoReading,
};

use crate::bench::{SETTINGS, Server, Wire, configs, setup, standing};

/// Positions, behind three drives.
const EL5101: usize = 3;
const FORCE: usize = 4;
const EL5151: usize = 5;

/// In another order than on the bus.
const GAUGES: [GaugeConfig; 2] = [gauge(EL5151, 0x141F_3052), gauge(EL5101, 0x13ED_3052)];
const SENSOR: ForceSensorConfig = ForceSensorConfig {
    place: DevicePlace::Position(FORCE as u16),
    vendor: ForceTerminal::IDENTITY.vendor,
    product: ForceTerminal::IDENTITY.product,
    calibration: 5,
};

const fn gauge(position: usize, product: u32) -> GaugeConfig {
    GaugeConfig {
        place: DevicePlace::Position(position as u16),
        vendor: GaugeConfig::BECKHOFF,
        product,
    }
}

fn bus() -> Wire {
    let drives = (0..3).map(|index| Node::Drive(SubDevice::of(Drive::new(&setup(index)))));
    let units = ForceUnits {
        force: 2,
        torque: 3,
        counts_per_force: 1_000,
        counts_per_torque: 1_000,
    };
    let instruments = [
        Instrument::Encoder(EncoderTerminal::new(EncoderModel::El5101)),
        Instrument::Force(ForceTerminal::new(ForceTerminal::IDENTITY, units)),
        Instrument::Encoder(EncoderTerminal::new(EncoderModel::El5151)),
    ];
    let instruments = instruments.map(|device| Node::Instrument(SubDevice::of(device)));
    EmulatedWire::new(Chain::of(drives.chain(instruments).collect(), Kinematic))
}

fn bring_up(wire: Wire, gauges: &[GaugeConfig]) -> Result<Drives<Wire, 3>, BringUpError> {
    let extras = Extras {
        clocks: None,
        force_sensor: Some(SENSOR),
        gauges,
    };
    Drives::bring_up_with(wire, &configs(), SETTINGS, extras)
}

fn running() -> Server<3> {
    let wire = bus();
    let mut drives = bring_up(wire.clone(), &GAUGES).unwrap();
    let offsets = drives.initial().map(|initial| initial.offset);
    drives.start(|inputs| standing(inputs, &offsets));
    let targets = standing(drives.inputs(), &offsets);
    let mut server = Server {
        wire,
        drives,
        targets,
    };
    // A start takes longer than the watchdogs of the instruments.
    (0..60).for_each(|_| server.cycle().unwrap());
    server
}

fn counts(server: &Server<3>) -> Vec<Result<i64, NoReading>> {
    server.drives.gauge_counts().collect()
}

/// Moves a gauge.
fn show(wire: &Wire, position: usize, counts: i64) {
    let mut bench = wire.bench();
    match bench.chain.instrument_mut(position).unwrap().device_mut() {
        Instrument::Encoder(terminal) => terminal.set_counts(counts),
        Instrument::Plain(_) | Instrument::Force(_) => panic!("no gauge"),
    }
}

/// Sets the force, and returns the control words.
fn load(wire: &Wire, counts: [i32; 6]) -> [u32; 2] {
    let mut bench = wire.bench();
    match bench.chain.instrument_mut(FORCE).unwrap().device_mut() {
        Instrument::Force(terminal) => {
            terminal.set_counts(counts);
            terminal.control()
        }
        Instrument::Plain(_) | Instrument::Encoder(_) => panic!("no force sensor"),
    }
}

#[test]
fn each_instrument_is_read_in_the_cycle_of_the_drives() {
    let mut server = running();
    let wire = server.wire.clone();
    assert_eq!(
        server.drives.gauge_maps().collect::<Vec<_>>(),
        [CounterMap::Bits32; 2]
    );
    assert_eq!(counts(&server), [Ok(0), Ok(0)]);
    for step in 1..100_i64 {
        show(&wire, EL5101, step);
        show(&wire, EL5151, -1_000 * step);
        // The calibration is the sensor's alone: the outputs of the gauges are zero.
        assert_eq!(load(&wire, [1_000, 0, 0, 0, 0, step as i32]), [0x500, 0]);
        assert_eq!(server.cycle(), Ok(()));
        assert_eq!(counts(&server), [Ok(-1_000 * step), Ok(step)]);
        let force = server.drives.force().unwrap().unwrap();
        assert!((force[0] - 1.0).abs() < 1e-12);
        assert!((force[5] - step as f64 / 1e3).abs() < 1e-12);
    }
    assert_eq!(server.largest_step(), 0);
}

#[test]
fn one_that_is_gone_takes_neither_drives_nor_others_with_it() {
    let mut server = running();
    let wire = server.wire.clone();
    show(&wire, EL5101, 77);
    for position in [EL5101, FORCE, EL5151] {
        let mut bench = wire.bench();
        bench.chain.instrument_mut(position).unwrap().fail(0x001B);
        drop(bench);
        assert_eq!(server.cycle(), Ok(()));
        let without = |gauge: usize| match position == [EL5151, EL5101][gauge] {
            true => Err(NoReading::State { state: 4 }),
            false => Ok([0, 77][gauge]),
        };
        assert_eq!(counts(&server), [without(0), without(1)], "{position}");
        let is_read = server.drives.force().unwrap().is_ok();
        assert_eq!(is_read, position != FORCE);
        (0..30).for_each(|_| assert_eq!(server.cycle(), Ok(())));
    }
    // The end of the line is cut off: what is before it goes on.
    wire.bench().chain.bypass(Some(EL5151));
    (0..200).for_each(|_| assert_eq!(server.cycle(), Ok(())));
    assert_eq!(
        counts(&server),
        [Err(NoReading::State { state: 0 }), Ok(77)]
    );
    assert!(server.drives.force().unwrap().is_ok());
    assert_eq!(server.drives.condition(), Condition::Running);
    assert_eq!(server.largest_step(), 0);
}

#[test]
fn a_gauge_that_cannot_be_used_is_named_by_its_number() {
    let refusal = |gauges: &[GaugeConfig]| match bring_up(bus(), gauges).map(drop) {
        Err(BringUpError::Gauge { gauge, reason }) => (gauge, reason),
        other => panic!("{other:?}"),
    };
    let swapped = [GAUGES[0], gauge(EL5101, GAUGES[0].product)];
    let (number, reason) = refusal(&swapped);
    assert!(
        number == 1 && matches!(reason, InstrumentRefusal::Identity { .. }),
        "{number}: {reason}"
    );
    let (number, reason) = refusal(&[gauge(9, GAUGES[0].product), GAUGES[1]]);
    assert!(
        number == 0 && matches!(reason, InstrumentRefusal::Missing { .. }),
        "{number}: {reason}"
    );
    for place in [EL5101, FORCE] {
        let (number, reason) = refusal(&[GAUGES[0], GAUGES[1], gauge(place, GAUGES[1].product)]);
        assert!(
            matches!(reason, InstrumentRefusal::Ambiguous { .. }),
            "{number}: {reason}"
        );
    }
}
