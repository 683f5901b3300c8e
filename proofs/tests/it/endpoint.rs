//! An endpoint on stable Rust: connections that come and go, frames, noise, bursts and cuts, in any
//! order.

use crate::any;

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::endpoint::{Endpoint, Transport};
use gantry_tau_core::control::message::{Capabilities, ClientMessage, Command, Hello, Mode, Phase};
use gantry_tau_core::control::session::{Connection, Event, Input, NoRecorder, Session, Start};
use gantry_tau_core::control::wire::{Suite, encode_client};
use gantry_tau_core::units::{Epoch, EpochRange, PositionNm, Sequence};
use gantry_tau_core::verification::control::{Internals, Slot};
use gantry_tau_proofs::properties::endpoint::{
    EndpointOp, Told, events_are_counted, fate_is_told, takes_anything,
};
use proptest::collection::vec;
use proptest::prelude::*;

/// Operation, and one that makes sense in most states.
#[derive(Clone, Debug)]
enum Move {
    Op(EndpointOp<2>),
    /// The owner answers the last State, so many times, cut behind so many bytes.
    Answer(Mode, Offsets, usize, usize),
}

fn on_time() -> EndpointOp<2> {
    EndpointOp::Tick(Input::empty(EpochRange::VOLATILE).tick, Told::Accepted)
}

fn frames(messages: &[ClientMessage<2>]) -> Vec<u8> {
    messages
        .iter()
        .flat_map(|one| encode_client(one).to_vec())
        .collect()
}

fn connection() -> impl Strategy<Value = Connection> {
    (0..8_u64).prop_map(Connection)
}

fn moves() -> impl Strategy<Value = Vec<Move>> {
    let hello = frames(&[ClientMessage::Hello(Hello {
        axes: 2,
        capabilities: Default::default(),
    })]);
    let message = any::event().prop_filter_map("a message", |event| match event {
        Event::Message(message) => Some(message),
        _ => None,
    });
    let op = prop_oneof![
        2 => prop_oneof![3 => Just(Transport::Stream), 1 => Just(Transport::Datagram)].prop_map(EndpointOp::Open),
        1 => connection().prop_map(EndpointOp::Close),
        4 => connection().prop_map(move |from| EndpointOp::Feed(from, hello.clone())),
        1 => (connection(), vec(message, 0..20)).prop_map(|(from, all)| EndpointOp::Feed(from, frames(&all))),
        1 => (connection(), vec(any::<u8>(), 0..40)).prop_map(|(from, bytes)| EndpointOp::Feed(from, bytes)),
        1 => (any::tick_input(), any::told()).prop_map(|(tick, told)| EndpointOp::Tick(tick, told)),
        16 => Just(on_time()),
    ];
    let times = prop_oneof![8 => Just(1), 1 => 1..20_usize];
    let answer = (any::mode(), any::offsets(), times, 0..200_usize);
    let one = prop_oneof![
        26 => op.prop_map(Move::Op),
        8 => answer.prop_map(|(mode, offsets, times, cut)| Move::Answer(mode, offsets, times, cut)),
    ];
    vec(one, 0..120)
}

fn ops(endpoint: &Endpoint<2>, one: &Move) -> Vec<EndpointOp<2>> {
    let (mode, offsets, times, cut) = match one {
        Move::Op(op) => return vec![op.clone()],
        Move::Answer(mode, offsets, times, cut) => (*mode, *offsets, *times, *cut),
    };
    let discrete = &endpoint.session().parts().discrete;
    let command = ClientMessage::Command(Command {
        epoch: discrete.epoch,
        sequence: Sequence(discrete.accepted.0.saturating_add(1)),
        echo: discrete.tick,
        mode: if discrete.phase == Phase::Handshake {
            Mode::Submit
        } else {
            mode
        },
        targets: [offsets; 2],
    });
    let bytes = frames(&vec![command; times]);
    let (one, other) = bytes.split_at(cut.min(bytes.len()));
    let owner = discrete.owner.unwrap_or(Connection(0));
    vec![
        EndpointOp::Feed(owner, one.to_vec()),
        EndpointOp::Feed(owner, other.to_vec()),
        on_time(),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn anything_happens(config in any::config::<2>(), moves in moves()) {
        let session = Session::new(config, &Start::at_rest([PositionNm(0); 2])).unwrap();
        let mut endpoint = Endpoint::new(session, EpochRange::VOLATILE);
        for one in &moves {
            for op in ops(&endpoint, one) {
                takes_anything(&mut endpoint, &op, &mut NoRecorder);
            }
            while endpoint.poll_close().is_some() {}
        }
    }

    #[test]
    fn one_fate(session in any::session::<3>(), withheld: bool, told in any::told()) {
        fate_is_told(&session, withheld, told);
    }

    /// An owner's connection by itself, beyond its budget: a Stop, another frame, noise, or a tick.
    #[test]
    fn one_connection(
        stream: bool, steps in vec((0..24_u8, vec(any::<u8>(), 0..12)), 0..60), patience in 0..4_u32,
    ) {
        let mut slot = Slot::new(Connection(0), if stream { Transport::Stream } else { Transport::Datagram }, Suite::Checksum);
        for (kind, noise) in steps {
            let bytes = match kind {
                0..4 => frames(&[ClientMessage::Stop(Epoch(1))]),
                4..20 => frames(&[ClientMessage::Hello(Hello { axes: 2, capabilities: Capabilities(0) })]),
                20..22 => noise,
                _ => {
                    slot.begin_tick(noise.len() < 6, patience);
                    continue;
                }
            };
            if slot.is_read() {
                events_are_counted(&slot, &bytes);
                let _ = slot.decode::<2>(&bytes, true);
            }
        }
    }
}
