//! The worked example of `wire.md`, vectors of RFC 4231, and the crate `hmac` as a second opinion.

use hmac::{Hmac, Mac};
use proptest::prelude::*;
use sha2::Sha256;
use std::string::ToString;
use std::vec::Vec as StdVec;

use super::*;
use crate::units::{Epoch, Tick};

fn hex<const N: usize>(digits: &str) -> [u8; N] {
    let bytes: StdVec<u8> = (0..digits.len())
        .step_by(2)
        .map(|at| u8::from_str_radix(&digits[at..at + 2], 16).unwrap())
        .collect();
    bytes.try_into().unwrap()
}

/// An address of IPv4, mapped, and its port.
fn peer() -> [u8; 18] {
    hex("00000000000000000000ffffc0a80105c350")
}

fn nonce() -> Nonce {
    hex("a0a1a2a3a4a5a6a7a8a9aaabacadaeaf")
}

/// Header and body of a Hello with this cookie.
fn hello(cookie: &str) -> StdVec<u8> {
    let header: [u8; 8] = hex("475402082c000100");
    let body: [u8; 28] = hex("0300030091ab2dba9840f109a0a1a2a3a4a5a6a7a8a9aaabacadaeaf");
    [&header[..], &body, &hex::<16>(cookie)].concat()
}

/// Every value of the example of the specification, from the secret on.
#[test]
fn the_worked_example_holds() {
    const ZERO: &str = "00000000000000000000000000000000";
    const COOKIE: &str = "6dfcabd16bac3d202769bc2b1d78e0e2";
    let key = Key::new(
        &core::array::from_fn(|index| u8::try_from(index).unwrap()),
        Role::Control,
    );
    assert_eq!(key.id().to_string(), "91ab2dba9840f109");
    let greeting = "d978f04c54233a7c1f65b497d359aa7907cfc5972e17af909867b9d766fe6fd0";
    let greeting = MacKey::new(&hex(greeting));
    assert_eq!(key.greeting().mac(&[]), greeting.mac(&[]));
    for (cookie, expected) in [
        (ZERO, "c50992aa8c34e280e5106b9a478ce6b1"),
        (COOKIE, "ffdab22b96ea41d5e497ddf5772112de"),
    ] {
        assert_eq!(tag(key.greeting(), &hello(cookie), &[]), hex(expected));
    }
    let keyring = Keyring::new(&[0x55; 32]);
    let cookie = keyring.cookie(&peer(), &nonce(), Epoch(7), Tick(999));
    assert_eq!(cookie, hex(COOKIE));
    let header: [u8; 8] = hex("4754020910000100");
    let challenge = [&header[..], &cookie].concat();
    assert_eq!(
        tag(key.greeting(), &challenge, &nonce()),
        hex("645a6f97e57550e058e68d2be25a6d7e")
    );
    let session = key.session(&SessionOf {
        nonce: nonce(),
        cookie,
        epoch: Epoch(7),
        axes: 3,
        kinematics_checksum: 0x8f2c_1a77,
    });
    let expected = "c021b073637080ada909f4fd27ac6082f4de47cd8a31111a6799d88a86ecb622";
    let expected = MacKey::new(&hex(expected));
    assert_eq!(session.mac(&[]), expected.mac(&[]));
    let goodbye: [u8; 16] = hex("47540205080001000700000000000000");
    assert_eq!(
        tag(&session, &goodbye, &[]),
        hex("3bbdd95abcd09e00454141f182eeb437")
    );
}

/// Cases 1 to 4 of RFC 4231; a shorter key is that key with zeros behind it.
#[test]
fn vectors_of_rfc_4231_hold() {
    fn key(bytes: &[u8]) -> [u8; 32] {
        let mut key = [0; 32];
        key[..bytes.len()].copy_from_slice(bytes);
        key
    }
    let counting: StdVec<u8> = (1..=25).collect();
    for (key, data, expected) in [
        (
            key(&[0x0b; 20]),
            &b"Hi There"[..],
            "b0344c61d8db38535ca8afceaf0bf12b881dc200c9833da726e9376c2e32cff7",
        ),
        (
            key(b"Jefe"),
            b"what do ya want for nothing?",
            "5bdcc146bf60754e6a042426089575c75a003f089d2739839dec58b964ec3843",
        ),
        (
            key(&[0xaa; 20]),
            &[0xdd; 50],
            "773ea91e36800e46854db8ebd09181a72959098b3ef8c122d9635514ced565fe",
        ),
        (
            key(&counting),
            &[0xcd; 50],
            "82558a389a443c0ea4cc819899f2083a85f0faa3e578f8077a2e3ff46729665b",
        ),
    ] {
        assert_eq!(MacKey::new(&key).mac(&[data]), hex(expected));
    }
}

