//! T3 to T7, T9 to T11 on stable Rust: one step from any state, and sequences from the beginning.

use crate::any;

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::message::{ClientMessage, Command, Hello, Mode, Phase};
use gantry_tau_core::control::session::{
    BlackBox, Connection, EVENTS, Event, Events, Input, Output, Session, Start, replay,
};
use gantry_tau_core::units::{Epoch, EpochRange, PositionNm, Sequence, Tick};
use gantry_tau_core::verification::control::{Accepted, Classifier, Diagnostics, Internals};
use gantry_tau_proofs::axis::Kind;
use gantry_tau_proofs::session::StepInput;
use gantry_tau_proofs::{axis, blackbox, fsm, ingress, motors, session};
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4_000))]

    #[test]
    fn one_decision((rules, state) in any::rules().prop_flat_map(|rules| (Just(rules), any::discrete(rules.handshake_ticks))), fsm in any::fsm()) {
        fsm::decision_is_right(&state, &fsm, &rules);
    }

    #[test]
    fn one_event(
        session in any::session::<3>(), connection in any::connection(), event in any::event(), next_epoch: Option<u64>,
        before in proptest::collection::vec((any::connection(), any::event()), 0..4),
    ) {
        let classifier = Classifier {
            discrete: &session.parts().discrete,
            parameters: session.config().parameters(),
            axes: &session.parts().axes,
            next_epoch: next_epoch.map(Epoch),
        };
        let mut accepted = Accepted::nothing();
        let mut diagnostics = Diagnostics::default();
        for (connection, event) in &before {
            classifier.classify(*connection, event, &mut accepted, &mut diagnostics);
        }
        ingress::only_the_owner_decides(&classifier, connection, &event, &accepted, &mut diagnostics.clone());
        let notes = (&mut diagnostics, &mut Diagnostics::default());
        ingress::counts_decide_nothing(&classifier, connection, &event, &accepted, notes);
        if let Event::Message(ClientMessage::Command(command)) = event {
            ingress::fresh_is_as_defined(&classifier, &command);
        }
    }

    /// Commands that are fresh but for one number, or fresh.
    #[test]
    fn one_nearly_fresh_command(session in any::session::<3>(), command in any::command(), epoch in 0..2_u64, ahead in 0..3_u64, behind in 0..3_u64) {
        let discrete = &session.parts().discrete;
        let command = Command {
            epoch: Epoch(discrete.epoch.0.wrapping_add(epoch)),
            sequence: Sequence(discrete.accepted.0.wrapping_add(ahead)),
            echo: Tick(discrete.tick.0.wrapping_sub(behind)),
            ..command
        };
        let classifier = Classifier {
            discrete,
            parameters: session.config().parameters(),
            axes: &session.parts().axes,
            next_epoch: None,
        };
        ingress::fresh_is_as_defined(&classifier, &command);
    }

    #[test]
    fn one_write(session in any::session::<3>(), last_write in any::last_write()) {
        session::settles_any_write(&session, &last_write);
    }

    #[test]
    fn one_step(
        session in any::session::<3>(), tick in any::tick_input(), epochs in any::epochs(),
        events in proptest::collection::vec((any::connection(), any::event()), 0..EVENTS),
    ) {
        let events = Events::from_slice(&events).unwrap();
        session::step_is_right(&StepInput::after_events(&session, &Input { tick, epochs, events }));
    }

    #[test]
    fn one_reference(
        config in any::axis_config(), nominal: i64, from in -(1_i64 << 61)..=1 << 61, to in -(1_i64 << 61)..=1 << 61,
        before in any::offsets(), after in any::offsets(),
    ) {
        for nominal in [nominal, nominal % 1_000_000] {
            axis::reference_is_inside_travel(&config, PositionNm(nominal), &before);
        }
        axis::reference_moves_no_further(&config, (PositionNm(from), PositionNm(to)), (&before, &after));
        axis::reference_moves_no_further(&config, (PositionNm(from % 10_000), PositionNm(to % 10_000)), (&before, &after));
    }

    #[test]
    fn one_order((config, axis) in any::axis(), command in any::axis_command()) {
        for kind in Kind::ALL {
            axis::order_is_bounded(&axis, &command, &config, kind);
            axis::shadow_is_bounded(&axis, &command, &config, kind);
        }
    }

    #[test]
    fn any_map_of_motors(map in proptest::array::uniform9(0..7_usize), axes in proptest::array::uniform6(any::reference())) {
        motors::paired_motors_are_equal::<6, 9>(map, &axes);
    }
}

