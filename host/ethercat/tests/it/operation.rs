//! OP, enabled, cyclic; offsets where they belong; an orderly end.

use gantry_tau_ethercat::emulation::PowerState;
use gantry_tau_ethercat::{Condition, Offset, Target};

use crate::bench::{Server, setups, wire};

fn reaches_operation<const M: usize>() {
    let mut server = Server::<M>::running();
    for step in 0..200 {
        for (motor, target) in server.targets.iter_mut().enumerate() {
            target.position += 3 + motor as i32;
            target.offset = Offset {
                position: -step,
                velocity: 7 * step,
                torque: step as i16,
            };
        }
        server.cycle().unwrap();
    }
    let bench = server.wire.bench();
    for (drive, target) in bench.chain.drives().zip(&server.targets) {
        assert_eq!(drive.state(), PowerState::OperationEnabled);
        let objects = [0x607A, 0x60B0, 0x60B1, 0x60B2].map(|object| drive.object(object, 0));
        let Target { position, offset } = *target;
        assert_eq!(
            objects,
            [
                position,
                offset.position,
                offset.velocity,
                offset.torque.into()
            ]
        );
    }
    drop(bench);
    server.cycle().unwrap();
    for (input, target) in server.drives.inputs().iter().zip(&server.targets) {
        assert!(
            (input.position - target.position - target.offset.position).abs() <= 24,
            "{input:?} {target:?}"
        );
    }
    assert!(
        server.largest_step() <= 12,
        "enabling and cycling made a step"
    );
}

#[test]
fn three_and_nine_motors_reach_operation() {
    reaches_operation::<3>();
    reaches_operation::<9>();
}

#[test]
fn without_60b0_the_sum_reaches_607a() {
    let mut setups = setups(3);
    setups[1].missing.push(0x60B0);
    let wire = wire(&setups);
    let mut server = Server::<3>::on(&wire);
    assert_eq!(
        server
            .drives
            .initial()
            .map(|initial| initial.has_position_offset),
        [true, false, true]
    );
    let start = server.targets.map(|target| target.position);
    for _ in 0..100 {
        for target in &mut server.targets {
            target.offset.position += 2;
        }
        server.cycle().unwrap();
    }
    let bench = wire.bench();
    let objects: Vec<[i32; 2]> = bench
        .chain
        .drives()
        .map(|d| [0x607A, 0x60B0].map(|object| d.object(object, 0)))
        .collect();
    assert_eq!(
        objects,
        [[start[0], 200], [start[1] + 200, 0], [start[2], 200]]
    );
}

#[test]
fn an_orderly_end_leaves_no_fault() {
    let server = Server::<3>::running();
    let wire = server.wire.clone();
    drop(server);
    wire.idle(100_000);
    for drive in wire.bench().chain.drives() {
        assert_eq!(
            (drive.state(), drive.object(0x603F, 0)),
            (PowerState::SwitchOnDisabled, 0)
        );
    }
    let server = Server::<3>::on(&wire);
    assert_eq!(server.drives.condition(), Condition::Running);
}

#[test]
fn drives_are_found_by_alias_wherever_they_stand() {
    let wire = wire(&setups(3));
    wire.bench().chain.swap(0, 2);
    let mut server = Server::<3>::on(&wire);
    server.targets[0].offset.position = 4;
    server.cycle().unwrap();
    server.cycle().unwrap();
    let bench = wire.bench();
    let offsets: Vec<i32> = bench
        .chain
        .drives()
        .map(|drive| drive.object(0x60B0, 0))
        .collect();
    assert_eq!(offsets, [0, 0, 4], "motor 0 is the last on the bus");
}

/// Devices that the file does not name stay in PRE-OP, and do not count.
#[test]
fn other_devices_are_left_alone() {
    let mut chain = setups(4);
    chain.swap(0, 3);
    let wire = wire(&chain);
    let mut server = Server::<3>::on(&wire);
    server.cycle().unwrap();
    assert!(!wire.bench().chain.subdevice(0).unwrap().is_operational());
}
