//! Frames that are lost while offsets change: an accepted write never changes what a drive has by
//! more than the limit (T21).

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::message::{Mode, Phase};
use gantry_tau_ethercat::emulation::Faults;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{Clocks, Ethercat, RobotFile};
use gantry_tau_server::server::cycle::OperatorInputs;

use super::{Server, bus_of, section_of_whole_steps};

/// One count, nm.
const COUNT_NM: i64 = 10;

/// Position offset of every drive, and the sum that it follows, counts.
fn at_the_drives<const N: usize, const M: usize>(server: &Server<N, M>) -> Vec<[i64; 2]> {
    let bench = server.bus.bench();
    let objects = bench.chain.drives().map(|drive| {
        let [target, offset] = [0x607A, 0x60B0].map(|object| i64::from(drive.object(object, 0)));
        [offset, target + offset]
    });
    objects.collect()
}

/// Steps of the drives, none of which may be larger than its limit.
struct Steps {
    limits_nm: Vec<i64>,
    last: Vec<[i64; 2]>,
    case: String,
}

impl Steps {
    fn check<const N: usize, const M: usize>(&mut self, server: &Server<N, M>) {
        let now = at_the_drives(server);
        for (motor, (now, last)) in now.iter().zip(&self.last).enumerate() {
            for (now, last) in now.iter().zip(last) {
                let nm = (now - last).abs() * COUNT_NM;
                assert!(
                    nm <= self.limits_nm[motor],
                    "{}: motor {motor} moves by {nm} nm",
                    self.case
                );
            }
        }
        self.last = now;
    }
}

/// Loses frames, while the offsets grow or shrink, and follows what the drives have until it is
/// zero again.
fn loses<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    clocks: Clocks,
    faults: Faults,
    grows: bool,
) {
    let limits_nm: Vec<i64> = robot
        .motors
        .axis_of_motor
        .iter()
        .map(|axis| robot.limits[*axis].limits.position.step().into())
        .collect();
    assert!(limits_nm.iter().all(|nm| nm % COUNT_NM == 0));
    let section = Ethercat {
        clocks,
        ..section_of_whole_steps(robot)
    };
    let bus = bus_of::<K, N, M>(robot, &section);
    let mut server = Server::with(robot, &section, &bus, 0.0);
    let start = at_the_drives(&server);
    let mut client = server.client();
    let (before, then) = if grows {
        (0, 1_000_000)
    } else {
        (1_000_000, 0)
    };
    let mut steps = Steps {
        limits_nm,
        last: at_the_drives(&server),
        case: format!("{clocks:?}, {faults:?}, grows {grows}"),
    };
    for _ in 0..250 {
        server.answered(&mut client, Mode::Obtain, before);
        steps.check(&server);
    }
    for _ in 0..20 {
        server.answered(&mut client, Mode::Obtain, then);
        steps.check(&server);
    }
    bus.bench().faults = faults;
    let row = server.answered(&mut client, Mode::Obtain, then);
    assert!(row.plant_failed && row.failure.unwrap().to_string().contains("no answer"));
    steps.check(&server);
    let mut failing = 1;
    while server.tick().plant_failed {
        steps.check(&server);
        failing += 1;
    }
    steps.check(&server);
    // The tick after the last lost frame has no reading, and its write confirms what was sent
    // before.
    assert_eq!(failing, 1 + faults.lost_out.max(faults.lost_back));
    while server
        .tick()
        .state
        .axes
        .iter()
        .any(|axis| axis.offsets != Offsets::ZERO)
    {
        assert_eq!(server.cycle.phase(), Phase::Fault);
        steps.check(&server);
    }
    steps.check(&server);
    if clocks != Clocks::Free {
        // The last references are taken with the pulse after their frame.
        server.tick();
        steps.check(&server);
    }
    assert_eq!(at_the_drives(&server), start);
}

/// Sizes of the position offsets of all drives, nm.
fn offsets_nm(server: &Server<3, 3>) -> Vec<i64> {
    at_the_drives(server)
        .iter()
        .map(|[offset, _]| offset.abs() * COUNT_NM)
        .collect()
}

/// Re-arm while the bus is away, and once it is back: the drives go on with what core has in force.
#[test]
fn a_bus_lost_while_an_offset_grows_is_rearmed_with_the_offsets_that_are_in_force() {
    let robot = RobotFile::builtin_l2().unwrap();
    let limit_nm = i64::from(robot.limits[0].limits.position.step());
    let section = section_of_whole_steps(&robot);
    for (is_lost_out, rearms_early) in [(true, false), (true, true), (false, false), (false, true)]
    {
        let bus = bus_of::<_, 3, 3>(&robot, &section);
        let mut server = Server::with(&robot, &section, &bus, 0.0);
        let mut client = server.client();
        for _ in 0..150 {
            server.answered(&mut client, Mode::Obtain, 1_000_000);
        }
        let confirmed = offsets_nm(&server);
        let mut last = confirmed.clone();
        let [lost_out, lost_back] = if is_lost_out { [200, 0] } else { [0, 200] };
        bus.bench().faults = Faults {
            lost_out,
            lost_back,
            ..Faults::default()
        };
        assert!(
            server
                .answered(&mut client, Mode::Obtain, 1_000_000)
                .plant_failed
        );
        let mut ramps = 0;
        for tick in 1..60_000 {
            let rearm = rearms_early || tick > 300;
            let row = server.step(OperatorInputs {
                stop: false,
                rearm,
                ..OperatorInputs::default()
            });
            let now = offsets_nm(&server);
            let moves = now
                .iter()
                .zip(&last)
                .map(|(now, last)| (now - last).abs())
                .max()
                .unwrap();
            let case = format!("{is_lost_out} {rearms_early} {tick}: from {last:?} to {now:?} nm");
            assert!(moves <= limit_nm, "{case}");
            let in_force = row
                .state
                .axes
                .map(|axis| i64::from(axis.offsets.position.0.abs()));
            if !row.plant_failed {
                assert_eq!(now, in_force, "{case}");
                ramps += 1;
            } else if tick < 200 {
                // What no answer has confirmed is not in force.
                assert_eq!(confirmed, in_force, "{case}");
            }
            last = now;
            if row.state.phase == Phase::Listening {
                break;
            }
        }
        assert!(ramps > 7_000 && last == [0; 3], "{ramps} {last:?}");
    }
}

#[test]
fn a_frame_lost_while_an_offset_grows() {
    for frames in 1..=4 {
        let out = Faults {
            lost_out: frames,
            ..Faults::default()
        };
        let back = Faults {
            lost_back: frames,
            ..Faults::default()
        };
        for (faults, grows) in [(out, false), (out, true), (back, false), (back, true)] {
            let l2 = RobotFile::builtin_l2().unwrap();
            loses::<_, 3, 3>(&l2, Clocks::Free, faults, grows);
            // After three pulses without references the drives leave OP, until a re-arm.
            if frames < 3 {
                loses::<_, 3, 3>(&l2, Clocks::Sync0, faults, grows);
            }
            let f1 = RobotFile::builtin_f1().unwrap();
            loses::<_, 6, 9>(&f1, Clocks::Free, faults, grows);
        }
    }
}
