//! A server on a bus whose drives run on SYNC0 alone: offsets, lost frames, a killed server, the
//! demo's compensation, as without clocks; and the steering by any samples.

use gantry_tau::ethercat::{EthercatPlant, emulated_bus};
use gantry_tau_core::control::message::{Mode, Phase};
use gantry_tau_ethercat::emulation::Faults;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{Clocks, Ethercat, RobotFile};
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::record::TickRecord;
use gantry_tau_tests::fuzzed::{self, SAMPLE, SETTINGS};
use gantry_tau_tests::short_demo;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{Server, bus_of, open, section};

/// The drives of an emulated bus, on SYNC0.
fn with_sync0<K, const N: usize>(robot: &RobotFile<K, N>) -> Ethercat {
    Ethercat {
        clocks: Clocks::Sync0,
        ..section(robot)
    }
}

fn offsets_reach_the_drives<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
) {
    let section = with_sync0(robot);
    let bus = bus_of::<K, N, M>(robot, &section);
    let mut server = Server::with(robot, &section, &bus, 0.0);
    let mut client = server.client();
    server.counts_allocations = true;
    for _ in 0..300 {
        let row = server.answered(&mut client, Mode::Obtain, 20_000);
        assert_eq!((row.state.phase, row.failure), (Phase::Obtain, None));
        assert!(server.largest_step_nm() <= i64::from(robot.limits[0].limits.position.step()) + 20);
    }
    // 20 um are 2 097 counts.
    for drive in bus.bench().chain.drives() {
        assert_eq!(drive.object(0x60B0, 0).abs(), 2_097);
    }
    // Ten lost frames: the drives leave OP, nothing steps, and a re-arm goes on.
    bus.bench().faults = Faults {
        lost_out: 10,
        ..Faults::default()
    };
    for _ in 0..30 {
        server.tick();
    }
    assert_eq!(server.cycle.phase(), Phase::Fault);
    comes_back(&mut server, robot.limits[0].limits.position.step().into());
}

/// From offsets of 20 um in force to zero by a re-arm, without a step.
fn comes_back<const N: usize, const M: usize>(server: &mut Server<N, M>, step_nm: i64) {
    let offsets = |row: TickRecord<N>| row.state.axes.map(|axis| axis.offsets.position.0);
    let in_force = offsets(server.tick());
    assert!(
        in_force.iter().all(|nm| (nm - 20_000).abs() <= 10),
        "{in_force:?}"
    );
    server.largest_step_nm();
    let ticks = server.rearm();
    assert!(server.largest_step_nm() <= step_nm + 20, "a step");
    assert!(i64::from(ticks) >= 20_000 / step_nm, "{ticks}: it ramps");
    assert_eq!(offsets(server.tick()), [0; N]);
}

#[test]
fn offsets_reach_drives_on_sync0() {
    offsets_reach_the_drives::<_, 3, 3>(&RobotFile::builtin_l2().unwrap());
    offsets_reach_the_drives::<_, 6, 9>(&RobotFile::builtin_f1().unwrap());
}

/// The next server finds drives that left OP, and goes on from their offsets without a step.
#[test]
fn a_killed_server_on_sync0_and_its_successor() {
    let robot = RobotFile::builtin_l2().unwrap();
    let section = with_sync0(&robot);
    let bus = bus_of::<_, 3, 3>(&robot, &section);
    let mut server = Server::with(&robot, &section, &bus, 0.0);
    let mut client = server.client();
    for _ in 0..300 {
        server.answered(&mut client, Mode::Obtain, 20_000);
    }
    server.kill();
    bus.idle(100_000);
    for position in 0..3 {
        let bench = bus.bench();
        assert!(!bench.chain.subdevice(position).unwrap().is_operational());
    }
    let mut next = Server::with(&robot, &section, &bus, 0.0);
    assert_eq!(next.tick().state.phase, Phase::Fault, "drives in fault");
    comes_back(&mut next, robot.limits[0].limits.position.step().into());
}

/// A drive that requires SYNC0 is named, with its AL status code, when the file says "free".
#[test]
fn a_drive_that_requires_sync0_stays_out_of_op_without_it() {
    let robot = RobotFile::builtin_l2().unwrap();
    let bus = bus_of::<_, 3, 3>(&robot, &with_sync0(&robot));
    let mut server = Server::on(&robot, &bus, 0.0);
    let row = server.tick();
    assert_eq!(row.state.phase, Phase::Fault);
    let lines = server.log.see(Phase::Fault);
    assert!(
        lines
            .iter()
            .any(|line| line.contains("motor 0") && line.to_lowercase().contains("sync")),
        "{lines:?}"
    );
}

#[test]
fn a_bus_without_clocks_is_refused_by_motor_and_key() {
    let robot = RobotFile::builtin_l2().unwrap();
    let bus = bus_of::<_, 3, 3>(&robot, &section(&robot));
    let refused = open(&robot, &with_sync0(&robot), &bus, 0.0).map(drop);
    assert_eq!(
        refused.unwrap_err().to_string(),
        "robots/l2.toml (built in): ethercat.clocks: motor 0: the drive has no distributed clock (register 0008h)"
    );
}

/// The compensation of the demo within its own tolerances.
#[test]
fn the_demo_compensates_on_sync0() {
    let robot = RobotFile::builtin_l2().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let complaints = short_demo::complaints(
        folder.path(),
        robot,
        |robot, tool| {
            let section = with_sync0(robot);
            let bus = emulated_bus::<_, 3, 3>(robot, &section, tool)?;
            EthercatPlant::<_, 3, 3>::open(robot, &section, bus, |_| Motion::Hold)
        },
        |cycle, _| Ok(cycle),
    );
    assert_eq!(complaints, Vec::<String>::new());
}

/// The property of the fuzz target, on drawn bytes.
#[test]
fn the_steering_is_bounded_and_follows() {
    let mut draw = ChaCha8Rng::seed_from_u64(1);
    for _ in 0..2_000 {
        let mut bytes = vec![0; draw.random_range(0..SETTINGS + 50 * SAMPLE)];
        draw.fill(&mut *bytes);
        fuzzed::steering(&bytes);
    }
}
