//! Any event on any connection, after any earlier events: three axes.

use gantry_tau_core::control::message::{Counters, Phase};
use gantry_tau_core::control::session::{Connection, Event, Session};
use gantry_tau_core::verification::control::{Accepted, Diagnostics};

use super::kani;
use crate::properties::ingress;

const AXES: usize = 3;

/// Any counts; the refusals are written, never read.
fn any_diagnostics() -> Diagnostics {
    Diagnostics {
        counters: kani::any::<Counters>(),
        late: kani::any(),
        ..Diagnostics::default()
    }
}

harnesses! {
    sift_only_the_owner_decides [minisat, unwind 5] {
        let session: Session<AXES> = kani::any();
        let connection: Connection = kani::any();
        let accepted: Accepted<AXES> = kani::any();
        let classifier = ingress::classifier(&session, kani::any());
        ingress::only_the_owner_decides(&classifier, connection, &kani::any(), &accepted, &mut any_diagnostics());
        kani::cover!(session.owner() == Some(connection), "an event of the owner");
        kani::cover!(session.phase() == Phase::Listening, "an event without an owner");
    }
    sift_owner_decides_what_it_says [minisat, unwind 5] {
        let session: Session<AXES> = kani::any();
        let accepted: Accepted<AXES> = kani::any();
        let event: Event<AXES> = kani::any();
        let classifier = ingress::classifier(&session, kani::any());
        ingress::owner_decides_what_it_says(&classifier, &event, &accepted, &mut any_diagnostics());
        kani::cover!(accepted.fsm.command.is_some(), "a command after another one");
        kani::cover!(matches!(event, Event::Closed), "a connection that is gone");
    }
    sift_fresh_is_as_defined [minisat, unwind 5] {
        let session: Session<AXES> = kani::any();
        let classifier = ingress::classifier(&session, kani::any());
        let command = kani::any();
        ingress::fresh_is_as_defined(&classifier, &command);
        kani::cover!(ingress::is_fresh(&classifier, &command), "some commands are fresh");
    }
    sift_accepts_only_what_is_new [minisat, unwind 5] {
        let session: Session<AXES> = kani::any();
        let accepted: Accepted<AXES> = kani::any();
        let event: Event<AXES> = kani::any();
        let from = (kani::any(), &event);
        ingress::accepts_only_what_is_new(&session, &kani::any(), from, &accepted, &mut any_diagnostics());
    }
    sift_counts_decide_nothing [minisat, unwind 5] {
        let session: Session<AXES> = kani::any();
        let accepted: Accepted<AXES> = kani::any();
        let classifier = ingress::classifier(&session, kani::any());
        let (mut one, mut other) = (any_diagnostics(), any_diagnostics());
        let notes = (&mut one, &mut other);
        ingress::counts_decide_nothing(&classifier, kani::any(), &kani::any(), &accepted, notes);
    }
}
