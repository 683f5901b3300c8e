//! A server whose drives take velocities: its own position loops, in motion, tick by tick.

mod compensation;
mod stops;
mod theorem;

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};

use allocation_counter::measure;
use gantry_tau_core::control::axis::{InForce, Reference};
use gantry_tau_core::control::message::{Capabilities, Mode, Phase};
use gantry_tau_core::control::position_loop::VelocityReference;
use gantry_tau_core::control::position_loop::quick_stop::QuickStop;
use gantry_tau_core::units::EpochRange;
use gantry_tau_machine::model::{L2, L2_MOTORS};
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile};
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::plant::{DriveState, Plant, PlantError, Reading, VelocityPlant};
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::cycle::{Cycle, OperatorInputs};
use gantry_tau_server::state::StopLatch;
use gantry_tau_sim::load_generator::{LoadGenerator, load_generator};
use gantry_tau_sim::machine::SimulatedMachine;
use gantry_tau_tests::client::Client;
use gantry_tau_tests::server_fixture::{LOOPBACK, await_bytes};
use gantry_tau_tests::wait_for;

const N: usize = 3;
type Machine = SimulatedMachine<N, L2_MOTORS>;

/// Velocity limit of the loops, m/s.
const MAX_M_PER_S: f64 = 0.6;

/// Text of the L2's robot file with drives that take velocities, and these keys of theirs.
fn text(drives: &str) -> String {
    let l2 = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../robots/l2.toml"));
    let wider = "machine_travel_m = [[-0.53, 2.03], [-2.03, 0.53], [-0.53, 2.03]]";
    l2.replacen(
        "machine_travel_m = [[-0.51, 2.01], [-2.01, 0.51], [-0.51, 2.01]]",
        wider,
        1,
    )
    .replacen(
        "nominal_step_um = [2000.0, 2000.0, 2000.0]",
        "nominal_step_um = [600.0, 600.0, 600.0]",
        1,
    )
    .replacen(
        "[simulation]",
        &format!("[drives]\ninterface = \"velocity\"\n{drives}\n[simulation]"),
        1,
    )
}

fn robot(drives: &str) -> RobotFile<L2, N> {
    let AnyRobotFile::L2(robot) = AnyRobotFile::parse("x.toml", &text(drives)).unwrap() else {
        panic!("an L2")
    };
    *robot
}

/// Report of positions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Misread {
    #[default]
    Rightly,
    /// That of one axis is off by more than its window.
    Wrong,
    /// Those of two axes in each other's place.
    Swapped,
    /// Those of the start.
    Stale,
    /// None: what is in force is not known.
    Missing,
}

impl Misread {
    fn report(self, [first, second, third]: [i64; N], start: [i64; N]) -> [i64; N] {
        match self {
            Self::Rightly | Self::Missing => [first, second, third],
            Self::Wrong => [first, second + 2_100_000, third],
            Self::Swapped => [third, second, first],
            Self::Stale => start,
        }
    }
}

/// The machine behind a bus that can be lost: nothing gets through then, and the drives go on by
/// themselves.
#[derive(Clone)]
struct Bus {
    machine: Arc<Mutex<Machine>>,
    is_lost: Arc<AtomicBool>,
    /// Writes alone, or readings alone, do not get through.
    refuses: Arc<AtomicBool>,
    is_deaf: Arc<AtomicBool>,
    /// Positions in force, and actual ones, are reported wrongly.
    in_force_misread: Arc<Mutex<Misread>>,
    actual_misread: Arc<Mutex<Misread>>,
    /// Positions at the start, nm.
    start_nm: [i64; N],
    /// Velocities in force at the drives, µm/s.
    in_force: Arc<Mutex<[i32; N]>>,
}

impl Bus {
    fn machine(&self) -> MutexGuard<'_, Machine> {
        self.machine.lock().unwrap()
    }

    fn checked(&self, also: &AtomicBool) -> Result<(), PlantError> {
        let lost = PlantError {
            operation: "exchange process data",
            reason: "the bus is lost",
        };
        let fails = self.is_lost.load(Ordering::Relaxed) || also.load(Ordering::Relaxed);
        if fails { Err(lost) } else { Ok(()) }
    }
}

