//! One cycle of the server: read sockets and machine, tick the core, write machine and sockets. No clock: tests step it by hand.

use std::io;
use std::net::{SocketAddr, TcpStream};

use gantry_tau_core::control::axis::Reference;
use gantry_tau_core::control::endpoint::{Cycle as CoreCycle, Endpoint, MotorMap};
use gantry_tau_core::control::message::{Cause, Phase, State};
use gantry_tau_core::control::session::Session;
use gantry_tau_core::control::session::config::Config;
use gantry_tau_core::units::Tick;

use super::connections::{Connections, Listen};
use super::outbox::Outbox;
use super::{HALF, ServerError};
use crate::black_box::handover::Handover;
use crate::epoch::Epochs;
use crate::plant::{Plant, Reading, ToolReading};
use crate::realtime::Socket;
use crate::sensor_link::{Sample, SensorPublisher};

/// What one cycle did; the whole of what observers see.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row<const N: usize> {
    /// The State of the tick: nominal references, offsets, actual values, counters.
    pub state: State<N>,
    /// What the drives received.
    pub references: [Reference; N],
    /// What the instruments at the tool saw.
    pub tool: Option<ToolReading>,
    /// Why a session ended in this tick, if one did.
    pub ended: Option<Cause>,
    /// A session was granted in this tick.
    pub welcomed: bool,
    /// Hellos refused in this tick.
    pub refused: u8,
    /// Cycles since the last tick.
    pub elapsed: u32,
    /// From the State's departure to the arrival of its answer, µs; absent without an answer or without a clock.
    pub round_trip_us: Option<u32>,
    /// The machine did not answer.
    pub plant_failed: bool,
}

/// What is asked of one step, beside the time that has passed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Demands {
    /// The stop at the machine is asserted.
    pub stop: bool,
    /// Somebody at the machine re-arms.
    pub rearm: bool,
}

/// A server without a clock.
pub struct Cycle<const N: usize, const M: usize, P> {
    endpoint: Box<Endpoint<N, M, HALF>>,
    connections: Connections,
    outbox: Outbox,
    sensor: Option<SensorPublisher>,
    plant: P,
    epochs: Epochs,
    last_reading: Reading<N>,
    /// The machine did not take the last references; the coming tick stops.
    write_failed: bool,
    round_trip_us: Option<u32>,
    /// Who wants the black boxes.
    handover: Option<Handover<N>>,
}

impl<const N: usize, const M: usize, P: Plant<N, M>> Cycle<N, M, P> {
    /// Reads the offsets in force, starts the session from them, and listens.
    ///
    /// # Errors
    /// [`ServerError`]: the address cannot be bound, or the machine's offsets are unreadable or beyond their limits.
    pub fn new(
        config: Config<N>,
        motors: MotorMap<N, M>,
        mut plant: P,
        epochs: Epochs,
        listen: impl Into<Listen>,
    ) -> Result<Self, ServerError> {
        let listen = listen.into();
        let connections = Connections::bind(&listen)
            .map_err(|error| ServerError::listen(listen.address, &error))?;
        let in_force = plant.offsets_in_force().map_err(ServerError::Plant)?;
        let last_reading = plant.read(1).map_err(ServerError::Plant)?;
        let nominal = last_reading.nominal;
        let session = Session::new(config, &in_force, nominal, Tick(0), epochs.last())
            .map_err(|error| ServerError::Start(error.to_string()))?;
        Ok(Self {
            endpoint: Box::new(Endpoint::new(session, motors)),
            connections,
            outbox: Outbox::new(),
            sensor: None,
            plant,
            epochs,
            last_reading,
            write_failed: false,
            round_trip_us: None,
            handover: None,
        })
    }

    /// Publishes the sensor's samples.
    #[must_use]
    pub fn with_sensor(mut self, sensor: SensorPublisher) -> Self {
        self.sensor = Some(sensor);
        self
    }

    /// Hands black boxes over: each one that freezes, and each one with something to tell that would be forgotten.
    #[must_use]
    pub fn with_black_box(mut self, handover: Handover<N>) -> Self {
        self.handover = Some(handover);
        self
    }

