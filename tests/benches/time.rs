//! Wall time per call, reported and not judged: `cargo bench -p gantry-tau-tests --bench time`.
#![allow(
    clippy::unwrap_used,
    clippy::arithmetic_side_effects,
    reason = "a measurement that cannot be made must stop"
)]

mod setup;

use divan::{Bencher, black_box};
use gantry_tau_core::control::message::{ClientMessage, Mode};
use gantry_tau_core::control::wire::{Deframer, Feed, Frame, decode_client, encode_client};
use gantry_tau_core::model::kinematics::WARM_ITERATIONS;

fn main() {
    divan::main();
}

#[divan::bench]
fn nominal_inverse(bencher: Bencher<'_, '_>) {
    let (nominal, tcp, _) = setup::l2();
    bencher.bench_local(|| nominal.inverse(black_box(&tcp)));
}

#[divan::bench]
fn nominal_forward(bencher: Bencher<'_, '_>) {
    let (nominal, _, q) = setup::l2();
    bencher.bench_local(|| nominal.forward(black_box(&q)));
}

#[divan::bench]
fn l2_compensation(bencher: Bencher<'_, '_>) {
    let (compensator, nominal) = setup::l2_compensator();
    let load = setup::load();
    bencher.bench_local(|| compensator.correct(black_box(&nominal), black_box(&load)));
}

#[divan::bench]
fn six_inverse(bencher: Bencher<'_, '_>) {
    let (kinematics, pose, ..) = setup::six();
    bencher.bench_local(|| kinematics.inverse(black_box(&pose), None));
}

#[divan::bench]
fn six_forward_warm(bencher: Bencher<'_, '_>) {
    let (kinematics, _, q, before) = setup::six();
    bencher.bench_local(|| {
        kinematics.forward_from(black_box(&q), black_box(&before), WARM_ITERATIONS)
    });
}

#[divan::bench]
fn six_jacobian(bencher: Bencher<'_, '_>) {
    let (kinematics, pose, q, _) = setup::six();
    bencher.bench_local(|| kinematics.jacobian(black_box(&pose), &q));
}

#[divan::bench]
fn six_compensation(bencher: Bencher<'_, '_>) {
    let (compensator, pose, q) = setup::six_compensator();
    let load = setup::load();
    bencher.bench_local(|| compensator.correct_at(black_box(&pose), &q, black_box(&load)));
}

/// One command in, one state out; the command is made and encoded, too.
#[divan::bench]
fn client_and_server_tick(bencher: Bencher<'_, '_>) {
    let mut server = setup::a_command().0;
    bencher.bench_local(|| {
        let command = server.command(Mode::Obtain);
        server.cycle(&encode_client(&ClientMessage::Command(command)));
    });
}

#[divan::bench]
fn deframe_and_decode(bencher: Bencher<'_, '_>) {
    let bytes = encode_client(&ClientMessage::Command(setup::a_command().1));
    let mut deframer = Deframer::new();
    bencher.bench_local(|| match deframer.feed(black_box(&bytes)) {
        Feed::Frame { frame, .. } => decode_client::<6>(&frame).ok(),
        Feed::Incomplete | Feed::Broken(_) => None,
    });
}

#[divan::bench]
fn parse_a_datagram(bencher: Bencher<'_, '_>) {
    let bytes = encode_client(&ClientMessage::Command(setup::a_command().1));
    bencher.bench_local(|| Frame::parse(black_box(&bytes)).is_ok());
}
