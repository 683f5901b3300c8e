//! The endpoint: bytes of any connections in, bounded references out.

use gantry_tau_core::control::axis::InForce;
use gantry_tau_core::control::endpoint::{Endpoint, FRAMES, Transport, Write};
use gantry_tau_core::control::session::{
    Connection, EVENTS, Event, LastWrite, Record, Session, TickInput,
};
use gantry_tau_core::verification::control::{Internals, Slot, inbox, is_open, no_output, pending};

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
    /// A cycle, and what is said of its references.
    Tick(TickInput<N>, Told<N>),
}

/// Fate that an embedder tells of the references of a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Told<const N: usize> {
    /// The drives have taken them; of references that are withheld, nothing.
    Accepted,
    /// The drives have these values in force.
    ReadBack([InForce; N]),
    /// It is not known.
    Unknown,
    /// Nothing.
    Nothing,
}

impl<const N: usize> Told<N> {
    /// Says it.
    pub fn say(self, write: Write<'_, N>) {
        match (self, write) {
            (Self::Accepted, Write::Due(write)) => write.accepted(),
            (Self::ReadBack(in_force), Write::Due(write)) => write.refused(in_force),
            (Self::ReadBack(in_force), Write::Withheld(drives)) => drives.read_back(in_force),
            (Self::Unknown, write) => write.unknown(),
            (Self::Nothing | Self::Accepted, _) => {}
        }
    }
}

/// T21: what is said of the references of a tick is what the next one goes on from, and what its
/// State reports; what is not said is unknown; and accepted is only what was said to be.
pub fn fate_is_told<const N: usize>(session: &Session<N>, withheld: bool, told: Told<N>) {
    let mut output = no_output::<N>();
    output.withheld = withheld;
    let before = output.state;
    let (mut next, mut is_told) = (LastWrite::Accepted, true);
    let write = pending(session, &mut output, &mut next, &mut is_told);
    told.say(write);
    let expected = match told {
        Told::Accepted if !withheld => LastWrite::Accepted,
        Told::ReadBack(in_force) => LastWrite::Refused { in_force },
        Told::Accepted | Told::Unknown | Told::Nothing => LastWrite::Unknown,
    };
    assert!(next == expected, "T21: what was said counts, and no more");
    let is_said = match told {
        Told::Accepted => !withheld,
        Told::ReadBack(_) | Told::Unknown => true,
        Told::Nothing => false,
    };
    assert!(is_told == is_said, "T21: what was said is known to be said");
    let mut settled = *session;
    settled.apply_write_result(&next);
    let reported = match next {
        LastWrite::Refused { in_force } if !settled.parts().withheld => Some(in_force),
        _ => (is_told && next != LastWrite::Accepted).then_some(*session.in_force()),
    };
    for (axis, old) in before.axes.iter().enumerate() {
        let new = &output.state.axes[axis];
        let is = (new.nominal, new.offsets);
        let expected = reported.map_or((old.nominal, old.offsets), |reported| {
            (reported[axis].nominal, reported[axis].offsets)
        });
        assert!(is == expected, "T21: the State reports what is in force");
    }
}

/// Any operation keeps the invariant, and with accepted writes no offset changes by more than its
/// limit.
pub fn takes_anything<const N: usize>(
    endpoint: &mut Endpoint<N>,
    op: &EndpointOp<N>,
    recorder: &mut impl Record<N>,
) {
    inbox_has_room(endpoint);
    match op {
        EndpointOp::Open(transport) => opens(endpoint, *transport),
        EndpointOp::Close(connection) => closes(endpoint, *connection),
        EndpointOp::Feed(connection, bytes) => feeds(endpoint, *connection, bytes),
        EndpointOp::Tick(input, told) => tick(endpoint, input, *told, recorder),
    }
    assert!(endpoint.is_valid(), "T25: the endpoint stays valid");
}

/// T25: an event that may still be posted before the tick finds room: of the owner as long as it
/// has a connection, of others within their common budget. A session that has an owner can hear
/// from it, or of its end.
pub fn inbox_has_room<const N: usize>(endpoint: &Endpoint<N>) {
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
pub fn opens<const N: usize>(endpoint: &mut Endpoint<N>, transport: Transport) {
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
pub fn closes<const N: usize>(endpoint: &mut Endpoint<N>, connection: Connection) {
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
fn events_of_others<const N: usize>(
    endpoint: &Endpoint<N>,
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
pub fn feeds<const N: usize>(endpoint: &mut Endpoint<N>, connection: Connection, bytes: &[u8]) {
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

/// A tick; T1 for every axis, and no more frames than a tick has.
fn tick<const N: usize>(
    endpoint: &mut Endpoint<N>,
    input: &TickInput<N>,
    told: Told<N>,
    recorder: &mut impl Record<N>,
) {
    let before = *endpoint.session();
    let nominal = before.demanded().map(|axis| axis.nominal);
    let was_taken = endpoint.output().is_none() || endpoint.hold(&nominal, 1).is_some();
    let write = endpoint.tick_recorded(input, recorder);
    let is_due = matches!(write, Write::Due(_));
    told.say(write);
    let mut sent = 0;
    while let Some((_, frame)) = endpoint.poll_transmit() {
        assert!(!frame.is_empty(), "every message fits its frame");
        sent += 1;
    }
    assert!(sent <= FRAMES, "no more frames than there is room for");
    assert!(
        endpoint.pending().is_none(),
        "T21: what was not said before the State is unknown"
    );
    let after = endpoint.session();
    if was_taken {
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
        is_due != output.withheld,
        "references are withheld exactly where they must be"
    );
    let is_held = endpoint.hold(&nominal, 1).is_some();
    assert!(
        is_held == (is_due && told == Told::Accepted),
        "T21: accepted is only what was said to be"
    );
}
