//! T3 to T7, T9 to T11, T33 on stable Rust: one step from any state. (Sequences from the beginning:
//! `scenario.rs`.)

use crate::any;

use gantry_tau_core::control::axis::InForce;
use gantry_tau_core::control::message::{ClientMessage, Command};
use gantry_tau_core::control::session::{EVENTS, Event, Events, Input, Session, Start};
use gantry_tau_core::units::{Epoch, EpochRange, PositionNm, Sequence, Tick};
use gantry_tau_core::verification::control::{
    Accepted, Axis, Diagnostics, FsmInput, Internals, Order,
};
use gantry_tau_proofs::properties::agitation::Spent;
use gantry_tau_proofs::properties::axis::Kind;
use gantry_tau_proofs::properties::drive::{self, Before};
use gantry_tau_proofs::properties::session::StepInput;
use gantry_tau_proofs::properties::{
    agitation, axis, blackbox, channel, fsm, ingress, motors, session, tick,
};
use proptest::prelude::*;

/// A server that starts with any values in force, and with its own.
fn starts<const N: usize>(session: &Session<N>, in_force: [InForce; N], stop_latched: bool) {
    for in_force in [in_force, session.demanded()] {
        let start = Start {
            in_force,
            stop_latched,
        };
        session::starts_as_told(*session.config(), &start);
    }
}

/// A tick, its parts and the whole.
fn steps<const N: usize>(session: &Session<N>, input: &Input<N>, order: &Order<N>, acted: &Axis) {
    tick::classifies_one_by_one(session, &input.events, &input.epochs);
    session::tick_is_its_parts(session, input);
    let input = StepInput::after_events(session, input);
    session::step_is_right(&input);
    session::axes_act_by_themselves(&input, order, acted);
}

/// Strategies of six axes need more than the stack of a test.
fn on_a_large_stack(test: fn()) {
    let thread = std::thread::Builder::new().stack_size(64 << 20);
    let ended = thread.spawn(test).unwrap().join();
    ended.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
}

#[test]
fn one_start_and_one_write_of_six_axes() {
    on_a_large_stack(|| {
        proptest!(ProptestConfig::with_cases(1_000), |(
            session in any::session::<6>(), in_force in any::axes_in_force(), stop_latched: bool, last_write in any::last_write(),
        )| {
            starts(&session, in_force, stop_latched);
            session::settles_any_write(&session, &last_write);
        });
    });
}

