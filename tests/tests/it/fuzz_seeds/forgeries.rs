//! Acts of a forger without the key.

use gantry_tau_tests::fuzzed::acts::{
    CUT, FLIP, FLIP_AS_STRANGER, RAW, REFLECT, REPLAY, REPLAY_AS_STRANGER, TICK,
};

use super::Seed;

/// An act: kind, frame, and a number.
fn act(kind: u8, frame: u8, number: u16) -> Vec<u8> {
    let [low, high] = number.to_le_bytes();
    vec![kind, frame, low, high]
}

/// The same act on many frames, twelve to a tick.
fn many(kind: u8, number: impl Fn(u16) -> u16) -> Vec<u8> {
    (0..240_u16)
        .flat_map(|count| {
            let frame = u8::try_from(count % 256).unwrap();
            let end = (count % 12 == 11).then(|| act(TICK, frame, 0));
            let one = act(kind, frame, number(count));
            [one, end.unwrap_or_default()].concat()
        })
        .collect()
}

/// Raw bytes, in an act of their own.
fn raw(bytes: &[u8]) -> Vec<u8> {
    let length = u16::try_from(bytes.len()).unwrap();
    let end = act(TICK, 1, 0);
    [&act(RAW, 0, length)[..], bytes, &end].concat()
}

pub(super) fn seeds() -> Vec<Seed> {
    [
        ("flipped_in_the_tag", many(FLIP, |count| 560 + count % 128)),
        ("flipped_in_the_body", many(FLIP, |count| 64 + count)),
        ("flipped_in_the_header", many(FLIP, |count| count % 64)),
        (
            "flipped_by_a_stranger",
            many(FLIP_AS_STRANGER, |count| count),
        ),
        ("replayed", many(REPLAY, |_| 0)),
        ("replayed_by_a_stranger", many(REPLAY_AS_STRANGER, |_| 0)),
        ("cut", many(CUT, |count| count)),
        ("sent_back_to_the_client", many(REFLECT, |_| 0)),
        ("nothing", raw(b"")),
        (
            "a_hello_without_a_key",
            raw(b"GT\x02\x01\x04\0\0\0\x03\0\0\0\0\0\0\0"),
        ),
        ("garbage", raw(&[0x5a; 100])),
    ]
    .map(|(name, bytes)| (name.to_owned(), bytes))
    .into()
}
