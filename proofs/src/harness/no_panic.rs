//! T12: functions that no other family calls. Kani checks that nothing panics; the assertions
//! beside it use the results.

use gantry_tau_core::control::session::config::{Config, Parameters};
use gantry_tau_core::control::session::{Connection, Event, Events, LastWrite, Session, Start};
use gantry_tau_core::verification::control::Internals;

use super::kani;
use crate::properties::session;

/// Any parameters, valid or not, are judged; a session starts from any offsets, or refuses, and is
/// then valid.
fn start_any<const N: usize>() {
    let parameters: Parameters<N> = kani::any();
    if let Ok(config) = Config::new(parameters) {
        let start: Start<N> = kani::any();
        session::starts_as_told(config, &start);
        kani::cover!(start.stop_latched, "some stops are latched");
    }
}

/// Any fate of the last references is settled.
fn write_any<const N: usize>() {
    let last_write: LastWrite<N> = kani::any();
    session::settles_any_write::<N>(&kani::any(), &last_write);
    kani::cover!(
        matches!(last_write, LastWrite::Refused { .. }),
        "some writes are refused"
    );
}

harnesses! {
    total_start [minisat, unwind 5] { start_any::<3>(); }
    total_start_of_six [minisat, unwind 8] { start_any::<6>(); }
    total_write [minisat, unwind 5] { write_any::<3>(); }
    total_write_of_six [minisat, unwind 8] { write_any::<6>(); }
    /// Events are classified one after the other; there is room for every refusal.
    total_hear [minisat, unwind 5] {
        let session: Session<1> = kani::any();
        let mut events: Events<1> = Events::new();
        for _ in 0..3 {
            let event: (Connection, Event<1>) = kani::any();
            assert!(events.push(event).is_ok(), "there is room");
        }
        let (_, diagnostics) = session.classify(&events, &kani::any());
        assert!(diagnostics.refusals.len() <= 3, "T12: one refusal per event at most");
        kani::cover!(diagnostics.refusals.len() == 3, "three refusals");
    }
}
