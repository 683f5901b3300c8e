//! Gauges on an emulated bus: counts, and each reason to have none.

use gantry_tau_ethercat::emulation::{
    Chain, EmulatedWire, EncoderModel, EncoderTerminal, Instrument, Kinematic, Node, Plain,
    SubDevice,
};
use gantry_tau_ethercat::gauges::{Gauges, GaugesError};
use gantry_tau_ethercat::{
    BusError, CounterMap, DevicePlace, GaugeConfig, InstrumentRefusal, NoReading, Wire as _,
};

use crate::bench::{CYCLE_US, Wire};

const MODELS: [EncoderModel; 4] = [
    EncoderModel::El5101,
    EncoderModel::El5101Old,
    EncoderModel::El5101Fast,
    EncoderModel::El5151,
];
const EL5101: u32 = 0x13ED_3052;
const EL5151: u32 = 0x141F_3052;
/// Answers are waited for so long, µs.
const ANSWER_US: u32 = 500;

/// A coupler with terminals of these models behind it.
fn bus(models: &[EncoderModel]) -> Wire {
    let terminals = models.iter().map(|model| {
        let device = Instrument::Encoder(EncoderTerminal::new(*model));
        Node::Instrument(SubDevice::of(device))
    });
    let coupler = Node::Instrument(SubDevice::of(Instrument::Plain(Plain::coupler())));
    let nodes = std::iter::once(coupler).chain(terminals);
    EmulatedWire::new(Chain::of(nodes.collect(), Kinematic))
}

fn config(position: u16, product: u32) -> GaugeConfig {
    GaugeConfig {
        place: DevicePlace::Position(position),
        vendor: GaugeConfig::BECKHOFF,
        product,
    }
}

/// Gauges of [`MODELS`].
fn configs() -> [GaugeConfig; 4] {
    [
        config(1, EL5101),
        config(2, EL5101),
        config(3, EL5101),
        config(4, EL5151),
    ]
}

struct Bench {
    wire: Wire,
    gauges: Gauges<Wire>,
}

impl Bench {
    fn of(models: &[EncoderModel], configs: &[GaugeConfig]) -> Result<Self, GaugesError> {
        let wire = bus(models);
        let gauges = Gauges::bring_up(wire.clone(), configs, CYCLE_US as u32, ANSWER_US)?;
        Ok(Self { wire, gauges })
    }

    fn new() -> Self {
        Self::of(&MODELS, &configs()).unwrap()
    }

    /// Handles the terminal of gauge `index`.
    fn terminal<T>(&self, index: usize, change: impl FnOnce(&mut EncoderTerminal) -> T) -> T {
        let mut bench = self.wire.bench();
        let subdevice = bench.chain.instrument_mut(index + 1).unwrap();
        let Instrument::Encoder(terminal) = subdevice.device_mut() else {
            panic!("no encoder");
        };
        change(terminal)
    }

    fn subdevice<T>(
        &self,
        index: usize,
        change: impl FnOnce(&mut SubDevice<Instrument>) -> T,
    ) -> T {
        let mut bench = self.wire.bench();
        change(bench.chain.instrument_mut(index + 1).unwrap())
    }

    fn cycle(&mut self) -> Vec<Result<i64, NoReading>> {
        self.gauges.wire_mut().begin_cycles(1, CYCLE_US);
        self.gauges.cycle();
        self.gauges.counts().collect()
    }

    fn after(&mut self, cycles: u32) -> Vec<Result<i64, NoReading>> {
        (1..cycles).for_each(|_| drop(self.cycle()));
        self.cycle()
    }
}

#[test]
fn every_terminal_gives_its_counts_from_the_start_on() {
    let models = MODELS;
    let wire = bus(&models);
    // A machine that has been on for long.
    for (index, counts) in [7, -40_000, i64::from(i32::MAX), 1 << 33]
        .into_iter()
        .enumerate()
    {
        let mut bench = wire.bench();
        let subdevice = bench.chain.instrument_mut(index + 1).unwrap();
        if let Instrument::Encoder(terminal) = subdevice.device_mut() {
            terminal.set_counts(counts);
        }
    }
    let gauges = Gauges::bring_up(wire.clone(), &configs(), CYCLE_US as u32, ANSWER_US).unwrap();
    assert_eq!(
        gauges.maps().collect::<Vec<_>>(),
        [
            CounterMap::Bits32,
            CounterMap::Old,
            CounterMap::Bits32,
            CounterMap::Bits32
        ]
    );
    let mut bench = Bench { wire, gauges };
    assert_eq!(bench.cycle(), [Ok(0); 4]);
    // There and back, over the ends of counters of 16 and of 32 bits.
    let mut way = 0_i64;
    for step in (0..40).map(|_| 9_000_i64).chain((0..60).map(|_| -9_000)) {
        way += step;
        for (index, zero) in [7, -40_000, i64::from(i32::MAX), 1 << 33]
            .into_iter()
            .enumerate()
        {
            bench.terminal(index, |terminal| terminal.set_counts(zero + way));
        }
        // The terminals show a count with the next frame.
        assert_eq!(bench.cycle(), [Ok(way); 4]);
    }
    assert_eq!(way, -180_000);
}

