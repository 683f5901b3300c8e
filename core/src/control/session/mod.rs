//! The server's state machine on messages `[T 5.1.1, Figure 5.4]`; knows no bytes, no clock, no sockets.
//!
//! [`Session::tick`] is one pure step with bounded work. It has two halves and an entrance:
//! events are sifted into what decides; [`decide::decide`] chooses the next discrete state and ONE action;
//! [`act`] lets every channel apply that action with its own limits. What only counts is kept apart from all three.

pub mod act;
pub mod channels;
pub mod config;
mod diagnostics;
pub mod fsm;
pub mod ingress;
mod io;
pub mod recorder;
mod replay;
mod step;

use core::fmt;

use crate::control::axis::Offsets;
use crate::control::message::{AxisState, Cause, Counters, Phase, Refusal, State, Welcome};
use crate::units::{Epoch, PositionNm, Sequence, Tick};
use crate::zip::{each, zip};

use act::Axis;
use channels::AxisChannels;
use config::{Config, Parameters};
use diagnostics::{count_flags, on_time_of_100};
use fsm::{Connection, Decision, FsmInput, FsmState};
use ingress::{Accepted, Classifier, Diagnostics};
use step::{Step, advance, all_zero};

pub use io::{Cycle, EVENTS, Event, Events, Input, OWNER_FRAMES, Output, Refusals};
pub use replay::{Replayed, replay};

/// The black box: the last ticks' complete inputs and outputs, the session before the oldest, and the configuration within it.
/// Replaying the inputs from that session gives every output again, bit for bit ([`replay`], T11).
pub type BlackBox<const N: usize, const HALF: usize> =
    recorder::Recorder<Session<N>, Input<N>, Output<N>, HALF>;
/// One recorded tick.
pub type Entry<const N: usize> = recorder::Entry<Input<N>, Output<N>>;

/// Why a session cannot start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum StartError {
    /// An offset in force is beyond its limits: the server must not start.
    OffsetInForce {
        /// Which axis.
        axis: usize,
        /// The offsets read back from its drive.
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

/// The state of the server: discrete state, channels, last nominal reference, evidence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Session<const N: usize> {
    config: Config<N>,
    parts: Parts<N>,
}

/// The parts of a session's state; for replay, fuzzing and proofs, which build states from them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Parts<const N: usize> {
    /// The discrete state.
    pub discrete: FsmState,
    /// The axes.
    pub axes: [Axis; N],
    /// Why the last session ended; evidence.
    pub cause: Cause,
    /// A late command arrived since the last fresh one; evidence that tells a late network from a late client.
    pub late: bool,
    /// Counts since the session was granted; evidence.
    pub counters: Counters,
}

impl<const N: usize> Session<N> {
    /// A server that nobody has talked to yet. Offsets that a drive still has in force start in SafeDisconnect.
    ///
    /// `tick` is the number of the cycle before the first; `last_epoch` the last epoch ever given.
    ///
    /// # Errors
    /// [`StartError::OffsetInForce`] when an offset in force is beyond its limits.
    pub fn new(
        config: Config<N>,
        in_force: &[Offsets; N],
        nominal: [PositionNm; N],
        tick: Tick,
        last_epoch: Epoch,
    ) -> Result<Self, StartError> {
        let axes = axes_at_rest(&config, in_force, nominal)?;
        let (phase, cause) = if all_zero(&axes) {
            (Phase::Listening, Cause::None)
        } else {
            (Phase::SafeDisconnect, Cause::Restart)
        };
        let discrete = FsmState {
            phase,
            owner: None,
            epoch: last_epoch,
            accepted: Sequence(0),
            tick,
            misses: 0,
            history: 0,
            waited: 0,
            rearm_released: false,
        };
        let parts = Parts {
            discrete,
            axes,
            cause,
            late: false,
            counters: Counters::default(),
        };
        Ok(Self { config, parts })
    }

    /// The machine did not take the last references; these are the offsets it has in force instead.
    /// Channels go on from them at rest, without a step, and the session is over.
    ///
    /// # Errors
    /// [`StartError::OffsetInForce`] when one is beyond its limits; nothing is changed then.
    pub fn resume(&mut self, in_force: &[Offsets; N]) -> Result<(), StartError> {
        let parts = &mut self.parts;
        let nominal = parts.axes.map(|axis| axis.nominal);
        parts.axes = axes_at_rest(&self.config, in_force, nominal)?;
        let discrete = &mut parts.discrete;
        let goes_on = discrete.phase == Phase::Fault;
        if !goes_on {
            *discrete = FsmState {
                phase: Phase::SafeDisconnect,
                misses: 0,
                waited: 0,
                ..*discrete
            };
            parts.cause = Cause::Restart;
        }
        Ok(())
    }

    /// A session in any state that satisfies the invariant.
    #[must_use]
    pub fn from_parts(config: Config<N>, parts: Parts<N>) -> Option<Self> {
        let session = Self { config, parts };
        session.is_valid().then_some(session)
    }

