//! A play on messages: every tick has every property, and is what the oracle says.

use gantry_tau_core::control::session::act::nominal_stepped;
use gantry_tau_core::control::session::fsm::{Connection, FsmInput, FsmState, Rules};
use gantry_tau_core::control::session::{BlackBox, Events, Input, Session, replay};
use gantry_tau_core::units::{Epoch, PositionNm, Tick};

use super::{Actor, Circumstances, Motion, N, Play, Shares, Who, Word, event, life, offsets};
use crate::oracle::Oracle;
use crate::session::Moment;
use crate::{blackbox, fsm, motors, session};

/// Plays, and checks every tick: T1 to T11, and every output against the oracle's.
///
/// # Panics
/// When something does not hold.
pub fn every_tick_is_right(play: &Play) {
    let Some(mut stage) = Stage::set(play) else {
        return;
    };
    stage.play_all(&play.moves);
    stage.black_box_replays();
}

/// Everything while it is played.
struct Stage {
    session: Session<N>,
    oracle: Oracle<N>,
    black_box: BlackBox<N, 6>,
    /// Ticks in the black box, and the last of them.
    recorded: usize,
    latest: Tick,
    events: Events<N>,
    motion: Motion,
}

impl Stage {
    /// None when the offsets in force refuse the start, as core and oracle agree.
    fn set(play: &Play) -> Option<Self> {
        let config = play.machine.config();
        let in_force = offsets(&config, &play.in_force);
        let nominal = [PositionNm(0); N];
        let (tick, epoch) = (Tick(life(play)), Epoch(life(play)));
        let session = Session::new(config, &in_force, nominal, tick, epoch);
        let oracle = Oracle::new(*config.parameters(), &in_force, nominal, tick, epoch);
        assert!(
            session.is_ok() == oracle.is_some(),
            "a start is refused for offsets beyond their limits only"
        );
        Some(Self {
            session: session.ok()?,
            oracle: oracle?,
            black_box: BlackBox::new(),
            recorded: 0,
            latest: tick,
            events: Events::new(),
            motion: Motion::default(),
        })
    }

    /// The tick itself: into the black box, and the same as the oracle's.
    fn record(&mut self, input: &Input<N>) {
        let frozen = self.black_box.is_frozen();
        let output = blackbox::record(&mut self.black_box, &mut self.session, input);
        let expected = self.oracle.tick(input);
        assert!(
            output == expected,
            "the oracle says otherwise:\n core   {output:?}\n oracle {expected:?}\n input  {input:?}"
        );
        assert!(self.session.is_valid(), "the session stays valid");
        motors::paired_motors_are_equal([0, 0, 1], &output.references);
        if !frozen {
            (self.recorded, self.latest) = (self.recorded + 1, output.state.tick);
        }
        // Skipped cycles leave a gap in the ticks' numbers, and at the end of the numbers there is none left.
        let gap = input.cycle.cycles() > 1 || output.state.tick == Tick(u64::MAX);
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

    fn input(&mut self, circumstances: &Circumstances) -> Input<N> {
        Input {
            cycle: self.motion.cycle(&self.session, circumstances),
            events: std::mem::take(&mut self.events),
        }
    }
}

impl Actor for Stage {
    fn session(&self) -> &Session<N> {
        &self.session
    }

    fn motion(&mut self) -> &mut Motion {
        &mut self.motion
    }

    fn say(&mut self, who: Who, word: &Word) {
        let from = match who {
            Who::Owner => self.session.owner().unwrap_or(Connection(0)),
            Who::One => Connection(0),
            Who::Other => Connection(1),
        };
        let event = event(&self.session, word);
        // What finds no room is lost: the endpoint would have seen to that.
        let _ = self.events.push((from, event));
    }

    fn tick(&mut self, circumstances: &Circumstances) {
        let input = self.input(circumstances);
        let moment = Moment::after_hearing(&self.session, &input);
        session::step_is_right(&moment);
        let (discrete, fsm, rules) = decided_on(&moment);
        fsm::decision_is_right(discrete, &fsm, &rules);
        let essential = session::essential(&self.session, &input);
        session::same_outcome(&self.session, &input, &essential);
        self.record(&input);
    }

    fn resume(&mut self, shares: &Shares) {
        let in_force = offsets(self.session.config(), shares);
        session::resumes_or_refuses(&self.session, &in_force);
        let resumed = self.session.resume(&in_force).is_ok();
        assert!(
            resumed == self.oracle.resume(&in_force),
            "what is within its limits is taken over"
        );
        if resumed {
            self.black_box.release();
            self.recorded = 0;
        }
    }
}

/// What a tick decides on, once more.
fn decided_on(moment: &Moment<N>) -> (&FsmState, FsmInput, Rules) {
    let (session, cycle) = (&moment.session, &moment.cycle);
    let parameters = session.config().parameters();
    let axes = &session.parts().axes;
    let stepped = |axis: usize| {
        let (from, to) = (axes[axis].nominal, cycle.nominal[axis]);
        nominal_stepped(from, to, &parameters.axes[axis], cycle.cycles())
    };
    let accepted = moment.accepted.fsm;
    let fsm = FsmInput {
        stop: accepted.stop || cycle.stop,
        rearm: cycle.rearm,
        skipped: cycle.cycles() - 1,
        all_zero: axes.iter().all(|axis| axis.channels.is_zero()),
        nominal_fault: (0..N).any(stepped),
        ..accepted
    };
    let rules = Rules {
        handshake_ticks: parameters.handshake_ticks,
        budget: parameters.budget,
    };
    (&session.parts().discrete, fsm, rules)
}
