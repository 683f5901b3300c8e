//! The endpoint: bytes of any connections in, bounded references out.

use gantry_tau_core::control::endpoint::{Endpoint, FRAMES, Transport};
use gantry_tau_core::control::session::{Connection, EVENTS, Event, LastWrite, Record, TickInput};
use gantry_tau_core::verification::control::{Internals, Slot, inbox, is_open};

use crate::properties::axis::{Bounded, Kind};

/// Operation on an endpoint.
#[derive(Clone, Debug)]
pub enum EndpointOp<const N: usize> {
    /// A new connection.
    Open(Transport),
    /// The end of a connection, open or not.
    Close(Connection),
    /// Bytes from a connection, open or not.
    Feed(Connection, Vec<u8>),
    /// A cycle.
    Tick(TickInput<N>),
}

/// Any operation keeps the invariant, and with accepted writes no offset changes by more than its
/// limit.
pub fn takes_anything<const N: usize, const MOTORS: usize>(
    endpoint: &mut Endpoint<N, MOTORS>,
    op: &EndpointOp<N>,
    recorder: &mut impl Record<N>,
) {
    inbox_has_room(endpoint);
    match op {
        EndpointOp::Open(transport) => opens(endpoint, *transport),
        EndpointOp::Close(connection) => closes(endpoint, *connection),
        EndpointOp::Feed(connection, bytes) => feeds(endpoint, *connection, bytes),
        EndpointOp::Tick(input) => tick(endpoint, input, recorder),
    }
    assert!(endpoint.is_valid(), "T25: the endpoint stays valid");
}

/// T25: an event that may still be posted before the tick finds room: of the owner as long as it
/// has a connection, of others within their common budget. A session that has an owner can hear
/// from it, or of its end.
pub fn inbox_has_room<const N: usize, const MOTORS: usize>(endpoint: &Endpoint<N, MOTORS>) {
    let Some(owner) = endpoint.session().owner() else {
        return;
    };
    let has_closed = inbox(endpoint).contains(&(owner, Event::Closed));
    assert!(
        is_open(endpoint, owner) || has_closed,
        "T25: an owner is connected, or its end is known"
    );
    assert!(
        !is_open(endpoint, owner) || inbox(endpoint).len() < EVENTS,
        "T25: an event of the owner finds room"
    );
}

/// T25: a new connection keeps the invariant, and has a number of its own.
pub fn opens<const N: usize, const MOTORS: usize>(
    endpoint: &mut Endpoint<N, MOTORS>,
    transport: Transport,
) {
    let before = inbox(endpoint).len();
    if let Ok(connection) = endpoint.open(transport) {
        assert!(
            endpoint.session().owner() != Some(connection),
            "T25: a new connection owns nothing"
        );
    }
    assert!(endpoint.is_valid(), "T25: an opening keeps the invariant");
    assert!(
        inbox(endpoint).len() == before,
        "T25: an opening is no event"
    );
}

/// T25: a connection that is gone keeps the invariant; the owner's end is an event.
pub fn closes<const N: usize, const MOTORS: usize>(
    endpoint: &mut Endpoint<N, MOTORS>,
    connection: Connection,
) {
    let before = inbox(endpoint).len();
    let was_open = is_open(endpoint, connection);
    endpoint.close(connection);
    assert!(endpoint.is_valid(), "T25: a closing keeps the invariant");
    assert!(!is_open(endpoint, connection), "T25: closed is closed");
    if was_open && endpoint.session().owner() == Some(connection) {
        let last = (inbox(endpoint).len() == before + 1)
            .then(|| inbox(endpoint).last())
            .flatten();
        assert!(
            last == Some(&(connection, Event::Closed)),
            "T25: the owner's end is an event"
        );
    }
}

/// Events in the inbox that are not of this connection.
fn events_of_others<const N: usize, const MOTORS: usize>(
    endpoint: &Endpoint<N, MOTORS>,
    connection: Connection,
) -> Vec<(Connection, Event<N>)> {
    inbox(endpoint)
        .iter()
        .filter(|(from, _)| *from != connection)
        .copied()
        .collect()
}

/// T25: what is read from a connection keeps the invariant; events of others stand, in their order,
/// and so do earlier ones of the owner.
pub fn feeds<const N: usize, const MOTORS: usize>(
    endpoint: &mut Endpoint<N, MOTORS>,
    connection: Connection,
    bytes: &[u8],
) {
    let before = inbox(endpoint).to_vec();
    let of_others = events_of_others(endpoint, connection);
    let _ = endpoint.feed(connection, bytes);
    assert!(endpoint.is_valid(), "T25: a read keeps the invariant");
    assert!(
        events_of_others(endpoint, connection) == of_others,
        "T25: events of others stand, and an event has its connection"
    );
    // Only a connection that does not own the session takes its own back, when it is closed.
    let is_owner = endpoint.session().owner() == Some(connection);
    assert!(
        !is_owner || inbox(endpoint).starts_with(&before),
        "T25: earlier events stand"
    );
}

/// T25, one connection: every event of an owner is counted, so that its events before a tick are as
/// many as it was read for, and at most 10. With its Closed and the five of all others that is what
/// the inbox has room for.
pub fn events_are_counted(slot: &Slot, bytes: &[u8]) {
    let mut after = slot.clone();
    let decoded = after.decode::<1>(bytes, true);
    let (event, consumed) = decoded.unwrap_or((None, 0));
    assert!(
        after.is_valid(),
        "T25: a connection stays within its budget"
    );
    assert!(
        consumed <= bytes.len(),
        "T25: no more is consumed than given"
    );
    let posted = usize::from(event.is_some());
    assert!(
        slot.most_events() + posted <= after.most_events(),
        "T25: every event is counted"
    );
    assert!(
        after.most_events() <= 10,
        "T25: an owner has at most ten events"
    );
}

/// A tick; T1 for every axis, T10, and no more frames than a tick has.
fn tick<const N: usize, const MOTORS: usize>(
    endpoint: &mut Endpoint<N, MOTORS>,
    input: &TickInput<N>,
    recorder: &mut impl Record<N>,
) {
    let before = *endpoint.session();
    let motors = endpoint.tick_recorded(input, recorder);
    let mut sent = 0;
    while let Some((_, frame)) = endpoint.poll_transmit() {
        assert!(!frame.is_empty(), "every message fits its frame");
        sent += 1;
    }
    assert!(sent <= FRAMES, "no more frames than there is room for");
    let after = endpoint.session();
    if input.last_write == LastWrite::Accepted {
        for index in 0..N {
            let limits = &after.config().parameters().axes[index].limits;
            let old = &before.parts().axes[index].channels;
            let new = &after.parts().axes[index].channels;
            Kind::Position.check((old, new), limits, &Bounded);
        }
    }
    let Some(output) = endpoint.output() else {
        panic!("a tick has an output");
    };
    assert!(
        motors.is_none() == output.withheld,
        "references are withheld exactly where they must be"
    );
    let are_known = motors
        .iter()
        .flatten()
        .all(|motor| output.references.iter().any(|reference| reference == motor));
    assert!(
        are_known,
        "T10: what motors receive is the references of axes"
    );
}
