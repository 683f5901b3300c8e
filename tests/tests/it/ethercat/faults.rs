//! What a bus and its drives do wrong: stop and cause as stated, nothing stale, no jump, back by a
//! re-arm only.

use gantry_tau::ethercat::emulated_bus;
use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::message::{Cause, Mode, Phase};
use gantry_tau_ethercat::Fault;
use gantry_tau_ethercat::emulation::Faults;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile, text_of};
use gantry_tau_server::plant::DriveState;
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::cycle::OperatorInputs;
use gantry_tau_sim::load_generator::{Load, load_generator};
use gantry_tau_tests::client::Client;

use super::{Server, bus, section};

/// Largest step of a drive's own reference: 0.1 m/s, an offset's step of 5 µm (20 µm on six axes),
/// and rounding.
const STEP_NM: i64 = 105_020;
const STEP_OF_SIX_NM: i64 = 120_020;
/// Offset that the client asks for, nm.
const OFFSET_NM: i32 = 200_000;

/// A session in Obtain, moving, with its offsets in force.
pub(super) fn moving() -> (Server<3, 3>, Client<3>) {
    moving_on(&RobotFile::builtin_l2().unwrap(), 0.2)
}

/// The same of the axes of another robot, by another way.
fn moving_on<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    motion_m: f64,
) -> (Server<N, M>, Client<N>) {
    let bus = bus::<_, N, M>(robot);
    let mut server = Server::on(robot, &bus, motion_m);
    let mut client = server.client();
    for _ in 0..2_000 {
        let before = server.positions();
        server.answered(&mut client, Mode::Obtain, OFFSET_NM);
        let ways: Vec<i64> = before
            .iter()
            .zip(server.positions())
            .map(|(then, now)| (now - then).abs())
            .collect();
        // Near its 0.1 m/s, 105 counts a cycle for each mm/s.
        if ways.iter().min() > Some(&9_000) {
            server.largest_step_nm();
            return (server, client);
        }
    }
    panic!("it does not move");
}

impl<const N: usize, const M: usize> Server<N, M> {
    /// Lets these happen to the next frames.
    pub(super) fn next_frames(&self, faults: Faults) {
        self.bus.bench().faults = faults;
    }

    /// Runs the tick of the fault, whose references are refused, and the next one: the server is in
    /// Fault, and not before. Returns its row and the first fault.
    fn until_fault(&mut self) -> (TickRecord<N>, Fault) {
        let row = self.tick();
        assert!(row.plant_failed && row.failure.is_some());
        assert!(
            row.state.phase != Phase::Fault,
            "the fault is not known before the exchange"
        );
        let row = self.tick();
        assert_eq!(
            (row.state.phase, row.ended),
            (Phase::Fault, Some(Cause::Stop))
        );
        (row, self.log.next().unwrap())
    }

    /// Ticks through the ramp to a new session; nothing jumps on the way.
    fn recovers(&mut self) {
        self.rearm();
        assert!(
            self.largest_step_nm() <= if N == 3 { STEP_NM } else { STEP_OF_SIX_NM },
            "a jump"
        );
        let mut client = self.client();
        let row = self.answered(&mut client, Mode::Obtain, 1_000);
        assert_eq!((row.state.phase, row.failure), (Phase::Obtain, None));
        assert_eq!(row.drives, Some([DriveState::Operating; N]));
    }
}

#[test]
fn a_lost_frame_out_and_back() {
    for back in [false, true] {
        let (mut server, _client) = moving();
        server.next_frames(Faults {
            lost_out: u32::from(!back),
            lost_back: u32::from(back),
            ..Faults::default()
        });
        // The tick of the loss, and the one without a reading; the drives go on afterwards.
        let (row, fault) = server.until_fault();
        assert_eq!(fault, Fault::NoAnswer);
        assert!(
            row.failure
                .unwrap()
                .to_string()
                .contains("no answer on the bus in time")
        );
        let next = server.tick();
        assert_eq!(
            (next.failure, next.drives),
            (None, Some([DriveState::Operating; 3]))
        );
        assert!(
            server.largest_step_nm() <= STEP_NM,
            "the way of two cycles at once"
        );
        server.recovers();
    }
}

