//! Authentication: tags of frames under shared keys, and cookies that prove a return address.
//!
//! | item | contents |
//! |---|---|
//! | [`MacKey`], [`tag`], [`is_same`] | HMAC-SHA-256, cut to 128 bits (FIPS 198-1, RFC 2104) |
//! | [`Key`], [`KeyId`], [`Role`] | a shared secret of 32 bytes, and what is derived from it |
//! | [`Secret`] | the text of a key file |
//! | [`Keyring`] | the keys of a server, and its cookies |
//!
//! Nothing here erases a secret: copies stay on the stack, and erasing them needs `unsafe`.

mod key;
mod keyring;
mod mac;
mod secret;
#[cfg(test)]
mod tests;

pub use key::{Key, KeyId, Role, SessionOf};
pub use keyring::{Keyring, KeyringError, MAX_KEYS};
pub use mac::{MacKey, Tag, is_same, tag};
pub use secret::{KeyTextError, Secret};

/// Random bytes of a client, one value per connection or attempt.
pub type Nonce = [u8; 16];
/// Proof that a client hears what is sent to its address; opaque to it.
pub type Cookie = [u8; 16];
