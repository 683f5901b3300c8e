//! Any session of three axes in any valid state, any input.

use gantry_tau_core::session::decide::Connection;
use gantry_tau_core::session::{EVENTS, Event, Events, Input, Session};

use crate::session;

/// Any input with at most `EVENTS` events.
fn any_input<const N: usize>(most: usize) -> Input<N> {
    let mut events: Events<N> = Events::new();
    let count: usize = kani::any();
    kani::assume(count <= most && most <= EVENTS);
    kani::cover!(count == most, "as many events as there can be");
    for _ in 0..count {
        let event: (Connection, Event<N>) = kani::any();
        events.push(event).unwrap_or(());
    }
    Input {
        cycle: kani::any(),
        events,
    }
}

#[kani::proof]
#[kani::unwind(8)]
#[kani::solver(minisat)]
fn session_axis_is_bounded() {
    let session: Session<1> = kani::any();
    let input = any_input(1);
    session::axis_is_bounded(&session, &input, 0);
    kani::cover!(true, "the end is reached");
}
