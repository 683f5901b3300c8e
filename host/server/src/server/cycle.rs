//! One cycle of the server: reads sockets and machine, ticks core, writes machine and sockets. It
//! has no clock, so tests can step it.

use std::io;
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use gantry_tau_core::control::axis::InForce;
use gantry_tau_core::control::endpoint::{Budget, Endpoint, MotorMap, Write};
use gantry_tau_core::control::message::Phase;
use gantry_tau_core::control::position_loop::config::LoopConfig;
use gantry_tau_core::control::session::config::Config;
use gantry_tau_core::control::session::{self, Session, Start, TickInput};
use gantry_tau_core::units::{EpochRange, WrenchSample};

use super::ServerError;
use super::connections::{Connections, Listen, Listening};
use super::velocity_interface::{Followed, VelocityInterface, Written};
use crate::black_box::swap_channel::Sender;
use crate::links::accelerometer::{Acceleration, AccelerometerPublisher};
use crate::plant::{Plant, PlantFailure, Reading, VelocityPlant};
use crate::publication::Publication;
use crate::realtime::Socket;
use crate::record::TickRecord;
use crate::state::StopLatch;

/// Longest wait of a cycle for the stop latch. Drives wait longer for their references; a disk that
/// works needs some ten microseconds.
const LATCH_PATIENCE: Duration = Duration::from_millis(2);

/// Inputs of the operator at the machine in one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OperatorInputs {
    /// The stop is asserted.
    pub stop: bool,
    /// The server is to end.
    pub quit: bool,
    /// The re-arm is pressed.
    pub rearm: bool,
}

/// A server without a clock.
pub struct Cycle<const N: usize, const M: usize, P: Plant<N, M>> {
    /// First, so that a machine is given back before the addresses.
    plant: P,
    endpoint: Box<Endpoint<N>>,
    connections: Connections,
    accelerometer: Option<AccelerometerPublisher>,
    sensors: Vec<Publication>,
    motors: MotorMap<N, M>,
    velocity: Option<VelocityInterface<N, M, P>>,
    /// The machine has not taken the last references: it must be read back.
    write_failed: bool,
    round_trip_us: Option<u32>,
    latch: StopLatch,
    black_boxes: Option<Sender<N>>,
}

impl<const N: usize, const M: usize, P: Plant<N, M>> Cycle<N, M, P> {
    /// Reads the values in force, starts the session from them, and listens. `epochs` must not be
    /// used by another run; a `latch` that is latched starts in Fault.
    ///
    /// # Errors
    /// [`ServerError`]: the address cannot be bound, or the machine's values in force are
    /// unreadable or beyond their limits.
    pub fn new(
        config: Config<N>,
        motors: MotorMap<N, M>,
        plant: P,
        epochs: EpochRange,
        latch: StopLatch,
        listen: impl Into<Listen>,
    ) -> Result<Self, ServerError> {
        Self::listening(
            config,
            motors,
            plant,
            epochs,
            latch,
            Listening::bind(&listen.into())?,
        )
    }

    /// The same on an address that is owned already: before a machine is touched that another
    /// server may move.
    ///
    /// # Errors
    /// [`ServerError`]: the machine's values in force are unreadable or beyond their limits.
    pub fn listening(
        config: Config<N>,
        motors: MotorMap<N, M>,
        mut plant: P,
        epochs: EpochRange,
        latch: StopLatch,
        listening: Listening,
    ) -> Result<Self, ServerError> {
        let in_force = plant.in_force().map_err(ServerError::of_plant)?;
        // Not needed: a machine that does not answer is found before the server listens.
        plant.read(1).map_err(ServerError::of_plant)?;
        let start = Start {
            in_force,
            stop_latched: latch.is_latched(),
        };
        let session =
            Session::new(config, &start).map_err(|error| ServerError::Start(error.into()))?;
        Ok(Self {
            plant,
            endpoint: Box::new(match listening.keyring {
                None => Endpoint::new(session, epochs),
                Some(keyring) => Endpoint::keyed(session, epochs, keyring, Budget::default()),
            }),
            connections: listening.connections,
            accelerometer: None,
            sensors: Vec::new(),
            motors,
            velocity: None,
            write_failed: false,
            round_trip_us: None,
            latch,
            black_boxes: None,
        })
    }

    /// Moves the drives by velocities, with position loops in the server; `None`: by positions.
    ///
    /// # Errors
    /// [`ServerError::Start`]: drives that take positions, or do not stop by themselves in time or
    /// within the travel.
    pub fn with_position_loops(self, config: Option<[LoopConfig; N]>) -> Result<Self, ServerError>
    where
        P: VelocityPlant<N, M>,
    {
        let Some(config) = config else {
            return Ok(self);
        };
        let session = self.endpoint.session();
        let (axes, in_force) = (&session.config().parameters().axes, session.in_force());
        let velocity = VelocityInterface::new(config, self.motors, axes, in_force, &self.plant);
        Ok(Self {
            velocity: Some(velocity.map_err(|error| ServerError::Start(error.into()))?),
            ..self
        })
    }

