//! Scenarios of two hostile clients, a machine and time: sequences of operations that make sense in
//! most states, and the checks in every tick of them.
//!
//! The same sequences come from a fuzzer's bytes (feature `arbitrary`) and from proptest.

mod on_endpoint;
mod on_session;

pub use on_endpoint::endpoint_is_right;
pub use on_session::every_tick_is_right;

use std::num::NonZeroU32;

use gantry_tau_core::control::agitation::AgitationBudget;
use gantry_tau_core::control::axis::{Actual, InForce, Offsets};
use gantry_tau_core::control::channel::{LimitValues, Limits};
use gantry_tau_core::control::message::{
    AxisLimits, Capabilities, ClientMessage, Command, Hello, Mode, Phase,
};
use gantry_tau_core::control::session::config::{
    AxisConfig, Config, MissBudget, NominalAccel, Parameters, Travel,
};
use gantry_tau_core::control::session::{Event, LastWrite, Reading, Session, Start, TickInput};
use gantry_tau_core::control::wire::{ContentError, FrameError};
use gantry_tau_core::units::{
    ChannelUnit, Epoch, EpochRange, ForceMn, MomentUnm, OffsetNm, PositionNm, Sequence, Tick,
    TorquePermille, VelocityUmS, WrenchSample,
};
use gantry_tau_core::verification::control::{FsmState, Internals, Parts};

use crate::reference_model::ReferenceModel;

/// Axes of the machine; two, so that one can be forgotten.
pub const N: usize = 2;

/// Ticks after which a sequence ends.
const MAX_TICKS: usize = 160;

/// Shares of the limits of every channel, in hundredths: beyond 100 is out of range.
pub type Shares = [[i8; 3]; N];

/// A machine, and a sequence of operations.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "arbitrary", derive(arbitrary::Arbitrary))]
pub struct Scenario {
    /// Configuration.
    pub machine: Machine,
    /// Offsets in force when the server starts.
    pub in_force: Shares,
    /// Tick and epoch before the first; the largest there are, instead of zero.
    pub late_in_life: bool,
    /// Operations.
    pub ops: Vec<Op>,
}

/// A valid configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "arbitrary", derive(arbitrary::Arbitrary))]
pub struct Machine {
    /// Limits of position, velocity and torque offset of each axis.
    pub rates: [[Rates; 3]; N],
    /// Nominal travel of each axis below and above zero, nm.
    pub reach: [[u32; 2]; N],
    /// Largest step of the nominal reference of each axis, nm.
    pub nominal_step: [u16; N],
    /// Largest second difference of the nominal reference of each axis, less 1, nm, and whether it
    /// stops the machine.
    pub nominal_accel: [Option<(u16, bool)>; N],
    /// Agitation budget of each axis, nm per tick.
    pub agitation: [Option<u16>; N],
    /// Window and allowed misses.
    pub budget: Option<(u8, u8)>,
    /// Echo window.
    pub echo_window: u8,
    /// Ticks of the handshake, less 1.
    pub handshake_ticks: u8,
    /// Lock-step.
    pub lockstep: bool,
}

/// Limits of a channel, each as the excess over its smallest valid value, all times
/// `2^(scale % 20)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "arbitrary", derive(arbitrary::Arbitrary))]
pub struct Rates {
    /// Largest magnitude.
    pub max: u16,
    /// Ramp, less 1.
    pub ramp: u8,
    /// Step, less the ramp.
    pub step: u8,
    /// Change of the change, less the smallest valid one.
    pub accel: u8,
    /// A power of two.
    pub scale: u8,
}

/// Operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "arbitrary", derive(arbitrary::Arbitrary))]
pub enum Op {
    /// The owner answers so many States, one by one, each in time.
    Answer {
        /// Obtain, or Submit.
        obtain: bool,
        /// Wanted offsets.
        targets: Shares,
        /// Number of answers.
        times: u8,
    },
    /// Nothing arrives for so many ticks.
    Silence(u8),
    /// Something arrives before the next tick.
    Say(Peer, ClientAction),
    /// A tick in which something is different.
    Tick(Circumstances),
    /// The nominal reference moves by this much per tick from now on, in hundredths of its limit.
    Drift([i8; N]),
    /// The drives refuse the references of the last tick and have these shares in force; beyond
    /// 100, they cannot be read back.
    RefusedWrite(Shares),
}

