//! The server's state machine on messages `[T 5.1.1, Figure 5.4]`. It knows no bytes, no clock, no
//! sockets.
//!
//! [`Session::tick`] is one pure step with bounded work, in three parts: events are classified into
//! accepted and counted ones; a finite state machine decides on the next discrete state and ONE
//! action; every channel applies that action with its own limits. Counters and causes are kept
//! apart from all three.

pub(crate) mod act;
#[cfg(test)]
pub(crate) mod bench;
pub(crate) mod channels;
pub mod config;
mod diagnostics;
pub(crate) mod fsm;
mod hold;
pub(crate) mod ingress;
mod io;
pub mod recorder;
mod replay;
pub(crate) mod step;

use core::fmt;

use crate::control::agitation::Agitation;
use crate::control::axis::{InForce, Offsets};
use crate::control::message::{Cause, Counters, Phase, Refusal, State, Welcome};
use crate::units::{Epoch, EpochRange, Sequence, Tick};
use crate::zip::zip;

use act::Axis;
use channels::AxisChannels;
use config::{Config, Parameters};
use diagnostics::{count_flags, on_time_of_100};
use fsm::{Decision, FsmInput, FsmState};
use ingress::{Accepted, Classifier, Diagnostics};
use step::{Known, Outcome, Step, all_zero, step};

pub use fsm::may_end;
pub use hold::Held;
pub use io::{
    Connection, EVENTS, Event, Events, Input, LastWrite, OWNER_FRAMES, Output, Reading, Refusals,
    TickInput,
};
pub use recorder::{NoRecorder, Record};
pub use replay::{Replayed, replay};

/// Black box: the complete inputs and outputs of the last ticks, the session before the oldest, and
/// the configuration within it. Replaying the inputs from that session reproduces every output, bit
/// for bit ([`replay()`], T11).
pub type BlackBox<const N: usize, const HALF: usize> =
    recorder::Recorder<Session<N>, Input<N>, Output<N>, HALF>;
/// One recorded tick.
pub type Entry<const N: usize> = recorder::Entry<Input<N>, Output<N>>;

/// State of the machine at the start of the server, read back before the first tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Start<const N: usize> {
    /// Values in force at the drives. Nonzero offsets start in SafeDisconnect: a restart makes no
    /// step.
    pub in_force: [InForce; N],
    /// A stop was asserted before and has not been re-armed. The server then starts in Fault.
    pub stop_latched: bool,
}

impl<const N: usize> Start<N> {
    /// A machine without offsets in force, not stopped, at these nominal references.
    #[must_use]
    pub fn at_rest(nominal: [crate::units::PositionNm; N]) -> Self {
        Self {
            in_force: nominal.map(InForce::at),
            stop_latched: false,
        }
    }
}

/// Error of [`Session::new`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum StartError {
    /// An offset in force is beyond its limits: the server must not start.
    OffsetInForce {
        /// Index of the axis.
        axis: usize,
        /// Offsets read back from its drive.
        offsets: Offsets,
    },
}

impl fmt::Display for StartError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OffsetInForce { axis, offsets } => write!(
                f,
                "axis {axis}: the drive has offsets in force beyond their limits ({} nm, {} um/s, {} per mille)",
                offsets.position.0, offsets.velocity.0, offsets.torque.0
            ),
        }
    }
}

impl core::error::Error for StartError {}

/// State of the server: configuration, discrete state, channels, last nominal references,
/// diagnostics.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(try_from = "Unchecked<N>"))]
pub struct Session<const N: usize> {
    config: Config<N>,
    parts: Parts<N>,
}

/// A session as read from a file, before [`Session::is_valid`] has judged it.
#[cfg(feature = "serde")]
#[derive(serde::Deserialize)]
struct Unchecked<const N: usize> {
    config: Config<N>,
    parts: Parts<N>,
}

#[cfg(feature = "serde")]
impl<const N: usize> TryFrom<Unchecked<N>> for Session<N> {
    type Error = Contradiction;

    fn try_from(Unchecked { config, parts }: Unchecked<N>) -> Result<Self, Self::Error> {
        let phase = parts.discrete.phase;
        let mut axes = zip(&parts.axes, &config.parameters().axes);
        let axis = axes.position(|(axis, config)| !axis.is_valid(phase, config));
        Self::from_parts(config, parts).ok_or(Contradiction { axis })
    }
}

