//! Two hostile clients, lost and late ticks, disconnects, motion, mode changes, stop, re-arm: tick
//! by tick T1 to T11, and what the model of the state machine says; once on messages, once on bytes
//! through an endpoint.

use gantry_tau_proofs::scenario::{Scenario, endpoint_is_right, every_tick_is_right};

/// A [`Scenario`].
pub fn session(data: &[u8]) {
    if let Some(scenario) = super::input::<Scenario>(data) {
        every_tick_is_right(&scenario);
        endpoint_is_right(&scenario);
    }
}