/// Sender of an action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "arbitrary", derive(arbitrary::Arbitrary))]
pub enum Peer {
    /// Owner of the session.
    Owner,
    /// One client.
    One,
    /// The other.
    Other,
}

/// Action of a client; numbers count from the right ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "arbitrary", derive(arbitrary::Arbitrary))]
pub enum ClientAction {
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
    /// A datagram without a valid frame.
    Dropped,
    /// A stream that lost its boundary.
    Broken,
    /// More frames than are read.
    Flood,
    /// A connection that is gone.
    Closed,
}

/// Circumstances of a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "arbitrary", derive(arbitrary::Arbitrary))]
pub struct Circumstances {
    /// Cycles since the last tick.
    pub elapsed: u32,
    /// The stop at the machine.
    pub stop: bool,
    /// The re-arm at the machine.
    pub rearm: bool,
    /// The machine cannot be read.
    pub unread: bool,
    /// The nominal reference jumps there.
    pub jump: Option<i64>,
    /// Epoch for the next session, from the one after the last.
    pub epoch: i8,
    /// The program is to end.
    pub quit: bool,
}

impl Machine {
    /// The configuration.
    ///
    /// # Panics
    /// When core refuses it.
    #[must_use]
    pub fn config(&self) -> Config<N> {
        let axes = std::array::from_fn(|axis| {
            let [position, velocity, torque] = self.rates[axis];
            let limits = AxisLimits {
                position: position.limits(i32::MAX),
                velocity: velocity.limits(i32::MAX),
                torque: torque.limits(i16::MAX.into()),
            };
            let [below, above] = self.reach[axis].map(i64::from);
            let travel = Travel {
                lower: PositionNm(-below),
                upper: PositionNm(above),
            };
            let nominal_step = self.nominal_step[axis].into();
            AxisConfig {
                limits,
                nominal_accel: self.nominal_accel[axis].map(|(nm, is_fault)| NominalAccel {
                    nm: NonZeroU32::MIN.saturating_add(nm.into()),
                    is_fault,
                }),
                agitation: self.agitation[axis].and_then(|rate| AgitationBudget::new(rate.into())),
                ..AxisConfig::position_only(limits.position, travel, nominal_step)
            }
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
        config.unwrap_or_else(|error| panic!("a machine of a scenario is refused: {error}"))
    }
}

impl Rates {
    fn limits<U>(&self, most: i32) -> Limits<U> {
        let ramp = self.scaled(u32::from(self.ramp) + 1);
        let step = ramp + self.scaled(self.step.into());
        let accel = step + ramp + self.scaled(self.accel.into());
        let max = self.scaled(self.max.into()).min(most);
        let values = LimitValues {
            max,
            step,
            accel,
            ramp,
        };
        Limits::new(values)
            .unwrap_or_else(|error| panic!("limits of a scenario are refused: {error}"))
    }

    /// A number in the scale of these rates, counts.
    fn scaled(&self, number: u32) -> i32 {
        let number = u64::from(number) << (self.scale % 20);
        i32::try_from(number).unwrap_or(i32::MAX)
    }
}

/// A share of a limit, in percent; saturates.
fn share_of(max: i32, percent: i8) -> i32 {
    let saturated = if percent < 0 { i32::MIN } else { i32::MAX };
    i32::try_from(i64::from(max) * i64::from(percent) / 100).unwrap_or(saturated)
}

/// Returns these shares of the limits as offsets.
fn offsets(config: &Config<N>, shares: &Shares) -> [Offsets; N] {
    let axes = &config.parameters().axes;
    std::array::from_fn(|axis| {
        let AxisLimits {
            position,
            velocity,
            torque,
        } = &axes[axis].limits;
        let [p, v, t] = shares[axis];
        Offsets {
            position: OffsetNm(share_of(position.max(), p)),
            velocity: VelocityUmS(share_of(velocity.max(), v)),
            torque: TorquePermille::saturating_from(share_of(torque.max(), t)),
        }
    })
}

impl ClientAction {
    /// Returns the message to a session in this state; `None` for an action without a message.
    pub fn message<const K: usize>(
        &self,
        session: &Session<K>,
        offsets: impl FnOnce(&Shares) -> [Offsets; K],
    ) -> Option<ClientMessage<K>> {
        let discrete = &session.parts().discrete;
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
                epoch: shifted(discrete.epoch, *epoch),
                sequence: Sequence(discrete.accepted.0.wrapping_add_signed((*ahead).into())),
                echo: Tick(discrete.tick.0.wrapping_add_signed(-i64::from(*behind))),
                mode: if *obtain { Mode::Obtain } else { Mode::Submit },
                targets: offsets(targets),
            })),
            Self::Goodbye { epoch } => {
                Some(ClientMessage::Goodbye(shifted(discrete.epoch, *epoch)))
            }
            Self::Stop { epoch } => Some(ClientMessage::Stop(shifted(discrete.epoch, *epoch))),
            Self::Malformed | Self::Dropped | Self::Broken | Self::Flood | Self::Closed => None,
        }
    }
}

