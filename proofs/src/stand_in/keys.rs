//! Stand-ins for HMAC-SHA-256.

use core::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use gantry_tau_core::control::keys::{Cookie, Keyring, MacKey, Nonce, Tag};
use gantry_tau_core::units::Epoch;
use gantry_tau_core::verification::control::keyed::{mac_key, states_of};

static SECRET: AtomicUsize = AtomicUsize::new(0);
static WORD: AtomicUsize = AtomicUsize::new(0);
static BYTE: AtomicUsize = AtomicUsize::new(0);
static CONTEXT: AtomicUsize = AtomicUsize::new(0);
static SALT: AtomicU64 = AtomicU64::new(0);

/// Places in the arguments of [`new_key`], [`mac`] and [`tag`], of which these know one each.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Places {
    /// Byte of the 32 that a key is made of.
    pub secret: usize,
    /// Word of the states of a key.
    pub word: usize,
    /// Byte of what is covered; of several parts, as if they were one.
    pub byte: usize,
    /// Byte of the context.
    pub context: usize,
    /// Number that makes any tag possible.
    pub salt: u64,
}

/// Chooses what [`new_key`], [`mac`] and [`tag`] depend on.
pub fn choose_tag(places: Places) {
    SECRET.store(places.secret, Ordering::Relaxed);
    WORD.store(places.word, Ordering::Relaxed);
    BYTE.store(places.byte, Ordering::Relaxed);
    CONTEXT.store(places.context, Ordering::Relaxed);
    SALT.store(places.salt, Ordering::Relaxed);
}

/// States of a key: an unknown function of an unknown byte of it.
#[must_use]
pub fn new_key(secret: &[u8; 32]) -> MacKey {
    let byte = secret[SECRET.load(Ordering::Relaxed) % 32];
    mac_key([[u32::from(byte); 8]; 2])
}

/// HMAC: an unknown function of the length of all parts, of an unknown byte of them, and of an unknown
/// word of the key.
#[must_use]
pub fn mac(key: &MacKey, parts: &[&[u8]]) -> [u8; 32] {
    let place = BYTE.load(Ordering::Relaxed);
    let (mut length, mut found) = (0, None);
    for part in parts {
        let in_part = place
            .checked_sub(length)
            .and_then(|at| part.get(at).copied());
        found = found.or(in_part);
        length += part.len();
    }
    let mut mac = [0; 32];
    let (tag, _) = mac.split_at_mut(16);
    tag.copy_from_slice(&packed(key, (found, length), (None, 0)));
    mac
}

/// Tag of bytes and a context: an unknown function of the length of each, of an unknown byte of each,
/// and of an unknown word of the key.
#[must_use]
pub fn tag(key: &MacKey, bytes: &[u8], context: &[u8]) -> Tag {
    let byte = bytes.get(BYTE.load(Ordering::Relaxed)).copied();
    let behind = context.get(CONTEXT.load(Ordering::Relaxed)).copied();
    packed(key, (byte, bytes.len()), (behind, context.len()))
}

/// Cookie: an unknown function of an unknown byte of address and nonce, of epoch and window.
fn cookie(peer: &[u8; 18], nonce: &Nonce, next: Epoch, window: u64) -> Cookie {
    let place = BYTE.load(Ordering::Relaxed);
    let bytes = u16::from_le_bytes([peer[place % 18], nonce[place % 16]]);
    let all = u128::from(window) << 64 | u128::from(next.0.rotate_left(32) ^ u64::from(bytes));
    let salt = u128::from(SALT.load(Ordering::Relaxed));
    (all ^ salt).to_le_bytes()
}

/// Cookie of a keyring: the same unknown function.
#[must_use]
pub fn cookie_of_keyring(
    _: &Keyring,
    peer: &[u8; 18],
    nonce: &Nonce,
    next: Epoch,
    window: u64,
) -> Cookie {
    cookie(peer, nonce, next, window)
}

/// Cookie by its definition: the same unknown function.
#[must_use]
pub fn cookie_of_definition(
    _: &MacKey,
    peer: &[u8; 18],
    nonce: &Nonce,
    next: Epoch,
    window: u64,
) -> Cookie {
    cookie(peer, nonce, next, window)
}

/// A word of the key, bytes and lengths, each in its own place.
fn packed(
    key: &MacKey,
    (byte, length): (Option<u8>, usize),
    (behind, length_behind): (Option<u8>, usize),
) -> Tag {
    let [inner, outer] = states_of(key);
    let place = WORD.load(Ordering::Relaxed);
    let states = if place & 8 == 0 { inner } else { outer };
    let lengths = [length, length_behind].map(|length| u16::try_from(length).unwrap_or(u16::MAX));
    let [[l0, l1], [c0, c1]] = lengths.map(u16::to_le_bytes);
    let [k0, k1, k2, k3] = states[place & 7].to_le_bytes();
    let bytes = [byte, behind].map(|byte| byte.unwrap_or(0));
    let [b, c] = bytes;
    let all = u128::from_le_bytes([k0, k1, k2, k3, b, c, l0, l1, c0, c1, 0, 0, 0, 0, 0, 0]);
    let salt = u128::from(SALT.load(Ordering::Relaxed));
    (all ^ salt).to_le_bytes()
}
