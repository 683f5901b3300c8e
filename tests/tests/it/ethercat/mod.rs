//! The server with drives over an emulated EtherCAT bus, tick by tick.

mod campaign;
mod clocks;
mod compensation;
mod faults;
mod force;
mod gauges;
mod log;
mod lost_frames;
mod offsets;
mod refused;

use allocation_counter::measure;
use gantry_tau::ethercat::{EmulatedBus, EthercatError, EthercatPlant, FaultLog, emulated_bus};
use gantry_tau_core::control::message::{Capabilities, Mode, Phase};
use gantry_tau_core::units::EpochRange;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{AnyRobotFile, Ethercat, RobotFile, text_of};
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::cycle::{Cycle, OperatorInputs};
use gantry_tau_server::state::StopLatch;
use gantry_tau_sim::load_generator::load_generator;
use gantry_tau_tests::client::Client;
use gantry_tau_tests::server_fixture::{LOOPBACK, await_bytes};
use gantry_tau_tests::wait_for;

type Plant<const N: usize, const M: usize> = EthercatPlant<EmulatedBus<N, M>, N, M>;

/// The drives of an emulated bus, as a robot file without a section has them.
fn section<K, const N: usize>(robot: &RobotFile<K, N>) -> Ethercat {
    Ethercat::emulated(&robot.motors.axis_of_motor, &robot.metres_per_q)
}

/// A bus whose drives have just been powered, at home.
fn bus<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
) -> EmulatedBus<N, M> {
    bus_of(robot, &section(robot))
}

/// The same, of the drives of a section.
pub(crate) fn bus_of<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    section: &Ethercat,
) -> EmulatedBus<N, M> {
    let (_hand, tool) = load_generator();
    emulated_bus(robot, section, tool).unwrap()
}

/// The drives of an emulated bus with 10 nm to a count: the steps of offsets are whole counts.
pub(crate) fn section_of_whole_steps<K, const N: usize>(robot: &RobotFile<K, N>) -> Ethercat {
    let mut section = section(robot);
    for (drive, axis) in section.drives.iter_mut().zip(&robot.motors.axis_of_motor) {
        drive.counts_per_q = 1e8 * robot.metres_per_q[*axis];
    }
    section
}

/// Reads a robot file with three drives on a bus, and what `rest` adds.
fn parse_bus(rest: &str) -> Result<AnyRobotFile, String> {
    let drives: String = (0..3)
        .map(|position| {
            format!(
                "[[ethercat.drives]]\nposition = {position}\nvendor = 1\nproduct = 1\n\
                 counts_per_q = 104857600.0\nsign = 1\nzero_counts = 0\n"
            )
        })
        .collect();
    let text = format!(
        "{}\n[ethercat]\ncycle_us = 1000\nwatchdog_cycles = 5\n{drives}{rest}\n",
        text_of("l2").unwrap()
    );
    AnyRobotFile::parse("bus.toml", &text).map_err(|error| error.to_string())
}

/// Opens a bus, moving back and forth by `motion_m`.
fn open<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    section: &Ethercat,
    bus: &EmulatedBus<N, M>,
    motion_m: f64,
) -> Result<Plant<N, M>, EthercatError> {
    EthercatPlant::open(robot, section, bus.clone(), |start_m| {
        if motion_m == 0.0 {
            return Motion::Hold;
        }
        Motion::BackAndForth {
            waypoints_m: vec![start_m.map(|place| place + motion_m)],
            speed_m_per_s: 0.1,
            acceleration_m_per_s2: 1.0,
            dwell_cycles: 10,
        }
    })
}

/// A server whose machine is a bus.
struct Server<const N: usize, const M: usize> {
    bus: EmulatedBus<N, M>,
    cycle: Cycle<N, M, Plant<N, M>>,
    log: FaultLog,
    counts_allocations: bool,
}

impl<const N: usize, const M: usize> Server<N, M> {
    fn on<K: MachineKind<N>>(
        robot: &RobotFile<K, N>,
        bus: &EmulatedBus<N, M>,
        motion_m: f64,
    ) -> Self {
        Self::with(robot, &section(robot), bus, motion_m)
    }

    fn with<K: MachineKind<N>>(
        robot: &RobotFile<K, N>,
        section: &Ethercat,
        bus: &EmulatedBus<N, M>,
        motion_m: f64,
    ) -> Self {
        Self::of(robot, bus, open(robot, section, bus, motion_m).unwrap())
    }

    fn of<K: MachineKind<N>>(
        robot: &RobotFile<K, N>,
        bus: &EmulatedBus<N, M>,
        mut plant: Plant<N, M>,
    ) -> Self {
        let log = plant.fault_log();
        let (config, motors) = (
            robot.session_config(Capabilities::NONE).unwrap(),
            robot.motor_map().unwrap(),
        );
        let latch = StopLatch::volatile();
        let mut cycle =
            Cycle::new(config, motors, plant, EpochRange::VOLATILE, latch, LOOPBACK).unwrap();
        cycle.start().unwrap();
        let server = Self {
            bus: bus.clone(),
            cycle,
            log,
            counts_allocations: false,
        };
        server.largest_step_nm();
        server
    }

    fn step(&mut self, operator: OperatorInputs) -> TickRecord<N> {
        let mut row = None;
        let counted = measure(|| {
            self.cycle.receive();
            row = Some(self.cycle.step(1, operator));
        });
        assert!(
            !self.counts_allocations || counted.count_total == 0,
            "the cycle allocated"
        );
        row.unwrap()
    }

    fn tick(&mut self) -> TickRecord<N> {
        self.step(OperatorInputs::default())
    }

    /// Ticks with the re-arm pressed until the server listens.
    fn rearm(&mut self) -> u32 {
        for tick in 0..60_000 {
            if self
                .step(OperatorInputs {
                    stop: false,
                    rearm: true,
                    ..OperatorInputs::default()
                })
                .state
                .phase
                == Phase::Listening
            {
                return tick;
            }
        }
        panic!("the server does not listen again: {:?}", self.log.next());
    }

    /// A session in Obtain.
    fn client(&mut self) -> Client<N> {
        let mut client = Client::connect(self.cycle.address().unwrap());
        client.say_hello();
        wait_for("the Welcome", || self.tick().welcomed);
        client.welcome();
        client.state();
        self.answered(&mut client, Mode::Submit, 0);
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

    /// Largest step of a drive's own reference since the last call, nm.
    fn largest_step_nm(&self) -> i64 {
        self.bus
            .bench()
            .chain
            .drives_mut()
            .map(|drive| drive.take_largest_step() * 1_000_000_000 / 104_857_600)
            .max()
            .unwrap()
    }

    /// Positions of all motors, counts.
    fn positions(&self) -> Vec<i64> {
        self.bus
            .bench()
            .chain
            .drives()
            .map(|drive| drive.motor().position)
            .collect()
    }

    /// Ends as a killed process does: nothing is said to the drives.
    fn kill(self) {
        std::mem::forget(self.cycle);
    }
}
