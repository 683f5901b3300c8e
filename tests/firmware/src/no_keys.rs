//! Server without keys.

use gantry_tau_core::control::session::Session;
use gantry_tau_core::units::EpochRange;

use super::machine::{AXES, Server};

/// Returns the server of a session. Epochs are not persisted: an emulated machine never runs twice.
#[inline(always)]
pub(crate) fn server(session: Session<AXES>) -> Server {
    Server::new(session, EpochRange::VOLATILE)
}
