//! The same scenario through an endpoint: actions arrive as bytes, cut in two, on connections that come and go. The recorded input
//! of each tick, given to the reference model, must lead to the same output.

use gantry_tau_core::control::endpoint::{Endpoint, MotorMap, Transport};
use gantry_tau_core::control::session::{BlackBox, Connection, Event, NoRecorder, Session};
use gantry_tau_core::control::wire::encode_client;
use gantry_tau_core::units::{Epoch, EpochRange, Tick};

use super::{Circumstances, ClientAction, Motion, N, Peer, Scenario, SystemUnderTest, answer, event, life, start};
use crate::endpoint::{EndpointOp, takes_anything};
use crate::reference_model::{Expected, ReferenceModel};
use crate::wire::sealed;

/// An endpoint with a pair of motors.
type Tested = Endpoint<N, 3>;

/// Plays by bytes. The first client is on a stream, the other sends datagrams.
///
/// # Panics
/// When something does not hold.
pub fn endpoint_is_right(scenario: &Scenario) {
    let Some(mut wire) = EndpointUnderTest::set(scenario) else {
        return;
    };
    wire.play_all(&scenario.ops);
}

struct EndpointUnderTest {
    endpoint: Tested,
    model: ReferenceModel<N>,
    motion: Motion,
    /// Connections of the two clients, where they are open.
    clients: [Option<Connection>; 2],
}

impl EndpointUnderTest {
    fn set(scenario: &Scenario) -> Option<Self> {
        let (config, start, session) = start(scenario);
        let (tick, epoch) = (Tick(life(scenario)), Epoch(life(scenario)));
        let model = ReferenceModel::new(*config.parameters(), &start, tick, epoch)?;
        let motors = MotorMap::new([0, 0, 1]).ok()?;
        Some(Self {
            endpoint: Tested::new(session?, motors, EpochRange::VOLATILE),
            model,
            motion: Motion::default(),
            clients: [None; 2],
        })
    }

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
            Event::Malformed(_) => sealed(1, 3, b"no command"),
            Event::Dropped(_) => sealed(2, 1, b"a client of the next version"),
            Event::Broken(_) | Event::Closed => b"no frame".to_vec(),
            Event::Flood => {
                let action = answer(session, true, [[0; 3]; N]);
                match event(session, &action) {
                    Event::Message(message) => encode_client(&message).repeat(9),
                    _ => Vec::new(),
                }
            }
        }
    }
}

impl SystemUnderTest for EndpointUnderTest {
    fn session(&self) -> &Session<N> {
        self.endpoint.session()
    }

    fn motion(&mut self) -> &mut Motion {
        &mut self.motion
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
            takes_anything(&mut self.endpoint, &EndpointOp::Close(connection), &mut NoRecorder);
            return;
        }
        let bytes = self.bytes(action);
        let is_datagram = client == 1;
        let parts = match bytes.split_at(bytes.len() / 3) {
            (one, other) if !is_datagram => vec![one.to_vec(), other.to_vec()],
            _ => vec![bytes],
        };
        for part in parts {
            takes_anything(&mut self.endpoint, &EndpointOp::Feed(connection, part), &mut NoRecorder);
        }
    }

    fn tick(&mut self, circumstances: &Circumstances) {
        let (input, epochs) = self.motion.input(self.endpoint.session(), circumstances);
        self.endpoint.set_epochs(epochs);
        // A fresh one for every tick: it shows what the endpoint made of the bytes.
        let mut black_box = BlackBox::<N, 1>::new();
        takes_anything(&mut self.endpoint, &EndpointOp::Tick(input), &mut black_box);
        let Some(entry) = black_box.entries().last() else {
            panic!("a tick is recorded");
        };
        let expected = self.model.tick(&entry.input);
        assert!(
            Expected::from(&entry.output) == expected,
            "the model says otherwise:\n core   {:?}\n model  {expected:?}\n input  {:?}",
            entry.output,
            entry.input
        );
        while let Some(gone) = self.endpoint.poll_close() {
            for client in &mut self.clients {
                *client = client.filter(|client| *client != gone);
            }
        }
    }
}
