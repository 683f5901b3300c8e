//! Rooms of an endpoint and of a client with keys.

pub use crate::control::client::guard::keyed::Keyed;
pub use crate::control::endpoint::gate::{
    Coming, Gate, Greeting, Seen, SessionKey, peer_of_stream,
};
pub use crate::control::endpoint::keyed::{decode, enclose};
pub use crate::control::endpoint::slot::Answer;
pub use crate::control::endpoint::slot::keyed::Heard;

use crate::control::keys::MacKey;

/// Builds a key from the states of its inner and outer hash.
#[must_use]
pub const fn mac_key(states: [[u32; 8]; 2]) -> MacKey {
    MacKey::from_states(states)
}

/// Returns the states of the inner and outer hash of a key.
#[must_use]
pub const fn states_of(key: &MacKey) -> [[u32; 8]; 2] {
    key.states()
}
