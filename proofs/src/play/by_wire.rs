//! The same play through an endpoint: what is said arrives as bytes, cut in two, on connections that come and go. What the endpoint
//! made of it is in its black box, and the tick is what the oracle says of that.

use gantry_tau_core::control::endpoint::{Endpoint, MotorMap, Transport};
use gantry_tau_core::control::session::fsm::Connection;
use gantry_tau_core::control::session::{Event, Session};
use gantry_tau_core::control::wire::encode_client;
use gantry_tau_core::units::{Epoch, PositionNm, Tick};

use super::{
    Actor, Circumstances, Motion, N, Play, Shares, Who, Word, answer, event, life, offsets,
};
use crate::endpoint::{Doing, takes_anything};
use crate::oracle::Oracle;
use crate::wire::sealed;

/// An endpoint with a pair of motors.
type Tested = Endpoint<N, 3, 6>;

/// Plays by bytes. The first client is on a stream, the other sends datagrams.
///
/// # Panics
/// When something does not hold.
pub fn endpoint_is_right(play: &Play) {
    let Some(mut wire) = Wire::set(play) else {
        return;
    };
    wire.play_all(&play.moves);
}

struct Wire {
    endpoint: Tested,
    oracle: Oracle<N>,
    motion: Motion,
    /// Connections of the two clients, where they are open.
    clients: [Option<Connection>; 2],
}

impl Wire {
    fn set(play: &Play) -> Option<Self> {
        let config = play.machine.config();
        let in_force = offsets(&config, &play.in_force);
        let nominal = [PositionNm(0); N];
        let (tick, epoch) = (Tick(life(play)), Epoch(life(play)));
        let session = Session::new(config, &in_force, nominal, tick, epoch).ok()?;
        let oracle = Oracle::new(*config.parameters(), &in_force, nominal, tick, epoch)?;
        Some(Self {
            endpoint: Tested::new(session, MotorMap::new([0, 0, 1]).ok()?),
            oracle,
            motion: Motion::default(),
            clients: [None; 2],
        })
    }

    /// Where a client speaks; none when there is no room for it.
    fn connection(&mut self, client: usize) -> Option<Connection> {
        if self.clients[client].is_none() {
            let transport = [Transport::Stream, Transport::Datagram][client];
            self.clients[client] = self.endpoint.open(transport).ok();
        }
        self.clients[client]
    }

    fn bytes(&self, word: &Word) -> Vec<u8> {
        let session = self.endpoint.session();
        match event(session, word) {
            Event::Message(message) => encode_client(&message).to_vec(),
            Event::Malformed(_) => sealed(1, 3, b"no command"),
            Event::Dropped(_) => sealed(2, 1, b"a client of the next version"),
            Event::Broken(_) | Event::Closed => b"no frame".to_vec(),
            Event::Flood => {
                let word = answer(session, true, [[0; 3]; N]);
                match event(session, &word) {
                    Event::Message(message) => encode_client(&message).repeat(9),
                    _ => Vec::new(),
                }
            }
        }
    }
}

impl Actor for Wire {
    fn session(&self) -> &Session<N> {
        self.endpoint.session()
    }

    fn motion(&mut self) -> &mut Motion {
        &mut self.motion
    }

    fn say(&mut self, who: Who, word: &Word) {
        let client = match who {
            Who::One => 0,
            Who::Other => 1,
            Who::Owner => {
                let owner = self.endpoint.session().owner();
                usize::from(owner.is_some() && owner == self.clients[1])
            }
        };
        let Some(connection) = self.connection(client) else {
            return;
        };
        if *word == Word::Closed {
            self.clients[client] = None;
            takes_anything(&mut self.endpoint, &Doing::Close(connection));
            return;
        }
        let bytes = self.bytes(word);
        let is_datagram = client == 1;
        let parts = match bytes.split_at(bytes.len() / 3) {
            (one, other) if !is_datagram => vec![one.to_vec(), other.to_vec()],
            _ => vec![bytes],
        };
        for part in parts {
            takes_anything(&mut self.endpoint, &Doing::Feed(connection, part));
        }
    }

    fn tick(&mut self, circumstances: &Circumstances) {
        let cycle = self.motion.cycle(self.endpoint.session(), circumstances);
        takes_anything(&mut self.endpoint, &Doing::Tick(cycle));
        let black_box = self.endpoint.black_box_mut();
        if let Some(entry) = black_box.entries().last() {
            let expected = self.oracle.tick(&entry.input);
            assert!(
                entry.output == expected,
                "the oracle says otherwise:\n core   {:?}\n oracle {expected:?}\n input  {:?}",
                entry.output,
                entry.input
            );
            if let Some(gone) = entry.output.close {
                for client in &mut self.clients {
                    *client = client.filter(|client| *client != gone);
                }
            }
        }
        // A frozen one would not show the next tick.
        black_box.release();
    }

    fn resume(&mut self, shares: &Shares) {
        let in_force = offsets(self.endpoint.session().config(), shares);
        let resumed = self.endpoint.resume(&in_force).is_ok();
        assert!(resumed == self.oracle.resume(&in_force), "both resume");
    }
}