/// Operation in a tick of a sequence; it makes sense in most states.
#[derive(Clone, Debug)]
enum Op {
    /// Nothing arrives.
    Silence,
    /// The owner answers the last State.
    Answer(Mode, Offsets),
    /// A connection asks for a session.
    Hello(u64),
    /// Any event on any connection.
    Noise(Connection, Event<2>),
    /// The owner says goodbye, or stops.
    Goodbye,
    Stop,
    /// The stop at the machine; the re-arm.
    LocalStop,
    Rearm,
    /// The server is late by so many cycles.
    Overrun(u32),
}

fn ops() -> impl Strategy<Value = Vec<Op>> {
    let one = prop_oneof![
        3 => Just(Op::Silence),
        12 => (any::mode(), any::offsets()).prop_map(|(mode, offsets)| Op::Answer(mode, offsets)),
        3 => (0..3_u64).prop_map(Op::Hello),
        3 => (any::connection(), any::event()).prop_map(|(from, event)| Op::Noise(from, event)),
        1 => Just(Op::Goodbye),
        1 => Just(Op::Stop),
        1 => Just(Op::LocalStop),
        2 => Just(Op::Rearm),
        1 => (0..3_u32).prop_map(Op::Overrun),
    ];
    // Runs of the same: an offset has to grow, and a ramp to end.
    let run = (one, 1..12_usize).prop_map(|(one, times)| vec![one; times]);
    proptest::collection::vec(run, 1..25).prop_map(|runs| runs.concat())
}

/// The input of a move in this state.
fn input_of(session: &Session<2>, ops: &Op, nominal: i64) -> Input<2> {
    let discrete = &session.parts().discrete;
    let mut input = Input::empty(EpochRange::VOLATILE);
    let tick = &mut input.tick;
    tick.nominal = [PositionNm(nominal), PositionNm(-nominal)];
    let owner = discrete.owner.unwrap_or(Connection(0));
    let mut post = |from, event| input.events.push((from, event)).unwrap();
    match ops {
        Op::Silence => {}
        Op::Answer(mode, offsets) => {
            let command = Command {
                epoch: discrete.epoch,
                sequence: Sequence(discrete.accepted.0 + 1),
                echo: discrete.tick,
                mode: if discrete.phase == Phase::Handshake { Mode::Submit } else { *mode },
                targets: [*offsets; 2],
            };
            post(owner, Event::Message(ClientMessage::Command(command)));
        }
        Op::Hello(from) => {
            let capabilities = Default::default();
            let hello = ClientMessage::Hello(Hello { axes: 2, capabilities });
            post(Connection(*from), Event::Message(hello));
        }
        Op::Noise(from, event) => post(*from, *event),
        Op::Goodbye => post(owner, Event::Message(ClientMessage::Goodbye(discrete.epoch))),
        Op::Stop => post(owner, Event::Message(ClientMessage::Stop(discrete.epoch))),
        Op::LocalStop => tick.stop = true,
        Op::Rearm => tick.rearm = discrete.tick.0 % 2 == 0,
        Op::Overrun(cycles) => tick.elapsed_cycles = *cycles,
    }
    input
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// Every step of a sequence has every property, events that must not matter do not, and the black box holds and replays the end.
    #[test]
    fn a_sequence(config in any::config::<2>(), ops in ops(), drift in -3_i64..3) {
        let mut session = Session::new(config, &Start::at_rest([PositionNm(0); 2])).unwrap();
        let mut black_box = BlackBox::<2, 6>::new();
        let (mut at, mut recorded, mut latest) = (0, 0, Tick(0));
        for one in &ops {
            at += drift;
            let input = input_of(&session, one, at);
            session::step_is_right(&StepInput::after_events(&session, &input));
            session::same_outcome(&session, &input, &session::essential(&session, &input));
            let frozen = black_box.is_frozen();
            let output: Output<2> = blackbox::record(&mut black_box, &mut session, &input);
            if !frozen {
                (recorded, latest) = (recorded + 1, output.state.tick);
            }
            if input.tick.cycles() > 1 || (frozen && output.welcome.is_some()) {
                // Skipped cycles leave a gap in the ticks' numbers.
                black_box.release();
                recorded = 0;
            }
            blackbox::holds_the_end(&black_box, latest, recorded);
        }
        if let Some(before) = black_box.before() {
            let replayed = replay(before, black_box.entries());
            prop_assert!(replayed.differing.is_none(), "T11: every output again");
            prop_assert_eq!(replayed.agreeing, black_box.entries().count());
        }
    }

    /// The recorder of any sequence of numbered steps, ends and releases.
    #[test]
    fn a_recording(steps in prop::collection::vec((any::<bool>(), 0..40_u8), 0..80)) {
        let mut recorder = blackbox::Numbered::<3>::new();
        let mut latest = 0;
        for (ends, release) in steps {
            if release == 0 {
                recorder.release();
            }
            let frozen = recorder.is_frozen();
            blackbox::records_a_step(&mut recorder, latest, ends && release < 4);
            if !frozen {
                latest = latest.wrapping_add(1);
            }
        }
    }
}
