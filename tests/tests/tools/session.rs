//! A server of the simulated L2 in lock-step, programs that connect to it, and its record, judged
//! tick by tick.
#![allow(
    clippy::arithmetic_side_effects,
    clippy::unwrap_used,
    clippy::panic,
    reason = "tests fail by panicking"
)]

use std::process::{Child, Output};
use std::time::{Duration, Instant};

use gantry_tau_core::Monitor;
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::keys::Keyring;
use gantry_tau_core::control::message::{Capabilities, Cause, Phase};
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_core::units::EpochRange;
use gantry_tau_machine::model::{L2, L2_MOTORS, MachineKind};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::plant::{Plant, Reading};
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::Server;
use gantry_tau_server::server::connections::{Listen, Listening};
use gantry_tau_server::server::cycle::Cycle;
use gantry_tau_server::server::tick_source::TickSource;
use gantry_tau_server::state::StopLatch;
use gantry_tau_sim::load_generator::load_generator;
use gantry_tau_sim::load_profile::LoadProfile;
use gantry_tau_sim::machine::SimulatedMachine;
use gantry_tau_sim::workpiece::Workpiece;
use gantry_tau_tests::liar::Liar;
use gantry_tau_tests::server_fixture::LOOPBACK;

/// Longest life of a program and wait for a row.
const PATIENCE: Duration = Duration::from_secs(60);

/// Load on the tool.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Tool {
    /// Steps of 60 N during Obtain: largest force, N, and length of a step, s.
    Steps(f64, f64),
    /// A workpiece of this stiffness, N/m, 50 um below the tool.
    Above(f64),
}

/// A running server, and every row so far.
pub(crate) struct Session {
    server: Server<ARMS>,
    observer: rtrb::Consumer<TickRecord<ARMS>>,
    monitor: Monitor<ARMS>,
    load: LoadProfile,
    pub(crate) rows: Vec<TickRecord<ARMS>>,
}

impl Session {
    /// Starts the server.
    pub(crate) fn new(tool: Tool) -> Self {
        let robot = RobotFile::builtin_l2().unwrap();
        let (hand, applied) = load_generator();
        let mut machine =
            SimulatedMachine::<3, L2_MOTORS>::from_robot(&robot, applied, Motion::Hold).unwrap();
        let (force_max_n, seconds) = match tool {
            Tool::Steps(force_max_n, seconds) => (force_max_n, seconds),
            Tool::Above(n_per_m) => {
                machine = machine.above(
                    Workpiece::below(&robot.simulation.home_m, n_per_m, 50e-6, false).unwrap(),
                );
                (0.0, 1.0)
            }
        };
        let load = LoadProfile::new(hand, force_max_n, seconds);
        Self::serving(&robot, machine, load)
    }

    /// Starts one whose readings are changed, without a load.
    pub(crate) fn lying(speak: impl FnMut(u64, &mut Reading<ARMS>) + Send + 'static) -> Self {
        let robot = RobotFile::builtin_l2().unwrap();
        let (hand, applied) = load_generator();
        let machine = SimulatedMachine::from_robot(&robot, applied, Motion::Hold).unwrap();
        let load = LoadProfile::new(hand, 0.0, 1.0);
        Self::serving(&robot, Liar::new(machine, speak), load)
    }

    /// Starts one with keys, or over another transport, without a load.
    pub(crate) fn listening(transport: Transport, keyring: Option<Keyring>) -> Self {
        let robot = RobotFile::builtin_l2().unwrap();
        let (hand, applied) = load_generator();
        let machine =
            SimulatedMachine::<3, L2_MOTORS>::from_robot(&robot, applied, Motion::Hold).unwrap();
        let listen = Listen {
            transport,
            ..LOOPBACK.into()
        };
        let listening = Listening::bind(&listen).unwrap().with_keys(keyring);
        let load = LoadProfile::new(hand, 0.0, 1.0);
        Self::serving_at(listening, &robot, machine, load)
    }

    fn serving(
        robot: &RobotFile<L2, ARMS>,
        plant: impl Plant<ARMS, L2_MOTORS> + 'static,
        load: LoadProfile,
    ) -> Self {
        let listening = Listening::bind(&LOOPBACK.into()).unwrap();
        Self::serving_at(listening, robot, plant, load)
    }

