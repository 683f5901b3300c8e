//! Two hostile clients, a machine and time: sequences of what can happen to a session, told in words that make sense in most states,
//! and what is checked in every tick of them.
//!
//! The same sequences come from a fuzzer's bytes (feature `arbitrary`) and from proptest.

mod by_wire;
mod stage;

pub use by_wire::endpoint_is_right;
pub use stage::every_tick_is_right;

use gantry_tau_core::control::axis::{Actual, Offsets};
use gantry_tau_core::control::channel::Limits;
use gantry_tau_core::control::message::{
    AxisLimits, Capabilities, ClientMessage, Command, Hello, Mode, Phase,
};
use gantry_tau_core::control::session::config::{
    AxisConfig, Config, MissBudget, Parameters, Travel,
};
use gantry_tau_core::control::session::{Cycle, Event, Session};
use gantry_tau_core::control::wire::{ContentError, FrameError};
use gantry_tau_core::units::{
    Epoch, OffsetNm, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS,
};

/// Axes of the machine that is played with; two, so that one can be forgotten.
pub const N: usize = 2;

/// Ticks after which a sequence ends.
const MOST_TICKS: usize = 160;

/// Shares of the limits of every channel, in hundredths: beyond 100 is out of range.
pub type Shares = [[i8; 3]; N];

/// A machine, and what happens to it.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "arbitrary", derive(arbitrary::Arbitrary))]
pub struct Play {
    /// How it is configured.
    pub machine: Machine,
    /// Offsets in force when the server starts.
    pub in_force: Shares,
    /// Tick and epoch before the first; the largest there are, instead of zero.
    pub late_in_life: bool,
    /// What happens.
    pub moves: Vec<Move>,
}

/// A configuration, of which every one is valid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "arbitrary", derive(arbitrary::Arbitrary))]
pub struct Machine {
    /// Limits of position, velocity and torque offset of each axis.
    pub rates: [[Rates; 3]; N],
    /// Nominal travel to either side of zero, nm.
    pub reach: u32,
    /// Largest step of the nominal reference, nm.
    pub nominal_step: u16,
    /// Window and allowed misses.
    pub budget: Option<(u8, u8)>,
    /// How far echoes may be behind.
    pub echo_window: u8,
    /// How long a handshake may take.
    pub handshake_ticks: u8,
    /// The server is in lock-step.
    pub lockstep: bool,
}

/// Limits of a channel, each beyond what it must at least be, all times `2^(scale % 20)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "arbitrary", derive(arbitrary::Arbitrary))]
pub struct Rates {
    /// Largest magnitude.
    pub max: u16,
    /// Ramp, less 1.
    pub ramp: u8,
    /// By how much a step may be larger than the ramp.
    pub step: u8,
    /// By how much it may be bent further than it must.
    pub accel: u8,
    /// A power of two.
    pub scale: u8,
}

/// Something that happens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "arbitrary", derive(arbitrary::Arbitrary))]
pub enum Move {
    /// The owner answers so many States, one by one, each in time.
    Answer {
        /// Obtain, or Submit.
        obtain: bool,
        /// Wanted offsets.
        targets: Shares,
        /// How often.
        times: u8,
    },
    /// Nothing arrives for so many ticks.
    Silence(u8),
    /// Something arrives before the next tick.
    Say(Who, Word),
    /// A tick in which something is different.
    Tick(Circumstances),
    /// The nominal reference moves by this much per tick from now on, in hundredths of its limit.
    Drift([i8; N]),
    /// The machine did not take the last references.
    Resume(Shares),
}

/// Who speaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "arbitrary", derive(arbitrary::Arbitrary))]
pub enum Who {
    /// Whoever owns the session.
    Owner,
    /// One client.
    One,
    /// The other.
    Other,
}

/// What is said; numbers count from those that would be right.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "arbitrary", derive(arbitrary::Arbitrary))]
pub enum Word {
    /// Asks for the session.
    Hello {
        /// Further axes than there are.
        axes: u8,
        /// Capabilities.
        capabilities: u16,
    },
    /// Wants offsets.
    Command {
        /// Epoch from that of the session.
        epoch: i8,
        /// Sequence from the last accepted one.
        ahead: i32,
        /// Ticks behind the last State.
        behind: i8,
        /// Obtain, or Submit.
        obtain: bool,
        /// Wanted offsets.
        targets: Shares,
    },
    /// Ends the session.
    Goodbye {
        /// Epoch from that of the session.
        epoch: i8,
    },
    /// Stops.
    Stop {
        /// Epoch from that of the session.
        epoch: i8,
    },
    /// A frame with bad content.
    Malformed,
    /// A datagram that is no frame.
    Dropped,
    /// A stream that lost its boundary.
    Broken,
    /// More frames than are read.
    Flood,
    /// A connection that is gone.
    Closed,
}