/// The wires of all terminals are checked; one of old firmware has no check.
#[test]
fn each_fault_of_a_terminal_is_seen_within_three_cycles_and_is_of_its_gauge_alone() {
    type Change = fn(&mut EncoderTerminal, bool);
    let faults: [(NoReading, Change); 4] = [
        (NoReading::OpenCircuit, EncoderTerminal::break_wire),
        (NoReading::SyncError, EncoderTerminal::set_sync_error),
        (NoReading::Invalid, EncoderTerminal::invalidate),
        (NoReading::Frozen, EncoderTerminal::freeze),
    ];
    let mut bench = Bench::new();
    for (reason, change) in faults {
        for index in [0, 2, 3] {
            bench.terminal(index, |terminal| change(terminal, true));
            let mut expected = [Ok(0); 4];
            expected[index] = Err(reason);
            assert_eq!(bench.after(3), expected);
            bench.terminal(index, |terminal| change(terminal, false));
            assert_eq!(bench.after(2), [Ok(0); 4]);
        }
    }
}

#[test]
fn lost_frames_and_wrong_counters_leave_all_without_for_a_cycle() {
    let mut bench = Bench::new();
    bench.terminal(0, |terminal| terminal.set_counts(5));
    bench.wire.bench().faults.lost_out = 1;
    assert_eq!(bench.cycle(), [Err(NoReading::NoAnswer); 4]);
    bench.wire.bench().faults.lost_back = 1;
    assert_eq!(bench.cycle(), [Err(NoReading::NoAnswer); 4]);
    bench.wire.bench().faults.counter_less = 1;
    assert_eq!(bench.cycle(), [Err(NoReading::WorkingCounter); 4]);
    bench.wire.bench().faults.counter_less = 0;
    assert_eq!(bench.cycle(), [Ok(5), Ok(0), Ok(0), Ok(0)]);
    // An answer that comes after its time is no answer, and none of the next frame.
    let mut bench_now = bench.wire.bench();
    (bench_now.faults.delay_us, bench_now.faults.delayed) = (900, 1);
    drop(bench_now);
    assert_eq!(bench.cycle(), [Err(NoReading::NoAnswer); 4]);
    assert_eq!(bench.after(2), [Ok(5), Ok(0), Ok(0), Ok(0)]);
}

#[test]
fn a_terminal_that_left_op_is_led_back_and_keeps_its_count() {
    let mut bench = Bench::new();
    bench.terminal(2, |terminal| terminal.set_counts(12));
    bench.cycle();
    bench.subdevice(2, |subdevice| subdevice.fail(0x001B));
    bench.terminal(2, |terminal| terminal.set_counts(40));
    let counts = bench.cycle();
    assert_eq!(counts[2], Err(NoReading::State { state: 4 }));
    assert_eq!((counts[0], counts[3]), (Ok(0), Ok(0)));
    assert_eq!(bench.after(30), [Ok(0), Ok(0), Ok(40), Ok(0)]);
    // The server's computer stands for longer than the watchdogs.
    bench.wire.idle(200_000);
    assert!(bench.cycle().iter().all(Result::is_err));
    let counts = bench.after(100);
    assert_eq!(counts, [Ok(0), Ok(0), Ok(40), Ok(0)]);
}

/// A count after a loss of power is another one, though the terminal comes back.
#[test]
fn a_terminal_that_was_restarted_stays_without_and_the_others_go_on() {
    let mut bench = Bench::new();
    (0..4).for_each(|index| bench.terminal(index, |terminal| terminal.set_counts(100)));
    assert_eq!(bench.after(2), [Ok(100); 4]);
    bench.subdevice(0, SubDevice::power_cycle);
    let expected = [
        Err(NoReading::State { state: 0 }),
        Ok(100),
        Ok(100),
        Ok(100),
    ];
    assert_eq!(bench.after(3), expected);
    assert_eq!(bench.after(2_000), expected);
}

/// The plug is pulled for a while; the terminal keeps its power.
#[test]
fn a_cable_that_is_mended_brings_the_counts_back_but_for_narrow_counters() {
    let mut bench = Bench::new();
    bench.wire.bench().chain.cut_behind(2);
    let gone = Err(NoReading::State { state: 0 });
    assert_eq!(bench.after(3), [Ok(0), gone, gone, gone]);
    (1..4).for_each(|index| bench.terminal(index, |terminal| terminal.set_counts(30)));
    bench.after(300);
    bench.wire.bench().chain.cut_behind(5);
    assert_eq!(
        bench.after(100),
        [Ok(0), Err(NoReading::LostTurns), Ok(30), Ok(30)]
    );
}

