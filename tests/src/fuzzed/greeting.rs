//! A session under a key, and a forger without it who has recorded all of its frames: what he sends,
//! from the owner's address and from his own, to the server and to the client, changes nothing (T27 to
//! T29, T31).

use gantry_tau_core::control::client::{Client, Event, Requirements};
use gantry_tau_core::control::endpoint::{Budget, Endpoint, Greeted, Transport};
use gantry_tau_core::control::keys::{Key, Keyring, Role};
use gantry_tau_core::control::message::{Mode, Phase};
use gantry_tau_core::control::session::config::Config;
use gantry_tau_core::control::session::{Connection, Session, Start};
use gantry_tau_core::units::{EpochRange, OffsetNm, PositionNm};
use gantry_tau_core::{Offsets, Reference};

use crate::server_fixture::{on_time, parameters, taken};

/// Most acts in a tick: fewer than the tags of a tick, so that the owner's own frame is looked at.
const ACTS: usize = 12;
/// Most ticks of a run.
const TICKS: usize = 200;
/// Address of the owner, and of the forger.
const PEERS: [[u8; 18]; 2] = [[1; 18], [2; 18]];

/// Bytes of an act: kind, frame and two numbers.
pub const ACT: usize = 4;

/// Kinds of acts; the others are raw bytes, which follow, from the forger's address.
pub mod acts {
    /// The tick ends.
    pub const TICK: u8 = 0;
    /// A recorded frame with a flipped bit, from the owner's address.
    pub const FLIP: u8 = 1;
    /// The same from the forger's.
    pub const FLIP_AS_STRANGER: u8 = 2;
    /// A recorded frame, from the owner's address.
    pub const REPLAY: u8 = 3;
    /// The same from the forger's.
    pub const REPLAY_AS_STRANGER: u8 = 4;
    /// The beginning of a recorded frame, from the owner's address.
    pub const CUT: u8 = 5;
    /// A frame of the client, back to it.
    pub const REFLECT: u8 = 6;
    /// Raw bytes, from the owner's address.
    pub const RAW: u8 = 7;
}

/// Server and client, and all frames that were sent.
struct Scene {
    server: Endpoint<3>,
    client: Client<3>,
    owner: Option<Connection>,
    recorded: Vec<Vec<u8>>,
    /// Those of the client.
    said: Vec<Vec<u8>>,
}

impl Scene {
    /// A session in Obtain.
    fn obtaining() -> Self {
        let config = Config::new(parameters()).unwrap();
        let session = Session::new(config, &Start::at_rest([PositionNm(0); 3])).unwrap();
        let key = || Key::new(&[7; 32], Role::Control);
        let mut keyring = Keyring::new(&[8; 32]);
        keyring.add(key()).unwrap();
        let epochs = EpochRange::VOLATILE;
        let mut scene = Self {
            server: Endpoint::keyed(session, epochs, keyring, Budget::default()),
            client: Client::keyed(Transport::Datagram, Requirements::default(), key(), [9; 16]),
            owner: None,
            recorded: Vec::new(),
            said: Vec::new(),
        };
        scene.say_hello();
        for _ in 0..8 {
            scene.turn(0);
        }
        assert_eq!(scene.server.session().phase(), Phase::Obtain);
        scene
    }

    fn say_hello(&mut self) {
        let Some(hello) = self.client.hello() else {
            return;
        };
        self.said.push(hello.to_vec());
        self.recorded.push(hello.to_vec());
        let answer = match self.server.greet(&PEERS[0], &hello) {
            Greeted::Nothing => return,
            Greeted::Peer(connection) => return self.owner = Some(connection),
            Greeted::Answer(answer) => answer.to_vec(),
        };
        self.hear(&answer);
    }

    fn hear(&mut self, frame: &[u8]) {
        self.recorded.push(frame.to_vec());
        if self.client.feed(frame).poll_event() == Some(Ok(Event::Challenged)) {
            self.say_hello();
        }
    }