/// A cookie serves its peer, its nonce, the epoch that is next, in its window and the next one.
#[test]
fn a_cookie_is_fresh_for_its_terms_alone() {
    let keyring = Keyring::new(&[0x55; 32]);
    let (peer, nonce, next) = (peer(), nonce(), Epoch(7));
    let of = |tick| keyring.cookie(&peer, &nonce, next, Tick(tick));
    let cookie = of(4_096);
    let is_fresh = |tick| keyring.is_fresh(&cookie, (&peer, &nonce), next, Tick(tick));
    assert_eq!(
        [4_095, 4_096, 8_191, 8_192, 12_287, 12_288].map(is_fresh),
        [false, true, true, true, true, false]
    );
    // The first window has one before it as well.
    assert!(keyring.is_fresh(&of(0), (&peer, &nonce), next, Tick(0)));
    assert!(!keyring.is_fresh(&of(u64::MAX), (&peer, &nonce), next, Tick(4_096)));
    let (mut other_peer, mut other_nonce) = (peer, nonce);
    other_peer[17] ^= 1;
    other_nonce[0] ^= 1;
    let now = Tick(4_096);
    assert!(!keyring.is_fresh(&cookie, (&other_peer, &nonce), next, now));
    assert!(!keyring.is_fresh(&cookie, (&peer, &other_nonce), next, now));
    assert!(!keyring.is_fresh(&cookie, (&peer, &nonce), Epoch(8), now));
    assert!(!Keyring::new(&[0x56; 32]).is_fresh(&cookie, (&peer, &nonce), next, now));
    assert!(!keyring.is_fresh(&[0; 16], (&peer, &nonce), next, now));
}

#[test]
fn a_keyring_has_four_keys_each_once() {
    let mut keyring = Keyring::new(&[0; 32]);
    let key = |secret| Key::new(&[secret; 32], Role::Control);
    for secret in 1..=4 {
        assert_eq!(keyring.add(key(secret)), Ok(()));
        let id = key(secret).id();
        assert_eq!(keyring.add(key(secret)), Err(KeyringError::Twice { id }));
        assert_eq!(keyring.get(id).map(Key::id), Some(id));
    }
    assert_eq!(keyring.add(key(5)), Err(KeyringError::Full));
    let (under, is_known) = keyring.under(key(5).id());
    assert!(!is_known && keyring.get(under.id()).is_none());
    assert!(keyring.under(key(2).id()).1);
}

/// Nothing of a secret is printed.
#[test]
fn a_key_shows_its_name_alone() {
    let key = Key::new(&[7; 32], Role::Read);
    let shown = std::format!("{key:?} {:?}", Keyring::new(&[9; 32]));
    assert!(
        shown.starts_with(&std::format!("Key({}, Read)", key.id())),
        "{shown}"
    );
    assert!(shown.contains("cookie: CookieKey"), "{shown}");
}

#[test]
fn tags_are_the_same_if_every_byte_is() {
    let tag: Tag = core::array::from_fn(|index| u8::try_from(index).unwrap());
    assert!(is_same(&tag, &tag));
    for bit in 0..128 {
        let mut other = tag;
        other[bit / 8] ^= 1 << (bit % 8);
        assert!(!is_same(&tag, &other), "{bit}");
    }
}

proptest! {
    /// Parts of any length, across every border of a block.
    #[test]
    fn a_mac_is_that_of_another_implementation(
        key: [u8; 32], parts in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..150), 0..4),
    ) {
        let mut other = Hmac::<Sha256>::new_from_slice(&key).unwrap();
        parts.iter().for_each(|part| other.update(part));
        let parts: StdVec<&[u8]> = parts.iter().map(StdVec::as_slice).collect();
        let mac = MacKey::new(&key).mac(&parts);
        prop_assert_eq!(&mac[..], &other.finalize().into_bytes()[..]);
    }
}