/// The epoch that is `by` after this one; wraps.
fn shifted(epoch: Epoch, by: i8) -> Epoch {
    Epoch(epoch.0.wrapping_add_signed(by.into()))
}

/// Returns the event of an action, for a session in this state.
fn event(session: &Session<N>, action: &ClientAction) -> Event<N> {
    let message = action.message(session, |targets| offsets(session.config(), targets));
    match (message, action) {
        (Some(message), _) => Event::Message(message),
        (None, ClientAction::Malformed) => Event::Malformed(ContentError::Reserved),
        (None, ClientAction::Dropped) => Event::Dropped(FrameError::Checksum),
        (None, ClientAction::Flood) => Event::Flood,
        (None, ClientAction::Closed) => Event::Closed,
        (None, _) => Event::Broken(FrameError::Magic),
    }
}

/// Answer of a client that follows `wire.md`: its first Command asks for Submit.
fn answer(session: &Session<N>, obtain: bool, targets: Shares) -> ClientAction {
    ClientAction::Command {
        epoch: 0,
        ahead: 1,
        behind: 0,
        obtain: obtain && session.phase() != Phase::Handshake,
        targets,
    }
}

/// System that a scenario runs on: a session alone, or an endpoint.
trait SystemUnderTest {
    /// Returns the session.
    fn session(&self) -> &Session<N>;
    /// A peer acts before the next tick.
    fn say(&mut self, peer: Peer, action: &ClientAction);
    /// Runs one tick that may grant these epochs, with its checks.
    fn tick(&mut self, cycle: Cycle);
}

/// Everything of a tick but its events.
struct Cycle {
    tick: TickInput<N>,
    /// Shares in force after a write that is refused.
    refused: Option<Shares>,
    arrival_us: u16,
    /// Epochs that may be granted.
    epochs: EpochRange,
}

/// Runs all operations, up to [`MAX_TICKS`].
fn play(system: &mut impl SystemUnderTest, ops: &[Op]) {
    let mut motion = Motion::default();
    let mut ticks = 0;
    for one in ops {
        ticks += motion.run(system, one);
        if ticks >= MAX_TICKS {
            return;
        }
    }
}

/// Any sample of the force sensor, or none.
fn sensor([kind, age, rest @ ..]: [u8; 8]) -> Option<WrenchSample> {
    let [a, b, c, d, ..] = rest;
    let value = i32::from_ne_bytes([a, b, c, d]);
    (kind % 4 != 0).then_some(WrenchSample {
        age,
        is_cut: kind % 4 == 1,
        force: [ForceMn(value); 3],
        moment: [MomentUnm(value.wrapping_neg()); 3],
    })
}

/// The machine's own motion.
#[derive(Clone, Copy, Debug, Default)]
struct Motion {
    nominal: [i64; N],
    drift: [i8; N],
    /// Shares in force after a refused write, for the next tick.
    refused: Option<Shares>,
}

impl Motion {
    /// Runs one operation. Returns its number of ticks.
    fn run(&mut self, system: &mut impl SystemUnderTest, one: &Op) -> usize {
        let on_time = Circumstances::default();
        match one {
            Op::Answer {
                obtain,
                targets,
                times,
            } => {
                for _ in 0..*times {
                    let action = answer(system.session(), *obtain, *targets);
                    system.say(Peer::Owner, &action);
                    self.tick(system, &on_time);
                }
                return (*times).into();
            }
            Op::Silence(ticks) => {
                (0..*ticks).for_each(|_| self.tick(system, &on_time));
                return (*ticks).into();
            }
            Op::Tick(circumstances) => {
                self.tick(system, circumstances);
                return 1;
            }
            Op::Say(peer, action) => system.say(*peer, action),
            Op::Drift(drift) => self.drift = *drift,
            Op::RefusedWrite(shares) => self.refused = Some(*shares),
        }
        0
    }

