//! Server with keys. Its secrets are constants here; a product has them from option bytes or a secure
//! element, and the start secret from its generator of random numbers.

use gantry_tau_core::control::endpoint::Budget;
use gantry_tau_core::control::keys::{Key, Keyring, Role};
use gantry_tau_core::control::session::Session;
use gantry_tau_core::units::EpochRange;

use super::machine::{AXES, Server};

/// Secret of the key.
pub(crate) const SECRET: [u8; 32] = [0x5a; 32];
/// Secret of the cookies of this start.
const START_SECRET: [u8; 32] = [0xa5; 32];
/// Work that strangers can cause in a tick.
const BUDGET: Budget = Budget {
    tags: 4,
    greetings: 1,
};

/// Returns the server of a session.
#[inline(always)]
pub(crate) fn server(session: Session<AXES>) -> Server {
    Server::keyed(session, EpochRange::VOLATILE, keyring(), BUDGET)
}

/// Not inlined, so that its stack is free again when the server is written.
#[inline(never)]
fn keyring() -> Keyring {
    let mut keyring = Keyring::new(&START_SECRET);
    // An empty keyring has room.
    keyring.add(Key::new(&SECRET, Role::Control)).unwrap_or(());
    keyring
}
