//! The server's state machine on messages `[T 5.1.1, Figure 5.4]`; knows no bytes, no clock, no sockets.
//!
//! [`Session::tick`] is one pure step with bounded work. It has two halves and an entrance:
//! events are sifted into what decides; [`decide::decide`] chooses the next discrete state and ONE action;
//! [`act`] lets every channel apply that action with its own limits.

pub mod act;
mod blackbox;
pub mod config;
pub mod decide;
mod sift;

use core::fmt;

use heapless::Vec;

use crate::axis::{Actual, Offsets, Reference};
use crate::message::{
    AxisFlags, AxisState, Cause, ClientMessage, Counters, Phase, Refusal, State, Welcome,
};
use crate::units::{Epoch, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS};
use crate::wire::{ContentError, FrameError};

use act::{AxisChannels, nominal_stepped, reference};
use config::{AxisConfig, Config, Parameters};
use decide::{Action, Connection, Decision, Discrete, End, Rules};
use sift::{Sieve, Sifted};

pub use blackbox::{BlackBox, Entry};

/// Events that one tick can take: 8 frames of the owner, its flood or broken stream, its closing, and 6 events of strangers.
pub const EVENTS: usize = 16;
/// Frames of the owner that are read per tick (`K`); one more ends the session.
pub const OWNER_FRAMES: u8 = 8;

/// Something that happened on a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Event<const N: usize> {
    /// A message.
    Message(ClientMessage<N>),
    /// A well-framed frame with bad content. It costs that frame.
    Malformed(ContentError),
    /// A datagram that is no frame. It costs that datagram.
    Dropped(FrameError),
    /// The stream lost its frame boundary.
    Broken(FrameError),
    /// More frames than are read per tick.
    Flood,
    /// The connection is gone.
    Closed,
}

/// One tick's events, in order of arrival.
pub type Events<const N: usize> = Vec<(Connection, Event<N>), EVENTS>;
/// Hellos refused in one tick.
pub type Refusals = Vec<(Connection, Refusal), EVENTS>;

/// Everything that one tick depends on, beside the session itself.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Input<const N: usize> {
    /// Cycles since the last tick: 1 when on time; 0 counts as 1.
    pub elapsed: u32,
    /// What arrived.
    pub events: Events<N>,
    /// Nominal references of this cycle.
    pub nominal: [PositionNm; N],
    /// What the drives measure.
    pub actual: [Actual; N],
    /// The stop at the machine is asserted.
    pub stop: bool,
    /// Somebody at the machine re-arms.
    pub rearm: bool,
    /// Epoch to give to the next session; the host takes it from a counter persisted before use.
    pub next_epoch: Epoch,
    /// When in the cycle the last command arrived, µs; evidence only.
    pub arrival_us: u16,
}

impl<const N: usize> Input<N> {
    /// No event, no demand, everything at zero.
    #[must_use]
    pub const fn nothing() -> Self {
        let at_rest = Actual {
            position: PositionNm(0),
            velocity: VelocityUmS(0),
            torque: TorquePermille(0),
        };
        Self {
            elapsed: 1,
            events: Vec::new(),
            nominal: [PositionNm(0); N],
            actual: [at_rest; N],
            stop: false,
            rearm: false,
            next_epoch: Epoch(0),
            arrival_us: 0,
        }
    }

    /// Copies `other` into this place: only the events there are, not the room for more.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.events.clear();
        // There is room: both have the same capacity.
        self.events.extend_from_slice(&other.events).unwrap_or(());
        self.elapsed = other.elapsed;
        self.nominal = other.nominal;
        self.actual = other.actual;
        self.stop = other.stop;
        self.rearm = other.rearm;
        self.next_epoch = other.next_epoch;
        self.arrival_us = other.arrival_us;
    }
}

