//! Distributed clocks: the cycle follows the reference, and every interval of SYNC0 has one frame.

use gantry_tau_ethercat::emulation::Instrument;
use gantry_tau_ethercat::emulation::{
    Chain, ClockHandle, ClockSetup, Drive, EmulatedWire, Kinematic, Node, Plain, PowerState,
    SubDevice, Sync0Intervals,
};
use gantry_tau_ethercat::steering::SteeringFault;
use gantry_tau_ethercat::{
    BringUpError, ClockSettings, Condition, Drives, Extras, Fault, Offset, Wire as _,
};

use crate::bench::{CYCLE_US, Lossy, SETTINGS, Server, Wire, configs, setup, standing};

const CLOCKS: ClockSettings = ClockSettings {
    sync0_ns: 1_000_000,
    frame_to_sync0_ns: 500_000,
    has_sync1: false,
};
fn with(clocks: ClockSettings) -> Extras<'static> {
    Extras {
        clocks: Some(clocks),
        force_sensor: None,
        gauges: &[],
    }
}

/// Types of 1C32h:04 of a drive that runs on SYNC0 alone.
const SYNC0_ONLY: u16 = 0x0804;

fn drive(index: u32, drift_ppb: i32) -> Node {
    let drive = Drive::new(&setup(index))
        .with_synchronisation(SYNC0_ONLY)
        .requiring_sync0();
    let offset_ns = 1_000_000_000 * u64::from(index + 1) + 123_457;
    Node::Drive(SubDevice::of(drive).with_clock(ClockSetup {
        drift_ppb,
        offset_ns,
    }))
}

/// Three drives behind a coupler without a clock; the first drive is the reference.
fn chain(drift_ppb: [i32; 3]) -> Wire {
    let mut nodes = vec![Node::Instrument(SubDevice::of(Instrument::Plain(
        Plain::coupler(),
    )))];
    nodes.extend((0..3).map(|index| drive(index, drift_ppb[index as usize])));
    EmulatedWire::new(Chain::of(nodes, Kinematic))
}

fn started(wire: &Wire, clocks: ClockSettings) -> Result<Server<3>, BringUpError> {
    let mut drives = Drives::bring_up_with(wire.clone(), &configs(), SETTINGS, with(clocks))?;
    let offsets = [Offset::default(); 3];
    drives.start(|inputs| standing(inputs, &offsets));
    let targets = standing(drives.inputs(), &offsets);
    Ok(Server {
        wire: wire.clone(),
        drives,
        targets,
    })
}

fn running(drift_ppb: [i32; 3]) -> Server<3> {
    let wire = chain(drift_ppb);
    let server = started(&wire, CLOCKS).unwrap();
    assert_eq!(server.drives.condition(), Condition::Running);
    assert_eq!(server.drives.is_locked(), Some(true));
    take_intervals(&wire);
    server
}

/// Intervals of SYNC0 of all drives since the last call.
fn take_intervals(wire: &Wire) -> [Sync0Intervals; 3] {
    let mut bench = wire.bench();
    [1, 2, 3].map(|position| {
        bench
            .chain
            .subdevice_mut(position)
            .unwrap()
            .take_sync0_intervals()
    })
}

fn set_drift(wire: &Wire, drift_ppb: i32) {
    let mut bench = wire.bench();
    for position in 1..=3 {
        let drive = bench.chain.subdevice_mut(position).unwrap();
        drive.clock_mut().unwrap().set_drift(drift_ppb);
    }
}

/// Cycles of a long run, and those before the phase is judged.
const LONG: usize = 120_000;
const SETTLED: usize = 600;

/// Every interval has exactly one frame, and the phase stays within 5 µs on an ideal wire, at
/// any drift of the reference against the computer.
#[test]
fn every_interval_of_sync0_has_one_frame_at_any_drift() {
    for ppm in [0, 20, -20, 100, -100, 400, -400] {
        let own = 1_000 * ppm;
        let mut server = running([own, own + 30_000, own - 50_000]);
        let mut largest = 0;
        for cycle in 0..LONG {
            assert_eq!(server.cycle(), Ok(()), "{ppm} ppm");
            let phase_ns = server.drives.phase_ns().unwrap().abs();
            largest = largest.max(if cycle < SETTLED { 0 } else { phase_ns });
        }
        for intervals in take_intervals(&server.wire) {
            assert_eq!((intervals.none, intervals.more), (0, 0), "{ppm} ppm");
            assert!((LONG as u64).abs_diff(intervals.one) < 100, "{intervals:?}");
        }
        assert!(largest <= 5_000, "{ppm} ppm: {largest} ns");
    }
}