/// What is different in a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "arbitrary", derive(arbitrary::Arbitrary))]
pub struct Circumstances {
    /// Cycles since the last tick.
    pub elapsed: u32,
    /// The stop at the machine.
    pub stop: bool,
    /// The re-arm at the machine.
    pub rearm: bool,
    /// The nominal reference jumps there.
    pub jump: Option<i64>,
    /// Epoch for the next session, from the one after the last.
    pub epoch: i8,
}

impl Machine {
    /// The configuration.
    ///
    /// # Panics
    /// When core refuses it.
    #[must_use]
    pub fn config(&self) -> Config<N> {
        let axes = self.rates.map(|[position, velocity, torque]| {
            let limits = AxisLimits {
                position: position.limits(i32::MAX),
                velocity: velocity.limits(i32::MAX),
                torque: torque.limits(i16::MAX.into()),
            };
            let travel = Travel::around_zero(self.reach);
            let step = u32::from(self.nominal_step);
            let axis = AxisConfig::position_only(limits.position, travel, step);
            AxisConfig { limits, ..axis }
        });
        let budget = self.budget.map(|(window, allowed)| MissBudget {
            window: window % 128 + 1,
            allowed,
        });
        let config = Config::new(Parameters {
            budget,
            echo_window: self.echo_window,
            handshake_ticks: u32::from(self.handshake_ticks) + 1,
            capabilities: if self.lockstep {
                Capabilities::LOCKSTEP
            } else {
                Capabilities::NONE
            },
            ..Parameters::thesis(axes)
        });
        config.unwrap_or_else(|error| panic!("a machine of a play is refused: {error}"))
    }
}

impl Rates {
    fn limits(&self, most: i32) -> Limits {
        let scaled = |number: u32| {
            let number = u64::from(number) << (self.scale % 20);
            i32::try_from(number).unwrap_or(i32::MAX)
        };
        let ramp = scaled(u32::from(self.ramp) + 1);
        let step = ramp + scaled(self.step.into());
        let accel = step + ramp + scaled(self.accel.into());
        let max = scaled(self.max.into()).min(most);
        Limits::new(max, step, accel, ramp)
            .unwrap_or_else(|error| panic!("limits of a play are refused: {error}"))
    }
}

/// These shares of the limits.
fn offsets(config: &Config<N>, shares: &Shares) -> [Offsets; N] {
    let axes = &config.parameters().axes;
    std::array::from_fn(|axis| {
        let AxisLimits {
            position,
            velocity,
            torque,
        } = &axes[axis].limits;
        let [p, v, t] = shares[axis];
        let of = |limits: &Limits, share: i8| i64::from(limits.max()) * i64::from(share) / 100;
        let number = |value: i64| {
            let most = if value < 0 { i32::MIN } else { i32::MAX };
            i32::try_from(value).unwrap_or(most)
        };
        let torque = of(torque, t);
        let most = if torque < 0 { i16::MIN } else { i16::MAX };
        Offsets {
            position: OffsetNm(number(of(position, p))),
            velocity: VelocityUmS(number(of(velocity, v))),
            torque: TorquePermille(i16::try_from(torque).unwrap_or(most)),
        }
    })
}

impl Word {
    /// The message it is, to a session in this state; `None` when it is none.
    pub fn message<const K: usize>(
        &self,
        session: &Session<K>,
        offsets: impl FnOnce(&Shares) -> [Offsets; K],
    ) -> Option<ClientMessage<K>> {
        let discrete = &session.parts().discrete;
        let epoch_at = |from: i8| Epoch(discrete.epoch.0.wrapping_add_signed(from.into()));
        match self {
            Self::Hello { axes, capabilities } => Some(ClientMessage::Hello(Hello {
                axes: u8::try_from(K).unwrap_or(u8::MAX).wrapping_add(*axes),
                capabilities: Capabilities(*capabilities),
            })),
            Self::Command {
                epoch,
                ahead,
                behind,
                obtain,
                targets,
            } => Some(ClientMessage::Command(Command {
                epoch: epoch_at(*epoch),
                sequence: Sequence(discrete.accepted.0.wrapping_add_signed((*ahead).into())),
                echo: Tick(discrete.tick.0.wrapping_add_signed(-i64::from(*behind))),
                mode: if *obtain { Mode::Obtain } else { Mode::Submit },
                targets: offsets(targets),
            })),
            Self::Goodbye { epoch } => Some(ClientMessage::Goodbye(epoch_at(*epoch))),
            Self::Stop { epoch } => Some(ClientMessage::Stop(epoch_at(*epoch))),
            Self::Malformed | Self::Dropped | Self::Broken | Self::Flood | Self::Closed => None,
        }
    }
}

