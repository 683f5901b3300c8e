//! The compensating client, whose frames pass from cycle to cycle.

use gantry_tau_client::force_sensor::SensorConnection;
use gantry_tau_client::{Controller, HomeMargin};
use gantry_tau_core::control::client::{self as protocol, Event, Requirements};
use gantry_tau_core::control::endpoint::{Endpoint, Transport};
use gantry_tau_core::control::message::{Capabilities, Mode, State, Welcome};
use gantry_tau_core::control::session::Connection;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{CYCLE_US, RobotFile};

use crate::log::Log;

/// Task of a client.
pub(super) struct Wishes<'a, K, const N: usize> {
    pub(super) robot: &'a RobotFile<K, N>,
    pub(super) margin: &'a HomeMargin,
    /// Obtain once the sensor is tared.
    pub(super) obtain: bool,
    /// Obtain with a small margin, too.
    pub(super) accept_unstable: bool,
}

/// A client from its Hello to its end.
#[derive(Clone)]
pub(super) struct UnitClient<const N: usize> {
    connection: Connection,
    protocol: protocol::Client<N>,
    /// Present from the Welcome on.
    controller: Option<Controller<N>>,
    /// Frames of the last tick, which it hears before the coming one.
    inbox: Vec<u8>,
    /// The frame for the coming tick.
    frame: Vec<u8>,
    /// It left Obtain by itself, until it is asked to obtain again.
    has_left_obtain: bool,
    /// The server has closed its connection.
    is_closed: bool,
    is_over: bool,
}

impl<const N: usize> UnitClient<N> {
    /// Connects to a server. `None`: it has no place left.
    pub(super) fn connect(endpoint: &mut Endpoint<N>, kinematics_checksum: u32) -> Option<Self> {
        let connection = endpoint.open(Transport::Stream).ok()?;
        let requirements = Requirements {
            capabilities: Capabilities::LOCKSTEP,
            cycle_us: Some(CYCLE_US),
            kinematics_checksum: Some(kinematics_checksum),
        };
        let mut protocol = protocol::Client::new(Transport::Stream, requirements);
        let hello = protocol.hello()?.to_vec();
        Some(Self {
            connection,
            protocol,
            controller: None,
            inbox: Vec::new(),
            frame: hello,
            has_left_obtain: false,
            is_closed: false,
            is_over: false,
        })
    }

    /// Returns its connection at the server.
    pub(super) const fn connection(&self) -> Connection {
        self.connection
    }

    /// True once its session is over and it knows.
    pub(super) const fn is_over(&self) -> bool {
        self.is_over
    }

    /// Returns what it computes; `None` before the Welcome.
    pub(super) const fn controller(&self) -> Option<&Controller<N>> {
        self.controller.as_ref()
    }

    /// Takes note of a connection that the server has closed: what it sent before is still heard.
    pub(super) fn note_closed(&mut self, connection: Connection) {
        self.is_closed |= connection == self.connection;
    }

    /// Takes a frame of the server for its inbox.
    pub(super) fn receive(&mut self, frame: &[u8]) {
        self.inbox.extend_from_slice(frame);
    }

    /// Hears the frames of the last tick, and hands its answer to the server for the coming one. With
    /// the cable out both are lost.
    pub(super) fn exchange<K: MachineKind<N>>(
        &mut self,
        endpoint: &mut Endpoint<N>,
        wishes: Option<&Wishes<'_, K, N>>,
        log: &mut Log,
    ) {
        let inbox = std::mem::take(&mut self.inbox);
        if let Some(wishes) = wishes.filter(|_| !inbox.is_empty()) {
            self.hear(&inbox, wishes, log);
        }
        self.is_over |= self.is_closed && wishes.is_some();
        let frame = std::mem::take(&mut self.frame);
        if wishes.is_some() && !frame.is_empty() {
            endpoint.feed(self.connection, &frame);
        }
    }

    /// Takes frames of the server, and makes that which answers them.
    fn hear<K: MachineKind<N>>(&mut self, frames: &[u8], wishes: &Wishes<'_, K, N>, log: &mut Log) {
        let mut events = Vec::new();
        let mut received = self.protocol.feed(frames);
        while let Some(event) = received.poll_event() {
            events.push(event);
        }
        for event in events {
            match event {
                Ok(Event::Welcomed(welcome)) => self.begin(&welcome, wishes, log),
                Ok(Event::State(state)) => self.answer(&state, wishes, log),
                Ok(Event::Ended(state)) => {
                    log.warn(format!("the server has ended the session: {}", state.cause));
                    self.is_over = true;
                }
                Ok(Event::Refused(refusal)) => {
                    log.warn(format!("the server refuses the session: {refusal}"));
                    self.is_over = true;
                }
                Ok(_) => {}
                Err(error) => {
                    log.warn(format!("the client leaves: {error}"));
                    self.is_over = true;
                }
            }
        }
    }

    fn begin<K: MachineKind<N>>(
        &mut self,
        welcome: &Welcome<N>,
        wishes: &Wishes<'_, K, N>,
        log: &mut Log,
    ) {
        let margin = wishes.margin.clone();
        match Controller::new(wishes.robot, welcome, margin, wishes.accept_unstable) {
            Ok(controller) => self.controller = Some(controller),
            Err(error) => {
                log.warn(format!("the client leaves: {error}"));
                self.is_over = true;
            }
        }
    }

    fn answer<K: MachineKind<N>>(
        &mut self,
        state: &State<N>,
        wishes: &Wishes<'_, K, N>,
        log: &mut Log,
    ) {
        let Some(controller) = &mut self.controller else {
            return;
        };
        let sensor = &mut SensorConnection::States;
        if let Err(silent) = controller.compensate(state, sensor, |_| Ok(None)) {
            log.warn(format!("the client leaves: {silent}"));
            let goodbye = self.protocol.goodbye();
            self.frame = goodbye.map(|frame| frame.to_vec()).unwrap_or_default();
            return;
        }
        self.has_left_obtain &= wishes.obtain;
        let mode = controller
            .mode(wishes.obtain && !self.has_left_obtain)
            .unwrap_or_else(|reason| {
                log.warn(format!("not obtaining: {reason}"));
                self.has_left_obtain = true;
                Mode::Submit
            });
        if let Some(answer) = self.protocol.answer(mode, &controller.targets()) {
            controller.note_answer(&answer);
            self.frame = answer.frame.to_vec();
        }
        if let Some(oscillation) = controller.oscillation(state) {
            log.warn(format!(
                "{oscillation}: leaving Obtain until `obtain` is set again"
            ));
            self.has_left_obtain = true;
        }
    }
}
