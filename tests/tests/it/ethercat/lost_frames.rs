//! Frames that are lost while offsets change: an accepted write never changes what a drive has by more than the limit (T21).

use gantry_tau::model::MachineKind;
use gantry_tau::robot_file::RobotFile;
use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::message::{Mode, Phase};
use gantry_tau_ethercat::emulation::Faults;

use super::{Server, bus_of, section_of_whole_steps};

/// One count, nm.
const COUNT_NM: i64 = 10;

/// Position offset of every drive, and the sum that it follows, counts.
fn at_the_drives<const N: usize, const M: usize>(server: &Server<N, M>) -> Vec<[i64; 2]> {
    let objects = |drive: &gantry_tau_ethercat::emulation::Drive| {
        let [target, offset] = [0x607A, 0x60B0].map(|object| i64::from(drive.object(object, 0)));
        [offset, target + offset]
    };
    server.bus.bench().chain.drives().map(objects).collect()
}

/// Loses frames, while the offsets grow or shrink, and follows what the drives have until it is zero again.
fn loses<K: MachineKind<N>, const N: usize, const M: usize>(robot: &RobotFile<K, N>, faults: Faults, grows: bool) {
    let limits_nm: Vec<i64> =
        robot.motors.axis_of_motor.iter().map(|axis| robot.limits[*axis].limits.position.step().into()).collect();
    assert!(limits_nm.iter().all(|nm| nm % COUNT_NM == 0));
    let section = section_of_whole_steps(robot);
    let bus = bus_of::<K, N, M>(robot, &section);
    let mut server = Server::with(robot, &section, &bus, 0.0);
    let start = at_the_drives(&server);
    let mut client = server.client();
    let (before, then) = if grows { (0, 1_000_000) } else { (1_000_000, 0) };
    let mut last = at_the_drives(&server);
    let mut check = |server: &Server<N, M>| {
        let now = at_the_drives(server);
        for (motor, (now, last)) in now.iter().zip(&last).enumerate() {
            for (now, last) in now.iter().zip(last) {
                let nm = (now - last).abs() * COUNT_NM;
                assert!(nm <= limits_nm[motor], "{faults:?}, grows {grows}: motor {motor} moves by {nm} nm");
            }
        }
        last = now;
    };
    for _ in 0..250 {
        server.answered(&mut client, Mode::Obtain, before);
        check(&server);
    }
    for _ in 0..20 {
        server.answered(&mut client, Mode::Obtain, then);
        check(&server);
    }
    bus.bench().faults = faults;
    let row = server.answered(&mut client, Mode::Obtain, then);
    assert!(row.plant_failed && row.failure.unwrap().to_string().contains("no answer"));
    check(&server);
    let mut failing = 1;
    while server.tick().plant_failed {
        check(&server);
        failing += 1;
    }
    check(&server);
    // The tick after the last lost frame has no reading, and its write confirms what was sent before.
    assert_eq!(failing, 1 + faults.lost_out.max(faults.lost_back));
    while server.tick().state.axes.iter().any(|axis| axis.offsets != Offsets::ZERO) {
        assert_eq!(server.cycle.phase(), Phase::Fault);
        check(&server);
    }
    check(&server);
    assert_eq!(at_the_drives(&server), start);
}

#[test]
fn a_frame_lost_while_an_offset_grows() {
    for frames in 1..=4 {
        let out = Faults { lost_out: frames, ..Faults::default() };
        let back = Faults { lost_back: frames, ..Faults::default() };
        for (faults, grows) in [(out, false), (out, true), (back, false), (back, true)] {
            loses::<_, 3, 3>(&RobotFile::builtin_l2().unwrap(), faults, grows);
            loses::<_, 6, 9>(&RobotFile::builtin_f1().unwrap(), faults, grows);
        }
    }
}
