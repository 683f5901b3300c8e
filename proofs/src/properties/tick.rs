//! The events of a tick, T12: one after the other, in order of arrival.

use gantry_tau_core::control::session::{Events, Session};
use gantry_tau_core::units::EpochRange;
use gantry_tau_core::verification::control::{Accepted, Diagnostics, Internals};

use crate::properties::ingress;

/// The events are classified as the last of them is after the others; without any, nothing is accepted.
pub fn classifies_one_by_one<const N: usize>(
    session: &Session<N>,
    events: &Events<N>,
    epochs: &EpochRange,
) {
    let (accepted, diagnostics) = session.classify(events, epochs);
    let mut others = events.clone();
    let Some((connection, event)) = others.pop() else {
        let nothing = Diagnostics::after(&session.parts().counters);
        assert!(
            accepted == Accepted::nothing() && diagnostics == nothing,
            "T12: without an event nothing is accepted"
        );
        return;
    };
    let (mut expected, mut counted) = session.classify(&others, epochs);
    let next = epochs.after(session.parts().discrete.epoch);
    let classifier = ingress::classifier(session, next);
    classifier.classify(connection, &event, &mut expected, &mut counted);
    assert!(
        accepted == expected && diagnostics == counted,
        "T12: the events are classified in order of arrival"
    );
}
