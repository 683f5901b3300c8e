//! Clients of all characters: what they say to what they hear, whatever carries it.

use std::time::Duration;

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{ClientMessage, Command, Mode, Phase, Refusal, ServerMessage, State};
use gantry_tau_core::control::wire::{Deframer, Feed, Frame, decode_server, encode_client};
use gantry_tau_core::units::{Epoch, OffsetNm, Sequence, TorquePermille, VelocityUmS};

use super::audit::is_live;
use super::cause_attribution::ClientFault;
use crate::client::Noise;

/// Largest offset a client asks for, nm; ramps stay some hundred ticks long.
const REACH_NM: i32 = 40_000;
/// Silence of the server after which a client gives up.
const PATIENCE: Duration = Duration::from_millis(60);

/// A client: answers every State, until it has had enough.
pub(super) struct Client<const N: usize> {
    deframer: Deframer,
    epoch: Option<Epoch>,
    sequence: u64,
    /// States after which it does its deed; the first of them that it wants to obtain from.
    life: usize,
    obtain_from: usize,
    states: usize,
    deed: ClientFault,
    /// Its last deed, and the time.
    pub(super) deed_done: Option<(ClientFault, Duration)>,
    last_heard: Option<Duration>,
    /// It has closed.
    pub(super) gone: bool,
}

impl<const N: usize> Client<N> {
    pub(super) fn new(noise: &mut Noise) -> Self {
        Self {
            deframer: Deframer::new(),
            epoch: None,
            sequence: 0,
            life: noise.below(600),
            obtain_from: noise.below(60),
            states: 0,
            deed: ClientFault::ALL[noise.below(ClientFault::ALL.len())],
            deed_done: None,
            last_heard: None,
            gone: false,
        }
    }

    /// Returns its answers to the bytes it receives.
    pub(super) fn live(
        &mut self,
        now: Duration,
        heard: &[Vec<u8>],
        transport: Transport,
        noise: &mut Noise,
    ) -> Vec<Vec<u8>> {
        let mut said = Vec::new();
        let last_heard = *self.last_heard.get_or_insert(now);
        if !heard.is_empty() {
            self.last_heard = Some(now);
        } else if now - last_heard > PATIENCE {
            self.leave(now);
        }
        for bytes in heard {
            for message in self.messages(bytes, transport, now) {
                match message {
                    ServerMessage::Welcome(welcome) => self.epoch = Some(welcome.epoch),
                    ServerMessage::Refusal(refusal) => {
                        // A corrupt Hello may be of another version; its axes are behind a checksum.
                        assert!(!matches!(refusal, Refusal::Axes { .. }));
                        self.leave(now);
                    }
                    ServerMessage::State(state) => said.extend(self.answer(&state, now, noise)),
                }
            }
        }
        said
    }

    /// Returns the messages in the bytes. A broken stream is closed, a broken datagram is lost.
    fn messages(&mut self, bytes: &[u8], transport: Transport, now: Duration) -> Vec<ServerMessage<N>> {
        if transport == Transport::Datagram {
            let message = Frame::parse(bytes).ok().map(|frame| decode_server(&frame));
            return message.into_iter().flatten().collect();
        }
        let mut messages = Vec::new();
        let mut rest = bytes;
        while !rest.is_empty() {
            match self.deframer.feed(rest) {
                Feed::Incomplete => break,
                Feed::Frame { frame, consumed } => {
                    messages.extend(decode_server(&frame));
                    rest = &rest[consumed..];
                }
                Feed::Broken(_) => {
                    self.leave(now);
                    break;
                }
            }
        }
        messages
    }

    /// Closes; a deed of its own, unless another one was the last.
    fn leave(&mut self, now: Duration) {
        self.gone = true;
        self.deed_done.get_or_insert((ClientFault::Close, now));
    }

    fn answer(&mut self, state: &State<N>, now: Duration, noise: &mut Noise) -> Vec<Vec<u8>> {
        self.states += 1;
        let over = !is_live(state.phase) || self.gone;
        let (Some(epoch), None, false) = (self.epoch, self.deed_done, over) else {
            return Vec::new();
        };
        let frame = |message: ClientMessage<N>| encode_client(&message).to_vec();
        if self.states < self.life {
            return vec![frame(self.command(epoch, state, noise))];
        }
        self.deed_done = Some((self.deed, now));
        match self.deed {
            ClientFault::Goodbye => vec![frame(ClientMessage::Goodbye(epoch))],
            ClientFault::Stop => vec![frame(ClientMessage::Stop(epoch))],
            ClientFault::Flood => (0..12).map(|_| frame(self.command(epoch, state, noise))).collect(),
            ClientFault::Garbage => vec![noise.bytes(20)],
            ClientFault::Close => {
                self.gone = true;
                Vec::new()
            }
            ClientFault::Silence => Vec::new(),
        }
    }

    fn command(&mut self, epoch: Epoch, state: &State<N>, noise: &mut Noise) -> ClientMessage<N> {
        self.sequence += 1;
        let obtains = self.states > self.obtain_from && state.phase != Phase::Handshake;
        let span = usize::try_from(2 * REACH_NM).unwrap();
        let target = |noise: &mut Noise| i32::try_from(noise.below(span)).unwrap() - REACH_NM;
        let pushes = noise.below(10) == 0;
        ClientMessage::Command(Command {
            epoch,
            sequence: Sequence(self.sequence),
            echo: state.tick,
            // Now and then back to Submit for a while.
            mode: if obtains && self.states % 200 < 170 { Mode::Obtain } else { Mode::Submit },
            targets: std::array::from_fn(|_| Offsets {
                position: OffsetNm(target(noise)),
                velocity: VelocityUmS(if pushes { 1_000 } else { 0 }),
                // Beyond the limit now and then, never twice in a row: it costs the frame.
                torque: TorquePermille(if self.sequence % 97 == 50 { 51 } else { 0 }),
            }),
        })
    }
}