    /// Starts the writer of the stop latch, then enables the drives. In the thread of the cycles,
    /// before the first of them.
    ///
    /// # Errors
    /// [`ServerError::Thread`], [`ServerError::Plant`].
    pub fn start(&mut self) -> Result<(), ServerError> {
        self.latch
            .start_writer(LATCH_PATIENCE)
            .map_err(|error| ServerError::Thread(error.to_string()))?;
        self.plant.start().map_err(ServerError::of_plant)
    }

    /// Returns the time at which the machine wants the first cycle to begin, ns; see
    /// [`Plant::first_deadline_ns`].
    pub fn first_deadline_ns(&mut self) -> Option<u64> {
        self.plant.first_deadline_ns()
    }

    /// Returns the time by which the machine wants the next cycle to begin later, ns; see
    /// [`Plant::deadline_shift_ns`].
    pub fn deadline_shift_ns(&mut self) -> i64 {
        self.plant.deadline_shift_ns()
    }

    /// Publishes the samples of the accelerometer.
    #[must_use]
    pub fn with_accelerometer(mut self, accelerometer: AccelerometerPublisher) -> Self {
        self.accelerometer = Some(accelerometer);
        self
    }

    /// Publishes gauges and force sensor on these ports too; see [`Publication::is_of_sensors`].
    #[must_use]
    pub fn with_sensors(mut self, sensors: Vec<Publication>) -> Self {
        self.sensors = sensors;
        self
    }

    /// Records, and sends the black boxes: each one that freezes, and each one with an end that a
    /// new session would erase.
    #[must_use]
    pub fn with_black_box(mut self, black_boxes: Sender<N>) -> Self {
        self.black_boxes = Some(black_boxes);
        self
    }