    /// Where clients connect.
    ///
    /// # Errors
    /// When the system does not tell.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.connections.address()
    }

    /// The core's endpoint, to look at.
    #[must_use]
    pub const fn endpoint(&self) -> &Endpoint<N, M, HALF> {
        &self.endpoint
    }

    /// The phase after the last step.
    #[must_use]
    pub fn phase(&self) -> Phase {
        self.endpoint.session().phase()
    }

    /// Takes in new connections and everything that has arrived on all of them.
    /// Returns how many frames the coming tick has of the owner.
    pub fn receive(&mut self) -> u8 {
        self.connections.receive(&mut self.endpoint)
    }

    /// Takes in what has arrived from the owner.
    pub fn receive_owner(&mut self) -> u8 {
        self.connections.receive_owner(&mut self.endpoint)
    }

    /// Lock-step: the coming tick has what it waits for.
    #[must_use]
    pub fn owner_has_answered(&self) -> bool {
        self.endpoint.owner_has_answered()
    }

    /// What to wait on for the owner's bytes; absent without an owner.
    pub fn owner_socket(&mut self) -> Option<Socket<'_>> {
        let owner = self.endpoint.session().owner()?;
        self.connections.socket(owner)
    }

    /// The owner's stream; absent without an owner, and over UDP.
    pub fn owner_stream(&mut self) -> Option<&TcpStream> {
        let owner = self.endpoint.session().owner()?;
        self.connections.stream(owner)
    }

    /// The answer to the last State arrived this long after it left.
    pub const fn note_round_trip(&mut self, microseconds: u32) {
        self.round_trip_us = Some(microseconds);
    }

    /// One tick, `elapsed` cycles after the last, on what was received since.
    pub fn step(&mut self, elapsed: u32, demands: Demands) -> Row<N> {
        let outage = self.write_failed;
        let resumed = !outage || self.resume();
        let reading = self.plant.read(u64::from(elapsed));
        let read_failed = reading.is_err();
        // A machine that does not answer is stopped; its last nominal reference stands.
        let reading = reading.unwrap_or(self.last_reading);
        self.last_reading = reading;
        self.publish(&reading);
        let round_trip_us = self.round_trip_us.take();
        let cycle = CoreCycle {
            elapsed,
            nominal: reading.nominal,
            actual: reading.actual,
            stop: demands.stop || read_failed || outage,
            rearm: demands.rearm,
            next_epoch: self.epochs.next(),
            arrival_us: u16::try_from(round_trip_us.unwrap_or(0)).unwrap_or(u16::MAX),
        };
        let outbox = &mut self.outbox;
        let turn = self
            .endpoint
            .tick(&cycle, &mut |to, bytes| outbox.push(to, bytes));
        // What the drives have in force must be known before anything is added to it.
        self.write_failed = !resumed || self.plant.write(&turn.motors).is_err();
        self.outbox
            .empty(|to, bytes| self.connections.send(to, bytes));
        for connection in &turn.close {
            self.connections.close(*connection);
        }
        let output = &turn.output;
        if output.welcome.is_some() {
            self.epochs.taken(output.state.epoch);
            // A new session is recorded from its beginning; the last one's end has been kept until now.
            self.hand_over_end();
            self.endpoint.black_box_mut().release();
        } else {
            self.hand_over_frozen();
        }
        Row {
            state: output.state,
            references: output.references,
            tool: reading.tool,
            ended: output.ended,
            welcomed: output.welcome.is_some(),
            refused: u8::try_from(output.refusals.len()).unwrap_or(u8::MAX),
            elapsed,
            round_trip_us,
            plant_failed: read_failed || self.write_failed,
        }
    }

    /// Hands over what the black box has of an end, frozen or not: nothing more will be added to it.
    pub fn hand_over_end(&mut self) {
        let black_box = self.endpoint.black_box();
        if black_box
            .entries()
            .any(|entry| entry.output.ended.is_some())
        {
            self.hand_over_now();
        }
    }

    /// Hands over a frozen box, after which recording goes on. Without room it stays frozen until there is some.
    fn hand_over_frozen(&mut self) {
        if let (Some(handover), true) = (&mut self.handover, self.endpoint.black_box().is_frozen())
        {
            handover.take(self.endpoint.black_box_mut());
        }
    }

    fn hand_over_now(&mut self) {
        if let Some(handover) = &mut self.handover {
            handover.take_now(self.endpoint.black_box_mut());
        }
    }

    /// After references that the machine did not take, goes on from the offsets it has in force, so that it sees no step.
    fn resume(&mut self) -> bool {
        let Ok(in_force) = self.plant.offsets_in_force() else {
            return false;
        };
        // The black box begins anew. What it has of a session, which this ends, is evidence of the outage.
        if self.endpoint.session().parts().discrete.is_live() {
            self.hand_over_now();
        } else {
            self.hand_over_end();
        }
        self.endpoint.resume(&in_force).is_ok()
    }

    /// The sample leaves before the State of the same tick, so that a client has it when it answers.
    fn publish(&mut self, reading: &Reading<N>) {
        if let (Some(sensor), Some(tool)) = (&mut self.sensor, &reading.tool) {
            let tick = self
                .endpoint
                .session()
                .parts()
                .discrete
                .tick
                .0
                .saturating_add(1);
            let wrench = tool.sensor;
            sensor.publish(&Sample { tick, wrench });
        }
    }
}
