//! Kani harnesses: every body at 1, 3 and 6 axes.

use gantry_tau_core::message::{Command, Hello, Refusal, State, Welcome};
use gantry_tau_core::units::Epoch;
use gantry_tau_core::wire::{Body, Collector};

use crate::wire::{
    body_is_canonical, body_survives, chunk_is_collected, cut_chunk_is_collected_alike,
    frame_is_parsed,
};

#[kani::proof]
#[kani::solver(minisat)]
fn wire_hello_is_canonical() {
    body_survives::<Hello>(&kani::any());
    let bytes: [u8; Hello::LENGTH] = kani::any();
    let decoded = body_is_canonical::<Hello>(&bytes);
    kani::cover!(decoded.is_ok(), "some bytes decode");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_command_1_is_canonical() {
    body_survives::<Command<1>>(&kani::any());
    let bytes: [u8; Command::<1>::LENGTH] = kani::any();
    let decoded = body_is_canonical::<Command<1>>(&bytes);
    kani::cover!(decoded.is_ok(), "some bytes decode");
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_state_1_is_canonical() {
    let bytes: [u8; State::<1>::LENGTH] = kani::any();
    let decoded = body_is_canonical::<State<1>>(&bytes);
    kani::cover!(decoded.is_ok(), "some bytes decode");
}
#[kani::proof]
#[kani::solver(minisat)]
fn wire_state_1_survives() {
    body_survives::<State<1>>(&kani::any());
}
#[kani::proof]
#[kani::solver(minisat)]
fn wire_state_6_survives() {
    body_survives::<State<6>>(&kani::any());
}

#[kani::proof]
#[kani::solver(minisat)]
fn wire_state_6_is_canonical() {
    let bytes: [u8; State::<6>::LENGTH] = kani::any();
    let decoded = body_is_canonical::<State<6>>(&bytes);
    kani::cover!(decoded.is_ok(), "some bytes decode");
}

/// Any valid collector.
fn any_collector() -> Collector {
    let collector = Collector::from_parts(kani::any(), kani::any());
    kani::assume(collector.is_some());
    kani::cover!(true, "some collectors are valid");
    collector.unwrap_or_default()
}

#[kani::proof]
#[kani::solver(minisat)]
#[kani::unwind(9)]
fn wire_chunk_is_collected() {
    let collector = any_collector();
    let chunk: [u8; 8] = kani::any();
    let length: usize = kani::any();
    kani::assume(length <= 8);
    let outcome = chunk_is_collected(&collector, &chunk[..length], kani::any());
    kani::cover!(outcome == Ok(true), "a frame can be complete");
}

#[kani::proof]
#[kani::solver(minisat)]
#[kani::unwind(5)]
fn wire_cut_is_collected_alike() {
    let collector = any_collector();
    let chunk: [u8; 4] = kani::any();
    let length: usize = kani::any();
    let cut: usize = kani::any();
    kani::assume(cut <= length && length <= 4);
    cut_chunk_is_collected_alike(&collector, &chunk[..length], cut, kani::any());
    kani::cover!(true, "end");
}

#[kani::proof]
#[kani::solver(minisat)]
#[kani::unwind(66)]
fn wire_frame_64_is_parsed() {
    let bytes: [u8; 64] = kani::any();
    let parsed = frame_is_parsed(&bytes);
    kani::cover!(parsed.is_ok(), "some bytes are a frame");
}