    /// The client's answer, and a tick. Returns the references.
    fn turn(&mut self, target_nm: i32) -> [Reference; 3] {
        let targets = [Offsets::position(OffsetNm(target_nm)); 3];
        if let (Some(answer), Some(owner)) =
            (self.client.answer(Mode::Obtain, &targets), self.owner)
        {
            self.said.push(answer.frame.to_vec());
            self.recorded.push(answer.frame.to_vec());
            self.server.feed(owner, &answer.frame);
        }
        let references = taken(self.server.tick(&on_time([PositionNm(0); 3])));
        let mut frames = Vec::new();
        while let Some((_, frame)) = self.server.poll_transmit() {
            frames.push(frame.to_vec());
        }
        for frame in frames {
            self.hear(&frame);
        }
        references
    }

    /// Sends bytes that are not the owner's.
    fn send(&mut self, bytes: &[u8], as_owner: bool) {
        match self.owner.filter(|_| as_owner) {
            Some(owner) => drop(self.server.feed(owner, bytes)),
            None => match self.server.greet(&PEERS[1], bytes) {
                Greeted::Nothing => {}
                Greeted::Answer(answer) => {
                    assert!(answer.len() <= bytes.len(), "T28: the answer is not longer");
                }
                Greeted::Peer(_) => panic!("T28: no peer without the key gets a place"),
            },
        }
    }

    /// Does what an act says; returns the rest of the input.
    fn act<'a>(&mut self, act: [u8; ACT], rest: &'a [u8]) -> &'a [u8] {
        let [kind, frame, low, high] = act;
        let number = usize::from(u16::from_le_bytes([low, high]));
        let of = |frames: &[Vec<u8>]| frames[usize::from(frame) % frames.len()].clone();
        let mut recorded = of(&self.recorded);
        let flipped = |mut frame: Vec<u8>| {
            let bit = number % (8 * frame.len());
            frame[bit / 8] ^= 1 << (bit % 8);
            frame
        };
        match kind % 9 {
            acts::FLIP => self.send(&flipped(recorded), true),
            acts::FLIP_AS_STRANGER => self.send(&flipped(recorded), false),
            acts::REPLAY => self.send(&recorded, true),
            acts::REPLAY_AS_STRANGER => self.send(&recorded, false),
            acts::CUT => {
                recorded.truncate(number % (recorded.len() + 1));
                self.send(&recorded, true);
            }
            acts::REFLECT => {
                let event = self.client.feed(&of(&self.said)).poll_event();
                assert_eq!(event, None, "T27: a client does not take its own frames");
            }
            kind => {
                let (raw, rest) = rest.split_at(rest.len().min(number % 128));
                self.send(raw, kind == acts::RAW);
                return rest;
            }
        }
        rest
    }
}

/// Acts of four bytes each, in any number of ticks.
pub fn greeting(data: &[u8]) {
    let (mut quiet, mut disturbed) = (Scene::obtaining(), Scene::obtaining());
    let (mut rest, mut in_tick, mut ticks) = (data, 0, 0);
    while let Some((act, behind)) = rest.split_first_chunk::<ACT>() {
        rest = behind;
        if act[0] % 9 == acts::TICK || in_tick == ACTS {
            in_tick = 0;
            ticks += 1;
            if ticks > TICKS {
                return;
            }
            let target_nm = 40_000 * i32::from(i8::from_le_bytes([act[1]]));
            let expected = quiet.turn(target_nm);
            let references = disturbed.turn(target_nm);
            assert_eq!(references, expected, "T27: a forgery moves nothing");
            let state = &disturbed.server.output().unwrap().state;
            assert_eq!(
                (state.phase, state.counters.missed),
                (Phase::Obtain, 0),
                "T27: a forgery costs nothing"
            );
        } else {
            in_tick += 1;
            rest = disturbed.act(*act, behind);
        }
    }
}
