//! Any event on any connection, after anything that has been accepted: three axes.

use gantry_tau_core::control::message::{Counters, Phase};
use gantry_tau_core::control::session::Session;
use gantry_tau_core::control::session::fsm::Connection;
use gantry_tau_core::control::session::ingress::{Accepted, Classifier, Diagnostics};
use gantry_tau_core::units::Epoch;

use crate::ingress;

const AXES: usize = 3;

/// What only counts, in any state but for the refusals: they are written, never read.
fn any_noted() -> Diagnostics {
    Diagnostics {
        counters: kani::any::<Counters>(),
        late: kani::any(),
        ..Diagnostics::default()
    }
}

/// The classifier of a session before a tick.
fn sieve_of(session: &Session<AXES>, next_epoch: Epoch) -> Classifier<'_, AXES> {
    Classifier {
        discrete: &session.parts().discrete,
        parameters: session.config().parameters(),
        axes: &session.parts().axes,
        next_epoch,
    }
}

#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn sift_only_the_owner_decides() {
    let session: Session<AXES> = kani::any();
    let connection: Connection = kani::any();
    let accepted: Accepted<AXES> = kani::any();
    let classifier = sieve_of(&session, kani::any());
    sift::only_the_owner_decides(
        &classifier,
        connection,
        &kani::any(),
        &accepted,
        &mut any_noted(),
    );
    kani::cover!(session.owner() == Some(connection), "the owner speaks");
    kani::cover!(session.phase() == Phase::Listening, "nobody owns");
}

#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn sift_fresh_is_as_defined() {
    let session: Session<AXES> = kani::any();
    let classifier = sieve_of(&session, kani::any());
    let command = kani::any();
    sift::fresh_is_as_defined(&classifier, &command);
    kani::cover!(
        sift::is_fresh(&classifier, &command),
        "some commands are fresh"
    );
}

#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn sift_counts_decide_nothing() {
    let session: Session<AXES> = kani::any();
    let accepted: Accepted<AXES> = kani::any();
    let classifier = sieve_of(&session, kani::any());
    let (mut one, mut other) = (any_noted(), any_noted());
    let notes = (&mut one, &mut other);
    sift::counts_decide_nothing(&classifier, kani::any(), &kani::any(), &accepted, notes);
    kani::cover!(true, "the end is reached");
}
