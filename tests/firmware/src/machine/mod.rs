//! The server and its machine: what one tick of the firmware does. The same file is compiled into the test, which runs it on the host.
//!
//! A tick begins with the work of floats, [`Machine::compute`]: from a pose to the nominal positions of six axes, and from a load to the offsets that would
//! hold the tool there. Then it is the endpoint's, [`Machine::serve`].

mod f1;
pub(crate) mod robots;
mod work;

use gantry_tau_core::control::axis::{Actual, Offsets};
use gantry_tau_core::control::endpoint::{Cycle, Endpoint, MotorMap, Turn};
use gantry_tau_core::control::message::Capabilities;
use gantry_tau_core::control::session::Session;
use gantry_tau_core::control::session::config::Config;
use gantry_tau_core::control::session::fsm::Connection;
use gantry_tau_core::units::{Epoch, PositionNm, Tick, TorquePermille, VelocityUmS};

pub(crate) use work::{Answer, Work};

/// Axes of the F1.
pub(crate) const AXES: usize = 6;
/// Motors: two on each cart, one on each screw.
pub(crate) const MOTORS: usize = 9;
/// Which axis each motor drives.
pub(crate) const AXIS_OF_MOTOR: [usize; MOTORS] = [0, 0, 1, 1, 2, 2, 3, 4, 5];
/// A third of the ticks in the black box.
pub(crate) const HALF: usize = 8;

/// A place, metres, and a rotation vector, radians.
pub(crate) type Pose6 = [f64; 6];

/// The endpoint of this machine.
pub(crate) type Server = Endpoint<AXES, MOTORS, HALF>;

/// A constant of this folder that core does not take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Refused {
    /// Limits of a channel.
    Limits,
    /// A robot.
    Robot,
    /// Compensator or sensor.
    Compensation,
    /// Configuration of the session, its start, the motors.
    Session,
}

/// Where the nominal positions of a tick come from.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Motion {
    /// They are given, and so is what the drives measure.
    Given {
        /// Nominal positions.
        nominal: [PositionNm; AXES],
        /// What the drives measure.
        actual: [Actual; AXES],
    },
    /// The three carts of the L2 take its tool there; the other axes rest.
    L2,
    /// The six axes of the F1 take its tool there.
    F1,
}

/// What a tick depends on, beside the bytes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moment {
    /// Cycles since the last tick.
    pub(crate) elapsed: u32,
    /// The stop at the machine.
    pub(crate) stop: bool,
    /// The re-arm at the machine.
    pub(crate) rearm: bool,
    /// Epoch for the next session.
    pub(crate) next_epoch: Epoch,
    /// When the last command arrived, µs.
    pub(crate) arrival_us: u16,
    /// Where the nominal positions come from.
    pub(crate) motion: Motion,
    /// Where the tool shall be, metres and rotation vector; with given positions as well, for the compensation.
    pub(crate) pose: Pose6,
    /// What the force sensor reads, N and N m.
    pub(crate) load: [f64; 6],
}

/// What is measured of a tick, one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    /// Bytes into the deframers.
    Feed,
    /// Kinematics, statics, compensation.
    Floats,
    /// The endpoint's tick, and what it sends.
    Tick,
}

/// Who measures.
pub(crate) trait Meter {
    /// A part begins.
    fn begin(&mut self);
    /// It ends.
    fn end(&mut self, part: Part);
}

/// The server, and what computes beside it.
pub(crate) struct Machine {
    server: Server,
    work: Work,
    nominal: [PositionNm; AXES],
    actual: [Actual; AXES],
}

/// What a [`Machine`] is made of: small, where the machine itself has no place on a stack.
pub(crate) struct Parts {
    session: Session<AXES>,
    motors: MotorMap<AXES, MOTORS>,
    work: Work,
    nominal: [PositionNm; AXES],
}

impl Parts {
    /// Checks every constant. The axes are at `nominal` when the server starts.
    pub(crate) fn new(
        capabilities: Capabilities,
        nominal: [PositionNm; AXES],
    ) -> Result<Self, Refused> {
        let (work, checksum) = Work::new()?;
        let parameters = robots::parameters(checksum, capabilities)?;
        let config = Config::new(parameters).map_err(|_| Refused::Session)?;
        let nothing = [Offsets::default(); AXES];
        let session = Session::new(config, &nothing, nominal, Tick(0), Epoch(0))
            .map_err(|_| Refused::Session)?;
        let motors = MotorMap::new(AXIS_OF_MOTOR).map_err(|_| Refused::Session)?;
        Ok(Self {
            session,
            motors,
            work,
            nominal,
        })
    }
}

impl Machine {
    /// The machine, its server without connections.
    #[inline]
    pub(crate) const fn new(parts: Parts) -> Self {
        Self {
            server: Server::new(parts.session, parts.motors),
            work: parts.work,
            nominal: parts.nominal,
            actual: [Actual {
                position: PositionNm(0),
                velocity: VelocityUmS(0),
                torque: TorquePermille(0),
            }; AXES],
        }
    }

    /// The endpoint: to open, feed and close.
    pub(crate) const fn server(&mut self) -> &mut Server {
        &mut self.server
    }

    /// The first half of a tick: floats. Without an answer of the kinematics the nominal positions stay.
    /// Not inlined, and neither is the second half: together they need as much stack as the larger of them.
    #[inline(never)]
    pub(crate) fn compute(&mut self, moment: &Moment, meter: &mut impl Meter) -> Answer<'_> {
        meter.begin();
        let answer = self.work.answer(moment);
        if let Motion::Given { nominal, actual } = &moment.motion {
            (self.nominal, self.actual) = (*nominal, *actual);
        } else if let Some(nominal) = answer.nominal() {
            self.nominal = nominal;
        }
        meter.end(Part::Floats);
        answer
    }

    /// The second half: the endpoint's tick.
    #[inline(never)]
    pub(crate) fn serve(
        &mut self,
        moment: &Moment,
        meter: &mut impl Meter,
        send: &mut impl FnMut(Connection, &[u8]),
    ) -> Turn<AXES, MOTORS> {
        let cycle = Cycle {
            elapsed: moment.elapsed,
            nominal: self.nominal,
            actual: self.actual,
            stop: moment.stop,
            rearm: moment.rearm,
            next_epoch: moment.next_epoch,
            arrival_us: moment.arrival_us,
        };
        meter.begin();
        let turn = self.server.tick(&cycle, send);
        meter.end(Part::Tick);
        for (actual, reference) in self.actual.iter_mut().zip(&turn.output.references) {
            actual.position = reference.position;
        }
        turn
    }
}
