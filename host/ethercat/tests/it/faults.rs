//! Faults in operation: named, judged in their cycle, and left by a re-arm only. The drives' own
//! references never jump.

use gantry_tau_ethercat::emulation::{PowerState, STEP_US};
use gantry_tau_ethercat::{Condition, Fault, Offset, Target};

use crate::bench::{Server, setups, standing, wire};

/// Largest step of a drive's own reference when a motor moves by 10 counts per cycle, and its
/// offset by 2.
const STEP: i64 = 12;

/// A server whose motors move.
fn moving() -> Server<3> {
    let mut server = Server::running();
    for _ in 0..50 {
        walk(&mut server);
        server.cycle().unwrap();
    }
    assert!(server.largest_step() <= STEP);
    server
}

fn walk(server: &mut Server<3>) {
    for target in &mut server.targets {
        target.position += 10;
        target.offset.position += 2;
    }
}

fn states(server: &Server<3>) -> Vec<PowerState> {
    server
        .wire
        .bench()
        .chain
        .drives()
        .map(|drive| drive.state())
        .collect()
}

#[test]
fn one_lost_frame_costs_one_cycle() {
    for back in [false, true] {
        let mut server = moving();
        let before = *server.drives.inputs();
        if back {
            server.wire.bench().faults.lost_back = 1;
        } else {
            server.wire.bench().faults.lost_out = 1;
        }
        walk(&mut server);
        assert_eq!(server.cycle(), Err(Fault::NoAnswer));
        assert_eq!(*server.drives.inputs(), before, "nothing stale is taken");
        assert_eq!(server.drives.condition(), Condition::Running);
        // They are sent again in place of the next ones, and are confirmed; the measurements are
        // good.
        let sent = server.targets;
        assert!(!server.drives.is_confirmed());
        walk(&mut server);
        assert_eq!(server.cycle(), Err(Fault::Resent));
        assert_eq!(targets_of_the_drives(&server), sent);
        assert!(server.drives.is_confirmed() && *server.drives.inputs() != before);
        server.targets = sent;
        walk(&mut server);
        server.cycle().unwrap();
        assert_eq!(targets_of_the_drives(&server), server.targets);
        assert!(
            server.largest_step() <= STEP,
            "the references of two cycles at once"
        );
    }
}

/// References that the drives have.
fn targets_of_the_drives(server: &Server<3>) -> [Target; 3] {
    let bench = server.wire.bench();
    let mut targets = [Target::default(); 3];
    for (target, drive) in targets.iter_mut().zip(bench.chain.drives()) {
        target.position = drive.object(0x607A, 0);
        target.offset.position = drive.object(0x60B0, 0);
    }
    targets
}

/// An answer that comes after its cycle, whenever it comes, is a lost one: measurements and
/// outcomes are the same, count for count.
#[test]
fn a_late_answer_is_a_lost_one() {
    // Half a cycle is waited for; 1.3 and 2.3 cycles are in the wait of another exchange, and so
    // are 1.01 and 1.49.
    for delay_us in [700, 1_010, 1_300, 1_490, 1_700, 2_300, 3_200] {
        for delayed in [1, 3] {
            let (mut late, mut lost) = (moving(), moving());
            {
                let mut bench = late.wire.bench();
                (bench.faults.delayed, bench.faults.delay_us) = (delayed, delay_us);
            }
            lost.wire.bench().faults.lost_back = delayed;
            for cycle in 0..20 {
                walk(&mut late);
                walk(&mut lost);
                let outcomes = (late.cycle(), lost.cycle());
                assert_eq!(outcomes.0, outcomes.1, "{delay_us} us, cycle {cycle}");
                assert_eq!(outcomes.0.is_err(), cycle <= delayed, "{outcomes:?}");
                assert_eq!(
                    late.drives.inputs(),
                    lost.drives.inputs(),
                    "{delay_us} us, cycle {cycle}"
                );
                assert_eq!(targets_of_the_drives(&late), targets_of_the_drives(&lost));
            }
        }
    }
}

#[test]
fn a_wrong_counter_is_no_reading() {
    let mut server = moving();
    server.wire.bench().faults.counter_less = 1;
    let before = *server.drives.inputs();
    walk(&mut server);
    assert_eq!(
        server.cycle(),
        Err(Fault::WorkingCounter {
            expected: 9,
            received: 8
        })
    );
    assert_eq!(*server.drives.inputs(), before);
    server.wire.bench().faults.counter_less = 0;
    assert_eq!(server.cycle(), Err(Fault::Resent));
    server.cycle().unwrap();
}

