//! A scenario on messages: every tick has every property, and is what the model says.

use gantry_tau_core::control::session::{BlackBox, Connection, Events, Input, Session, replay};
use gantry_tau_core::units::Tick;
use gantry_tau_core::verification::control::Internals as _;

use super::{ClientAction, Cycle, N, Peer, Scenario, SystemUnderTest, event, fate, play, start};
use crate::properties::session::StepInput;
use crate::properties::{blackbox, fsm, motors, session};
use crate::reference_model::ReferenceModel;

/// Plays, and checks every tick: T1 to T11, and every output against the model's.
pub fn every_tick_is_right(scenario: &Scenario) {
    let Some((session, model)) = start(scenario) else {
        return;
    };
    let mut system = SessionUnderTest {
        session,
        model,
        black_box: BlackBox::new(),
        recorded: 0,
        latest: session.last_tick(),
        events: Events::new(),
    };
    play(&mut system, &scenario.ops);
    system.black_box_replays();
}

/// Everything while it is played.
struct SessionUnderTest {
    session: Session<N>,
    model: ReferenceModel<N>,
    black_box: BlackBox<N, 6>,
    /// Ticks in the black box, and the last of them.
    recorded: usize,
    latest: Tick,
    events: Events<N>,
}

impl SessionUnderTest {
    /// The tick itself: into the black box, and the same as the model's.
    fn record(&mut self, input: &Input<N>) {
        let frozen = self.black_box.is_frozen();
        self.black_box.before_tick(&self.session);
        let output = self.session.tick(input);
        self.black_box
            .after_tick(input, &output, output.ended.is_some());
        self.model.tick(input, &output);
        assert!(self.session.is_valid(), "the session stays valid");
        motors::paired_motors_are_equal([0, 0, 1], &output.references);
        if !frozen {
            (self.recorded, self.latest) = (self.recorded + 1, output.state.tick);
        }
        // Skipped cycles leave a gap in the ticks' numbers, and at the end of the numbers there is
        // none left.
        let gap = input.tick.cycles() > 1 || output.state.tick == Tick(u64::MAX);
        if gap || (frozen && output.welcome.is_some()) {
            self.black_box_replays();
            self.black_box.release();
            self.recorded = 0;
        }
        blackbox::holds_the_end(&self.black_box, self.latest, self.recorded);
    }

    /// T11: what the black box holds happens again.
    fn black_box_replays(&self) {
        if let Some(before) = self.black_box.before() {
            let replayed = replay(before, self.black_box.entries());
            let all = self.black_box.entries().count();
            let same = replayed.differing.is_none() && replayed.agreeing == all;
            assert!(same, "T11: every output again");
        }
    }
}

impl SystemUnderTest for SessionUnderTest {
    fn session(&self) -> &Session<N> {
        &self.session
    }

    fn say(&mut self, peer: Peer, action: &ClientAction) {
        let from = match peer {
            Peer::Owner => self.session.owner().unwrap_or(Connection(0)),
            Peer::One => Connection(0),
            Peer::Other => Connection(1),
        };
        let event = event(&self.session, action);
        // What finds no room is lost: the endpoint would have seen to that.
        let _ = self.events.push((from, event));
    }

    fn tick(&mut self, cycle: Cycle) {
        let input = Input {
            tick: cycle.tick,
            last_write: fate(&self.session, cycle.refused.as_ref()),
            arrival_us: cycle.arrival_us,
            unauthentic: cycle.arrival_us % 3,
            epochs: cycle.epochs,
            events: std::mem::take(&mut self.events),
        };
        session::settles_any_write(&self.session, &input.last_write);
        let step = StepInput::after_events(&self.session, &input);
        session::step_is_right(&step);
        let (fsm, rules) = session::decided_on(&step);
        fsm::decision_is_right(&step.session.parts().discrete, &fsm, &rules);
        let essential = session::essential(&self.session, &input);
        session::same_outcome(&self.session, &input, &essential);
        self.record(&input);
    }
}