#[test]
fn a_late_frame_is_a_lost_one() {
    let (mut server, _client) = moving();
    server.next_frames(Faults {
        delayed: 1,
        delay_us: 800,
        ..Faults::default()
    });
    assert_eq!(server.until_fault().1, Fault::NoAnswer);
    for _ in 0..20 {
        let row = server.tick();
        assert_eq!(row.failure, None);
        for axis in row.state.axes {
            let behind = (axis.nominal.0 + i64::from(axis.offsets.position.0)
                - axis.actual.position.0)
                .abs();
            assert!(behind < 400_000, "an old measurement: {behind} nm");
        }
    }
    server.recovers();
}

/// The server waits for half a cycle, as the page says.
#[test]
fn an_answer_within_half_a_cycle_is_in_time() {
    let (mut server, mut client) = moving();
    server.next_frames(Faults {
        delayed: u32::MAX,
        delay_us: 450,
        ..Faults::default()
    });
    for _ in 0..100 {
        assert_eq!(
            server
                .answered(&mut client, Mode::Obtain, OFFSET_NM)
                .failure,
            None
        );
    }
    server.next_frames(Faults {
        delayed: 1,
        delay_us: 550,
        ..Faults::default()
    });
    assert_eq!(server.until_fault().1, Fault::NoAnswer);
}

#[test]
fn a_wrong_counter() {
    let (mut server, _client) = moving();
    server.next_frames(Faults {
        counter_less: 1,
        ..Faults::default()
    });
    let (row, fault) = server.until_fault();
    assert_eq!(
        fault,
        Fault::WorkingCounter {
            expected: 9,
            received: 8
        }
    );
    assert!(row.failure.unwrap().to_string().contains("working counter"));
    server.next_frames(Faults::default());
    server.recovers();
}

#[test]
fn a_lost_drive() {
    let (mut server, _client) = moving();
    server.bus.bench().chain.bypass(Some(1));
    assert_eq!(server.until_fault().1, Fault::Absent { motor: 1 });
    let actual = server.tick().state.axes.map(|axis| axis.actual);
    for _ in 0..50 {
        // The last measurements stand, flagged by a failed machine: none is handed out as new.
        let row = server.tick();
        assert!(row.plant_failed);
        assert_eq!(row.state.axes.map(|axis| axis.actual), actual);
    }
    server.bus.bench().chain.bypass(None);
    assert!(server.tick().plant_failed, "not enabled by itself");
    server.recovers();
}

#[test]
fn an_error_of_the_application_layer() {
    let (mut server, _client) = moving();
    server
        .bus
        .bench()
        .chain
        .subdevice_mut(2)
        .unwrap()
        .fail(0x001A);
    let (row, fault) = server.until_fault();
    assert_eq!(
        fault,
        Fault::State {
            motor: 2,
            state: 4,
            code: 0x001A
        }
    );
    assert!(row.failure.unwrap().to_string().contains("left OP"));
    server.recovers();
}

#[test]
fn a_drive_in_fault_and_a_following_error() {
    let (mut server, _client) = moving();
    server
        .bus
        .bench()
        .chain
        .subdevice_mut(0)
        .unwrap()
        .drive_mut()
        .trip();
    assert_eq!(
        server.until_fault().1,
        Fault::Drive {
            motor: 0,
            error_code: 0x2310
        }
    );
    server.recovers();
    // A window of half a count: it is left at once, for longer than 0 ms.
    let (mut server, _client) = moving();
    {
        let mut bench = server.bus.bench();
        let drive = bench.chain.subdevice_mut(1).unwrap().drive_mut();
        drive.set_object(0x6065, 0, 0);
        drive.set_object(0x6066, 0, 0);
    }
    assert_eq!(server.until_fault().1, Fault::FollowingError { motor: 1 });
    server
        .bus
        .bench()
        .chain
        .subdevice_mut(1)
        .unwrap()
        .drive_mut()
        .set_object(0x6065, 0, 200_000);
    server.recovers();
}

#[test]
fn a_bus_that_is_gone_for_ten_seconds_in_motion() {
    let (mut server, _client) = moving();
    server.bus.bench().chain.cut_behind(0);
    assert_eq!(server.until_fault().1, Fault::NoAnswer);
    for _ in 0..100 {
        assert!(server.tick().plant_failed);
    }
    let stood = server.positions();
    for _ in 100..10_000 {
        assert!(server.tick().plant_failed);
    }
    server.bus.bench().chain.cut_behind(3);
    for _ in 0..200 {
        assert!(server.tick().plant_failed, "not enabled by itself");
    }
    let apart = server
        .positions()
        .iter()
        .zip(&stood)
        .map(|(now, then)| (now - then).abs())
        .max()
        .unwrap();
    assert!(apart < 100, "{apart} counts: the brakes hold");
    server.recovers();
}

