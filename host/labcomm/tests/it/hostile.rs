use gantry_tau_labcomm::{Decoded, Decoder, ErrorKind, Limit, Malformed, Version};
use proptest::prelude::*;

use super::{decode, hex};

const START_2014: &str = "01 0f 0e 4c6162436f6d6d323031342e7631";

/// Error of a stream of 2006, and of one of 2014 behind its version packet.
fn refused(text: &str) -> ErrorKind {
    decode(&hex(text)).2.unwrap().kind
}

fn refused_2014(text: &str) -> ErrorKind {
    refused(&[START_2014, text].concat())
}

/// A stream of 2006: the definition of an int at index 80h, then `rest`.
fn after_definition(rest: &str) -> String {
    ["00000002 00000080 00000001 61 00000023", rest].concat()
}

#[test]
fn an_index_means_one_type() {
    assert_eq!(
        decode(&hex(&after_definition(
            "00000002 00000080 00000001 61 00000023"
        )))
        .2,
        None
    );
    assert_eq!(
        decode(&hex(&after_definition(
            "00000002 00000081 00000001 61 00000023 00000081 00000007"
        )))
        .0
        .len(),
        3
    );
    assert_eq!(
        refused(&after_definition("00000002 00000080 00000001 61 00000024")),
        ErrorKind::Conflict(0x80)
    );
    assert_eq!(
        refused(&after_definition("00000002 00000080 00000001 62 00000023")),
        ErrorKind::Conflict(0x80)
    );
}

#[test]
fn a_stream_of_2006_ends_at_an_unknown_index() {
    assert_eq!(refused("00000080 00000001"), ErrorKind::UnknownIndex(0x80));
    assert_eq!(refused("00000003"), ErrorKind::Malformed(Malformed::Tag(3)));
    assert_eq!(
        refused("00000002 00000020 00000001 61 00000023"),
        ErrorKind::Malformed(Malformed::Index(0x20))
    );
}

#[test]
fn packets_of_2014_are_exactly_filled() {
    let define = "02 04 40 01 61 01 23"; // one byte short
    assert_eq!(
        refused_2014(define),
        ErrorKind::Malformed(Malformed::PacketLength)
    );
    for length in ["03", "05"] {
        let data = ["02 05 40 01 61 01 23 40", length, "00000001 00"].concat();
        assert_eq!(
            refused_2014(&data),
            ErrorKind::Malformed(Malformed::PacketLength),
            "{length}"
        );
    }
    assert_eq!(
        refused_2014(START_2014),
        ErrorKind::Malformed(Malformed::VersionPlace)
    );
    assert_eq!(
        refused_2014("06 00"),
        ErrorKind::Malformed(Malformed::Tag(6))
    );
    assert_eq!(
        refused_2014("40 88 80 80 01"),
        ErrorKind::Limit(Limit::Value)
    );
}

/// Counts that would occupy a peer for hours or crash it, none of them longer than a few bytes.
#[test]
fn large_counts_are_refused_before_any_loop() {
    // Variable array of bytes: 2^31 - 1 elements.
    let bytes = "00000002 00000080 00000001 61 00000010 00000001 00000000 00000021";
    assert_eq!(
        refused(&[bytes, "00000080 7fffffff"].concat()),
        ErrorKind::Limit(Limit::Value)
    );
    // Two variable indices, whose product exceeds 64 bits with a third.
    let three =
        "00000002 00000080 00000001 61 00000010 00000003 00000000 00000000 00000000 00000021";
    assert_eq!(
        refused(&[three, "00000080 ffffffff ffffffff ffffffff"].concat()),
        ErrorKind::Limit(Limit::Value)
    );
    // With an empty index there are no elements.
    assert_eq!(
        decode(&hex(
            &[three, "00000080 ffffffff ffffffff 00000000"].concat()
        ))
        .0
        .len(),
        2
    );
    // Text of 4 GB, name of 4 GB, a type with 2^32 - 1 fields or indices, a value of 2^30
    // structures.
    assert_eq!(
        refused("00000002 00000080 00000001 61 00000027 00000080 ffffffff"),
        ErrorKind::Limit(Limit::Value)
    );
    assert_eq!(
        refused("00000002 00000080 ffffffff"),
        ErrorKind::Limit(Limit::Name)
    );
    assert_eq!(
        refused("00000002 00000080 00000001 61 00000011 ffffffff"),
        ErrorKind::Limit(Limit::Fields)
    );
    assert_eq!(
        refused("00000002 00000080 00000001 61 00000010 00000001 40000000 00000023"),
        ErrorKind::Limit(Limit::Value)
    );
    let indices = [
        "00000002 00000080 00000001 61 00000010 ffffffff",
        &"00000001".repeat(600),
    ]
    .concat();
    assert_eq!(refused(&indices), ErrorKind::Limit(Limit::TypeBytes));
    // An index of 2^30 crashes a peer.
    assert_eq!(
        refused("00000002 00000080 00000001 61 00000023 40000000"),
        ErrorKind::UnknownIndex(0x4000_0000)
    );
}

