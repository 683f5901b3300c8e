//! Keys of a server, and its cookies.

use core::fmt;

use heapless::Vec;

use super::mac::{MacKey, first};
use super::{Cookie, Key, KeyId, Nonce, Role};
use crate::units::{Epoch, Tick};

const COOKIE: &[u8] = b"gantry-tau 2 cookie";
const DECOY: &[u8] = b"gantry-tau 2 decoy";

/// Keys of a server at most: two that control and two that read, one of each to come and one to go.
pub const MAX_KEYS: usize = 4;
/// Ticks of a window of cookies, as a power of two: 4 096. A cookie serves in its window and in the
/// next.
const WINDOW_BITS: u32 = 12;

/// Error of [`Keyring::add`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum KeyringError {
    /// There are [`MAX_KEYS`] already.
    Full,
    /// The key is in it already.
    Twice {
        /// Its name.
        id: KeyId,
    },
}

impl fmt::Display for KeyringError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Full => write!(f, "a server has at most {MAX_KEYS} keys"),
            Self::Twice { id } => write!(f, "key {id} is given twice"),
        }
    }
}

impl core::error::Error for KeyringError {}

/// Keys of a server, and the secret of its cookies.
#[derive(Clone, Debug)]
pub struct Keyring {
    keys: Vec<Key, MAX_KEYS>,
    cookie: CookieKey,
    /// Key of ids that are unknown: their Hellos cost as much as those of known ones.
    decoy: Key,
}

/// Secret of cookies. `Debug` shows nothing of it.
#[derive(Clone)]
struct CookieKey(MacKey);

impl fmt::Debug for CookieKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("CookieKey")
    }
}

impl Keyring {
    /// Creates a keyring without keys. `start_secret`: random bytes of this start of the server; or
    /// fixed ones, where epochs never repeat.
    #[must_use]
    pub fn new(start_secret: &[u8; 32]) -> Self {
        let start = MacKey::new(start_secret);
        Self {
            keys: Vec::new(),
            cookie: CookieKey(MacKey::new(&start.mac(&[COOKIE]))),
            decoy: Key::new(&start.mac(&[DECOY]), Role::Read),
        }
    }

    /// Adds a key.
    ///
    /// # Errors
    /// [`KeyringError`]: there is no room, or it is there.
    pub fn add(&mut self, key: Key) -> Result<(), KeyringError> {
        let id = key.id();
        if self.keys.iter().any(|known| known.id() == id) {
            return Err(KeyringError::Twice { id });
        }
        self.keys.push(key).map_err(|_| KeyringError::Full)
    }

    /// Returns the key of a name.
    #[must_use]
    pub fn get(&self, id: KeyId) -> Option<&Key> {
        self.keys.iter().find(|key| key.id() == id)
    }

    /// Returns the key under which a Hello of this name is checked, and whether it is known.
    pub(crate) fn under(&self, id: KeyId) -> (&Key, bool) {
        self.get(id).map_or((&self.decoy, false), |key| (key, true))
    }

    /// Returns the cookie of a peer in a tick, with the epoch that would be granted next.
    #[must_use]
    pub fn cookie(&self, peer: &[u8; 18], nonce: &Nonce, next: Epoch, tick: Tick) -> Cookie {
        self.cookie_of_window(peer, nonce, next, window(tick))
    }

    /// True for the cookie of this window or of the one before. Both are always computed.
    #[must_use]
    pub fn is_fresh(
        &self,
        cookie: &Cookie,
        (peer, nonce): (&[u8; 18], &Nonce),
        next: Epoch,
        tick: Tick,
    ) -> bool {
        let now = window(tick);
        let [now, before] = [now, now.wrapping_sub(1)]
            .map(|window| self.cookie_of_window(peer, nonce, next, window));
        super::is_same(cookie, &now) | super::is_same(cookie, &before)
    }

    #[inline(never)]
    fn cookie_of_window(&self, peer: &[u8; 18], nonce: &Nonce, next: Epoch, window: u64) -> Cookie {
        first(
            &self
                .cookie
                .0
                .mac(&[peer, nonce, &next.0.to_le_bytes(), &window.to_le_bytes()]),
        )
    }
}

/// Returns the number of the window of cookies in which a tick lies.
const fn window(tick: Tick) -> u64 {
    tick.0 >> WINDOW_BITS
}