/// A word as the session hears it, in the state it is in.
fn event(session: &Session<N>, word: &Word) -> Event<N> {
    let message = word.message(session, |targets| offsets(session.config(), targets));
    match (message, word) {
        (Some(message), _) => Event::Message(message),
        (None, Word::Malformed) => Event::Malformed(ContentError::Reserved),
        (None, Word::Dropped) => Event::Dropped(FrameError::Checksum),
        (None, Word::Flood) => Event::Flood,
        (None, Word::Closed) => Event::Closed,
        (None, _) => Event::Broken(FrameError::Magic),
    }
}

/// What a client answers that has understood `wire.md`: its first Command asks for Submit.
fn answer(session: &Session<N>, obtain: bool, targets: Shares) -> Word {
    Word::Command {
        epoch: 0,
        ahead: 1,
        behind: 0,
        obtain: obtain && session.phase() != Phase::Handshake,
        targets,
    }
}

/// Who acts a play: a session alone, or an endpoint.
trait Actor {
    /// The session, as it is now.
    fn session(&self) -> &Session<N>;
    /// How the machine moves.
    fn motion(&mut self) -> &mut Motion;
    /// Somebody says something before the next tick.
    fn say(&mut self, who: Who, word: &Word);
    /// One tick, and what must hold in it.
    fn tick(&mut self, circumstances: &Circumstances);
    /// The machine has these shares of the limits in force.
    fn resume(&mut self, shares: &Shares);

    /// Plays a move; how many ticks it took.
    fn play(&mut self, one: &Move) -> usize {
        let on_time = Circumstances::default();
        match one {
            Move::Answer {
                obtain,
                targets,
                times,
            } => {
                for _ in 0..*times {
                    let word = answer(self.session(), *obtain, *targets);
                    self.say(Who::Owner, &word);
                    self.tick(&on_time);
                }
                return (*times).into();
            }
            Move::Silence(ticks) => {
                (0..*ticks).for_each(|_| self.tick(&on_time));
                return (*ticks).into();
            }
            Move::Tick(circumstances) => {
                self.tick(circumstances);
                return 1;
            }
            Move::Say(who, word) => self.say(*who, word),
            Move::Drift(drift) => self.motion().drift = *drift,
            Move::Resume(shares) => self.resume(shares),
        }
        0
    }

    /// Plays it all, or as much of it as is looked at.
    fn play_all(&mut self, moves: &[Move]) {
        let mut ticks = 0;
        for one in moves {
            ticks += self.play(one);
            if ticks >= MOST_TICKS {
                return;
            }
        }
    }
}

/// The machine's own motion.
#[derive(Clone, Copy, Debug, Default)]
struct Motion {
    nominal: [i64; N],
    drift: [i8; N],
}

impl Motion {
    /// The next cycle.
    fn cycle(&mut self, session: &Session<N>, circumstances: &Circumstances) -> Cycle<N> {
        let parameters = session.config().parameters();
        for axis in 0..N {
            let step = i64::from(parameters.axes[axis].nominal_step_nm);
            let change = step * i64::from(self.drift[axis]) / 100;
            let to = circumstances.jump.unwrap_or(self.nominal[axis]);
            self.nominal[axis] = to.saturating_add(change);
        }
        let epoch = (session.parts().discrete.epoch.0)
            .saturating_add(1)
            .saturating_add_signed(circumstances.epoch.into());
        Cycle {
            elapsed: circumstances.elapsed,
            stop: circumstances.stop,
            rearm: circumstances.rearm,
            ..Cycle::on_time(
                self.nominal.map(PositionNm),
                [Actual::default(); N],
                Epoch(epoch),
            )
        }
    }
}

/// The end of the numbers, or their beginning.
fn life(play: &Play) -> u64 {
    if play.late_in_life { u64::MAX - 40 } else { 0 }
}
