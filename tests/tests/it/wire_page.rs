//! `wire.md` against the encoder and decoder.

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::message::{ClientMessage, Command, Mode};
use gantry_tau_core::control::wire::{Frame, decode_client, encode_client};
use gantry_tau_core::units::{Epoch, OffsetNm, Sequence, Tick};

/// The worked example of `wire.md`, byte for byte.
#[test]
fn the_worked_example_of_the_specification_holds() {
    let page = include_str!("../../../wire.md");
    let (_, example) = page.split_once("```hex").unwrap();
    let (example, _) = example.split_once("```").unwrap();
    let bytes: Vec<u8> = example
        .lines()
        .filter_map(|line| line.split('|').next())
        .flat_map(str::split_whitespace)
        .map(|byte| u8::from_str_radix(byte, 16).unwrap())
        .collect();
    let command = Command::<3> {
        epoch: Epoch(7),
        sequence: Sequence(42),
        echo: Tick(1_000),
        mode: Mode::Obtain,
        targets: [-100_000, 2_500, 0].map(|position| Offsets { position: OffsetNm(position), ..Offsets::default() }),
    };
    assert_eq!(&*encode_client(&ClientMessage::Command(command)), bytes);
    let frame = Frame::parse(&bytes).unwrap();
    assert_eq!(decode_client(&frame), Ok(ClientMessage::Command(command)));
}