/// A killed server in motion: the watchdogs stop the drives, on a way that is stated. The next
/// server finds the offsets in force, waits for the re-arm, and ramps them to zero without a step.
#[test]
fn a_killed_server_and_its_successor() {
    let (server, _client) = moving();
    let bus = server.bus.clone();
    let before = server.positions();
    server.kill();
    bus.idle(1_000_000);
    let way = {
        let bench = bus.bench();
        bench
            .chain
            .drives()
            .zip(before)
            .map(|(drive, then)| (drive.motor().position - then).abs())
            .max()
            .unwrap()
    };
    // The references stand after the last cycle: the drives close in on them and hold, before the
    // watchdog of 5 ms ends. 0.1 m/s.
    let way_um = way * 1_000_000 / 104_857_600;
    println!("way after the kill at 0.1 m/s: {way_um} um");
    assert!(way_um < 300, "{way_um}");
    let robot = RobotFile::builtin_l2().unwrap();
    let mut again = Server::on(&robot, &bus, 0.0);
    let row = again.tick();
    assert_eq!(row.state.phase, Phase::Fault, "drives in fault");
    assert!(matches!(
        again.log.next(),
        Some(Fault::Drive {
            error_code: 0x7500,
            ..
        })
    ));
    let offsets = row.state.axes.map(|axis| axis.offsets.position.0);
    assert!(
        offsets.iter().all(|nm| (nm - OFFSET_NM).abs() < 10),
        "{offsets:?}"
    );
    again.rearm();
    // The brakes held the motors; enabling them where they stand, then the ramp of 100 nm per tick.
    assert!(again.largest_step_nm() <= 120, "a step");
    let row = again.tick();
    assert_eq!(row.state.axes.map(|axis| axis.offsets), [Offsets::ZERO; 3]);
    assert!(
        bus.bench()
            .chain
            .drives()
            .all(|drive| drive.object(0x60B0, 0) == 0)
    );
}

/// A machine behind the drives that stops, or whose springs find no equilibrium: none of its
/// measurements is handed out as fresh. Simulated drives with supervision of their own (`[drives]`)
/// would be such a machine; the emulated drives are the only ones there.
#[test]
fn a_machine_that_stops_behind_the_drives() {
    let text = text_of("l2")
        .unwrap()
        .replacen("[simulation]", "[drives]\n\n[simulation]", 1);
    let AnyRobotFile::L2(robot) = AnyRobotFile::parse("supervised.toml", &text).unwrap() else {
        panic!()
    };
    assert!(robot.drives.is_some());
    let (mut hand, tool) = load_generator();
    let bus = emulated_bus::<_, 3, 3>(&*robot, &section(&*robot), tool).unwrap();
    let mut server = Server::on(&*robot, &bus, 0.0);
    for _ in 0..200 {
        server.tick();
    }
    for force_n in [8_000.0, 1e5] {
        let pull = hand.set(&Load {
            step: 1,
            force_n: [force_n, 0.0, 0.0],
            moment_nm: [0.0; 3],
        });
        println!("{pull:?}");
        for _ in 0..100 {
            let row = server.tick();
            println!(
                "{:?}",
                (
                    row.failure,
                    row.state.phase,
                    row.state
                        .axes
                        .map(|axis| axis.actual.position.0 - axis.nominal.0)
                )
            );
        }
        hand.release();
        for _ in 0..1_000 {
            server.tick();
        }
        if server.cycle.phase() == Phase::Fault {
            server.rearm();
        }
        let mut client = server.client();
        for _ in 0..500 {
            server.answered(&mut client, Mode::Obtain, 100_000);
        }
        let row = server.answered(&mut client, Mode::Obtain, 100_000);
        assert_eq!((row.state.phase, row.failure), (Phase::Obtain, None));
        for axis in row.state.axes {
            let off = axis.actual.position.0 - axis.nominal.0;
            assert!((off - 100_000).abs() < 1_000, "{force_n} N: {off} nm");
        }
        drop(client);
        while server.tick().state.phase != Phase::Listening {}
    }
}