/// Reason why what was read is not a session.
#[cfg(feature = "serde")]
struct Contradiction {
    /// Index of the first axis that is not valid; without one the discrete state is not.
    axis: Option<usize>,
}

#[cfg(feature = "serde")]
impl fmt::Display for Contradiction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the state of the session contradicts its configuration")?;
        self.axis.map_or(Ok(()), |axis| {
            write!(
                f,
                ": axis {axis} has an offset beyond its limits, or an offset or agitation in the wrong phase"
            )
        })
    }
}

/// Parts of a session's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Parts<const N: usize> {
    /// Discrete state.
    pub discrete: FsmState,
    /// The axes.
    #[cfg_attr(feature = "serde", serde(with = "crate::serde_array"))]
    pub axes: [Axis; N],
    /// The values in force at the drives are unknown: only a read-back ends this.
    pub withheld: bool,
    /// The nominal references in force at the drives need not be those of the path: after a start,
    /// a refused write or a failed read. It ends when the path is within its step limit of them;
    /// until then they stand.
    pub off_path: bool,
    /// In the last tick the axes moved along the path, on time.
    pub paced: bool,
    /// Values in force at the drives when the last tick began, as far as known.
    #[cfg_attr(feature = "serde", serde(with = "crate::serde_array"))]
    pub in_force: [InForce; N],
    /// Cause of the end of the last session; diagnostics.
    pub cause: Cause,
    /// A late command arrived since the last fresh one; diagnostics that tell a late network from a
    /// late client.
    pub late: bool,
    /// Counts since the session was granted; diagnostics.
    pub counters: Counters,
}

impl<const N: usize> Session<N> {
    /// Creates a server without a session. Offsets in force start in SafeDisconnect, a latched stop
    /// in Fault.
    ///
    /// # Errors
    /// [`StartError::OffsetInForce`] when an offset in force is beyond its limits.
    // Not inlined: the copies that it makes stay out of its caller.
    #[inline(never)]
    pub fn new(config: Config<N>, start: &Start<N>) -> Result<Self, StartError> {
        let axes = axes_at_rest(&config, &start.in_force)?;
        let (phase, cause) = if start.stop_latched {
            (Phase::Fault, Cause::Stop)
        } else if all_zero(&axes) {
            (Phase::Listening, Cause::None)
        } else {
            (Phase::SafeDisconnect, Cause::Restart)
        };
        let discrete = FsmState {
            phase,
            owner: None,
            epoch: Epoch(0),
            accepted: Sequence(0),
            tick: Tick(0),
            misses: 0,
            history: 0,
            waited: 0,
            rearm_released: false,
            latched: start.stop_latched,
        };
        let parts = Parts {
            discrete,
            axes,
            withheld: false,
            off_path: true,
            paced: false,
            in_force: start.in_force,
            cause,
            late: false,
            counters: Counters::default(),
        };
        Ok(Self { config, parts })
    }

    /// True if the session can go on from these values in force.
    pub(crate) fn admits(&self, in_force: &[InForce; N]) -> bool {
        let mut axes = zip(in_force, &self.config.parameters().axes);
        axes.all(|(in_force, config)| config.limits.admits(&in_force.offsets))
    }

    /// Takes note of the fate of the last references. After a refused write the channels go on from
    /// the values in force at the drives, at rest and without a step, and the session is over.
    /// Without valid values nothing may be written.
    pub(crate) fn apply_write_result(&mut self, last_write: &LastWrite<N>) {
        let axes = match last_write {
            LastWrite::Accepted => return,
            LastWrite::Refused { in_force } => axes_at_rest(&self.config, in_force).ok(),
            LastWrite::Unknown => None,
        };
        let parts = &mut self.parts;
        parts.withheld = axes.is_none();
        if let Some(mut axes) = axes {
            for (axis, old) in axes.iter_mut().zip(&parts.axes) {
                axis.actual = old.actual;
            }
            parts.axes = axes;
            parts.off_path = true;
        }
        if parts.discrete.phase != Phase::Fault {
            parts.discrete = fsm::interrupted(&parts.discrete);
            parts.cause = Cause::Restart;
        }
        for axis in &mut parts.axes {
            axis.shadow = AxisChannels::ZERO;
            axis.agitation = Agitation::ZERO;
        }
    }

    /// Builds a session from its parts, if they satisfy the invariant.
    #[must_use]
    pub(crate) fn from_parts(config: Config<N>, parts: Parts<N>) -> Option<Self> {
        let session = Self { config, parts };
        session.is_valid().then_some(session)
    }