#[test]
fn what_stands_in_the_wrong_place_is_named() {
    let refusal =
        |models: &[EncoderModel], configs: &[GaugeConfig]| match Bench::of(models, configs)
            .map(drop)
        {
            Err(GaugesError::Gauge { gauge, reason }) => (gauge, reason),
            other => panic!("{other:?}"),
        };
    // An EL5151 in the place of an EL5101, and the reverse.
    let swapped = [EncoderModel::El5151, EncoderModel::El5101];
    let two = [config(1, EL5101), config(2, EL5151)];
    let (gauge, reason) = refusal(&swapped, &two);
    assert_eq!(gauge, 0);
    assert_eq!(
        reason.to_string(),
        "at position 1 is product 0x141f3052 of vendor 0x00000002; expected 0x13ed3052 of 0x00000002 (are two devices swapped?)"
    );
    let (gauge, _) = refusal(&swapped, &[config(1, EL5151), config(2, EL5151)]);
    assert_eq!(gauge, 1);
    // Of three, one is missing; a coupler is no terminal; two gauges are one.
    let missing = refusal(
        &[EncoderModel::El5101; 2],
        &[1, 2, 3].map(|at| config(at, EL5101)),
    );
    let place = DevicePlace::Position(3);
    assert_eq!(missing, (2, InstrumentRefusal::Missing { place, found: 3 }));
    let (_, reason) = refusal(&[EncoderModel::El5101], &[config(0, EL5101)]);
    assert!(matches!(reason, InstrumentRefusal::Identity { .. }));
    let (gauge, reason) = refusal(&[EncoderModel::El5101; 2], &[config(1, EL5101); 2]);
    let place = DevicePlace::Position(1);
    assert_eq!((gauge, reason), (0, InstrumentRefusal::Ambiguous { place }));
}

#[test]
fn a_terminal_that_refuses_op_is_named_with_its_code() {
    for (state, code) in [(4, 0x001E), (8, 0x8000)] {
        let wire = bus(&MODELS);
        let mut bench = wire.bench();
        bench.chain.instrument_mut(3).unwrap().refuse(state, code);
        drop(bench);
        let outcome = Gauges::bring_up(wire, &configs(), CYCLE_US as u32, ANSWER_US).map(drop);
        let Err(GaugesError::Gauge { gauge, reason }) = outcome else {
            panic!("{outcome:?}");
        };
        assert_eq!(gauge, 2);
        let InstrumentRefusal::NotOperational { state: stays, .. } = reason else {
            panic!("{reason}");
        };
        assert_eq!(stays, state / 2);
    }
    let silent = EmulatedWire::new(Chain::of(Vec::new(), Kinematic));
    let outcome = Gauges::bring_up(silent, &configs(), CYCLE_US as u32, ANSWER_US).map(drop);
    assert_eq!(outcome, Err(BusError::Silent.into()));
}

/// Nothing latches, sets or resets a counter, and no other device is written to.
#[test]
fn outputs_are_zero_and_other_devices_are_left_in_pre_op() {
    let wire = bus(&MODELS);
    let three = [config(1, EL5101), config(3, EL5101), config(4, EL5151)];
    wire.bench().chain.log_writes();
    let gauges = Gauges::bring_up(wire.clone(), &three, CYCLE_US as u32, ANSWER_US).unwrap();
    let mut bench = Bench { wire, gauges };
    bench.after(10);
    let mut now = bench.wire.bench();
    // The image has the inputs first: three times 10 bytes, then three times 6.
    let images = now
        .chain
        .writes()
        .iter()
        .filter(|write| write.address.is_none());
    let images: Vec<&[u8]> = images.map(|write| &write.data[..]).collect();
    assert!(images.len() > 30 && images.iter().all(|image| image.len() == 48));
    assert!(images.iter().all(|image| image[30..] == [0; 18]));
    let states =
        [0, 1, 2, 3, 4].map(|position| now.chain.instrument_mut(position).unwrap().state());
    assert_eq!(states, [2, 8, 2, 8, 8]);
    drop(now);
    // An orderly end takes all of them to INIT.
    let wire = bench.wire.clone();
    drop(bench);
    wire.idle(50_000);
    let mut now = wire.bench();
    let states =
        [0, 1, 2, 3, 4].map(|position| now.chain.instrument_mut(position).unwrap().state());
    assert_eq!(states, [1; 5]);
}

#[test]
fn a_cycle_without_an_answer_ends_in_time() {
    let mut bench = Bench::new();
    bench.wire.bench().chain.cut_behind(0);
    let before = bench.gauges.wire_mut().now_us();
    assert_eq!(bench.cycle(), [Err(NoReading::NoAnswer); 4]);
    let took = bench.gauges.wire_mut().now_us() - before;
    assert!(took <= CYCLE_US + 2 * u64::from(ANSWER_US), "{took}");
}
