//! An endpoint on stable Rust: connections that come and go, frames, noise, bursts and cuts, in any order.

use crate::any;

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::endpoint::{Endpoint, MotorMap, Transport};
use gantry_tau_core::control::message::{ClientMessage, Command, Hello, Mode, Phase};
use gantry_tau_core::control::session::{Connection, Event, Input, NoRecorder, Session, Start, TickInput};
use gantry_tau_core::control::wire::encode_client;
use gantry_tau_core::units::{EpochRange, PositionNm, Sequence};
use gantry_tau_core::verification::control::Internals;
use gantry_tau_proofs::endpoint::{EndpointOp, takes_anything};
use proptest::collection::vec;
use proptest::prelude::*;

type Tested = Endpoint<2, 3>;

/// Operation that makes sense in most states.
#[derive(Clone, Debug)]
enum Move {
    Open(Transport),
    Close(u64),
    /// The owner answers the last State, so many times, cut behind so many bytes.
    Answer(Mode, Offsets, usize, usize),
    Hello(u64),
    /// Any messages of one connection.
    Messages(u64, Vec<ClientMessage<2>>),
    Bytes(u64, Vec<u8>),
    Tick(TickInput<2>),
    OnTime,
}

fn message() -> impl Strategy<Value = ClientMessage<2>> {
    any::event().prop_filter_map("a message", |event| match event {
        Event::Message(message) => Some(message),
        _ => None,
    })
}

fn moves() -> impl Strategy<Value = Vec<Move>> {
    let transport = prop_oneof![3 => Just(Transport::Stream), 1 => Just(Transport::Datagram)];
    let times = prop_oneof![8 => Just(1), 1 => 1..20_usize];
    let answer = (any::mode(), any::offsets(), times, 0..200_usize);
    let one = prop_oneof![
        2 => transport.prop_map(Move::Open),
        1 => (0..8_u64).prop_map(Move::Close),
        8 => answer.prop_map(|(mode, offsets, times, cut)| Move::Answer(mode, offsets, times, cut)),
        4 => (0..8_u64).prop_map(Move::Hello),
        1 => (0..8_u64, vec(message(), 0..20)).prop_map(|(from, all)| Move::Messages(from, all)),
        1 => (0..8_u64, vec(any::<u8>(), 0..40)).prop_map(|(from, bytes)| Move::Bytes(from, bytes)),
        1 => any::tick_input().prop_map(Move::Tick),
        16 => Just(Move::OnTime),
    ];
    vec(one, 0..120)
}

fn ops(endpoint: &Tested, one: &Move) -> Vec<EndpointOp<2>> {
    let discrete = &endpoint.session().parts().discrete;
    let owner = discrete.owner.unwrap_or(Connection(0));
    let frames = |messages: &[ClientMessage<2>]| messages.iter().flat_map(|one| encode_client(one).to_vec()).collect();
    match one {
        Move::Open(transport) => vec![EndpointOp::Open(*transport)],
        Move::Close(connection) => vec![EndpointOp::Close(Connection(*connection))],
        Move::Answer(mode, offsets, times, cut) => {
            let handshake = discrete.phase == Phase::Handshake;
            let command = ClientMessage::Command(Command {
                epoch: discrete.epoch,
                sequence: Sequence(discrete.accepted.0.saturating_add(1)),
                echo: discrete.tick,
                mode: if handshake { Mode::Submit } else { *mode },
                targets: [*offsets; 2],
            });
            let bytes: Vec<u8> = frames(&vec![command; *times]);
            let (one, other) = bytes.split_at(*cut.min(&bytes.len()));
            let fed = |bytes: &[u8]| EndpointOp::Feed(owner, bytes.to_vec());
            vec![fed(one), fed(other), on_time()]
        }
        Move::Hello(from) => {
            let capabilities = endpoint.session().config().parameters().capabilities;
            let hello = ClientMessage::Hello(Hello { axes: 2, capabilities });
            vec![EndpointOp::Feed(Connection(*from), frames(&[hello]))]
        }
        Move::Messages(from, messages) => {
            vec![EndpointOp::Feed(Connection(*from), frames(messages))]
        }
        Move::Bytes(from, bytes) => vec![EndpointOp::Feed(Connection(*from), bytes.clone())],
        Move::Tick(cycle) => vec![EndpointOp::Tick(*cycle)],
        Move::OnTime => vec![on_time()],
    }
}

fn on_time() -> EndpointOp<2> {
    EndpointOp::Tick(Input::empty(EpochRange::VOLATILE).tick)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn anything_happens(config in any::config::<2>(), moves in moves()) {
        let session = Session::new(config, &Start::at_rest([PositionNm(0); 2])).unwrap();
        let motors = MotorMap::new([0, 0, 1]).unwrap();
        let mut endpoint = Tested::new(session, motors, EpochRange::VOLATILE);
        for one in &moves {
            for op in ops(&endpoint, one) {
                takes_anything(&mut endpoint, &op, &mut NoRecorder);
            }
            while endpoint.poll_close().is_some() {}
        }
    }
}