    /// The invariant, clause by clause: the discrete state is valid; every axis is valid in its
    /// phase; references are withheld only after a session.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let parameters = self.config.parameters();
        let discrete = &self.parts.discrete;
        let mut axes = zip(&self.parts.axes, &parameters.axes);
        discrete.is_valid(parameters.handshake_ticks)
            && axes.all(|(axis, config)| axis.is_valid(discrete.phase, config))
            && (!self.parts.withheld
                || matches!(discrete.phase, Phase::SafeDisconnect | Phase::Fault))
    }

    /// Returns the configuration.
    #[must_use]
    pub const fn config(&self) -> &Config<N> {
        &self.config
    }

    /// Returns the parts of the state.
    #[must_use]
    pub(crate) const fn parts(&self) -> &Parts<N> {
        &self.parts
    }

    /// Returns the values in force at the drives when the last tick began, as far as known. They
    /// stay in force if the references of that tick are refused.
    #[must_use]
    pub const fn in_force(&self) -> &[InForce; N] {
        &self.parts.in_force
    }

    /// Returns the parts of the references of the last tick: what is in force once the drives have
    /// taken them.
    #[must_use]
    pub fn demanded(&self) -> [InForce; N] {
        self.parts.axes.each_ref().map(Axis::in_force)
    }

    /// Returns the phase.
    #[must_use]
    pub const fn phase(&self) -> Phase {
        self.parts.discrete.phase
    }

    /// Returns the owner: the connection whose frames count, and which receives the States.
    #[must_use]
    pub const fn owner(&self) -> Option<Connection> {
        self.parts.discrete.owner
    }

    /// True while a session is granted and not over.
    #[must_use]
    pub const fn is_live(&self) -> bool {
        self.parts.discrete.is_live()
    }

    /// Returns the tick of the last State.
    #[must_use]
    pub const fn last_tick(&self) -> Tick {
        self.parts.discrete.tick
    }

    /// Returns the sequence of the last accepted command; 0 before the first.
    #[must_use]
    pub const fn accepted(&self) -> Sequence {
        self.parts.discrete.accepted
    }

    /// Returns the epoch of the current or last session.
    #[must_use]
    pub const fn epoch(&self) -> Epoch {
        self.parts.discrete.epoch
    }

    /// Runs one cycle. Not inlined, so that its stack is not added to the caller's.
    #[inline(never)]
    pub fn tick(&mut self, input: &Input<N>) -> Output<N> {
        self.apply_write_result(&input.last_write);
        let refused = input.last_write != LastWrite::Accepted;
        let (mut accepted, mut diagnostics) = (
            Accepted::nothing(),
            Diagnostics::after(&self.parts.counters),
        );
        self.classify(
            &input.events,
            &input.epochs,
            &mut accepted,
            &mut diagnostics,
        );
        diagnostics.count_unauthentic(input.unauthentic);
        let mut output = self.step(&input.tick, refused, &accepted, &diagnostics);
        output.state.arrival_us = input.arrival_us;
        output.state.sensor = input.tick.sensor;
        output
    }

    /// Classifies the events, in order of arrival.
    pub(crate) fn classify(
        &self,
        events: &Events<N>,
        epochs: &EpochRange,
        accepted: &mut Accepted<N>,
        diagnostics: &mut Diagnostics,
    ) {
        let classifier = Classifier {
            discrete: &self.parts.discrete,
            parameters: self.config.parameters(),
            axes: &self.parts.axes,
            next_epoch: epochs.after(self.parts.discrete.epoch),
        };
        for (connection, event) in events {
            classifier.classify(*connection, event, accepted, diagnostics);
        }
    }

    /// Decides and acts; the references of the last tick were `refused`. The invariant and every
    /// bound hold for anything that can have been accepted.
    pub(crate) fn step(
        &mut self,
        tick: &TickInput<N>,
        refused: bool,
        accepted: &Accepted<N>,
        diagnostics: &Diagnostics,
    ) -> Output<N> {
        if !self.parts.withheld {
            self.parts.in_force = self.demanded();
        }
        // Filled in its place: it has most of a kilobyte.
        let mut output = Output::nothing();
        let parts = &mut self.parts;
        let before = parts.discrete;
        let known = Known {
            withheld: parts.withheld,
            off_path: parts.off_path,
            paced: parts.paced,
            refused,
        };
        let outcome = Outcome {
            references: &mut output.references,
            states: &mut output.state.axes,
        };
        let Step {
            decision,
            fsm,
            off_path,
            paced,
        } = step(
            self.config.parameters(),
            &mut parts.discrete,
            &mut parts.axes,
            known,
            tick,
            accepted,
            outcome,
        );
        parts.off_path = off_path;
        parts.paced = paced;
        parts.counters = diagnostics.counters;
        parts.update_diagnostics(&before, &decision, &fsm, diagnostics.late);
        count_flags(&mut parts.counters, &output.state.axes);
        self.report(&mut output.state);
        output.withheld = self.parts.withheld;
        output.owner = decision.next.owner;
        output.close = before.owner.filter(|_| before.owner != output.owner);
        output.ended = decision.end.map(|_| self.parts.cause);
        output.latched = decision.next.latched;
        output.answer(&before, &decision, &fsm, &diagnostics.refusals);
        output
    }

    /// Returns the Welcome of the session that was just granted.
    #[must_use]
    pub fn welcome(&self) -> Welcome<N> {
        let parameters = self.config.parameters();
        Welcome {
            epoch: self.parts.discrete.epoch,
            tick: self.parts.discrete.tick,
            cycle_us: parameters.cycle_us,
            echo_window: parameters.echo_window,
            capabilities: parameters.capabilities,
            kinematics_checksum: parameters.kinematics_checksum,
            limits: parameters.axes.map(|axis| axis.limits),
        }
    }

    /// Reports in a State everything but the axes, which have done so, and the arrival of the
    /// command, which the step does not know.
    fn report(&self, state: &mut State<N>) {
        let parts = &self.parts;
        let discrete = &parts.discrete;
        state.tick = discrete.tick;
        state.epoch = discrete.epoch;
        state.accepted = discrete.accepted;
        state.phase = discrete.phase;
        state.cause = parts.cause;
        state.on_time_of_100 = on_time_of_100(discrete.history);
        state.ramp_ticks_left = ramp_ticks_left(self.config.parameters(), &parts.axes);
        state.counters = parts.counters;
    }
}

