//! The endpoint: bytes of any connections in, bounded references out.

use gantry_tau_core::control::endpoint::{Endpoint, FRAMES, Transport};
use gantry_tau_core::control::session::{Connection, LastWrite, Record, TickInput};
use gantry_tau_core::verification::control::Internals;

use crate::axis::{Bounded, Kind};

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

/// Any operation keeps the invariant, and with accepted writes no offset changes by more than its limit.
pub fn takes_anything<const N: usize, const MOTORS: usize>(
    endpoint: &mut Endpoint<N, MOTORS>,
    op: &EndpointOp<N>,
    recorder: &mut impl Record<N>,
) {
    match op {
        EndpointOp::Open(transport) => {
            let _ = endpoint.open(*transport);
        }
        EndpointOp::Close(connection) => endpoint.close(*connection),
        EndpointOp::Feed(connection, bytes) => {
            let _ = endpoint.feed(*connection, bytes);
        }
        EndpointOp::Tick(input) => tick(endpoint, input, recorder),
    }
    assert!(endpoint.is_valid(), "the endpoint stays valid");
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
    assert!(motors.is_none() == output.withheld, "references are withheld exactly where they must be");
    let known = |motor| output.references.iter().any(|reference| reference == motor);
    assert!(motors.iter().flatten().all(known), "T10: what motors receive is the references of axes");
}
