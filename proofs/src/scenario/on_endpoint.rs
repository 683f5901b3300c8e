//! The same scenario through an endpoint: actions arrive as bytes, cut in two, on connections that
//! come and go. The recorded input of each tick, given to the reference model, must lead to the
//! same output.

use gantry_tau_core::control::endpoint::{Endpoint, Transport};
use gantry_tau_core::control::session::{
    BlackBox, Connection, Event, LastWrite, NoRecorder, Session,
};
use gantry_tau_core::control::wire::{PROTOCOL_VERSION, encode_client};
use gantry_tau_core::units::EpochRange;

use super::{
    ClientAction, Cycle, N, Peer, Scenario, SystemUnderTest, answer, event, fate, play, start,
};
use crate::properties::endpoint::{EndpointOp, Told, takes_anything};
use crate::properties::wire::sealed;
use crate::reference_model::ReferenceModel;

/// Plays by bytes. The first client is on a stream, the other sends datagrams.
pub fn endpoint_is_right(scenario: &Scenario) {
    let Some((session, model)) = start(scenario) else {
        return;
    };
    let endpoint = Endpoint::new(session, EpochRange::VOLATILE);
    play(
        &mut EndpointUnderTest {
            endpoint,
            model,
            clients: [None; 2],
        },
        &scenario.ops,
    );
}

struct EndpointUnderTest {
    endpoint: Endpoint<N>,
    model: ReferenceModel<N>,
    /// Connections of the two clients, where they are open.
    clients: [Option<Connection>; 2],
}

impl EndpointUnderTest {
    /// Returns a client's connection, opened if need be; `None` if every place is taken.
    fn connection(&mut self, client: usize) -> Option<Connection> {
        if self.clients[client].is_none() {
            let transport = [Transport::Stream, Transport::Datagram][client];
            self.clients[client] = self.endpoint.open(transport).ok();
        }
        self.clients[client]
    }

    fn bytes(&self, action: &ClientAction) -> Vec<u8> {
        let session = self.endpoint.session();
        match event(session, action) {
            Event::Message(message) => encode_client(&message).to_vec(),
            Event::Malformed(_) => sealed(PROTOCOL_VERSION, 3, b"no command"),
            Event::Dropped(_) => sealed(PROTOCOL_VERSION + 1, 1, b"a client of the next version"),
            Event::Broken(_) | Event::Closed => b"no frame".to_vec(),
            Event::Flood => self.bytes(&answer(session, true, [[0; 3]; N])).repeat(9),
        }
    }
}

impl SystemUnderTest for EndpointUnderTest {
    fn session(&self) -> &Session<N> {
        self.endpoint.session()
    }

    fn say(&mut self, peer: Peer, action: &ClientAction) {
        let client = match peer {
            Peer::One => 0,
            Peer::Other => 1,
            Peer::Owner => {
                let owner = self.endpoint.session().owner();
                usize::from(owner.is_some() && owner == self.clients[1])
            }
        };
        let Some(connection) = self.connection(client) else {
            return;
        };
        if *action == ClientAction::Closed {
            self.clients[client] = None;
            takes_anything(
                &mut self.endpoint,
                &EndpointOp::Close(connection),
                &mut NoRecorder,
            );
            return;
        }
        let bytes = self.bytes(action);
        let is_datagram = client == 1;
        let parts = match bytes.split_at(bytes.len() / 3) {
            (one, other) if !is_datagram => vec![one.to_vec(), other.to_vec()],
            _ => vec![bytes],
        };
        for part in parts {
            takes_anything(
                &mut self.endpoint,
                &EndpointOp::Feed(connection, part),
                &mut NoRecorder,
            );
        }
    }

    fn tick(&mut self, cycle: Cycle) {
        self.endpoint.set_epochs(cycle.epochs);
        self.endpoint.note_arrival(cycle.arrival_us);
        // Of the references of this tick, in this system.
        let told = match fate(self.endpoint.session(), cycle.refused.as_ref()) {
            LastWrite::Accepted => Told::Accepted,
            LastWrite::Refused { in_force } => Told::ReadBack(in_force),
            LastWrite::Unknown if cycle.arrival_us % 2 == 0 => Told::Nothing,
            LastWrite::Unknown => Told::Unknown,
        };
        // A fresh one for every tick: it shows what the endpoint made of the bytes.
        let mut black_box = BlackBox::<N, 1>::new();
        let op = EndpointOp::Tick(cycle.tick, told);
        takes_anything(&mut self.endpoint, &op, &mut black_box);
        let Some(entry) = black_box.entries().last() else {
            panic!("a tick is recorded")
        };
        self.model.tick(&entry.input, &entry.output);
        while let Some(gone) = self.endpoint.poll_close() {
            for client in &mut self.clients {
                *client = client.filter(|client| *client != gone);
            }
        }
    }
}