/// Delay by which a cycle begins late, ns: of 4 µs in the mean with an exponential tail of 6 µs, as
/// a computer with a real-time kernel has it.
fn jitter_ns(state: &mut u64) -> i64 {
    *state ^= *state << 13;
    *state ^= *state >> 7;
    *state ^= *state << 17;
    let uniform = (*state >> 11) as f64 / (1_u64 << 53) as f64;
    4_000 - (6_000.0 * (1.0 - uniform).ln()) as i64
}

/// Cycles that begin late by a jitter; the steering is undone if it is not wanted. Returns the
/// phases.
fn run_late(server: &mut Server<3>, is_steered: bool) -> Vec<i64> {
    let mut state = 0x9E37_79B9_7F4A_7C15;
    let mut wire = server.wire.clone();
    let mut phases = Vec::new();
    for _ in 0..LONG {
        let late_ns = jitter_ns(&mut state);
        wire.shift_cycles(late_ns);
        let _outcome = server.cycle();
        let shift_ns = server.drives.take_shift_ns();
        wire.shift_cycles(-late_ns - if is_steered { 0 } else { shift_ns });
        phases.extend(server.drives.phase_ns());
    }
    phases
}

/// Drives of 20 ppm that stay in OP without data, with a jitter: steered, no interval is lost;
/// without the correction, many are.
#[test]
fn with_jitter_the_steering_makes_the_difference() {
    for is_steered in [true, false] {
        let nodes = (0..3).map(|index| {
            let drive = Drive::new(&setup(index)).with_synchronisation(SYNC0_ONLY);
            Node::Drive(SubDevice::of(drive).with_clock(ClockSetup {
                drift_ppb: 20_000,
                offset_ns: 5_000_000,
            }))
        });
        let wire = EmulatedWire::new(Chain::of(nodes.collect(), Kinematic));
        let mut server = started(&wire, CLOCKS).unwrap();
        let intervals = || {
            let mut bench = wire.bench();
            bench.chain.subdevice_mut(0).unwrap().take_sync0_intervals()
        };
        intervals();
        let mut phases = run_late(&mut server, is_steered);
        let Sync0Intervals { none, more, .. } = intervals();
        if is_steered {
            assert_eq!((none, more), (0, 0));
            let settled = &mut phases[SETTLED..];
            settled.sort_unstable();
            assert!(settled[settled.len() / 2].abs() <= 2_000);
        } else {
            assert!(none + more >= 100, "{none} empty, {more} with two or more");
        }
    }
}

#[test]
fn clocks_beyond_1000_ppm_are_refused_at_the_start_and_stop_in_operation() {
    for ppm in [1_500, -1_500] {
        let wire = chain([1_000 * ppm; 3]);
        let before_us = wire.now_us();
        let server = started(&wire, CLOCKS).unwrap();
        let expected = Condition::Stopped(Fault::Clock(SteeringFault::Drift));
        assert_eq!(server.drives.condition(), expected);
        assert!(wire.now_us() - before_us < 5_000_000);

        let mut server = running([0; 3]);
        server.forget_steps();
        set_drift(&server.wire, 1_000 * ppm);
        let (cycles, fault) = server.until_fault(2_000);
        assert!(matches!(fault, Fault::Clock(_)), "{fault} after {cycles}");
        for _ in 0..200 {
            server.cycle().unwrap_err();
        }
        assert!(server.largest_step() < 100, "no step");
    }
}

#[test]
fn a_lost_time_is_nothing_and_many_are_coasted_over() {
    let mut server = running([50_000, 20_000, -35_000]);
    for _ in 0..2_000 {
        server.cycle().unwrap();
    }
    for lost in [1, 100, 10_000] {
        server.wire.bench().lost_times = lost;
        for _ in 0..lost + 100 {
            assert_eq!(server.cycle(), Ok(()), "{lost} times lost");
        }
        for intervals in take_intervals(&server.wire) {
            assert_eq!((intervals.none, intervals.more), (0, 0), "{lost}");
        }
    }
}