#[test]
fn a_lost_drive_stops_the_others() {
    let mut server = moving();
    server.wire.bench().chain.bypass(Some(1));
    assert_eq!(server.until_fault(1), (0, Fault::Absent { motor: 1 }));
    for _ in 0..4 {
        assert_eq!(server.cycle(), Err(Fault::Absent { motor: 1 }));
    }
    assert_eq!(
        server.drives.condition(),
        Condition::Stopped(Fault::Absent { motor: 1 }),
        "after the watchdog's five"
    );
    for _ in 0..20 {
        assert!(server.cycle().is_err());
    }
    assert_eq!(
        states(&server),
        [
            PowerState::SwitchOnDisabled,
            PowerState::Fault,
            PowerState::SwitchOnDisabled
        ]
    );
    assert!(server.largest_step() <= STEP);
    // Found again, and enabled after a re-arm only, where the motors stand.
    server.wire.bench().chain.bypass(None);
    for _ in 0..20 {
        assert!(server.cycle().is_err());
    }
    server.drives.rearm();
    server.until_running(200);
    assert_eq!(states(&server), [PowerState::OperationEnabled; 3]);
    assert!(server.largest_step() <= STEP);
}

#[test]
fn a_cut_cable_loses_everything_behind() {
    let mut server = moving();
    server.wire.bench().chain.cut_behind(1);
    assert_eq!(server.cycle(), Err(Fault::Absent { motor: 1 }));
    server.wire.bench().chain.cut_behind(0);
    assert_eq!(server.cycle(), Err(Fault::NoAnswer));
}

#[test]
fn an_error_of_the_application_layer_is_named_with_its_code() {
    let mut server = moving();
    server
        .wire
        .bench()
        .chain
        .subdevice_mut(2)
        .unwrap()
        .fail(0x0027);
    let fault = Fault::State {
        motor: 2,
        state: 4,
        code: 0x0027,
    };
    assert_eq!(server.cycle(), Err(fault));
    assert_eq!(server.drives.condition(), Condition::Stopped(fault));
    assert!(
        fault.to_string().contains("0x0027: FreeRun not supported"),
        "{fault}"
    );
    for _ in 0..10 {
        assert_eq!(server.cycle(), Err(fault), "the first cause stands");
    }
    assert_eq!(
        states(&server)[2],
        PowerState::Fault,
        "a drive that leaves OP is not enabled"
    );
    server.drives.rearm();
    server.until_running(200);
    assert!(server.largest_step() <= STEP);
}

#[test]
fn a_drive_in_fault_is_reset_by_a_rearm_only() {
    let mut server = moving();
    server
        .wire
        .bench()
        .chain
        .subdevice_mut(0)
        .unwrap()
        .drive_mut()
        .trip();
    let (cycles, fault) = server.until_fault(3);
    assert_eq!(
        fault,
        Fault::Drive {
            motor: 0,
            error_code: 0x2310
        }
    );
    assert!(cycles <= 1);
    for _ in 0..500 {
        assert_eq!(server.cycle(), Err(fault));
    }
    assert_eq!(
        states(&server),
        [
            PowerState::Fault,
            PowerState::SwitchOnDisabled,
            PowerState::SwitchOnDisabled
        ]
    );
    server.drives.rearm();
    assert!(
        server.until_running(100) > 5,
        "states of CiA 402, one at a time"
    );
    assert!(server.largest_step() <= STEP);
}

#[test]
fn a_following_error_is_told_apart() {
    let mut server = moving();
    server
        .wire
        .bench()
        .chain
        .subdevice_mut(1)
        .unwrap()
        .drive_mut()
        .set_object(0x6065, 0, 3);
    // Half the way in each step: it is outside while it moves, for longer than its 10 ms.
    let fault = (0..50).find_map(|_| {
        walk(&mut server);
        server.cycle().err()
    });
    assert_eq!(fault, Some(Fault::FollowingError { motor: 1 }));
}

/// Positions of the motors, counts.
fn positions(server: &Server<3>) -> Vec<i64> {
    server
        .wire
        .bench()
        .chain
        .drives()
        .map(|drive| drive.motor().position)
        .collect()
}

/// The bus is gone for 10 s in motion, and comes back: the drives have stopped by themselves, and
/// stay so until a re-arm.
#[test]
fn a_bus_that_is_gone_for_ten_seconds_in_motion() {
    let mut server = moving();
    let offsets = server.targets.map(|target| target.offset);
    server.wire.bench().chain.cut_behind(0);
    for cycle in 0..10_000 {
        walk(&mut server);
        assert_eq!(server.cycle(), Err(Fault::NoAnswer), "{cycle}");
    }
    let place = positions(&server);
    assert_eq!(states(&server), [PowerState::Fault; 3]);
    assert!(server.largest_step() <= STEP);
    server.wire.bench().chain.cut_behind(3);
    for _ in 0..100 {
        assert!(server.cycle().is_err());
    }
    assert_eq!(
        states(&server),
        [PowerState::Fault; 3],
        "not enabled by itself"
    );
    server.targets = standing(server.drives.inputs(), &offsets);
    server.drives.rearm();
    server.until_running(200);
    let after = positions(&server);
    assert_eq!(place, after);
    assert!(server.largest_step() <= 1, "enabled where they stand");
}

