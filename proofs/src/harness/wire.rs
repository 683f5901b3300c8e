//! Kani harnesses of T8: every body without a checksum, frames with one, collector and deframer by one chunk.

use gantry_tau_core::control::message::{Command, Hello, Refusal, State, Welcome};
use gantry_tau_core::control::wire::{
    Body, Collector, Frame, HEADER_LEN, Kind, MAX_BODY, MAX_FRAME, PROTOCOL_VERSION, TRAILER_LEN,
    decode_client, decode_server,
};
use gantry_tau_core::units::Epoch;

use crate::wire::{
    body_is_canonical, body_survives, chunk_is_collected, frame_is_canonical, frame_is_parsed,
};

#[kani::proof]
#[kani::solver(minisat)]
fn wire_hello_is_canonical() {
    let bytes: [u8; Hello::LENGTH] = kani::any();
    let decoded = body_is_canonical::<Hello>(&bytes);
    kani::cover!(decoded.is_ok(), "some bytes are one");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_hello_survives() {
    body_survives::<Hello>(&kani::any());
    kani::cover!(true, "reached the end");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_epoch_is_canonical() {
    let bytes: [u8; Epoch::LENGTH] = kani::any();
    let decoded = body_is_canonical::<Epoch>(&bytes);
    kani::cover!(decoded.is_ok(), "some bytes are one");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_epoch_survives() {
    body_survives::<Epoch>(&kani::any());
    kani::cover!(true, "reached the end");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_refusal_is_canonical() {
    let bytes: [u8; Refusal::LENGTH] = kani::any();
    let decoded = body_is_canonical::<Refusal>(&bytes);
    kani::cover!(decoded.is_ok(), "some bytes are one");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_refusal_survives() {
    body_survives::<Refusal>(&kani::any());
    kani::cover!(true, "reached the end");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_command_1_is_canonical() {
    let bytes: [u8; Command::<1>::LENGTH] = kani::any();
    let decoded = body_is_canonical::<Command<1>>(&bytes);
    kani::cover!(decoded.is_ok(), "some bytes are one");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_command_1_survives() {
    body_survives::<Command<1>>(&kani::any());
    kani::cover!(true, "reached the end");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_command_6_is_canonical() {
    let bytes: [u8; Command::<6>::LENGTH] = kani::any();
    let decoded = body_is_canonical::<Command<6>>(&bytes);
    kani::cover!(decoded.is_ok(), "some bytes are one");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_command_6_survives() {
    body_survives::<Command<6>>(&kani::any());
    kani::cover!(true, "reached the end");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_welcome_1_is_canonical() {
    let bytes: [u8; Welcome::<1>::LENGTH] = kani::any();
    let decoded = body_is_canonical::<Welcome<1>>(&bytes);
    kani::cover!(decoded.is_ok(), "some bytes are one");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_welcome_1_survives() {
    body_survives::<Welcome<1>>(&kani::any());
    kani::cover!(true, "reached the end");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_welcome_6_is_canonical() {
    let bytes: [u8; Welcome::<6>::LENGTH] = kani::any();
    let decoded = body_is_canonical::<Welcome<6>>(&bytes);
    kani::cover!(decoded.is_ok(), "some bytes are one");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_welcome_6_survives() {
    body_survives::<Welcome<6>>(&kani::any());
    kani::cover!(true, "reached the end");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_state_1_is_canonical() {
    let bytes: [u8; State::<1>::LENGTH] = kani::any();
    let decoded = body_is_canonical::<State<1>>(&bytes);
    kani::cover!(decoded.is_ok(), "some bytes are one");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_state_1_survives() {
    body_survives::<State<1>>(&kani::any());
    kani::cover!(true, "reached the end");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_state_6_is_canonical() {
    let bytes: [u8; State::<6>::LENGTH] = kani::any();
    let decoded = body_is_canonical::<State<6>>(&bytes);
    kani::cover!(decoded.is_ok(), "some bytes are one");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_state_6_survives() {
    body_survives::<State<6>>(&kani::any());
    kani::cover!(true, "reached the end");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_decode_is_total() {
    let bytes: [u8; MAX_BODY] = kani::any();
    let length: usize = kani::any();
    kani::assume(length <= MAX_BODY);
    kani::cover!(length == MAX_BODY, "the longest body");
    let frame = Frame::from_parts(kani::any(), &bytes[..length]);
    let decoded = frame.is_some_and(|frame| {
        decode_client::<1>(&frame).is_ok() || decode_server::<1>(&frame).is_ok()
    });
    kani::cover!(decoded, "some frames are messages");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_write_is_total() {
    let mut room = [0; 128];
    let length: usize = kani::any();
    kani::assume(length <= room.len());
    kani::cover!(length == 0, "no room at all");
    let written = kani::any::<Command<1>>().write(&mut room[..length]);
    assert!(written.is_ok() == (length >= Command::<1>::LENGTH));
    let written = kani::any::<Welcome<1>>().write(&mut room[..length]);
    assert!(written.is_ok() == (length >= Welcome::<1>::LENGTH));
    let written = kani::any::<State<1>>().write(&mut room[..length]);
    assert!(written.is_ok() == (length >= State::<1>::LENGTH));
    kani::cover!(written.is_err(), "some rooms are too small");
}

#[kani::proof]
#[kani::solver(minisat)]
#[kani::unwind(20)]
fn wire_frame_to_18_is_parsed() {
    let bytes: [u8; 18] = kani::any();
    let mut frames = 0;
    for length in 0..=18 {
        frames += u8::from(frame_is_parsed(&bytes[..length]).is_ok());
    }
    kani::cover!(frames == 1, "some bytes are a frame");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_frame_64_is_parsed() {
    let bytes: [u8; 64] = kani::any();
    let parsed = frame_is_parsed(&bytes);
    kani::cover!(parsed.is_ok(), "some bytes are a frame");
}

/// Any bytes behind the good header of a kind.
fn any_frame<const LENGTH: usize>(kind: Kind) -> [u8; LENGTH] {
    let mut bytes: [u8; LENGTH] = kani::any();
    bytes[0] = b'G';
    bytes[1] = b'T';
    bytes[2] = PROTOCOL_VERSION;
    bytes[3] = kind.code();
    bytes[4] = u8::try_from(LENGTH - HEADER_LEN - TRAILER_LEN).unwrap_or(0);
    bytes[5] = 0;
    bytes
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_frame_of_hello_is_canonical() {
    let bytes = any_frame::<{ HEADER_LEN + Hello::LENGTH + TRAILER_LEN }>(Kind::Hello);
    let decoded = frame_is_canonical::<Hello>(Kind::Hello, &bytes);
    kani::cover!(decoded, "some bytes are one");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_frame_of_goodbye_is_canonical() {
    let bytes = any_frame::<{ HEADER_LEN + Epoch::LENGTH + TRAILER_LEN }>(Kind::Goodbye);
    let decoded = frame_is_canonical::<Epoch>(Kind::Goodbye, &bytes);
    kani::cover!(decoded, "some bytes are one");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_frame_of_refusal_is_canonical() {
    let bytes = any_frame::<{ HEADER_LEN + Refusal::LENGTH + TRAILER_LEN }>(Kind::Refusal);
    let decoded = frame_is_canonical::<Refusal>(Kind::Refusal, &bytes);
    kani::cover!(decoded, "some bytes are one");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_frame_of_command_1_is_canonical() {
    let bytes = any_frame::<{ HEADER_LEN + Command::<1>::LENGTH + TRAILER_LEN }>(Kind::Command);
    let decoded = frame_is_canonical::<Command<1>>(Kind::Command, &bytes);
    kani::cover!(decoded, "some bytes are one");
}

/// Any valid collector: up to a whole frame of any length.
fn any_collector() -> Collector {
    let collector = Collector::from_parts(kani::any(), kani::any());
    kani::assume(collector.is_some());
    let collector = collector.unwrap_or_default();
    kani::cover!(collector.held().len() == MAX_FRAME, "the longest frame");
    collector
}

/// Any length that is at most this.
fn any_length(most: usize) -> usize {
    let length = kani::any();
    kani::assume(length <= most);
    kani::cover!(length == most, "the longest chunk");
    length
}

#[kani::proof]
#[kani::solver(minisat)]
#[kani::unwind(9)]
fn wire_chunk_is_collected() {
    let chunk: [u8; 8] = kani::any();
    let chunk = &chunk[..any_length(8)];
    let outcome = chunk_is_collected(&any_collector(), chunk, kani::any());
    kani::cover!(outcome == Ok(true), "a frame can be complete");
}
