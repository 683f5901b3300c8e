//! A simulated L2, and in front of it the port of `gantry-tau pace`.

use std::net::SocketAddr;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use gantry_tau_client::pace::{self, PaceOptions, PaceReport, Programs};
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::keys::{Key, Keyring};
use gantry_tau_core::control::message::Capabilities;
use gantry_tau_core::units::EpochRange;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::links::Allowed;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::server::connections::{Listen, Listening};
use gantry_tau_server::server::{Cycle, Server, TickSource};
use gantry_tau_server::state::StopLatch;
use gantry_tau_sim::load_generator::load_generator;
use gantry_tau_sim::machine::SimulatedMachine;

use crate::server_fixture::LOOPBACK;

/// A server, and the switch of the pacer.
pub struct Pacing {
    quit: AtomicBool,
    server: Server<3>,
    checksum: u32,
    transport: Transport,
    key: Option<Key>,
}

impl Pacing {
    /// Starts the server.
    #[must_use]
    pub fn new(ticks: TickSource) -> Self {
        Self::over(Transport::Stream, None, ticks)
    }

    /// Starts the server over a transport, for the holder of a key if there is one.
    #[must_use]
    pub fn over(transport: Transport, key: Option<Key>, ticks: TickSource) -> Self {
        let robot = RobotFile::builtin_l2().unwrap();
        let (_hand, tool) = load_generator();
        let machine = SimulatedMachine::<3, 3>::from_robot(&robot, tool, Motion::Hold).unwrap();
        let config = robot.session_config(Capabilities::LOCKSTEP).unwrap();
        let motors = robot.motor_map().unwrap();
        let (epochs, latch) = (EpochRange::VOLATILE, StopLatch::volatile());
        let listen = Listen {
            transport,
            ..LOOPBACK.into()
        };
        let keyring = key.as_ref().map(|key| {
            let mut keyring = Keyring::new(&[0x55; 32]);
            keyring.add(key.clone()).unwrap();
            keyring
        });
        let listening = Listening::bind(&listen).unwrap().with_keys(keyring);
        let cycle = Cycle::listening(config, motors, machine, epochs, latch, listening).unwrap();
        let (server, _records) = Server::spawn(cycle, ticks).unwrap();
        Self {
            quit: AtomicBool::new(false),
            server,
            checksum: robot.checksum(),
            transport,
            key,
        }
    }

    /// Returns the address of the server.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.server.address
    }

    /// Options that end no program: in lock-step a second of the server passes in milliseconds.
    #[must_use]
    pub fn options(&self) -> PaceOptions {
        PaceOptions {
            server: self.server.address.into(),
            transport: self.transport,
            key: self.key.clone(),
            kinematics_checksum: self.checksum,
            latency: Duration::from_millis(20),
            hold: Duration::from_secs(100),
            give_up: Duration::from_secs(100),
            period: Duration::from_millis(100),
            is_hurried: true,
        }
    }

    /// Runs programs against the port; returns what it counted.
    pub fn with(&self, options: &PaceOptions, programs: impl FnOnce(SocketAddr)) -> PaceReport {
        let mut port = Programs::bind(LOOPBACK, Allowed::all()).unwrap();
        let address = port.address().unwrap();
        thread::scope(|scope| {
            let pacing = scope.spawn(|| pace::run::<3>(options, &mut port, &self.quit));
            let ended = catch_unwind(AssertUnwindSafe(|| programs(address)));
            self.quit.store(true, Ordering::Relaxed);
            let report = pacing.join().unwrap();
            ended.unwrap_or_else(|panic| resume_unwind(panic));
            report
        })
    }
}
