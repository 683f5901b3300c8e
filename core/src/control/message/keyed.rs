//! Messages before a session with keys. Only an endpoint with keys takes a [`KeyedHello`]; what a
//! session takes is the [`Hello`] in it.

use super::Hello;
use crate::control::keys::{Cookie, KeyId, Nonce};

/// Client with a key: asks for the session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct KeyedHello {
    /// The request.
    pub hello: Hello,
    /// Name of the client's key.
    pub key: KeyId,
    /// Random bytes of the client, the same in all its Hellos.
    pub nonce: Nonce,
    /// Cookie of the newest Challenge; zero before one.
    pub cookie: Cookie,
}

/// Server: asks the client to say Hello again, with this cookie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Challenge {
    /// The cookie.
    pub cookie: Cookie,
}
