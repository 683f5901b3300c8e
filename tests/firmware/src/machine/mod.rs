//! The server and its machine: one cycle of the firmware. The same file is compiled into the test,
//! which runs it on the host.
//!
//! A cycle has two halves. [`Machine::compute`] is the float part: from a pose to the nominal
//! positions of six axes, and from a load to the offsets that hold the tool there.
//! [`Machine::serve`] is the endpoint's tick.

mod control_cycle;
mod f1;
pub(crate) mod robots;

use gantry_tau_core::control::axis::Reference;
use gantry_tau_core::control::endpoint::{Endpoint, MotorMap, Write};
use gantry_tau_core::control::message::Capabilities;
use gantry_tau_core::control::session::config::Config;
use gantry_tau_core::control::session::{
    BlackBox, Connection, LastWrite, Output, Reading, Session, Start, TickInput,
};
use gantry_tau_core::units::{PositionNm, WrenchSample};

pub(crate) use control_cycle::{ControlCycle, CycleResult};

/// Axes of the F1.
pub(crate) const AXES: usize = 6;
/// Motors: two on each cart, one on each screw `[T 1.2.2]`.
pub(crate) const MOTORS: usize = 9;
/// Axis of each motor.
pub(crate) const AXIS_OF_MOTOR: [usize; MOTORS] = [0, 0, 1, 1, 2, 2, 3, 4, 5];
/// A third of the ticks in the black box.
pub(crate) const HALF: usize = 8;

/// A position, m, and a rotation vector, rad.
pub(crate) type Pose6 = [f64; 6];
/// References of the motors; `None` while they are withheld.
pub(crate) type MotorReferences = Option<[Reference; MOTORS]>;
/// Endpoint of this machine.
pub(crate) type Server = Endpoint<AXES>;

/// A constant of this folder that core refuses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SetupError {
    /// Limits of a channel.
    Limits,
    /// A robot.
    Robot,
    /// Compensator or sensor.
    Compensation,
    /// Configuration of the session, its start, the motors.
    Session,
}

/// Source of the nominal positions of a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Motion {
    /// Nominal positions and measurements are those of the [`TickInput`].
    Given,
    /// The three carts of the L2 bring its tool to the pose; the other axes rest.
    L2,
    /// The six axes of the F1 bring its tool to the pose.
    F1,
}

/// Input of a cycle, beside the bytes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CycleInput {
    /// Input of the endpoint; its nominal positions and measurements count for [`Motion::Given`]
    /// only.
    pub(crate) tick: TickInput<AXES>,
    /// Fate of the references of the cycle.
    pub(crate) fate: LastWrite<AXES>,
    /// Arrival of the last Command, µs.
    pub(crate) arrival_us: u16,
    /// Source of the nominal positions.
    pub(crate) motion: Motion,
    /// Pose of the tool; with given positions, for the compensation only.
    pub(crate) pose: Pose6,
    /// Sample of the force sensor, N and N m.
    pub(crate) load: [f64; 6],
}

impl CycleInput {
    /// A cycle on time, without stop and load, whose references are taken.
    pub(crate) const fn on_time(motion: Motion, pose: Pose6) -> Self {
        Self {
            tick: TickInput {
                elapsed_cycles: 1,
                reading: Some(Reading::unmeasured([PositionNm(0); AXES])),
                sensor: None,
                stop: false,
                quit: false,
                rearm: false,
            },
            fate: LastWrite::Accepted,
            arrival_us: 0,
            motion,
            pose,
            load: [0.0; 6],
        }
    }
}

/// Measured part of a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    /// Bytes into the deframers.
    Feed,
    /// Kinematics, statics, compensation.
    Floats,
    /// The endpoint's tick, and its frames.
    Tick,
}

/// Measurement of the parts of a cycle.
pub(crate) trait Meter {
    /// Begins a part.
    #[inline]
    fn begin(&mut self) {}
    /// Ends it.
    #[inline]
    fn end(&mut self, _: Part) {}
}

/// Measures nothing.
#[allow(dead_code, reason = "the images that are measured from outside use it")]
pub(crate) struct Unmeasured;

impl Meter for Unmeasured {}

/// The server, its black box, and the float part of its cycle.
pub(crate) struct Machine {
    server: Server,
    motors: MotorMap<AXES, MOTORS>,
    black_box: BlackBox<AXES, HALF>,
    cycle: &'static mut ControlCycle,
    /// Input of the coming tick.
    input: TickInput<AXES>,
    /// Last nominal positions and measurements; they stay until new ones are computed.
    last: Reading<AXES>,
}