/// In operation nothing is allocated, and neither is it on the way to a stop and back.
#[test]
fn no_cycle_allocates_through_loss_stop_and_rearm() {
    let (mut server, client) = moving();
    drop(client);
    server.counts_allocations = true;
    server.next_frames(Faults {
        lost_out: 1,
        lost_back: 1,
        ..Faults::default()
    });
    server.until_fault();
    server.rearm();
    for trouble in 0..3 {
        {
            let mut bench = server.bus.bench();
            match trouble {
                0 => bench.chain.cut_behind(0),
                1 => bench.chain.subdevice_mut(0).unwrap().drive_mut().trip(),
                _ => bench.chain.subdevice_mut(2).unwrap().fail(0x001A),
            }
        }
        server.until_fault();
        for _ in 0..20 {
            assert!(server.tick().plant_failed);
        }
        server.bus.bench().chain.cut_behind(3);
        server.rearm();
        assert_eq!(server.tick().drives, Some([DriveState::Operating; 3]));
    }
}

/// Counts between two motors; drives with odd numbers count backwards.
fn apart(server: &Server<6, 9>, motors: [usize; 2]) -> i64 {
    let at = server.positions();
    let [one, other] = motors.map(|motor| {
        if motor % 2 == 0 {
            at[motor]
        } else {
            -at[motor]
        }
    });
    (one - other).abs()
}

/// One of the two drives of an axis is lost: its partner stops too, and both come back together.
#[test]
fn one_of_a_pair_is_lost() {
    let robot = RobotFile::builtin_f1().unwrap();
    let axes = robot.motors.axis_of_motor.clone();
    let second = (1..9)
        .find(|motor| axes[..*motor].contains(&axes[*motor]))
        .unwrap();
    let first = axes.iter().position(|axis| *axis == axes[second]).unwrap();
    let (mut server, _client) = moving_on::<_, 6, 9>(&robot, 0.05);
    let before = apart(&server, [first, second]);
    server.bus.bench().chain.bypass(Some(second));
    let motor = u8::try_from(second).unwrap();
    assert_eq!(server.until_fault().1, Fault::Absent { motor });
    let mut most = 0;
    for _ in 0..500 {
        let row = server.tick();
        assert!(row.plant_failed && row.state.phase == Phase::Fault);
        most = most.max((apart(&server, [first, second]) - before).abs());
    }
    // Counts of 9.5 nm: one cart, whose motors are stiff in the simulation.
    println!("the motors of the pair are at most {most} counts further apart");
    assert!(most <= 1, "{most}");
    // What the drives do is not known.
    assert_eq!(server.tick().drives, Some([DriveState::NotReady; 6]));
    server.bus.bench().chain.bypass(None);
    server.recovers();
    // And a fault of that drive by itself.
    let (mut server, _client) = moving_on::<_, 6, 9>(&robot, 0.05);
    server
        .bus
        .bench()
        .chain
        .subdevice_mut(second)
        .unwrap()
        .drive_mut()
        .trip();
    assert_eq!(
        server.until_fault().1,
        Fault::Drive {
            motor,
            error_code: 0x2310
        }
    );
    for _ in 0..100 {
        assert!(server.tick().plant_failed);
    }
    server.recovers();
}

/// A killed server with offsets in force: the drives hold them, the next server finds what the
/// drives know, and ramps it without a step.
fn restarts<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    knows_offset: bool,
) {
    let bus = bus::<K, N, M>(robot);
    if !knows_offset {
        bus.bench()
            .chain
            .drives_mut()
            .for_each(|drive| drive.remove_object(0x60B0));
    }
    let mut server = Server::on(robot, &bus, 0.0);
    let mut client = server.client();
    for _ in 0..300 {
        server.answered(&mut client, Mode::Obtain, 20_000);
    }
    let before = server.positions();
    server.kill();
    bus.idle(1_000_000);
    let mut again: Server<N, M> = Server::on(robot, &bus, 0.0);
    let moved = before
        .iter()
        .zip(again.positions())
        .map(|(then, now)| (then - now).abs())
        .max()
        .unwrap();
    assert!(
        moved <= 110,
        "{moved} counts: what the motors lagged behind"
    );
    let row = again.tick();
    assert_eq!(row.state.phase, Phase::Fault);
    assert_eq!(
        again.log.next(),
        Some(Fault::Drive {
            motor: 0,
            error_code: 0x7500
        })
    );
    for axis in row.state.axes {
        // Without 60B0h the drive knows the sum: it is the nominal reference.
        let expected = if knows_offset { 20_000 } else { 0 };
        assert!((axis.offsets.position.0 - expected).abs() < 10, "{axis:?}");
    }
    let ticks = again.rearm();
    // 20 µm at the 100 nm of each tick of the ramp.
    assert_eq!(ticks > 200, knows_offset, "{ticks}");
    assert!(
        again.largest_step_nm() <= if knows_offset { 120 } else { 20 },
        "a step"
    );
    let row = again.tick();
    assert_eq!((row.state.phase, row.failure), (Phase::Listening, None));
    assert_eq!(row.state.axes.map(|axis| axis.offsets), [Offsets::ZERO; N]);
    assert!(
        bus.bench()
            .chain
            .drives()
            .all(|drive| drive.object(0x60B0, 0) == 0)
    );
}