/// Everything that one tick produces.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Output<const N: usize> {
    /// What the drives receive.
    pub references: [Reference; N],
    /// The State of this tick.
    pub state: State<N>,
    /// Whom to send the State to.
    pub owner: Option<Connection>,
    /// Whom to welcome, before the State; [`Session::welcome`] makes the message.
    pub welcome: Option<Connection>,
    /// Whom to refuse, and to close afterwards.
    pub refusals: Refusals,
    /// Whose connection has no further use and should be closed.
    pub close: Option<Connection>,
    /// Why a session ended in this tick, if one did.
    pub ended: Option<Cause>,
}

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
pub struct Parts<const N: usize> {
    /// The discrete state.
    pub discrete: Discrete,
    /// Channels whose values are in force.
    pub channels: [AxisChannels; N],
    /// Channels that follow in Submit and reach no drive.
    pub shadow: [AxisChannels; N],
    /// Nominal references of the last tick.
    pub nominal: [PositionNm; N],
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
        let mut channels = [AxisChannels::ZERO; N];
        let axes = config.parameters().axes.iter().zip(in_force);
        for (axis, (channel, (axis_config, offsets))) in channels.iter_mut().zip(axes).enumerate() {
            *channel = AxisChannels::at_rest(offsets, &axis_config.limits).ok_or(
                StartError::OffsetInForce {
                    axis,
                    offsets: *offsets,
                },
            )?;
        }
        let at_zero = channels.iter().all(AxisChannels::is_zero);
        let (phase, cause) = if at_zero {
            (Phase::Listening, Cause::None)
        } else {
            (Phase::SafeDisconnect, Cause::Restart)
        };
        let discrete = Discrete {
            phase,
            owner: None,
            epoch: last_epoch,
            accepted: Sequence(0),
            tick,
            misses: 0,
            history: 0,
            waited: 0,
        };
        let parts = Parts {
            discrete,
            channels,
            shadow: [AxisChannels::ZERO; N],
            nominal,
            cause,
            late: false,
            counters: Counters::default(),
        };
        Ok(Self { config, parts })
    }

    /// A session in any state that satisfies the invariant.
    #[must_use]
    pub fn from_parts(config: Config<N>, parts: Parts<N>) -> Option<Self> {
        let session = Self { config, parts };
        session.is_valid().then_some(session)
    }

    /// The invariant, clause by clause: the discrete state is valid; every channel and every shadow is valid under its limits;
    /// before Obtain every channel rests at zero (T6); outside Submit every shadow rests at zero.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let parameters = self.config.parameters();
        let parts = &self.parts;
        let limits = || parameters.axes.iter().map(|axis| &axis.limits);
        let channels = parts.channels.iter().zip(limits());
        let shadows = parts.shadow.iter().zip(limits());
        let resting = matches!(
            parts.discrete.phase,
            Phase::Listening | Phase::Handshake | Phase::Submit
        );
        let at_rest =
            |channels: &[AxisChannels; N]| channels.iter().all(AxisChannels::is_at_rest_at_zero);
        parts.discrete.is_valid(parameters.handshake_ticks)
            && channels
                .chain(shadows)
                .all(|(channel, limits)| channel.is_valid(limits))
            && (!resting || at_rest(&parts.channels))
            && (parts.discrete.phase == Phase::Submit || at_rest(&parts.shadow))
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

    /// One cycle.
    pub fn tick(&mut self, input: &Input<N>) -> Output<N> {
        let cycles = input.elapsed.max(1);
        let before = self.parts.discrete;
        let nominal_flags = self.nominal_flags(input, cycles);
        let sifted = self.sift(input, cycles, &nominal_flags);
        let decision = decide::decide(&before, &sifted.arrivals, &self.rules());
        self.settle_evidence(&before, &decision, &sifted);
        let mut axes = [AxisState::default(); N];
        let mut references = [Reference::default(); N];
        self.act(
            &decision,
            &sifted,
            input,
            &nominal_flags,
            &mut axes,
            &mut references,
        );
        self.parts.discrete = decision.next;
        self.output(&before, &decision, sifted, input, axes, references)
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

    const fn rules(&self) -> Rules {
        let parameters = self.config.parameters();
        Rules {
            handshake_ticks: parameters.handshake_ticks,
            budget: parameters.budget,
        }
    }

    /// Which axes' nominal references moved further than they may.
    fn nominal_flags(&self, input: &Input<N>, cycles: u32) -> [AxisFlags; N] {
        let mut flags = [AxisFlags::default(); N];
        let moves = self.parts.nominal.iter().zip(&input.nominal);
        let axes = self.config.parameters().axes.iter().zip(moves);
        for (flag, (axis, (from, to))) in flags.iter_mut().zip(axes) {
            let stepped = nominal_stepped(*from, *to, axis, cycles);
            *flag = AxisFlags::default().with(AxisFlags::NOMINAL_STEP, stepped);
        }
        flags
    }

    fn sift(&mut self, input: &Input<N>, cycles: u32, nominal: &[AxisFlags; N]) -> Sifted<N> {
        let parts = &mut self.parts;
        let mut sifted = Sieve::new(
            &parts.discrete,
            self.config.parameters(),
            &parts.channels,
            &mut parts.counters,
            input.next_epoch,
        )
        .sift(&input.events);
        let arrivals = &mut sifted.arrivals;
        arrivals.stop |= input.stop;
        arrivals.rearm = input.rearm;
        arrivals.skipped = cycles.saturating_sub(1);
        arrivals.all_zero = parts.channels.iter().all(AxisChannels::is_zero);
        arrivals.nominal_fault = nominal
            .iter()
            .any(|flags| flags.contains(AxisFlags::NOMINAL_STEP));
        sifted
    }

    /// Counters and causes; they never decide anything.
    fn settle_evidence(&mut self, before: &Discrete, decision: &Decision, sifted: &Sifted<N>) {
        let parts = &mut self.parts;
        let granted = before.phase == Phase::Listening && decision.next.phase == Phase::Handshake;
        if granted {
            parts.counters = Counters::default();
            parts.late = false;
        }
        parts.late |= sifted.late;
        if matches!(before.phase, Phase::Submit | Phase::Obtain) {
            let skipped = sifted.arrivals.skipped;
            let missed = skipped.saturating_add(u32::from(sifted.arrivals.command.is_none()));
            let run = u32::from(before.misses).saturating_add(missed);
            let counters = &mut parts.counters;
            counters.missed = counters.missed.saturating_add(missed);
            let run = u16::try_from(run).unwrap_or(u16::MAX);
            counters.longest_miss_run = counters.longest_miss_run.max(run);
        }
        match decision.end {
            Some(End::Because(cause)) => parts.cause = cause,
            Some(End::Missed) if parts.late => parts.cause = Cause::NetworkLate,
            Some(End::Missed) => parts.cause = Cause::ClientLate,
            None => {}
        }
        if sifted.arrivals.command.is_some() {
            parts.late = false;
        }
    }

    /// Every channel applies the action; every axis gets its reference.
    fn act(
        &mut self,
        decision: &Decision,
        sifted: &Sifted<N>,
        input: &Input<N>,
        nominal_flags: &[AxisFlags; N],
        states: &mut [AxisState; N],
        references: &mut [Reference; N],
    ) {
        let shadow_action = shadow_action(decision.next.phase, sifted.arrivals.command.is_some());
        let parts = &mut self.parts;
        parts.nominal = input.nominal;
        let configs = self.config.parameters().axes.iter();
        let channels = parts.channels.iter_mut().zip(parts.shadow.iter_mut());
        let inputs = input.nominal.iter().zip(&input.actual);
        let outputs = states.iter_mut().zip(references.iter_mut());
        let rows = configs.zip(channels).zip(inputs).zip(outputs);
        for ((row, target), flags) in rows.zip(&sifted.targets).zip(nominal_flags) {
            let (((config, (channels, shadow)), (nominal, actual)), (state, reference)) = row;
            let limits = &config.limits;
            *channels = channels.act(decision.action, target, limits);
            *shadow = match shadow_action {
                Some(action) => shadow.act(action, target, limits),
                None => AxisChannels::ZERO,
            };
            let limited = channels.limited(decision.action, target);
            let clamped = drive(config, *nominal, channels, reference);
            tally(&mut parts.counters, limited, clamped);
            *state = AxisState {
                nominal: *nominal,
                offsets: channels.offsets(),
                shadow: shadow.offsets(),
                actual: *actual,
                flags: AxisFlags(flags.0 | limited.0 | clamped.0),
            };
        }
    }

    fn output(
        &self,
        before: &Discrete,
        decision: &Decision,
        sifted: Sifted<N>,
        input: &Input<N>,
        axes: [AxisState; N],
        references: [Reference; N],
    ) -> Output<N> {
        let next = &decision.next;
        let welcome = match (before.phase, next.phase) {
            (Phase::Listening, Phase::Handshake) => next.owner,
            _ => None,
        };
        let mut refusals = sifted.refusals;
        if let (Some((connection, _)), None) = (sifted.arrivals.hello, welcome) {
            // A stop came with the Hello. There is room: every event gives at most one refusal.
            let reason = Refusal::Faulted { ticks_left: 0 };
            refusals.push((connection, reason)).unwrap_or(());
        }
        Output {
            references,
            state: State {
                tick: next.tick,
                epoch: next.epoch,
                accepted: next.accepted,
                phase: next.phase,
                cause: self.parts.cause,
                on_time_of_100: on_time_of_100(next.history),
                arrival_us: input.arrival_us,
                ramp_ticks_left: ramp_ticks_left(self.config.parameters(), &self.parts.channels),
                counters: self.parts.counters,
                axes,
            },
            owner: next.owner,
            welcome,
            refusals,
            close: if next.owner == before.owner {
                None
            } else {
                before.owner
            },
            ended: decision.end.map(|_| self.parts.cause),
        }
    }
}