impl Plant<N, L2_MOTORS> for Bus {
    type Error = PlantError;

    fn in_force(&mut self) -> Result<[InForce; N], PlantError> {
        self.checked(&self.is_deaf)?;
        let mut in_force = self.machine().in_force()?;
        let misread = *self.in_force_misread.lock().unwrap();
        if misread == Misread::Missing {
            return Err(PlantError {
                operation: "tell what is in force",
                reason: "the test says so",
            });
        }
        let nm = misread.report(in_force.map(|axis| axis.nominal.0), self.start_nm);
        in_force
            .iter_mut()
            .zip(nm)
            .for_each(|(axis, nm)| axis.nominal.0 = nm);
        Ok(in_force)
    }

    fn read(&mut self, elapsed: u64) -> Result<Reading<N>, PlantError> {
        let reading = self.machine().read(elapsed);
        self.checked(&self.is_deaf)?;
        let mut reading = reading?;
        let misread = *self.actual_misread.lock().unwrap();
        let nm = misread.report(reading.actual.map(|axis| axis.position.0), self.start_nm);
        reading
            .actual
            .iter_mut()
            .zip(nm)
            .for_each(|(axis, nm)| axis.position.0 = nm);
        Ok(reading)
    }

    fn write(
        &mut self,
        references: &[Reference; L2_MOTORS],
        parts: &[InForce; N],
    ) -> Result<(), PlantError> {
        self.checked(&self.refuses)?;
        self.machine().write(references, parts)
    }

    fn drives(&self) -> Option<[DriveState; N]> {
        self.machine().drives()
    }

    fn reset(&mut self) {
        if self.checked(&self.refuses).is_ok() {
            self.machine().reset();
        }
    }
}

impl VelocityPlant<N, L2_MOTORS> for Bus {
    fn write_velocity(
        &mut self,
        velocities: &[VelocityReference; L2_MOTORS],
        parts: Option<&[InForce; N]>,
    ) -> Result<(), PlantError> {
        self.checked(&self.refuses)?;
        *self.in_force.lock().unwrap() = velocities.map(|motor| motor.velocity.0);
        self.machine().write_velocity(velocities, parts)
    }

    fn quick_stop(&self) -> Option<QuickStop> {
        self.machine().quick_stop()
    }
}

/// A server in motion.
struct Server {
    bus: Bus,
    hand: LoadGenerator,
    cycle: Cycle<N, L2_MOTORS, Bus>,
}

impl Server {
    /// A server on a path of 0.4 m at up to 0.5 m/s, out and back.
    fn moving() -> Self {
        Self::on(&robot(""), 0.4)
    }

    fn on(robot: &RobotFile<L2, N>, way_m: f64) -> Self {
        let (hand, tool) = load_generator();
        let home_m = robot.home_q().unwrap();
        let motion = Motion::BackAndForth {
            waypoints_m: vec![home_m.map(|metres| metres + way_m)],
            speed_m_per_s: 0.5,
            acceleration_m_per_s2: 2.0,
            dwell_cycles: 100,
        };
        let motion = if way_m == 0.0 { Motion::Hold } else { motion };
        let mut machine = SimulatedMachine::from_robot(robot, tool, motion).unwrap();
        let start_nm = machine.in_force().unwrap().map(|axis| axis.nominal.0);
        let bus = Bus {
            machine: Arc::new(Mutex::new(machine)),
            is_lost: Arc::default(),
            refuses: Arc::default(),
            is_deaf: Arc::default(),
            in_force_misread: Arc::default(),
            actual_misread: Arc::default(),
            start_nm,
            in_force: Arc::default(),
        };
        let config = robot.session_config(Capabilities::NONE).unwrap();
        let motors = robot.motor_map().unwrap();
        let cycle = Cycle::new(
            config,
            motors,
            bus.clone(),
            EpochRange::VOLATILE,
            StopLatch::volatile(),
            LOOPBACK,
        )
        .unwrap();
        Self {
            bus,
            hand,
            cycle: cycle.with_position_loops(robot.position_loops).unwrap(),
        }
    }