/// Decodes a struct of a string and a byte, at most `max_len` bytes: the string has the length
/// `text`, and `given` bytes follow it. True if the value is complete.
fn is_complete(max_len: u32, text: u32, given: usize) -> Result<bool, ErrorKind> {
    // struct { string s; byte b; } of 2006.
    let define = hex(
        "00000002 00000080 00000001 61 00000011 00000002 00000001 73 00000027 00000001 62 00000021",
    );
    let mut decoder = Decoder::<1, 64>::new(max_len);
    assert!(matches!(decoder.decode(&define), Ok(Decoded::Event { .. })));
    let bytes = [
        &0x80_u32.to_be_bytes()[..],
        &text.to_be_bytes(),
        &vec![b'x'; given],
    ]
    .concat();
    match decoder.decode(&bytes) {
        Ok(Decoded::Event { .. }) => Ok(true),
        Ok(Decoded::Need(_)) => Ok(false),
        Err(error) => Err(error.kind),
    }
}

#[test]
fn values_beyond_the_callers_limit_are_refused() {
    assert_eq!(is_complete(10, 5, 6), Ok(true));
    assert_eq!(is_complete(10, 5, 5), Ok(false));
    for given in 7..9 {
        assert_eq!(
            is_complete(10, 6, given),
            Err(ErrorKind::Limit(Limit::Value))
        );
    }
}

/// Definition of an int in a stream of 2006.
fn definition(index: u8) -> Vec<u8> {
    hex(&format!("00000002 000000{index:02x} 00000001 61 00000023"))
}

#[test]
fn a_full_registry_says_so() {
    let mut decoder = Decoder::<2, 64>::default();
    for index in [0x80, 0x81, 0x80] {
        assert!(matches!(
            decoder.decode(&definition(index)),
            Ok(Decoded::Event { .. })
        ));
    }
    let error = decoder.decode(&definition(0x82)).unwrap_err();
    assert_eq!(
        (error.kind, error.at),
        (ErrorKind::Limit(Limit::Definitions), 51)
    );
    assert_eq!(decoder.decode(&definition(0x80)).unwrap_err(), error);
    assert_eq!(decoder.registry().iter().count(), 2);
    let mut decoder = Decoder::<2, 4>::default();
    assert_eq!(
        decoder.decode(&definition(0x80)).unwrap_err().kind,
        ErrorKind::Limit(Limit::DefinitionBytes)
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    /// Any bytes: no panic, and the decoder stays valid.
    #[test]
    fn any_bytes_are_decoded_or_refused(start in 0_usize..3, tail in prop::collection::vec(prop_oneof![0_u8..4, 0x10_u8..0x12, 0x20_u8..0x29, 0x40_u8..0x42, 0x7e_u8..0x82, any::<u8>()], 0..80)) {
        let stream = [["", "00000002 00000040 00000000", START_2014].map(hex)[start].clone(), tail].concat();
        let mut decoder = Decoder::<2, 64>::default();
        let mut rest = &stream[..];
        while let Ok(Decoded::Event { used, .. }) = decoder.decode(rest) {
            prop_assert!(used > 0 && used <= rest.len());
            rest = &rest[used..];
            prop_assert!(decoder.is_valid());
        }
        prop_assert!(decoder.is_valid());
        prop_assert!(decoder.version() != Some(Version::V2014_0));
    }
}
