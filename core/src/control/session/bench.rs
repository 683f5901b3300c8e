//! A session for tests, played tick by tick, with a monitor that checks T1, T2, T3 and T5 on every
//! tick.

use std::vec::Vec as StdVec;

use super::config::{Config, Parameters};
use super::{Connection, Event, Events, Input, LastWrite, Output, Reading, Session, Start};
use crate::control::axis::{InForce, Offsets};
use crate::control::fixture::{HELLO, at, command};
use crate::control::message::{ClientMessage, Mode};
use crate::control::monitor::Monitor;
use crate::units::{Epoch, EpochRange, PositionNm};

pub(crate) const OWNER: Connection = Connection(1);
/// Epochs from 7 on.
pub(super) const EPOCHS: EpochRange = EpochRange {
    first: Epoch(7),
    last: Epoch(u64::MAX),
};

/// Event of one tick, of the client, the server or the machine.
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

pub(crate) const STOP: Move = Move::Switches {
    stop: true,
    rearm: false,
};
pub(crate) const REARM: Move = Move::Switches {
    stop: false,
    rearm: true,
};
pub(super) const BOTH: Move = Move::Switches {
    stop: true,
    rearm: true,
};

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
    Start {
        in_force: offsets.map(|offsets| InForce { nominal, offsets }),
        stop_latched: false,
    }
}

#[derive(Clone)]
pub(crate) struct Bench {
    pub(crate) session: Session<2>,
    monitor: Monitor<2>,
    sequence: u64,
}

impl Bench {
    pub(crate) fn new(parameters: Parameters<2>) -> Self {
        Self::starting(parameters, &start([Offsets::ZERO; 2]))
    }

    pub(super) fn starting(parameters: Parameters<2>, start: &Start<2>) -> Self {
        let session = Session::new(Config::new(parameters).unwrap(), start).unwrap();
        let travel = parameters.axes.map(|axis| axis.machine_travel);
        let mut monitor = Monitor::new(parameters.axes.map(|axis| axis.limits), Some(travel));
        monitor.rebase(&start.in_force).unwrap();
        Self {
            session,
            monitor,
            sequence: 0,
        }
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
        let events: StdVec<_> = message
            .into_iter()
            .map(|message| (OWNER, Event::Message(message)))
            .collect();
        self.tick_with(&events, |input| {
            let tick = &mut input.tick;
            tick.reading = Some(Reading::unmeasured(nominal));
            match one {
                Move::Late(cycles, _) => tick.elapsed_cycles = *cycles,
                Move::Switches { stop, rearm } => (tick.stop, tick.rearm) = (*stop, *rearm),
                Move::Written(last_write) => input.last_write = *last_write,
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
        edit: impl FnOnce(&mut Input<2>),
    ) -> Output<2> {
        let mut input = Input::empty(EPOCHS);
        edit(&mut input);
        input.events = Events::from_slice(events).unwrap();
        let output = self.session.tick(&input);
        assert!(self.session.is_valid(), "{:?}", self.session.parts());
        if let LastWrite::Refused { in_force } = &input.last_write {
            // Values beyond their limits are withheld, and not those that the bounds hold from.
            let _ = self.monitor.rebase(in_force);
        }
        let checked = if output.withheld {
            self.monitor.check_state(&output.state)
        } else {
            self.monitor.check_tick(&output.state, &output.references)
        };
        assert_eq!(checked, Ok(()), "{output:?}");
        output
    }

    /// Position offset of the first axis.
    pub(super) fn offset(&self) -> i32 {
        self.session.parts().axes[0].channels.position.count()
    }
}