#[cfg(kani)]
impl<const N: usize> kani::Arbitrary for Session<N> {
    fn any() -> Self {
        let session = Self {
            config: kani::any(),
            parts: kani::any(),
        };
        kani::assume(session.is_valid());
        kani::cover!(true, "some sessions are valid");
        session
    }
}

/// Builds axes at rest at the values read back from the drives.
fn axes_at_rest<const N: usize>(
    config: &Config<N>,
    in_force: &[InForce; N],
) -> Result<[Axis; N], StartError> {
    let mut axes = in_force.map(|in_force| Axis {
        nominal: in_force.nominal,
        ..Axis::default()
    });
    let rows = zip(&config.parameters().axes, in_force);
    for (index, (config, in_force)) in rows.enumerate() {
        let offsets = in_force.offsets;
        let channels =
            AxisChannels::at_rest(&offsets, &config.limits).ok_or(StartError::OffsetInForce {
                axis: index,
                offsets,
            })?;
        if let Some(axis) = axes.get_mut(index) {
            axis.channels = channels;
        }
    }
    Ok(axes)
}

/// Returns the number of ramp ticks until every channel is zero.
fn ramp_ticks_left<const N: usize>(parameters: &Parameters<N>, axes: &[Axis; N]) -> u32 {
    zip(axes, &parameters.axes).fold(0, |most, (axis, config)| {
        if axis.channels.is_zero() {
            most
        } else {
            most.max(axis.channels.ramp_ticks_left(&config.limits))
        }
    })
}

impl<const N: usize> Output<N> {
    /// Answers the Hellos: the one that was granted with a Welcome, the others with their refusals.
    fn answer(
        &mut self,
        before: &FsmState,
        decision: &Decision,
        fsm: &FsmInput,
        refusals: &Refusals,
    ) {
        self.welcome = match (before.phase, decision.next.phase) {
            (Phase::Listening, Phase::Handshake) => decision.next.owner,
            _ => None,
        };
        // There is room: each event adds at most one refusal.
        self.refusals.extend_from_slice(refusals).unwrap_or(());
        if let (Some((connection, _)), None) = (fsm.hello, self.welcome) {
            // A stop came with the Hello.
            let reason = Refusal::Faulted { ticks_left: 0 };
            self.refusals.push((connection, reason)).unwrap_or(());
        }
    }
}

#[cfg(test)]
mod tests;