    /// The next tick, which may grant one epoch.
    fn tick(&mut self, system: &mut impl SystemUnderTest, circumstances: &Circumstances) {
        let session = system.session();
        for (axis, config) in session.config().parameters().axes.iter().enumerate() {
            let change = i64::from(config.nominal_step_nm) * i64::from(self.drift[axis]) / 100;
            let to = circumstances.jump.unwrap_or(self.nominal[axis]);
            self.nominal[axis] = to.saturating_add(change);
        }
        // Any numbers: they decide nothing.
        let noise = session
            .last_tick()
            .0
            .wrapping_mul(0x9E37_79B9_7F4A_7C15)
            .to_ne_bytes();
        let epoch = Epoch(
            (session.epoch().0)
                .saturating_add(1)
                .saturating_add_signed(circumstances.epoch.into()),
        );
        let input = TickInput {
            elapsed_cycles: circumstances.elapsed,
            reading: (!circumstances.unread).then_some(self.reading(noise)),
            sensor: sensor(noise),
            stop: circumstances.stop,
            quit: circumstances.quit,
            rearm: circumstances.rearm,
        };
        system.tick(Cycle {
            tick: input,
            refused: self.refused.take(),
            arrival_us: u16::from_ne_bytes([noise[6], noise[7]]),
            epochs: EpochRange {
                first: epoch,
                last: epoch,
            },
        });
    }

    fn reading(&self, noise: [u8; 8]) -> Reading<N> {
        let [.., a, b, c, d] = noise;
        let actual = self.nominal.map(|nominal| Actual {
            position: PositionNm(nominal.wrapping_add(i64::from_ne_bytes(noise))),
            velocity: VelocityUmS(i32::from_ne_bytes([a, b, c, d])),
            torque: TorquePermille(i16::from_ne_bytes([b, d])),
        });
        Reading {
            nominal: self.nominal.map(PositionNm),
            actual,
        }
    }
}

/// Fate of references. After a refused write the nominal references stay in force that were so before
/// it.
fn fate(session: &Session<N>, refused: Option<&Shares>) -> LastWrite<N> {
    let nominal = session.in_force().map(|axis| axis.nominal.0);
    match refused {
        None => LastWrite::Accepted,
        Some(shares) if shares.iter().flatten().all(|share| *share > 100) => LastWrite::Unknown,
        Some(shares) => LastWrite::Refused {
            in_force: in_force(session.config(), shares, &nominal),
        },
    }
}

/// Values in force at the drives.
fn in_force(config: &Config<N>, shares: &Shares, nominal: &[i64; N]) -> [InForce; N] {
    let offsets = offsets(config, shares);
    std::array::from_fn(|axis| InForce {
        nominal: PositionNm(nominal[axis]),
        offsets: offsets[axis],
    })
}

/// The start of a scenario's machine; `None` for offsets beyond their limits, on which core and
/// model agree.
fn start(scenario: &Scenario) -> Option<(Session<N>, ReferenceModel<N>)> {
    let config = scenario.machine.config();
    let start = Start {
        in_force: in_force(&config, &scenario.in_force, &[0; N]),
        stop_latched: false,
    };
    // Before the first tick: the end of the numbers, or their beginning.
    let last = if scenario.late_in_life {
        u64::MAX - 40
    } else {
        0
    };
    let (tick, epoch) = (Tick(last), Epoch(last));
    let session = Session::new(config, &start).ok().and_then(|session| {
        let parts = *session.parts();
        Session::from_parts(
            config,
            Parts {
                discrete: FsmState {
                    tick,
                    epoch,
                    ..parts.discrete
                },
                ..parts
            },
        )
    });
    let model = ReferenceModel::new(*config.parameters(), &start, tick, epoch);
    assert!(
        session.is_some() == model.is_some(),
        "a start is refused for offsets beyond their limits only"
    );
    session.zip(model)
}