/// 10 s without frames; after the re-arm every interval has its frame again.
#[test]
fn ten_seconds_without_frames_lose_nothing_after_the_rearm() {
    let mut server = running([50_000; 3]);
    for _ in 0..2_000 {
        server.cycle().unwrap();
    }
    server.wire.bench().faults.lost_out = 10_000;
    let mut faults = 0;
    for _ in 0..10_100 {
        faults += u32::from(server.cycle().is_err());
    }
    assert!(faults >= 10_000);
    server.drives.rearm();
    server.until_running(3_000);
    take_intervals(&server.wire);
    for _ in 0..5_000 {
        server.cycle().unwrap();
    }
    for intervals in take_intervals(&server.wire) {
        assert_eq!((intervals.none, intervals.more), (0, 0), "{intervals:?}");
    }
}

/// Does something to the clock of the reference, in operation; returns the fault.
fn disturbed(disturb: impl FnOnce(&mut ClockHandle<'_>)) -> (u32, Fault) {
    let mut server = running([0; 3]);
    for _ in 0..500 {
        server.cycle().unwrap();
    }
    {
        let mut bench = server.wire.bench();
        let reference = bench.chain.subdevice_mut(1).unwrap();
        disturb(&mut reference.clock_mut().unwrap());
    }
    let found = server.until_fault(10);
    assert!(server.largest_step() < 100, "no step");
    found
}

#[test]
fn a_reference_that_jumps_or_stands_is_named() {
    for by_ns in [450_000, -450_000] {
        let (cycles, fault) = disturbed(|clock| clock.jump(by_ns));
        assert!(
            matches!(fault, Fault::Clock(SteeringFault::Phase { .. })),
            "{fault}"
        );
        assert!(cycles >= 2, "one sample is no fault");
    }
    let (cycles, fault) = disturbed(|clock| clock.freeze());
    assert_eq!(fault, Fault::Clock(SteeringFault::Standing));
    assert!(cycles >= 2);
}

/// A drive that requires SYNC0, with and without clocks.
#[test]
fn a_drive_that_requires_sync0_is_refused_when_it_runs_freely() {
    let wire = chain([0; 3]);
    let mut drives = Drives::<_, 3>::bring_up(wire.clone(), &configs(), SETTINGS).unwrap();
    drives.start(|inputs| standing(inputs, &[Offset::default(); 3]));
    let Condition::Stopped(Fault::State { motor, state, code }) = drives.condition() else {
        panic!("{:?}", drives.condition());
    };
    assert_eq!((motor, state, code), (0, 4, 0x002D));
}

#[test]
fn every_register_and_object_that_differs_is_named() {
    // A drive without a clock.
    let mut nodes = vec![drive(0, 0), drive(2, 0)];
    nodes.insert(1, Node::Drive(SubDevice::new(&setup(1))));
    let wire = EmulatedWire::new(Chain::of(nodes, Kinematic));
    assert_eq!(
        started(&wire, CLOCKS).err(),
        Some(BringUpError::NoClock { motor: 1 })
    );
    // A drive that runs freely only.
    let free = Drive::new(&setup(1)).with_synchronisation(0x0003);
    let nodes = vec![
        drive(0, 0),
        Node::Drive(SubDevice::of(free).with_clock(ClockSetup::default())),
        drive(2, 0),
    ];
    let wire = EmulatedWire::new(Chain::of(nodes, Kinematic));
    assert_eq!(
        started(&wire, CLOCKS).err(),
        Some(BringUpError::NoSync0 {
            motor: 1,
            types: 0x0003
        })
    );
    // A drive that keeps another synchronisation.
    let keeping = Drive::new(&setup(1))
        .with_synchronisation(SYNC0_ONLY)
        .keeping_synchronisation();
    let nodes = vec![
        drive(0, 0),
        Node::Drive(SubDevice::of(keeping).with_clock(ClockSetup::default())),
        drive(2, 0),
    ];
    let wire = EmulatedWire::new(Chain::of(nodes, Kinematic));
    assert_eq!(
        started(&wire, CLOCKS).err(),
        Some(BringUpError::Synchronisation {
            motor: 1,
            object: 0x1C32,
            sub: 1,
            wanted: 2,
            found: 0
        })
    );
    // A drive whose controller ignores the period.
    let wire = chain([0; 3]);
    wire.bench()
        .chain
        .subdevice_mut(2)
        .unwrap()
        .clock_mut()
        .unwrap()
        .ignore_period();
    assert_eq!(
        started(&wire, CLOCKS).err(),
        Some(BringUpError::ClockRegister {
            motor: 1,
            register: 0x09A0
        })
    );
    // A clock that cannot be led.
    let wire = chain([0, 0, 5_000_000]);
    let Err(BringUpError::ClockApart { motor: 2, .. }) = started(&wire, CLOCKS).map(drop) else {
        panic!("led");
    };
}

/// By SYNC0, in the length of the cycle.
#[test]
fn drives_are_told_to_follow_sync0() {
    let server = running([0; 3]);
    let mut bench = server.wire.bench();
    for position in 1..=3 {
        let drive = bench.chain.subdevice_mut(position).unwrap().drive_mut();
        let told =
            [(0x1C32, 1), (0x1C33, 1), (0x1C32, 2)].map(|(index, sub)| drive.object(index, sub));
        assert_eq!(told, [2, 2, 1_000_000]);
    }
}

/// After a jump of the reference drives stand far from its pulses: a re-arm waits for the phase.
#[test]
fn a_rearm_leads_drives_on_in_phase_only() {
    let mut server = running([0; 3]);
    server
        .wire
        .bench()
        .chain
        .subdevice_mut(1)
        .unwrap()
        .clock_mut()
        .unwrap()
        .jump(450_000);
    let (_, fault) = server.until_fault(10);
    assert!(matches!(fault, Fault::Clock(_)), "{fault}");
    // They stop. A re-arm beyond 400 us is a fault again; between there and the pulse's place it waits.
    while server.drives.phase_ns().unwrap().abs() > 390_000 {
        let _stopping = server.cycle();
    }
    assert!(server.drives.phase_ns().unwrap().abs() > 380_000);
    server.drives.rearm();
    let mut cycles = 0;
    while server.drives.condition() != Condition::Running {
        let _rearming = server.cycle();
        let mut bench = server.wire.bench();
        let mut states = bench.chain.drives_mut().map(|drive| drive.state());
        if server.drives.is_locked() != Some(true) {
            assert!(
                !states.any(|it| it == PowerState::OperationEnabled),
                "cycle {cycles}"
            );
        }
        drop(states);
        drop(bench);
        cycles += 1;
        assert!(cycles < 3_000, "{:?}", server.drives.condition());
    }
    assert!(cycles > 200, "{cycles}");
    assert!(server.drives.phase_ns().unwrap().abs() < 20_000);
}

/// A cable that is pulled before the start is not told as a phase.
#[test]
fn a_bus_that_is_gone_at_the_start_is_named() {
    let wire = chain([0; 3]);
    let lossy = Lossy::new(wire, 0);
    let mut drives =
        Drives::<_, 3>::bring_up_with(lossy.clone(), &configs(), SETTINGS, with(CLOCKS)).unwrap();
    // The first exchange still passes.
    lossy.pass(1);
    drives.start(|inputs| standing(inputs, &[Offset::default(); 3]));
    assert_eq!(drives.condition(), Condition::Stopped(Fault::NoAnswer));
}

#[test]
fn settings_that_cannot_be_are_refused() {
    for (sync0_ns, frame_to_sync0_ns) in [
        (0, 500_000),
        (300_000, 500_000),
        (2_000_000, 500_000),
        (100_000, 500_000),
        (1_000_000, 199_999),
        (1_000_000, 800_001),
    ] {
        let clocks = ClockSettings {
            sync0_ns,
            frame_to_sync0_ns,
            has_sync1: false,
        };
        let refused = started(&chain([0; 3]), clocks).map(drop);
        assert!(
            matches!(refused, Err(BringUpError::Clocks { .. })),
            "{sync0_ns} {frame_to_sync0_ns}"
        );
    }
}

/// Registers as an independent MainDevice writes them: 4 bytes of period, SYNC1 once per cycle.
#[test]
fn sync1_comes_once_per_cycle() {
    let clocks = ClockSettings {
        sync0_ns: 250_000,
        frame_to_sync0_ns: 400_000,
        has_sync1: true,
    };
    let wire = chain([10_000, 0, 0]);
    wire.bench().chain.log_writes();
    let server = started(&wire, clocks).unwrap();
    let bench = wire.bench();
    let last = |address: u16| {
        let writes = bench.chain.writes().iter().rev();
        let mut to_it =
            writes.filter(|write| write.address == Some(address) && write.position == 3);
        to_it.next().unwrap().data.clone()
    };
    assert_eq!(last(0x0981), [7]);
    assert_eq!(last(0x0980), [0]);
    assert_eq!(last(0x09A0), 250_000_u32.to_le_bytes());
    assert_eq!(last(0x09A4), 750_000_u32.to_le_bytes());
    let start = u64::from_le_bytes(last(0x0990).try_into().unwrap());
    assert_eq!(start % (CYCLE_US * 1_000), 0);
    drop(bench);
    drop(server);
}
