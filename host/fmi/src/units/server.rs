//! Server and compensating client, joined by frames in memory.

mod client;
mod ports;

use std::sync::Arc;

use gantry_tau_client::HomeMargin;
use gantry_tau_core::control::endpoint::{Endpoint, Write};
use gantry_tau_core::control::message::{Capabilities, Phase, State};
use gantry_tau_core::control::session::{Reading, Session, Start, TickInput};
use gantry_tau_core::units::{EpochRange, WrenchSample};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;

use super::Unit;
use super::conversions::{home_m, metres, positions};
use crate::log::Log;
use crate::variable::{Declarations, Values};
use client::{UnitClient, Wishes};
use ports::ServerPorts;

/// A server in use.
#[derive(Clone)]
struct RunningServer<const N: usize> {
    endpoint: Box<Endpoint<N>>,
    client: Option<UnitClient<N>>,
    /// The cable was in, in the cycle before.
    was_connected: bool,
    /// A client waits for a server that listens.
    waits: bool,
}

/// The unit.
#[derive(Clone)]
pub(super) struct ServerUnit<K, const N: usize> {
    robot: Arc<RobotFile<K, N>>,
    margin: HomeMargin,
    ports: ServerPorts<N>,
    running: Option<RunningServer<N>>,
}

impl<K: MachineKind<N>, const N: usize> ServerUnit<K, N> {
    pub(super) fn new(robot: RobotFile<K, N>, declared: &mut Declarations) -> Result<Self, String> {
        robot
            .compliances_for("the compensation needs compliances")
            .map_err(|error| error.to_string())?;
        robot
            .session_config(Capabilities::LOCKSTEP)
            .map_err(|error| error.to_string())?;
        Ok(Self {
            margin: HomeMargin::of(&robot),
            ports: ServerPorts::declare(declared, &robot, home_m(&robot)?),
            robot: Arc::new(robot),
            running: None,
        })
    }
}

impl<K: MachineKind<N>, const N: usize> Unit for ServerUnit<K, N> {
    /// The drives stand at the nominal positions, without offsets.
    fn begin(&mut self, values: &mut Values) -> Result<(), String> {
        let obtains = values.is_set(self.ports.obtain);
        let reason = self.margin.against(self.robot.client.gain);
        if let Some(reason) =
            reason.filter(|_| obtains && !values.is_set(self.ports.accept_unstable))
        {
            return Err(format!("{reason}; or set accept_unstable"));
        }
        let config = self
            .robot
            .session_config(Capabilities::LOCKSTEP)
            .map_err(|error| error.to_string())?;
        let nominal = positions(values.get(self.ports.nominal));
        let session = Session::new(config, &Start::at_rest(nominal))
            .map_err(|error| format!("the session cannot start: {error}"))?;
        self.running = Some(RunningServer {
            endpoint: Box::new(Endpoint::new(session, EpochRange::VOLATILE)),
            client: None,
            was_connected: false,
            waits: false,
        });
        values.put(self.ports.reference, metres(nominal));
        Ok(())
    }

    fn cycle(&mut self, values: &mut Values, log: &mut Log) -> Result<(), String> {
        let Self {
            robot,
            margin,
            ports,
            running,
        } = self;
        let running = running.as_mut().ok_or("the server has not begun")?;
        let cable = values.is_set(ports.cable);
        running.connect(cable, robot.checksum());
        let wishes = Wishes {
            robot,
            margin,
            obtain: values.is_set(ports.obtain),
            accept_unstable: values.is_set(ports.accept_unstable),
        };
        running.exchange(cable.then_some(&wishes), log);
        let state = running.tick(ports, values)?;
        running.hand_out();
        let controller = running.client.as_ref().and_then(UnitClient::controller);
        ports.show_client(controller, values);
        ports.show_state(&state, values);
        Ok(())
    }

    fn copy(&self) -> Box<dyn Unit> {
        Box::new(self.clone())
    }
}

impl<const N: usize> RunningServer<N> {
    /// A client begins when the cable is put in, as soon as the server listens, unless its session
    /// still runs. One whose session has ended does not begin again by itself: it would tare its sensor
    /// under a load.
    fn connect(&mut self, cable: bool, kinematics_checksum: u32) {
        let was_connected = std::mem::replace(&mut self.was_connected, cable);
        let is_put_in = cable && !was_connected;
        let session = self.endpoint.session();
        let is_running = matches!(
            session.phase(),
            Phase::Handshake | Phase::Submit | Phase::Obtain
        );
        if is_put_in && !is_running {
            self.client = None;
            self.waits = true;
        }
        self.waits &= cable;
        if self.waits && session.phase() == Phase::Listening {
            self.client = UnitClient::connect(&mut self.endpoint, kinematics_checksum);
            self.waits = self.client.is_none();
        }
    }

    /// Lets the client hear the last tick and answer; `None`: its cable is out.
    fn exchange<K: MachineKind<N>>(&mut self, wishes: Option<&Wishes<'_, K, N>>, log: &mut Log) {
        let Some(client) = &mut self.client else {
            return;
        };
        client.exchange(&mut self.endpoint, wishes, log);
        if client.is_over() {
            self.endpoint.close(client.connection());
            self.client = None;
        }
    }

    /// Hands the frames of a tick to the client, and gives its connection back where the server has
    /// closed it.
    fn hand_out(&mut self) {
        while let Some((to, frame)) = self.endpoint.poll_transmit() {
            let mut client = self.client.iter_mut();
            if let Some(client) = client.find(|client| client.connection() == to) {
                client.receive(frame);
            }
        }
        while let Some(connection) = self.endpoint.poll_close() {
            if let Some(client) = &mut self.client {
                client.note_closed(connection);
            }
        }
    }

    /// Runs one tick, as the server's cycle does, and takes its references to the outputs.
    fn tick(&mut self, ports: &ServerPorts<N>, values: &mut Values) -> Result<State<N>, String> {
        let is_read = values.is_set(ports.machine_ok);
        let nominal = positions(values.get(ports.nominal));
        let sensor = WrenchSample::from_si(&ports.sample.read(values), 0);
        let input = TickInput {
            elapsed_cycles: 1,
            reading: is_read.then_some(Reading::unmeasured(nominal)),
            sensor: sensor.filter(|_| is_read),
            stop: values.is_set(ports.stop),
            quit: false,
            rearm: values.is_set(ports.rearm),
        };
        match self.endpoint.tick(&input) {
            Write::Due(write) => {
                ports.show_references(write.references(), values);
                write.accepted();
            }
            // Not reached: the references above are always taken.
            Write::Withheld(drives) => drives.unknown(),
        }
        let output = self.endpoint.output().ok_or("a tick has no output")?;
        values.put_switch(ports.latched, output.latched);
        Ok(output.state)
    }
}
