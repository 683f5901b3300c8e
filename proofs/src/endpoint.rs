//! The endpoint: bytes of any connections in, bounded references out.

use gantry_tau_core::control::endpoint::{Cycle, Endpoint, FRAMES, Transport};
use gantry_tau_core::control::session::fsm::Connection;

/// Something that happens to an endpoint.
#[derive(Clone, Debug)]
pub enum Doing<const N: usize> {
    /// Somebody connects.
    Open(Transport),
    /// A connection is gone, or one that never was.
    Close(Connection),
    /// Bytes arrive from a connection, or from one that never was.
    Feed(Connection, Vec<u8>),
    /// A cycle.
    Tick(Cycle<N>),
}

/// The invariant is kept whatever happens, and with a cycle on time no motor's offset changes by more than its limit.
///
/// # Panics
/// When it does not hold.
pub fn takes_anything<const N: usize, const MOTORS: usize, const HALF: usize>(
    endpoint: &mut Endpoint<N, MOTORS, HALF>,
    doing: &Doing<N>,
) {
    match doing {
        Doing::Open(transport) => {
            let _ = endpoint.open(*transport);
        }
        Doing::Close(connection) => endpoint.close(*connection),
        Doing::Feed(connection, bytes) => {
            let _ = endpoint.feed(*connection, bytes);
        }
        Doing::Tick(cycle) => tick(endpoint, cycle),
    }
    assert!(endpoint.is_valid(), "the endpoint stays valid");
}

/// A tick; T1 for every motor, and no more frames than a tick has.
fn tick<const N: usize, const MOTORS: usize, const HALF: usize>(
    endpoint: &mut Endpoint<N, MOTORS, HALF>,
    cycle: &Cycle<N>,
) {
    let before = *endpoint.session();
    let mut sent = 0;
    let turn = endpoint.tick(cycle, &mut |_, bytes| {
        assert!(!bytes.is_empty(), "every message fits its frame");
        sent += 1;
    });
    assert!(sent <= FRAMES, "no more frames than there is room for");
    let after = endpoint.session();
    for index in 0..N {
        let limits = &after.config().parameters().axes[index].limits;
        let old = &before.parts().axes[index].channels.position;
        let new = &after.parts().axes[index].channels.position;
        crate::channel::change_is_bounded(*old, *new, &limits.position);
    }
    let references = &turn.output.references;
    let known = |motor| references.iter().any(|reference| reference == motor);
    assert!(
        turn.motors.iter().all(known),
        "T10: what motors receive is the references of axes"
    );
}
