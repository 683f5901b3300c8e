//! The server's state machine on messages `[T 5.1.1, Figure 5.4]`; knows no bytes, no clock, no sockets.
//!
//! [`Session::tick`] is one pure step with bounded work. It has two halves and an entrance:
//! events are sifted into what decides; [`decide::decide`] chooses the next discrete state and ONE action;
//! [`act`] lets every channel apply that action with its own limits.

pub mod act;
mod blackbox;
pub mod config;
pub mod decide;
mod evidence;
mod io;
mod sift;

use core::fmt;

use crate::axis::{Offsets, Reference};
use crate::message::{AxisFlags, AxisState, Cause, Counters, Phase, Refusal, State, Welcome};
use crate::units::{Epoch, PositionNm, Sequence, Tick};

use act::{AxisChannels, drive_reference, nominal_stepped};
use config::{Config, Parameters};
use decide::{Action, Connection, Decision, Discrete, Rules};
use evidence::{on_time_of_100, tally};
use sift::{Sieve, Sifted};

pub use blackbox::{BlackBox, Entry};
pub use io::{Cycle, EVENTS, Event, Events, Input, OWNER_FRAMES, Output, Refusals};

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
        let channels = channels_at_rest(&config, in_force)?;
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
            rearm_released: false,
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

    /// The machine did not take the last references; these are the offsets it has in force instead.
    /// Channels go on from them at rest, without a step, and the session is over.
    ///
    /// # Errors
    /// [`StartError::OffsetInForce`] when one is beyond its limits; nothing is changed then.
    pub fn resume(&mut self, in_force: &[Offsets; N]) -> Result<(), StartError> {
        let parts = &mut self.parts;
        parts.channels = channels_at_rest(&self.config, in_force)?;
        parts.shadow = [AxisChannels::ZERO; N];
        let discrete = &mut parts.discrete;
        if discrete.phase != Phase::Fault {
            *discrete = Discrete {
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
        let cycles = input.cycle.elapsed.max(1);
        let before = self.parts.discrete;
        let nominal_flags = self.nominal_flags(input, cycles);
        let sifted = self.sift(input, cycles, &nominal_flags);
        let decision = decide::decide(&before, &sifted.arrivals, &self.rules());
        self.parts.settle_evidence(&before, &decision, &sifted);
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
        let moves = self.parts.nominal.iter().zip(&input.cycle.nominal);
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
            input.cycle.next_epoch,
        )
        .sift(&input.events);
        let arrivals = &mut sifted.arrivals;
        arrivals.stop |= input.cycle.stop;
        arrivals.rearm = input.cycle.rearm;
        arrivals.skipped = cycles.saturating_sub(1);
        arrivals.all_zero = parts.channels.iter().all(AxisChannels::is_zero);
        arrivals.nominal_fault = nominal
            .iter()
            .any(|flags| flags.contains(AxisFlags::NOMINAL_STEP));
        sifted
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
        parts.nominal = input.cycle.nominal;
        let configs = self.config.parameters().axes.iter();
        let channels = parts.channels.iter_mut().zip(parts.shadow.iter_mut());
        let inputs = input.cycle.nominal.iter().zip(&input.cycle.actual);
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
            // In Submit it is the shadow that approaches its target.
            let limited = match shadow_action {
                Some(action) => shadow.limited(action, target),
                None => channels.limited(decision.action, target),
            };
            let clamped;
            (*reference, clamped) =
                drive_reference(*nominal, &channels.offsets(), &config.machine_travel);
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
                arrival_us: input.cycle.arrival_us,
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

/// Channels at rest at offsets read back from the drives.
fn channels_at_rest<const N: usize>(
    config: &Config<N>,
    in_force: &[Offsets; N],
) -> Result<[AxisChannels; N], StartError> {
    let mut channels = [AxisChannels::ZERO; N];
    let axes = config.parameters().axes.iter().zip(in_force);
    for (axis, (channel, (axis_config, offsets))) in channels.iter_mut().zip(axes).enumerate() {
        let offsets = *offsets;
        *channel = AxisChannels::at_rest(&offsets, &axis_config.limits)
            .ok_or(StartError::OffsetInForce { axis, offsets })?;
    }
    Ok(channels)
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

#[cfg(test)]
mod tests;