    fn serving_at(
        listening: Listening,
        robot: &RobotFile<L2, ARMS>,
        plant: impl Plant<ARMS, L2_MOTORS> + 'static,
        load: LoadProfile,
    ) -> Self {
        let cycle = cycle(robot, plant, listening);
        let (server, observer) = Server::spawn(cycle, TickSource::Lockstep).unwrap();
        let travel = robot.limits.map(|axis| axis.machine_travel);
        let monitor = Monitor::new(robot.limits.map(|axis| axis.limits), Some(travel));
        Self {
            server,
            observer,
            monitor,
            load,
            rows: Vec::new(),
        }
    }

    /// Address of the server.
    pub(crate) fn address(&self) -> String {
        self.server.address.to_string()
    }

    /// Presses the stop at the machine.
    pub(crate) fn press_stop(&self) {
        self.server.controls.press_stop();
    }

    /// Takes the next row; what the drives were written is within the limits.
    fn next_row(&mut self) -> bool {
        let Ok(row) = self.observer.pop() else {
            return false;
        };
        let judged = self.monitor.check_tick(&row.state, &row.references);
        assert_eq!(judged, Ok(()), "{:?}", row.state);
        self.load.update(row.state.phase, row.state.tick);
        self.rows.push(row);
        true
    }

    /// Takes rows until one is as wanted.
    pub(crate) fn until(&mut self, what: &str, wanted: impl Fn(&TickRecord<ARMS>) -> bool) {
        let since = Instant::now();
        loop {
            if self.next_row() {
                if self.rows.last().is_some_and(&wanted) {
                    return;
                }
            } else {
                assert!(since.elapsed() < PATIENCE, "waited too long for {what}");
                std::thread::sleep(Duration::from_millis(1));
            }
        }
    }

    /// Takes rows until the program has ended; returns its exit code and what it said.
    pub(crate) fn end_of(&mut self, mut program: Child) -> (Option<i32>, String) {
        let since = Instant::now();
        while program.try_wait().unwrap().is_none() {
            if !self.next_row() {
                std::thread::sleep(Duration::from_millis(1));
            }
            if since.elapsed() > PATIENCE {
                program.kill().unwrap();
                panic!("it runs too long: {:?}", program.wait_with_output());
            }
        }
        let Output {
            status,
            stdout,
            stderr,
        } = program.wait_with_output().unwrap();
        let text = [stdout, stderr].map(|bytes| String::from_utf8(bytes).unwrap());
        (status.code(), text.concat())
    }

    /// Waits until the server has ended the session, with all offsets at zero, and returns the
    /// cause.
    pub(crate) fn ramped(&mut self) -> Cause {
        if !self.rows.iter().any(|row| row.ended.is_some()) {
            self.until("the end of the session", |row| row.ended.is_some());
        }
        let cause = self.rows.iter().rev().find_map(|row| row.ended).unwrap();
        self.until("the end of the ramp", |row| row.state.ramp_ticks_left == 0);
        assert!(matches!(
            self.rows.last().unwrap().state.phase,
            Phase::Listening | Phase::SafeDisconnect | Phase::Fault
        ));
        assert_eq!(self.offsets_nm(), [0; ARMS]);
        cause
    }

    /// Offsets in force in the last row, nm.
    pub(crate) fn offsets_nm(&self) -> [i32; ARMS] {
        self.rows
            .last()
            .unwrap()
            .state
            .axes
            .map(|axis| axis.offsets.position.0)
    }

    /// Rows in Obtain.
    pub(crate) fn obtained(&self) -> Vec<&TickRecord<ARMS>> {
        self.rows
            .iter()
            .filter(|row| row.state.phase == Phase::Obtain)
            .collect()
    }

    /// Ends the server; no row was lost.
    pub(crate) fn quit(self) -> Vec<TickRecord<ARMS>> {
        drop(self.observer);
        assert_eq!(
            self.server
                .controls
                .dropped_rows
                .load(std::sync::atomic::Ordering::Relaxed),
            0
        );
        self.server.quit().unwrap();
        self.rows
    }
}

fn cycle<K: MachineKind<ARMS>, P: Plant<ARMS, L2_MOTORS>>(
    robot: &RobotFile<K, ARMS>,
    machine: P,
    listening: Listening,
) -> Cycle<ARMS, L2_MOTORS, P> {
    let config = robot.session_config(Capabilities::LOCKSTEP).unwrap();
    let motors = robot.motor_map().unwrap();
    Cycle::listening(
        config,
        motors,
        machine,
        EpochRange::VOLATILE,
        StopLatch::volatile(),
        listening,
    )
    .unwrap()
}
