//! A shared key, and what is derived from it.

use core::fmt;

use super::mac::{MacKey, first};
use super::{Cookie, Nonce};
use crate::units::Epoch;

const ID: &[u8] = b"gantry-tau 2 key id";
const GREETING: &[u8] = b"gantry-tau 2 greeting";
const SESSION: &[u8] = b"gantry-tau 2 session";

/// Name of a key, which says nothing of its secret.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct KeyId(pub [u8; 8]);

/// Sixteen hexadecimal digits.
impl fmt::Display for KeyId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for KeyId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "KeyId({self})")
    }
}

/// Rights of the holder of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Role {
    /// Hold a session, and read.
    Control,
    /// Read.
    Read,
}

/// Terms of a session, which its key depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct SessionOf {
    /// The client's nonce.
    pub nonce: Nonce,
    /// The cookie in its second Hello.
    pub cookie: Cookie,
    /// Epoch that was granted.
    pub epoch: Epoch,
    /// Number of axes.
    pub axes: u8,
    /// Checksum of the kinematics.
    pub kinematics_checksum: u32,
}

/// A shared key. `Debug` shows its id.
#[derive(Clone)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Key {
    id: KeyId,
    role: Role,
    secret: MacKey,
    greeting: MacKey,
}

impl Key {
    /// Derives a key from its secret: 32 random bytes.
    #[must_use]
    pub fn new(secret: &[u8; 32], role: Role) -> Self {
        let secret = MacKey::new(secret);
        Self {
            id: KeyId(first(&secret.mac(&[ID]))),
            role,
            greeting: MacKey::new(&secret.mac(&[GREETING])),
            secret,
        }
    }

    /// Returns the name.
    #[must_use]
    pub const fn id(&self) -> KeyId {
        self.id
    }

    /// Returns what its holder may do.
    #[must_use]
    pub const fn role(&self) -> Role {
        self.role
    }

    /// Returns the key of frames before a session: Hello, Challenge, Refusal.
    #[must_use]
    pub const fn greeting(&self) -> &MacKey {
        &self.greeting
    }

    /// Returns the key of the frames of a session.
    #[must_use]
    pub fn session(&self, of: &SessionOf) -> MacKey {
        MacKey::new(&self.secret.mac(&[
            SESSION,
            &self.id.0,
            &of.nonce,
            &of.cookie,
            &of.epoch.0.to_le_bytes(),
            &[of.axes],
            &of.kinematics_checksum.to_le_bytes(),
        ]))
    }
}

/// Writes its id.
#[cfg(feature = "defmt")]
impl defmt::Format for Key {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "Key({})", self.id);
    }
}

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Key({}, {:?})", self.id, self.role)
    }
}