    fn step(&mut self, operator: OperatorInputs) -> TickRecord<N> {
        let mut row = None;
        let counted = measure(|| {
            self.cycle.receive();
            row = Some(self.cycle.step(1, operator));
        });
        assert_eq!(counted.count_total, 0, "the cycle allocated");
        row.unwrap()
    }

    fn tick(&mut self) -> TickRecord<N> {
        self.step(OperatorInputs::default())
    }

    /// Ticks until the path moves at 0.5 m/s. Returns the last row.
    fn at_full_speed(&mut self) -> TickRecord<N> {
        let mut last = self.tick();
        for _ in 0..5_000 {
            let row = self.tick();
            let speed = row.state.axes[0].nominal.0 - last.state.axes[0].nominal.0;
            last = row;
            if speed > 499_000 {
                return last;
            }
        }
        panic!("the path is slower: {last:?}");
    }

    /// True positions of the axes, m.
    fn positions_m(&self) -> [f64; N] {
        self.bus.machine().positions_m()
    }

    /// A session in Submit.
    fn client(&mut self) -> Client<N> {
        let mut client = Client::connect(self.cycle.address().unwrap());
        client.say_hello();
        wait_for("the Welcome", || self.tick().welcomed);
        client.welcome();
        client.state();
        client
    }

    /// One tick with the owner's answer in it.
    fn answered(&mut self, client: &mut Client<N>, mode: Mode, nm: i32) -> TickRecord<N> {
        let frame = client.frame(mode, [nm; N]);
        client.send_bytes(&frame);
        await_bytes(&mut self.cycle, frame.len());
        let row = self.tick();
        assert_eq!(client.state(), row.state);
        row
    }
}

/// Largest distance of an axis between two sets of positions, mm.
fn farthest_mm(from_m: &[f64; N], to_m: &[f64; N]) -> f64 {
    from_m
        .iter()
        .zip(to_m)
        .map(|(from, to)| (to - from).abs() * 1e3)
        .fold(0.0, f64::max)
}

/// The loops keep the axes within 15 µm of the reference that belongs to each measurement, three
/// cycles old.
#[test]
fn the_path_is_followed_closely() {
    let mut server = Server::moving();
    let rows: Vec<_> = (0..4_000).map(|_| server.tick()).collect();
    let fastest = rows
        .iter()
        .map(|row| row.state.axes[0].actual.velocity.0)
        .max()
        .unwrap();
    assert!(fastest > 490_000, "{fastest} um/s");
    for window in rows.windows(4) {
        let (then, now) = (&window[0], &window[3]);
        assert!(
            !now.plant_failed && now.state.phase == Phase::Listening,
            "{now:?}"
        );
        for axis in 0..N {
            let off = now.state.axes[axis].actual.position.0 - then.references[axis].position.0;
            assert!(off.abs() < 15_000, "tick {}: {off} nm", now.state.tick.0);
        }
    }
}

/// A skipped cycle puts the alignment off for some ticks: bounded, and over without a stop.
#[test]
fn a_skipped_cycle_is_ridden_out() {
    let mut server = Server::moving();
    server.at_full_speed();
    let row = server.cycle.step(2, OperatorInputs::default());
    assert!(!row.plant_failed, "{row:?}");
    let mut rows = vec![row];
    rows.extend((0..300).map(|_| server.tick()));
    let offs = rows.windows(4).map(|window| {
        (window[3].state.axes[0].actual.position.0 - window[0].references[0].position.0).abs()
    });
    let offs: Vec<i64> = offs.collect();
    assert!(
        rows.iter()
            .all(|row| !row.plant_failed && row.state.phase == Phase::Listening)
    );
    let worst = *offs.iter().max().unwrap();
    assert!((10_000..600_000).contains(&worst), "{worst} nm");
    assert!(offs[200..].iter().all(|off| *off < 15_000));
}
