//! Any event on any connection, after anything that has been heard: three axes.

use gantry_tau_core::message::{Counters, Phase};
use gantry_tau_core::session::Session;
use gantry_tau_core::session::decide::Connection;
use gantry_tau_core::session::sift::{Heard, Noted, Sieve};
use gantry_tau_core::units::Epoch;

use crate::sift;

const AXES: usize = 3;

/// What only counts, in any state but for the refusals: they are written, never read.
fn any_noted() -> Noted {
    Noted {
        counters: kani::any::<Counters>(),
        late: kani::any(),
        ..Noted::default()
    }
}

/// The sieve of a session before a tick.
fn sieve_of(session: &Session<AXES>, next_epoch: Epoch) -> Sieve<'_, AXES> {
    Sieve {
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
    let heard: Heard<AXES> = kani::any();
    let sieve = sieve_of(&session, kani::any());
    sift::only_the_owner_decides(&sieve, connection, &kani::any(), &heard, &mut any_noted());
    kani::cover!(session.owner() == Some(connection), "the owner speaks");
    kani::cover!(session.phase() == Phase::Listening, "nobody owns");
}

#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn sift_fresh_is_as_defined() {
    let session: Session<AXES> = kani::any();
    let sieve = sieve_of(&session, kani::any());
    let command = kani::any();
    sift::fresh_is_as_defined(&sieve, &command);
    kani::cover!(sift::is_fresh(&sieve, &command), "some commands are fresh");
}

#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn sift_counts_decide_nothing() {
    let session: Session<AXES> = kani::any();
    let heard: Heard<AXES> = kani::any();
    let sieve = sieve_of(&session, kani::any());
    let (mut one, mut other) = (any_noted(), any_noted());
    let notes = (&mut one, &mut other);
    sift::counts_decide_nothing(&sieve, kani::any(), &kani::any(), &heard, notes);
    kani::cover!(true, "the end is reached");
}