/// Parts of a [`Machine`] that are small enough for a stack; the machine itself is not.
pub(crate) struct Parts {
    session: Session<AXES>,
    motors: MotorMap<AXES, MOTORS>,
    cycle: &'static mut ControlCycle,
    nominal: [PositionNm; AXES],
}

impl Parts {
    /// Checks every constant. The axes are at `nominal` when the server starts.
    pub(crate) fn new(
        cycle: &'static mut ControlCycle,
        capabilities: Capabilities,
        nominal: [PositionNm; AXES],
    ) -> Result<Self, SetupError> {
        let parameters = robots::parameters(cycle.checksum(), capabilities)?;
        let config = Config::new(parameters).map_err(|_| SetupError::Session)?;
        let session =
            Session::new(config, &Start::at_rest(nominal)).map_err(|_| SetupError::Session)?;
        let motors = MotorMap::new(AXIS_OF_MOTOR).map_err(|_| SetupError::Session)?;
        Ok(Self {
            session,
            motors,
            cycle,
            nominal,
        })
    }
}

impl Machine {
    /// Creates the machine, and by `serve` its server, which has no connections.
    // Inlined, so that it is written to its place and never lies on the stack.
    #[inline(always)]
    pub(crate) fn new(parts: Parts, serve: impl FnOnce(Session<AXES>) -> Server) -> Self {
        Self {
            server: serve(parts.session),
            motors: parts.motors,
            black_box: BlackBox::new(),
            cycle: parts.cycle,
            input: CycleInput::on_time(Motion::Given, [0.0; 6]).tick,
            last: Reading::unmeasured(parts.nominal),
        }
    }

    /// Returns the endpoint: to open, feed and close connections, and to poll frames.
    pub(crate) const fn server(&mut self) -> &mut Server {
        &mut self.server
    }

    /// Returns the output of the last tick; `None` before the first.
    pub(crate) const fn output(&self) -> Option<&Output<AXES>> {
        self.server.output()
    }

    /// Runs the float half of a cycle. After an error of the kinematics the nominal positions stay.
    // Not inlined, nor is the second half, so that their stack use does not add up.
    #[inline(never)]
    pub(crate) fn compute(
        &mut self,
        input: &CycleInput,
        meter: &mut impl Meter,
    ) -> CycleResult<'_> {
        meter.begin();
        let result = self.cycle.run(input);
        self.input = input.tick;
        self.input.sensor = WrenchSample::from_si(&input.load, 0);
        if !matches!(input.motion, Motion::Given) {
            self.last.nominal = result.nominal().unwrap_or(self.last.nominal);
            self.input.reading = Some(self.last);
        } else if let Some(reading) = input.tick.reading {
            self.last = reading;
        }
        meter.end(Part::Floats);
        result
    }

    /// Runs the integer half of a cycle: the tick, then its frames. Returns the references of the
    /// motors.
    #[inline(never)]
    pub(crate) fn serve(
        &mut self,
        input: &CycleInput,
        meter: &mut impl Meter,
        send: &mut impl FnMut(Connection, &[u8]),
    ) -> MotorReferences {
        meter.begin();
        self.server.note_arrival(input.arrival_us);
        let write = (self.server).tick_recorded(&self.input, &mut self.black_box);
        let references = written(write, &self.motors, &input.fate);
        while let Some((to, frame)) = self.server.poll_transmit() {
            send(to, frame);
        }
        meter.end(Part::Tick);
        // A perfect drive is at its reference.
        if let Some(output) = self.server.output().filter(|output| !output.withheld) {
            for (actual, reference) in self.last.actual.iter_mut().zip(&output.references) {
                actual.position = reference.position;
            }
        }
        references
    }
}

/// Returns the references of the motors, and says what becomes of them.
fn written(
    write: Write<'_, AXES>,
    motors: &MotorMap<AXES, MOTORS>,
    fate: &LastWrite<AXES>,
) -> MotorReferences {
    let write = match write {
        Write::Due(write) => write,
        Write::Withheld(drives) => {
            match fate {
                LastWrite::Refused { in_force } => drives.read_back(*in_force),
                _ => drives.unknown(),
            }
            return None;
        }
    };
    let references = motors.spread(write.references());
    match fate {
        LastWrite::Accepted => write.accepted(),
        LastWrite::Refused { in_force } => write.refused(*in_force),
        LastWrite::Unknown => write.unknown(),
    }
    references
}