/// A killed server: the watchdog stops the drives, within its five cycles and the ramp of the
/// drive.
#[test]
fn a_killed_server_is_stopped_for() {
    let server = moving();
    let before = positions(&server);
    server.wire.idle(7 * STEP_US);
    assert_eq!(states(&server), [PowerState::Fault; 3]);
    let way = positions(&server)
        .iter()
        .zip(before)
        .map(|(now, then)| now - then)
        .max()
        .unwrap();
    // The last references are one cycle ahead of the motors, which close in on them.
    assert!((0..=2 * STEP).contains(&way), "{way}");
    server.wire.idle(1_000_000);
    assert!(
        server
            .wire
            .bench()
            .chain
            .drives()
            .all(|drive| drive.object(0x603F, 0) == 0x7500)
    );
}

/// A restart reads the offsets in force back, and enables without a step; a drive in fault waits
/// for the re-arm.
#[test]
fn a_restart_with_offsets_in_force_makes_no_step() {
    let server = moving();
    let wire = server.wire.clone();
    let in_force = server.targets.map(|target| target.offset);
    std::mem::forget(server);
    wire.idle(50_000);
    let mut again = Server::<3>::on(&wire);
    assert_eq!(
        again.drives.initial().map(|initial| initial.offset),
        in_force
    );
    assert!(in_force[0] != Offset::default());
    assert_eq!(
        again.drives.condition(),
        Condition::Stopped(Fault::Drive {
            motor: 0,
            error_code: 0x7500
        })
    );
    again.forget_steps();
    again.drives.rearm();
    again.until_running(200);
    assert!(again.largest_step() <= 1);
    assert_eq!(again.targets.map(|target| target.offset), in_force);
}

/// A drive that stays in another mode would take a position for something else: it is not enabled,
/// and named.
#[test]
fn a_drive_in_another_mode_is_not_enabled() {
    let wire = wire(&setups(3));
    wire.bench()
        .chain
        .subdevice_mut(1)
        .unwrap()
        .drive_mut()
        .force_mode(Some(1));
    let server = Server::<3>::on(&wire);
    let fault = Fault::Mode { motor: 1, mode: 1 };
    assert_eq!(server.drives.condition(), Condition::Stopped(fault));
    assert_eq!(
        fault.to_string(),
        "motor 1: the drive is in another mode of operation (6061h: 1, expected 8)"
    );
    assert_ne!(states(&server)[1], PowerState::OperationEnabled);
    assert_eq!(server.largest_step(), 0);
}

#[test]
fn a_mode_that_changes_in_operation_stops_the_drives() {
    let mut server = moving();
    server
        .wire
        .bench()
        .chain
        .subdevice_mut(2)
        .unwrap()
        .drive_mut()
        .force_mode(Some(9));
    assert_eq!(server.until_fault(3).1, Fault::Mode { motor: 2, mode: 9 });
    for _ in 0..20 {
        assert!(server.cycle().is_err());
    }
    assert_eq!(states(&server), [PowerState::SwitchOnDisabled; 3]);
    server
        .wire
        .bench()
        .chain
        .subdevice_mut(2)
        .unwrap()
        .drive_mut()
        .force_mode(None);
    server.drives.rearm();
    server.until_running(200);
}

/// A drive without 603Fh tells a following error by bit 13 of its status word.
#[test]
fn a_following_error_without_603f() {
    let mut setups = setups(3);
    setups[1].missing.push(0x603F);
    let mut server = Server::<3>::on(&wire(&setups));
    assert_eq!(server.drives.condition(), Condition::Running);
    server
        .wire
        .bench()
        .chain
        .subdevice_mut(1)
        .unwrap()
        .drive_mut()
        .set_object(0x6065, 0, 3);
    let fault = (0..50).find_map(|_| {
        walk(&mut server);
        server.cycle().err()
    });
    assert_eq!(fault, Some(Fault::FollowingError { motor: 1 }));
    // Another fault of it has no code.
    server
        .wire
        .bench()
        .chain
        .subdevice_mut(1)
        .unwrap()
        .drive_mut()
        .set_object(0x6065, 0, 20_000);
    server.drives.rearm();
    server.until_running(200);
    server
        .wire
        .bench()
        .chain
        .subdevice_mut(1)
        .unwrap()
        .drive_mut()
        .trip();
    assert_eq!(
        server.until_fault(3).1,
        Fault::Drive {
            motor: 1,
            error_code: 0
        }
    );
}

/// A drive that was without power has lost its configuration: it is not enabled again until the
/// server is started again.
#[test]
fn a_drive_without_power_for_a_moment() {
    let mut server = moving();
    server
        .wire
        .bench()
        .chain
        .subdevice_mut(1)
        .unwrap()
        .power_cycle();
    let (cycles, fault) = server.until_fault(1);
    assert_eq!((cycles, fault), (0, Fault::Absent { motor: 1 }));
    for _ in 0..3 {
        server.drives.rearm();
        for _ in 0..200 {
            assert!(server.cycle().is_err());
        }
        assert_ne!(states(&server)[1], PowerState::OperationEnabled);
    }
    assert!(server.largest_step() <= STEP);
    let wire = server.wire.clone();
    drop(server);
    wire.idle(50_000);
    let mut again = Server::<3>::on(&wire);
    again.drives.rearm();
    again.until_running(200);
    assert_eq!(states(&again), [PowerState::OperationEnabled; 3]);
}
