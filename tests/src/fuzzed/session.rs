//! Two hostile clients, lost and late ticks, disconnects, motion, mode changes, stop, re-arm: tick by tick T1 to T11, and what the
//! oracle of the state machine says; once on messages, once on bytes through an endpoint.

use gantry_tau_proofs::play::{Play, endpoint_is_right, every_tick_is_right};

/// A [`Play`].
pub fn session(data: &[u8]) {
    if let Some(play) = super::input::<Play>(data) {
        every_tick_is_right(&play);
        endpoint_is_right(&play);
    }
}
