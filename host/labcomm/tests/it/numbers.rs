use gantry_tau_labcomm::number::{decode, encode};
use gantry_tau_labcomm::{ErrorKind, Malformed, Version};
use proptest::prelude::*;

#[test]
fn packed_numbers_are_as_measured_at_the_peer() {
    for (number, bytes) in [
        (0, &[0x00][..]),
        (127, &[0x7f]),
        (128, &[0x81, 0x00]),
        (16384, &[0x81, 0x80, 0x00]),
    ] {
        assert_eq!(encode(Version::V2014, number).as_slice(), bytes);
    }
    assert_eq!(
        encode(Version::V2014, u32::MAX).as_slice(),
        [0x8f, 0xff, 0xff, 0xff, 0x7f]
    );
    assert_eq!(
        encode(Version::V2006, 0x1234_5678).as_slice(),
        [0x12, 0x34, 0x56, 0x78]
    );
}

/// Error of a number of 2014.
fn refused(bytes: &[u8]) -> ErrorKind {
    decode(Version::V2014, bytes).unwrap_err()
}

#[test]
fn longer_and_larger_numbers_are_refused() {
    assert_eq!(
        refused(&[0x80, 0x00]),
        ErrorKind::Malformed(Malformed::LongNumber)
    );
    assert_eq!(
        refused(&[0x90, 0x80, 0x80, 0x80, 0x00]),
        ErrorKind::Malformed(Malformed::LargeNumber)
    );
    assert_eq!(
        refused(&[0x81, 0x80, 0x80, 0x80, 0x80, 0x00]),
        ErrorKind::Malformed(Malformed::LargeNumber)
    );
    assert_eq!(refused(&[0x81]), ErrorKind::Incomplete);
    assert_eq!(
        decode(Version::V2006, &[0, 0, 0]).unwrap_err(),
        ErrorKind::Incomplete
    );
}

/// A packed number by division, not by shifts.
fn by_division(mut number: u32) -> Vec<u8> {
    let mut bytes = vec![u8::try_from(number % 128).unwrap()];
    while number >= 128 {
        number /= 128;
        bytes.insert(0, u8::try_from(number % 128).unwrap() + 128);
    }
    bytes
}

proptest! {
    #[test]
    fn numbers_survive(number: u32, shift in 0_u32..32, tail: [u8; 3]) {
        let number = number >> shift;
        prop_assert_eq!(encode(Version::V2014, number).as_slice().to_vec(), by_division(number));
        for version in [Version::V2006, Version::V2014, Version::V2014_0] {
            let mut bytes = encode(version, number).as_slice().to_vec();
            let length = bytes.len();
            bytes.extend(tail);
            prop_assert_eq!(decode(version, &bytes), Ok((number, length)));
        }
    }

    #[test]
    fn bytes_are_the_only_ones_of_their_number(bytes: [u8; 6]) {
        for version in [Version::V2006, Version::V2014] {
            if let Ok((number, taken)) = decode(version, &bytes) {
                prop_assert_eq!(encode(version, number).as_slice().to_vec(), &bytes[..taken]);
            }
        }
    }
}