    /// Returns the address on which clients connect.
    ///
    /// # Errors
    /// The system does not tell it.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.connections.address()
    }

    /// Returns core's endpoint.
    #[must_use]
    pub const fn endpoint(&self) -> &Endpoint<N> {
        &self.endpoint
    }

    /// True if the server may end: the machine took references without offsets in the last step or,
    /// moved by velocities, took that of zero.
    #[must_use]
    pub fn is_at_zero(&self) -> bool {
        self.velocity
            .as_ref()
            .map_or_else(|| self.endpoint.is_at_zero(), VelocityInterface::is_at_rest)
    }

    /// True if the machine did not take what was written in the last step.
    #[must_use]
    pub fn write_failed(&self) -> bool {
        self.velocity
            .as_ref()
            .map_or(self.write_failed, |velocity| !velocity.is_accepted())
    }

    /// Returns the values in force before the last step; they still are if the machine did not take
    /// its references.
    #[must_use]
    pub fn in_force(&self) -> &[InForce; N] {
        self.endpoint.session().in_force()
    }

    /// Returns the phase after the last step.
    #[must_use]
    pub fn phase(&self) -> Phase {
        self.endpoint.session().phase()
    }

    /// Accepts new connections and reads what has arrived on all of them.
    /// Returns the number of frames of the owner in the coming tick.
    pub fn receive(&mut self) -> u8 {
        self.connections.receive(&mut self.endpoint, None)
    }

    /// Reads what has arrived from the owner. Returns the number of its frames in the coming tick.
    pub fn receive_owner(&mut self) -> u8 {
        match self.endpoint.session().owner() {
            Some(owner) => self.connections.receive(&mut self.endpoint, Some(owner)),
            None => 0,
        }
    }

    /// True if the coming tick has what a server in lock-step waits for.
    #[must_use]
    pub fn owner_has_answered(&self) -> bool {
        self.endpoint.owner_has_answered()
    }

    /// Returns the socket with the owner's bytes; `None` without an owner.
    pub fn owner_socket(&mut self) -> Option<Socket<'_>> {
        let owner = self.endpoint.session().owner()?;
        self.connections.socket(owner)
    }

    /// Returns the owner's stream; `None` without an owner, and over UDP.
    pub fn owner_stream(&mut self) -> Option<&TcpStream> {
        let owner = self.endpoint.session().owner()?;
        self.connections.stream(owner)
    }

    /// Takes note of the time from the departure of the last State to the arrival of its answer,
    /// µs.
    pub const fn note_round_trip(&mut self, microseconds: u32) {
        self.round_trip_us = Some(microseconds);
    }

    /// Runs one tick, `elapsed` cycles after the last, on what was received since.
    pub fn step(&mut self, elapsed: u32, operator: OperatorInputs) -> TickRecord<N> {
        if operator.rearm && !operator.stop && !operator.quit && self.phase() == Phase::Fault {
            self.plant.reset();
        }
        let read = self.plant.read(u64::from(elapsed));
        let reading = read.as_ref().ok();
        let round_trip_us = self.round_trip_us.take();
        let input = TickInput {
            elapsed_cycles: elapsed,
            reading: reading.map(|reading| session::Reading {
                nominal: reading.nominal,
                actual: reading.actual,
            }),
            sensor: reading
                .and_then(|reading| reading.tool.as_ref())
                .and_then(|tool| WrenchSample::from_si(&tool.sensor, tool.sensor_age)),
            stop: operator.stop,
            quit: operator.quit,
            rearm: operator.rearm,
        };
        self.endpoint
            .note_arrival(u16::try_from(round_trip_us.unwrap_or(0)).unwrap_or(u16::MAX));
        let write = match &mut self.black_boxes {
            Some(sender) => self.endpoint.tick_recorded(&input, sender.black_box()),
            None => self.endpoint.tick(&input),
        };
        // Before anything acts, so that no crash can undo a stop; a disk that hangs is waited for a
        // moment only.
        self.latch.set(write.output().latched);
        let written = match &mut self.velocity {
            None => match &write {
                Write::Withheld(_) => None,
                Write::Due(write) => self.motors.spread(write.references()).map(|references| {
                    match self.plant.write(&references, &write.parts()) {
                        Ok(()) => Written::Followed,
                        Err(error) => Written::Failed(PlantFailure::of(&error)),
                    }
                }),
            },
            Some(velocity) => {
                let output = write.output();
                let followed = Followed {
                    references: &output.references,
                    parts: &write.parts(),
                    withheld: output.withheld,
                    actual: reading.map(|reading| &reading.actual),
                    phase: output.state.phase,
                    ends: output.ended.is_some(),
                    operator,
                };
                Some(velocity.write(
                    &mut self.plant,
                    &followed,
                    self.black_boxes.as_mut().map(Sender::loops),
                ))
            }
        };
        self.write_failed = written != Some(Written::Followed);
        say(write, self.write_failed, &mut self.plant);
        let plant_failed = reading.is_none() || matches!(written, None | Some(Written::Failed(_)));
        let failure = match (&read, written) {
            (Err(error), _) => Some(PlantFailure::of(error)),
            (Ok(_), Some(Written::Failed(failure))) => Some(failure),
            (Ok(_), _) => None,
        };
        let row = TickRecord {
            failure,
            plant_failed,
            ..self.row(reading, elapsed, round_trip_us)
        };
        // The sample leaves before the State of the same tick, so that a client has it when it
        // answers.
        if let Some(tool) = &row.tool {
            if let (Some(link), Some(components)) = (&mut self.accelerometer, tool.acceleration) {
                link.publish(&Acceleration {
                    tick: row.state.tick.0,
                    components,
                });
            }
            for port in &mut self.sensors {
                port.publish_sensors(tool);
            }
        }
        while let Some((to, frame)) = self.endpoint.poll_transmit() {
            self.connections.send(to, frame);
        }
        while let Some(connection) = self.endpoint.poll_close() {
            self.connections.close(connection);
        }
        if let Some(black_boxes) = &mut self.black_boxes {
            black_boxes.see(row.state.phase);
            if row.welcomed {
                black_boxes.begin();
            } else {
                black_boxes.send_frozen();
            }
        }
        row
    }

    /// Returns the stop latch.
    #[must_use]
    pub const fn latch(&self) -> &StopLatch {
        &self.latch
    }

    /// True if core has a stop latched after the last step; before the first, as the latch was
    /// opened.
    fn is_latched(&self) -> bool {
        self.endpoint
            .output()
            .map_or(self.latch.is_latched(), |output| output.latched)
    }

    /// True if a server that is to quit may end: zero is in force, and the latch says what
    /// core does.
    #[must_use]
    pub fn may_end(&self, quit: bool) -> bool {
        session::may_end(
            quit,
            self.is_at_zero(),
            self.is_latched(),
            self.latch.stored(),
        )
    }

    /// Sends the black box if it has an end: nothing more will be added to it.
    pub fn send_end(&mut self) {
        if let Some(black_boxes) = &mut self.black_boxes {
            black_boxes.send_end();
        }
    }

    /// Summarises the tick that has just run, but for its failures.
    fn row(
        &self,
        reading: Option<&Reading<N>>,
        elapsed: u32,
        round_trip_us: Option<u32>,
    ) -> TickRecord<N> {
        #[expect(clippy::expect_used, reason = "a tick always leaves its output")]
        let output = self.endpoint.output().expect("a tick has run");
        TickRecord {
            state: output.state,
            references: output.references,
            tool: reading.and_then(|reading| reading.tool),
            ended: output.ended,
            welcomed: output.welcome.is_some(),
            key: self.endpoint.granted_key(),
            refused: u8::try_from(output.refusals.len()).unwrap_or(u8::MAX),
            elapsed,
            round_trip_us,
            plant_failed: false,
            failure: None,
            drives: self.plant.drives(),
            latched: output.latched,
            latch_lost: self.latch.is_lost(),
        }
    }
}

/// Says what became of references. After a failed write, or none, the machine is read back.
fn say<const N: usize, const M: usize>(
    write: Write<'_, N>,
    failed: bool,
    plant: &mut impl Plant<N, M>,
) {
    match write {
        Write::Due(write) if !failed => write.accepted(),
        Write::Due(write) => match plant.in_force() {
            Ok(in_force) => write.refused(in_force),
            Err(_) => write.unknown(),
        },
        Write::Withheld(drives) => match plant.in_force() {
            Ok(in_force) => drives.read_back(in_force),
            Err(_) => drives.unknown(),
        },
    }
}
