//! A session for tests, played tick by tick, with T1, T2, T3 and T5 checked on every tick.

use std::vec::Vec as StdVec;

use super::config::{Config, Parameters};
use super::{Connection, Event, Events, Input, LastWrite, Output, Session, Start, TickInput};
use crate::control::axis::{InForce, Offsets};
use crate::control::channel::{Channel, Limits};
use crate::control::fixture::{HELLO, at, command};
use crate::control::message::{AxisLimits, ClientMessage, Mode, Phase};
use crate::units::{ChannelUnit, Epoch, EpochRange, PositionNm};

pub(crate) const OWNER: Connection = Connection(1);
/// Epochs from 7 on.
pub(super) const EPOCHS: EpochRange = EpochRange { first: Epoch(7), last: Epoch(u64::MAX) };

/// What happens in one tick.
#[derive(Clone, Debug)]
pub(crate) enum Move {
    /// The owner sends nothing.
    Silence,
    Hello,
    /// The owner answers the last State.
    Answer(Mode, [Offsets; 2]),
    /// An answer as before, but the server needed so many cycles.
    Late(u32, [Offsets; 2]),
    Goodbye,
    /// Stop and re-arm at the machine: asserted or not.
    Switches {
        stop: bool,
        rearm: bool,
    },
    Written(LastWrite<2>),
}

pub(crate) const STOP: Move = Move::Switches { stop: true, rearm: false };
pub(crate) const REARM: Move = Move::Switches { stop: false, rearm: true };
pub(super) const BOTH: Move = Move::Switches { stop: true, rearm: true };

/// The owner asks for this offset at both axes.
pub(super) fn obtain(position: i32) -> Move {
    Move::Answer(Mode::Obtain, at(position))
}

pub(super) fn submit(position: i32) -> Move {
    Move::Answer(Mode::Submit, at(position))
}

/// A start with these offsets in force, at nominal position zero.
pub(super) fn start(offsets: [Offsets; 2]) -> Start<2> {
    let nominal = PositionNm(0);
    Start { in_force: offsets.map(|offsets| InForce { nominal, offsets }), stop_latched: false }
}

#[derive(Clone)]
pub(crate) struct Bench {
    pub(crate) session: Session<2>,
    pub(super) last: Option<Output<2>>,
    sequence: u64,
}

impl Bench {
    pub(crate) fn new(parameters: Parameters<2>) -> Self {
        Self::starting(parameters, &start([Offsets::ZERO; 2]))
    }

    pub(super) fn starting(parameters: Parameters<2>, start: &Start<2>) -> Self {
        let config = Config::new(parameters).unwrap();
        Self { session: Session::new(config, start).unwrap(), last: None, sequence: 0 }
    }

    /// The next command of the owner.
    pub(super) fn command(&mut self, mode: Mode, targets: [Offsets; 2]) -> ClientMessage<2> {
        self.sequence += 1;
        ClientMessage::Command(command(&self.session, self.sequence, mode, targets))
    }

    pub(crate) fn play(&mut self, one: &Move) -> Output<2> {
        self.play_at(one, [PositionNm(0); 2])
    }

    /// Plays one tick with these nominal references.
    pub(crate) fn play_at(&mut self, one: &Move, nominal: [PositionNm; 2]) -> Output<2> {
        let message = match one {
            Move::Hello => Some(HELLO),
            Move::Answer(mode, targets) => Some(self.command(*mode, *targets)),
            Move::Late(_, targets) => Some(self.command(Mode::Obtain, *targets)),
            Move::Goodbye => Some(ClientMessage::Goodbye(self.session.epoch())),
            Move::Silence | Move::Switches { .. } | Move::Written(_) => None,
        };
        let events: StdVec<_> = message.into_iter().map(|message| (OWNER, Event::Message(message))).collect();
        self.tick_with(&events, |tick| {
            tick.nominal = nominal;
            match one {
                Move::Late(cycles, _) => tick.elapsed_cycles = *cycles,
                Move::Switches { stop, rearm } => (tick.stop, tick.rearm) = (*stop, *rearm),
                Move::Written(last_write) => tick.last_write = *last_write,
                _ => {}
            }
        })
    }

    pub(super) fn tick(&mut self, events: &[(Connection, Event<2>)]) -> Output<2> {
        self.tick_with(events, |_| {})
    }

    /// Runs one tick with these events, and an input that `edit` has changed.
    pub(super) fn tick_with(
        &mut self,
        events: &[(Connection, Event<2>)],
        edit: impl FnOnce(&mut TickInput<2>),
    ) -> Output<2> {
        let mut input = Input::empty(EPOCHS);
        edit(&mut input.tick);
        input.events = Events::from_slice(events).unwrap();
        let before = self.session;
        let output = self.session.tick(&input);
        assert!(self.session.is_valid(), "{:?}", self.session.parts());
        // A refused write begins elsewhere: the bounds hold from the values in force on.
        if input.tick.last_write == LastWrite::Accepted {
            assert_bounds(&before, &self.session, &output, self.last.as_ref());
        }
        self.last = Some(output.clone());
        output
    }

    /// Position offset of the first axis.
    pub(super) fn offset(&self) -> i32 {
        self.session.parts().axes[0].channels.position.count()
    }
}

fn assert_bounds(before: &Session<2>, after: &Session<2>, output: &Output<2>, last: Option<&Output<2>>) {
    let ramps = matches!(after.phase(), Phase::SafeDisconnect | Phase::Fault);
    for (axis, config) in before.config().parameters().axes.iter().enumerate() {
        let (old, new) = (&before.parts().axes[axis], &after.parts().axes[axis]);
        let AxisLimits { position, velocity, torque } = config.limits;
        assert_channel(old.channels.position, new.channels.position, position, ramps);
        assert_channel(old.channels.velocity, new.channels.velocity, velocity, ramps);
        assert_channel(old.channels.torque, new.channels.torque, torque, ramps);
        if let Some(last) = last {
            let moved = last.references[axis].position.0.abs_diff(output.references[axis].position.0);
            let nominal = old.nominal.0.abs_diff(new.nominal.0);
            assert!(moved <= nominal.saturating_add(position.step().unsigned_abs().into()));
        }
    }
}

fn assert_channel<U: ChannelUnit>(a: Channel<U>, b: Channel<U>, limits: Limits<U>, ramps: bool) {
    let change = i64::from(b.count()) - i64::from(a.count());
    assert_eq!(change, i64::from(b.change()));
    assert!(change.abs() <= i64::from(limits.step()));
    assert!((change - i64::from(a.change())).abs() <= i64::from(limits.accel()));
    assert!(b.count().abs() <= limits.max());
    if ramps {
        let ramp = i64::from(limits.ramp()).min(i64::from(a.count()).abs());
        assert_eq!(change, -i64::from(a.count().signum()) * ramp);
    }
}