    /// The invariant, clause by clause: the discrete state is valid; every axis is valid in its phase.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let parameters = self.config.parameters();
        let discrete = &self.parts.discrete;
        let mut axes = zip(&self.parts.axes, &parameters.axes);
        discrete.is_valid(parameters.handshake_ticks)
            && axes.all(|(axis, config)| axis.is_valid(discrete.phase, &config.limits))
    }

    /// The configuration.
    #[inline]
    #[must_use]
    pub const fn config(&self) -> &Config<N> {
        &self.config
    }

    /// The parts of the state.
    #[inline]
    #[must_use]
    pub const fn parts(&self) -> &Parts<N> {
        &self.parts
    }

    /// The phase.
    #[inline]
    #[must_use]
    pub const fn phase(&self) -> Phase {
        self.parts.discrete.phase
    }

    /// Whose frames count, and who is told what happens.
    #[inline]
    #[must_use]
    pub const fn owner(&self) -> Option<Connection> {
        self.parts.discrete.owner
    }

    /// One cycle: everything that arrived is accepted, then one step is taken. Not inlined, for the sake of the caller's stack.
    #[inline(never)]
    pub fn tick(&mut self, input: &Input<N>) -> Output<N> {
        let (accepted, diagnostics) = self.classify(&input.events, input.cycle.next_epoch);
        self.step(&input.cycle, accepted, diagnostics)
    }

    /// What the events amount to, in order of arrival.
    #[must_use]
    pub fn classify(&self, events: &Events<N>, next_epoch: Epoch) -> (Accepted<N>, Diagnostics) {
        let classifier = Classifier {
            discrete: &self.parts.discrete,
            parameters: self.config.parameters(),
            axes: &self.parts.axes,
            next_epoch,
        };
        let mut accepted = Accepted::nothing();
        let mut diagnostics = Diagnostics {
            counters: self.parts.counters,
            ..Diagnostics::default()
        };
        for (connection, event) in events {
            classifier.classify(*connection, event, &mut accepted, &mut diagnostics);
        }
        (accepted, diagnostics)
    }

    /// Decides, and acts. The invariant and every bound hold for anything that can have been accepted.
    pub fn step(
        &mut self,
        cycle: &Cycle<N>,
        accepted: Accepted<N>,
        diagnostics: Diagnostics,
    ) -> Output<N> {
        let parts = &mut self.parts;
        let before = parts.discrete;
        let Step {
            decision,
            fsm,
            references,
            axes,
        } = advance(
            self.config.parameters(),
            &mut parts.discrete,
            &mut parts.axes,
            cycle,
            &accepted,
        );
        parts.counters = diagnostics.counters;
        parts.update_diagnostics(&before, &decision, &fsm, diagnostics.late);
        for axis in each(&axes) {
            count_flags(&mut parts.counters, axis.flags);
        }
        let (welcome, refusals) = answers(&before, &decision, &fsm, diagnostics.refusals);
        let owner = decision.next.owner;
        Output {
            references,
            state: self.state(axes, cycle.arrival_us),
            owner,
            welcome,
            refusals,
            close: before.owner.filter(|_| before.owner != owner),
            ended: decision.end.map(|_| self.parts.cause),
        }
    }

    /// The Welcome of the session that was just granted.
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

    /// The State after this tick.
    fn state(&self, axes: [AxisState; N], arrival_us: u16) -> State<N> {
        let parts = &self.parts;
        let discrete = &parts.discrete;
        State {
            tick: discrete.tick,
            epoch: discrete.epoch,
            accepted: discrete.accepted,
            phase: discrete.phase,
            cause: parts.cause,
            on_time_of_100: on_time_of_100(discrete.history),
            arrival_us,
            ramp_ticks_left: ramp_ticks_left(self.config.parameters(), &parts.axes),
            counters: parts.counters,
            axes,
        }
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

/// Who is welcomed, and who is refused.
fn answers(
    before: &FsmState,
    decision: &Decision,
    fsm: &FsmInput,
    mut refusals: Refusals,
) -> (Option<Connection>, Refusals) {
    let welcome = match (before.phase, decision.next.phase) {
        (Phase::Listening, Phase::Handshake) => decision.next.owner,
        _ => None,
    };
    if let (Some((connection, _)), None) = (fsm.hello, welcome) {
        // A stop came with the Hello. There is room: every event gives at most one refusal.
        let reason = Refusal::Faulted { ticks_left: 0 };
        refusals.push((connection, reason)).unwrap_or(());
    }
    (welcome, refusals)
}

/// Axes at rest at offsets read back from the drives.
fn axes_at_rest<const N: usize>(
    config: &Config<N>,
    in_force: &[Offsets; N],
    nominal: [PositionNm; N],
) -> Result<[Axis; N], StartError> {
    let mut axes = nominal.map(|nominal| Axis {
        nominal,
        ..Axis::default()
    });
    let rows = zip(&config.parameters().axes, in_force).enumerate();
    for (index, (axis_config, offsets)) in rows {
        let channels = AxisChannels::at_rest(offsets, &axis_config.limits);
        let channels = channels.ok_or(StartError::OffsetInForce {
            axis: index,
            offsets: *offsets,
        })?;
        if let Some(axis) = axes.get_mut(index) {
            axis.channels = channels;
        }
    }
    Ok(axes)
}

/// Ticks until every channel would be zero.
fn ramp_ticks_left<const N: usize>(parameters: &Parameters<N>, axes: &[Axis; N]) -> u32 {
    zip(axes, &parameters.axes).fold(0, |most, (axis, config)| {
        if axis.channels.is_zero() {
            most
        } else {
            most.max(axis.channels.ramp_ticks_left(&config.limits))
        }
    })
}

#[cfg(test)]
mod tests;
