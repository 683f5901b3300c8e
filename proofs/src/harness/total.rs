//! T12: what no other family calls. Kani itself checks that nothing panics; what is asserted here is only that the results are used.

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::session::config::{Config, Parameters};
use gantry_tau_core::control::session::fsm::Connection;
use gantry_tau_core::control::session::{Event, Events, Session};
use gantry_tau_core::units::{Epoch, PositionNm, Tick};

use crate::session;

const AXES: usize = 3;

/// Any parameters at all, valid or not, are judged; a session starts from any offsets, or refuses, and is then valid.
#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn total_start() {
    let parameters: Parameters<AXES> = kani::any();
    let Ok(config) = Config::new(parameters) else {
        return;
    };
    let in_force: [Offsets; AXES] = kani::any();
    let nominal: [PositionNm; AXES] = kani::any();
    let (tick, epoch): (Tick, Epoch) = (kani::any(), kani::any());
    if let Ok(session) = Session::new(config, &in_force, nominal, tick, epoch) {
        assert!(session.is_valid(), "T12: a session starts valid");
        kani::cover!(true, "some sessions start");
    }
    kani::cover!(true, "the end is reached");
}

/// A session goes on from any offsets, or refuses and is what it was.
#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn total_resume() {
    session::resumes_or_refuses::<AXES>(&kani::any(), &kani::any());
    kani::cover!(true, "the end is reached");
}

/// Events are accepted one after the other; the refusals there is room for.
#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn total_hear() {
    let session: Session<1> = kani::any();
    let mut events: Events<1> = Events::new();
    for _ in 0..3 {
        let event: (Connection, Event<1>) = kani::any();
        assert!(events.push(event).is_ok(), "there is room");
    }
    let (_, diagnostics) = session.classify(&events, kani::any());
    assert!(
        diagnostics.refusals.len() <= 3,
        "T12: one refusal per event at most"
    );
    kani::cover!(diagnostics.refusals.len() == 3, "three refusals");
}