#[test]
fn one_step_of_six_axes() {
    on_a_large_stack(|| {
        proptest!(ProptestConfig::with_cases(1_000), |(
            session in any::session::<6>(), tick in any::tick_input(), last_write in any::last_write(), epochs in any::epochs(),
            order in any::order(), (_, acted) in any::axis(), events in proptest::collection::vec((any::connection(), any::event()), 0..EVENTS),
        )| {
            let events = Events::from_slice(&events).unwrap();
            let input = Input { tick, last_write, arrival_us: 0, unauthentic: 0, epochs, events };
            steps(&session, &input, &order, &acted);
        });
    });
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4_000))]

    #[test]
    fn one_decision((rules, state) in any::rules().prop_flat_map(|rules| (Just(rules), any::discrete(rules.handshake_ticks))), fsm in any::fsm()) {
        fsm::decision_is_right(&state, &fsm, &rules);
        agitation::agitation_ends_the_session(&state, &fsm, &rules);
    }

    #[test]
    fn one_event(
        session in any::session::<3>(), connection in any::connection(), event in any::event(), next_epoch: Option<u64>,
        before in proptest::collection::vec((any::connection(), any::event()), 0..4),
    ) {
        let classifier = ingress::classifier(&session, next_epoch.map(Epoch));
        let mut accepted = Accepted::nothing();
        let mut diagnostics = Diagnostics::default();
        for (connection, event) in &before {
            classifier.classify(*connection, event, &mut accepted, &mut diagnostics);
        }
        ingress::only_the_owner_decides(&classifier, connection, &event, &accepted, &mut diagnostics.clone());
        ingress::owner_decides_what_it_says(&classifier, &event, &accepted, &mut diagnostics.clone());
        let epochs = EpochRange { first: Epoch(1), last: Epoch(u64::MAX) };
        let from = (connection, &event);
        ingress::accepts_only_what_is_new(&session, &epochs, from, &Accepted::nothing(), &mut diagnostics.clone());
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
        ingress::fresh_is_as_defined(&ingress::classifier(&session, None), &command);
    }

    #[test]
    fn one_cycle_at_the_drives(
        session in any::session::<3>(), found in any::axes_in_force(), fate in any::fate(), tick in any::tick_input(), epochs in any::epochs(),
        events in proptest::collection::vec((any::connection(), any::event()), 0..EVENTS),
    ) {
        let before = Before::new(session, found, fate, tick, Accepted::nothing());
        let events = Events::from_slice(&events).unwrap();
        let input = Input { tick: before.tick, last_write: before.last_write, arrival_us: 0, unauthentic: 0, epochs, events };
        let accepted = StepInput::after_events(&session, &input).accepted;
        drive::nothing_jumps(&Before { accepted, ..before });
    }

    #[test]
    fn one_start(session in any::session::<3>(), in_force in any::axes_in_force(), stop_latched: bool) {
        starts(&session, in_force, stop_latched);
    }

    #[test]
    fn one_write(session in any::session::<3>(), last_write in any::last_write()) {
        session::settles_any_write(&session, &last_write);
    }

    #[test]
    fn one_step(
        session in any::session::<3>(), tick in any::tick_input(), last_write in any::last_write(), epochs in any::epochs(),
        order in any::order(), (_, acted) in any::axis(), events in proptest::collection::vec((any::connection(), any::event()), 0..EVENTS),
    ) {
        let events = Events::from_slice(&events).unwrap();
        let input = Input { tick, last_write, arrival_us: 0, unauthentic: 0, epochs, events };
        steps(&session, &input, &order, &acted);
    }

    #[test]
    fn one_of_many_axes(
        session in any::session::<1>(), (config, mut axis) in any::axis(), command in any::axis_command(), tick in any::tick_input(),
        last_write in any::last_write(),
        events in proptest::collection::vec((any::connection(), any::event()), 0..4), all_zero: bool, rests: bool,
    ) {
        let events = Events::from_slice(&events).unwrap();
        let input = Input { tick, last_write, arrival_us: 0, unauthentic: 0, epochs: EpochRange::VOLATILE, events };
        let (fsm, rules) = session::decided_on(&StepInput::after_events(&session, &input));
        if rests {
            axis = Axis { nominal: axis.nominal, ..Axis::default() };
        }
        let fsm = FsmInput { all_zero, ..fsm };
        session::axis_of_many_stays_valid(&axis, &config, (&session.parts().discrete, &fsm, &rules), &command);
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
    fn one_acceleration_of_the_path(
        from in -(1_i64 << 61)..=1 << 61, change in -10_000_i64..10_000, second_difference in -10_000_i64..10_000, far: i64,
        limit in any::nominal_accel(),
    ) {
        let last = from.saturating_add(change);
        for now in [far, last.saturating_add(change).saturating_add(second_difference)] {
            axis::acceleration_is_exact([from, last, now].map(PositionNm), limit);
        }
        let nm = i64::from(limit.nm.get());
        for second_difference in [nm, nm + 1, -nm, -nm - 1] {
            let now = last.saturating_add(change).saturating_add(second_difference);
            axis::acceleration_is_exact([from, last, now].map(PositionNm), limit);
        }
    }

    #[test]
    fn one_step_of_the_path(config in any::axis_config(), from: i64, far: i64, cycles: u32) {
        let limit = i64::from(config.nominal_step_nm);
        let near = [limit, limit + 1, -limit, -limit - 1].map(|change| from.saturating_add(change));
        for to in near.into_iter().chain([far]) {
            axis::step_is_exact(PositionNm(from), PositionNm(to), &config);
        }
        axis::standing_is_within(PositionNm(from), &config, cycles);
    }

    #[test]
    fn one_agitated_tick(
        before in any::agitation(), budget in any::agitation_budget(), far: (i32, i32), near in (-300..300_i32, -300..300_i32),
        slack in prop_oneof![0..3_i64, any::<i64>()],
    ) {
        let spent = Spent(i64::from(before.0).saturating_sub(slack));
        for changes in [far, near] {
            agitation::second_differences_are_bounded(before, spent, changes, &budget);
            agitation::quiet_is_not_counted(before, changes, &budget);
        }
    }

    #[test]
    fn one_order((config, axis) in any::axis(), command in any::axis_command()) {
        for kind in Kind::ALL {
            axis::order_is_bounded(&axis, &command, &config, kind);
            axis::shadow_is_bounded(&axis, &command, &config, kind);
        }
        agitation::axis_is_counted(&axis, &command, &config);
        channel::value_is_its_count(axis.channels.torque);
    }

    #[test]
    fn one_ramp_step(
        (limits, before) in any::limits().prop_flat_map(|limits| (Just(limits), any::channel(limits))), bound in 0..500_u32,
    ) {
        channel::ramp_is_exact(before, &limits);
        channel::ramp_counts_down(before, &limits);
        let magnitude = before.count().unsigned_abs();
        for bound in [magnitude, magnitude.saturating_add(bound), magnitude.saturating_sub(bound)] {
            channel::ramp_lowers_any_bound(before, bound, &limits);
        }
    }

    #[test]
    fn any_map_of_motors(map in proptest::array::uniform9(0..7_usize), axes in proptest::array::uniform6(any::reference())) {
        motors::paired_motors_are_equal::<6, 9>(map, &axes);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// The recorder of any sequence of numbered steps, ends and releases.
    #[test]
    fn a_recording(steps in prop::collection::vec((any::<bool>(), 0..40_u8), 0..80)) {
        let mut recorder = blackbox::Numbered::<3>::new();
        let mut latest = 0_u8;
        for (ends, release) in steps {
            if release == 0 {
                latest = latest.wrapping_add(1);
                blackbox::releases(&mut recorder, latest, ends);
            }
            let frozen = recorder.is_frozen();
            blackbox::records_a_step(&mut recorder, latest, ends && release < 4);
            if !frozen {
                latest = latest.wrapping_add(1);
            }
        }
    }

    #[test]
    fn a_copied_input(
        ticks in [any::tick_input(), any::tick_input()], writes in [any::last_write(), any::last_write()], arrivals: [u16; 2], epochs in [any::epochs(), any::epochs()],
        events in [proptest::collection::vec((any::connection(), any::event()), 0..=EVENTS),
            proptest::collection::vec((any::connection(), any::event()), 0..=EVENTS)],
    ) {
        let [place, given] = [0, 1].map(|which: usize| {
            let events = Events::from_slice(&events[which]).unwrap();
            Input::<3> {
                tick: ticks[which], last_write: writes[which], arrival_us: arrivals[which], unauthentic: arrivals[which].rotate_left(8),
                epochs: epochs[which], events,
            }
        });
        blackbox::input_is_copied(place, &given);
    }
}
