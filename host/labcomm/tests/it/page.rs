//! `docs/labcomm.md` against encoder and decoder.

use gantry_tau_labcomm::samples::{Data, ForceSensor};
use gantry_tau_labcomm::{Encoder, Sample, Text, Version, number};

use super::{Seen, decode, hex};

const PAGE: &str = include_str!("../../../../docs/labcomm.md");

/// Hex blocks of the page, without what stands behind a bar.
fn examples() -> Vec<Vec<u8>> {
    let blocks = PAGE
        .split("```hex\n")
        .skip(1)
        .map(|rest| rest.split("```").next().unwrap());
    blocks
        .map(|block| {
            let digits = block.lines().map(|line| line.split('|').next().unwrap());
            hex(&digits.collect::<String>())
        })
        .collect()
}

/// Version, definitions and values of the thesis' file.
fn thesis_file(version: Version) -> Vec<u8> {
    let mut buffer = [0; 256];
    let mut encoder = Encoder::new(version, &mut buffer);
    let first = version.first_index();
    encoder.version().unwrap();
    encoder.define::<Data>(first).unwrap();
    encoder.define::<ForceSensor>(first + 1).unwrap();
    encoder.data(first, &Data([42, -7, 2_000_000])).unwrap();
    encoder
        .data(
            first + 1,
            &ForceSensor([360.0, -12.5, 0.0, 0.25, -1.0, 3.0]),
        )
        .unwrap();
    encoder.bytes().to_vec()
}

#[test]
fn the_worked_examples_hold_in_both_versions() {
    let examples = examples();
    assert_eq!(examples.len(), 4);
    assert_eq!(examples[0], thesis_file(Version::V2006));
    assert_eq!(examples[1], thesis_file(Version::V2014));
    assert_eq!((examples[0].len(), examples[1].len()), (115, 90));
}

gantry_tau_labcomm::structure! {
    /// The page's structure, with two rows. Its type is not this one: the page's leaves the number
    /// of rows open.
    pub struct Rows { pub name: Text<8>, pub rows: i32, pub v: [[i16; 2]; 2] }
}

impl Sample for Rows {
    const NAME: &'static str = "s";
}

#[test]
fn the_value_with_parts_decodes_in_both_versions() {
    let examples = examples();
    let start = &examples[1][..17];
    let [of_2006, of_2014] = [examples[2].clone(), [start, &examples[3]].concat()].map(|stream| {
        let (seen, at_boundary, error) = decode(&stream);
        assert_eq!((at_boundary, error), (true, None));
        seen
    });
    let rows = Rows {
        name: Text::cut("ab"),
        rows: 2,
        v: [[1, -2], [3, 4]],
    };
    let mut buffer = [0; 64];
    let mut encoder = Encoder::new(Version::V2006, &mut buffer);
    encoder.data(0x82, &rows).unwrap();
    // The size of a variable index is a number, and a number of 2006 is an int.
    assert_eq!(of_2006[1], Seen::Data(0x82, encoder.bytes()[4..].to_vec()));
    assert_eq!(
        of_2014[2],
        Seen::Data(0x42, hex("02 6162 02 0001 fffe 0003 0004"))
    );
    let Seen::Define(0x82, name, ty) = &of_2006[0] else {
        panic!("a definition")
    };
    let Seen::Define(0x42, same, packed) = &of_2014[1] else {
        panic!("a definition")
    };
    assert_eq!(name, same);
    assert_eq!((ty.len(), packed.len()), (45, 15));
}

#[test]
fn the_packed_numbers_of_the_page_hold() {
    for (value, text) in [
        (0, "00"),
        (127, "7f"),
        (128, "81 00"),
        (16384, "81 80 00"),
        (u32::MAX, "8f ff ff ff 7f"),
    ] {
        assert_eq!(number::encode(Version::V2014, value).as_slice(), hex(text));
        assert!(PAGE.contains(&format!("`{text}`")), "{text}");
    }
}

/// A number from 1000 to 999 999 with its digits in groups of three.
fn grouped(number: usize) -> String {
    format!("{} {:03}", number / 1000, number % 1000)
}

#[test]
fn the_limits_of_the_page_hold() {
    for expected in [
        format!(
            "| bytes of a type, as encoded in this stream | {} |",
            grouped(gantry_tau_labcomm::MAX_TYPE)
        ),
        format!("void is a structure | {} |", gantry_tau_labcomm::MAX_DEPTH),
        format!(
            "| fields in all structures of a type together | {} |",
            gantry_tau_labcomm::MAX_FIELDS
        ),
        format!(
            "| bytes of the name of a definition | {} |",
            grouped(gantry_tau_labcomm::MAX_NAME)
        ),
        format!(
            "| {} MiB; the version packet 255 |",
            gantry_tau_labcomm::MAX_VALUE >> 20
        ),
    ] {
        assert!(PAGE.contains(&expected), "{expected}");
    }
}