/// Ticks until every channel would be zero.
fn ramp_ticks_left<const N: usize>(
    parameters: &Parameters<N>,
    channels: &[AxisChannels; N],
) -> u32 {
    let limits = parameters.axes.iter().map(|axis| &axis.limits);
    channels
        .iter()
        .zip(limits)
        .fold(0, |most, (channel, limits)| {
            if channel.is_zero() {
                most
            } else {
                most.max(channel.ramp_ticks_left(limits))
            }
        })
}

/// The shadow follows fresh commands in Submit and holds over a miss; elsewhere it rests at zero.
const fn shadow_action(phase: Phase, fresh: bool) -> Option<Action> {
    match (phase, fresh) {
        (Phase::Submit, true) => Some(Action::Follow),
        (Phase::Submit, false) => Some(Action::Hold),
        _ => None,
    }
}

fn drive(
    config: &AxisConfig,
    nominal: PositionNm,
    channels: &AxisChannels,
    place: &mut Reference,
) -> AxisFlags {
    let (reference, clamped) = reference(nominal, &channels.offsets(), &config.machine_travel);
    *place = reference;
    clamped
}

/// Counts channel steps held back and references clamped.
fn tally(counters: &mut Counters, limited: AxisFlags, clamped: AxisFlags) {
    counters.limited = counters.limited.saturating_add(limited.0.count_ones());
    counters.clamped = counters.clamped.saturating_add(clamped.0.count_ones());
}

/// On-time deadlines among the latest 100.
fn on_time_of_100(history: u128) -> u8 {
    let latest = history & ((1 << 100) - 1);
    let missed = u8::try_from(latest.count_ones()).unwrap_or(100);
    100_u8.saturating_sub(missed)
}

#[cfg(test)]
mod tests;
