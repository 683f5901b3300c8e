//! HMAC-SHA-256 with kept states: the key costs its two compressions once.

use core::hint::black_box;

use sha2::compress256;

/// Bytes of a block of SHA-256.
const BLOCK: usize = 64;
/// State before the first block (FIPS 180-4, 5.3.3).
const START: [u32; 8] = [
    0x6a09_e667,
    0xbb67_ae85,
    0x3c6e_f372,
    0xa54f_f53a,
    0x510e_527f,
    0x9b05_688c,
    0x1f83_d9ab,
    0x5be0_cd19,
];

/// First 16 bytes of an HMAC.
pub type Tag = [u8; 16];

/// Key of an HMAC: the states of the inner and outer hash behind its blocks. Not `Debug`, so that it
/// is not printed.
#[derive(Clone)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct MacKey {
    inner: [u32; 8],
    outer: [u32; 8],
}

impl MacKey {
    /// Derives the states of a key of 32 bytes.
    #[must_use]
    pub fn new(key: &[u8; 32]) -> Self {
        Self {
            inner: behind_key(key, 0x36),
            outer: behind_key(key, 0x5c),
        }
    }

    /// Builds a key from its states.
    pub(crate) const fn from_states([inner, outer]: [[u32; 8]; 2]) -> Self {
        Self { inner, outer }
    }

    /// Returns the states.
    pub(crate) const fn states(&self) -> [[u32; 8]; 2] {
        [self.inner, self.outer]
    }

    /// Returns the HMAC of these bytes, one part behind the other.
    #[inline(never)]
    #[must_use]
    pub fn mac(&self, parts: &[&[u8]]) -> [u8; 32] {
        let mut inner = Hash::behind_a_block(self.inner);
        for part in parts {
            inner.update(part);
        }
        let mut outer = Hash::behind_a_block(self.outer);
        outer.update(&inner.finish());
        outer.finish()
    }
}

/// Returns the state behind the block of a key, padded with `pad` (RFC 2104).
// Not inlined, as nothing here that compresses: a call is nothing beside it.
#[inline(never)]
fn behind_key(key: &[u8; 32], pad: u8) -> [u32; 8] {
    let mut block = [pad; BLOCK];
    for (place, byte) in block.iter_mut().zip(key) {
        *place ^= byte;
    }
    let mut state = START;
    compress256(&mut state, &[block.into()]);
    state
}

/// Returns the tag of bytes and a context behind them.
#[must_use]
pub fn tag(key: &MacKey, bytes: &[u8], context: &[u8]) -> Tag {
    first(&key.mac(&[bytes, context]))
}

/// True if all 16 bytes are the same. What it takes does not depend on which of them differ.
#[must_use]
pub fn is_same(one: &Tag, other: &Tag) -> bool {
    let [one, other] = [one, other].map(|tag| u128::from_ne_bytes(*tag));
    black_box(one ^ other) == 0
}

/// Returns the first bytes of an HMAC.
pub(super) fn first<const N: usize>(mac: &[u8; 32]) -> [u8; N] {
    let mut bytes = [0; N];
    for (place, byte) in bytes.iter_mut().zip(mac) {
        *place = *byte;
    }
    bytes
}

/// SHA-256 of a stream.
struct Hash {
    state: [u32; 8],
    block: [u8; BLOCK],
    /// Bytes of the block in use.
    filled: usize,
    /// Bytes taken.
    length: u64,
}

impl Hash {
    /// A hash that has taken one block.
    const fn behind_a_block(state: [u32; 8]) -> Self {
        Self {
            state,
            block: [0; BLOCK],
            filled: 0,
            length: 64,
        }
    }

    #[inline(never)]
    fn update(&mut self, bytes: &[u8]) {
        let added = u64::try_from(bytes.len()).unwrap_or(u64::MAX);
        self.length = self.length.saturating_add(added);
        let mut rest = bytes;
        while !rest.is_empty() {
            // Never empty: a block that is full is compressed at once.
            let room = self.block.get_mut(self.filled..).unwrap_or_default();
            let taken = room.len().min(rest.len());
            for (place, byte) in room.iter_mut().zip(rest) {
                *place = *byte;
            }
            self.filled = self.filled.saturating_add(taken);
            rest = rest.get(taken..).unwrap_or_default();
            if self.filled >= BLOCK {
                self.compress();
            }
        }
    }

    #[inline(never)]
    fn compress(&mut self) {
        compress256(&mut self.state, &[self.block.into()]);
        self.filled = 0;
    }

    /// Pads (FIPS 180-4, 5.1.1) and returns the digest.
    #[inline(never)]
    fn finish(mut self) -> [u8; 32] {
        let length_bits = self.length.saturating_mul(8).to_be_bytes();
        let rest = self.block.get_mut(self.filled..).unwrap_or_default();
        if let Some((first, zeros)) = rest.split_first_mut() {
            *first = 0x80;
            zeros.fill(0);
        }
        if self.filled >= BLOCK - 8 {
            self.compress();
            self.block = [0; BLOCK];
        }
        if let Some(last) = self.block.last_chunk_mut() {
            *last = length_bits;
        }
        self.compress();
        let mut digest = [0; 32];
        let mut rest = digest.as_mut_slice();
        for word in self.state {
            let Some((place, further)) = rest.split_first_chunk_mut() else {
                break;
            };
            *place = word.to_be_bytes();
            rest = further;
        }
        digest
    }
}