#[test]
fn a_restart_on_nine_motors_and_without_60b0() {
    for knows_offset in [true, false] {
        restarts::<_, 3, 3>(&RobotFile::builtin_l2().unwrap(), knows_offset);
        restarts::<_, 6, 9>(&RobotFile::builtin_f1().unwrap(), knows_offset);
    }
}

/// Pushes the first motors by counts.
fn push(server: &Server<6, 9>, pushed: [i64; 2]) {
    for (motor, counts) in pushed.into_iter().enumerate() {
        server
            .bus
            .bench()
            .chain
            .subdevice_mut(motor)
            .unwrap()
            .drive_mut()
            .motor_mut()
            .pushed = counts;
    }
}

/// After a fault somebody has moved a motor by hand, while the drives were off. A re-arm enables
/// them only where they agree: the motors of an axis together, and inside the travel.
#[test]
fn a_rearm_needs_motors_that_agree() {
    let (mut server, _client) = moving_on::<_, 6, 9>(&RobotFile::builtin_f1().unwrap(), 0.02);
    server
        .bus
        .bench()
        .chain
        .subdevice_mut(0)
        .unwrap()
        .drive_mut()
        .trip();
    server.until_fault();
    // One motor of a pair by 0.6 mm; then both, far beyond the travel.
    for (pushed, reason) in [
        // 104 857.6 counts per mm; drives with odd numbers count backwards.
        ([62_915, 0], "its motors stand more than 0.5 mm apart"),
        (
            [1_048_576_000, -1_048_576_000],
            "it stands outside of the machine's travel",
        ),
    ] {
        // Measured in the next cycle.
        push(&server, pushed);
        server.tick();
        server.tick();
        server.largest_step_nm();
        for _ in 0..2_000 {
            let row = server.step(OperatorInputs {
                stop: false,
                rearm: true,
                ..OperatorInputs::default()
            });
            assert_eq!(row.state.phase, Phase::Fault);
        }
        let row = server.tick();
        let failure = row.failure.unwrap();
        let expected = format!("the machine could not enable the drives of axis 0: {reason}");
        assert_eq!(failure.as_str(), expected);
        assert_ne!(row.drives, Some([DriveState::Operating; 6]));
        assert_eq!(server.largest_step_nm(), 0, "no drive was enabled");
        push(&server, [0; 2]);
        server.tick();
        server.tick();
    }
    server.recovers();
}

/// What a drive follows is the reference that core gave out, in its counts: no sum and no clamp
/// stands between.
#[test]
fn drives_follow_the_references_of_core() {
    let (mut server, mut client) = moving();
    let (mut given, mut followed) = (Vec::new(), Vec::new());
    for tick in 0..600 {
        // Offsets that are limited, reached, and turned back.
        let nm = if tick < 300 { OFFSET_NM } else { -OFFSET_NM };
        let row = server.answered(&mut client, Mode::Obtain, nm);
        assert_eq!(row.state.phase, Phase::Obtain);
        given.push(
            server
                .cycle
                .endpoint()
                .output()
                .unwrap()
                .references
                .map(|reference| reference.position.0),
        );
        let bench = server.bus.bench();
        // 104.8576 counts per um; drives with odd numbers count backwards.
        let nm = bench.chain.drives().enumerate().map(|(motor, drive)| {
            let counts = drive.motor().reference * if motor % 2 == 0 { 1 } else { -1 };
            counts * 1_000_000_000 / 104_857_600
        });
        followed.push(nm.collect::<Vec<_>>());
    }
    // The frame of a tick reaches the drives in it, or in the next one: the same for all ticks.
    let [same, next] = [0, 1].map(|delay| {
        let pairs = given.iter().zip(&followed[delay..]);
        let apart = pairs.flat_map(|(given, followed)| {
            given
                .iter()
                .zip(followed)
                .map(|(one, other)| (one - other).abs())
        });
        apart.max().unwrap()
    });
    println!("drives and core: at most {same} nm apart in the same tick, {next} in the next one");
    // A count is 9.5 nm.
    assert!(
        same.min(next) <= 10 && same.max(next) > 50_000,
        "{same} {next}"
    );
}
