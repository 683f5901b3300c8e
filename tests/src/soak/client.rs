//! Clients of all characters: what they say to what they hear, over either transport.

use std::time::Duration;

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::client::{Client as Dialogue, ClientError, Event, Requirements};
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{ClientMessage, Command, Mode, Refusal};
use gantry_tau_core::control::wire::encode_client;
use gantry_tau_core::units::{OffsetNm, Sequence, TorquePermille, VelocityUmS};

use super::cause_attribution::ClientFault;
use crate::client::Noise;

/// Largest offset a client asks for, nm; ramps stay some hundred ticks long.
const REACH_NM: i32 = 40_000;
/// Silence of the server after which a client gives up.
const PATIENCE: Duration = Duration::from_millis(60);

/// A client: answers every State, until it has had enough.
pub(super) struct Client<const N: usize> {
    dialogue: Dialogue<N>,
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
    pub(super) fn new(transport: Transport, noise: &mut Noise) -> Self {
        Self {
            dialogue: Dialogue::new(transport, Requirements::default()),
            life: noise.below(600),
            obtain_from: noise.below(60),
            states: 0,
            deed: ClientFault::ALL[noise.below(ClientFault::ALL.len())],
            deed_done: None,
            last_heard: None,
            gone: false,
        }
    }

    /// Returns its first word.
    pub(super) fn hello(&mut self) -> Vec<u8> {
        self.dialogue
            .hello()
            .expect("nothing was said before")
            .to_vec()
    }

    /// Returns its answers to the bytes it receives.
    pub(super) fn live(
        &mut self,
        now: Duration,
        heard: &[Vec<u8>],
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
            let mut rest = bytes.as_slice();
            while !self.gone {
                let mut received = self.dialogue.feed(rest);
                let Some(event) = received.poll_event() else {
                    break;
                };
                rest = &rest[rest.len() - received.left()..];
                match event {
                    Ok(Event::State(_)) => said.extend(self.answer(now, noise)),
                    Ok(Event::Refused(refusal)) => {
                        // The axes of a corrupt Hello are behind a checksum.
                        assert!(!matches!(refusal, Refusal::Axes { .. }));
                        self.leave(now);
                    }
                    // Links say things twice.
                    Ok(_) | Err(ClientError::OldState { .. } | ClientError::Unexpected { .. }) => {}
                    // Links break frames, in both directions, and fall silent in one.
                    Err(
                        ClientError::Frame(_)
                        | ClientError::Notice(_)
                        | ClientError::GoodbyeUnheard { .. },
                    ) => self.leave(now),
                    Err(error) => panic!("the server breaks the protocol: {error}"),
                }
            }
        }
        said
    }

    /// Closes; a deed of its own, unless another one was the last.
    fn leave(&mut self, now: Duration) {
        self.gone = true;
        self.deed_done.get_or_insert((ClientFault::Close, now));
    }

    /// Returns the answer to the newest State.
    fn answer(&mut self, now: Duration, noise: &mut Noise) -> Vec<Vec<u8>> {
        self.states += 1;
        match self.deed_done {
            None if self.states < self.life => {
                return self.command(noise).iter().map(frame).collect();
            }
            None => self.deed_done = Some((self.deed, now)),
            // Over datagrams it is repeated.
            Some((ClientFault::Goodbye, _)) => {}
            Some(_) => return Vec::new(),
        }
        match self.deed {
            ClientFault::Goodbye => self
                .dialogue
                .goodbye()
                .iter()
                .map(|frame| frame.to_vec())
                .collect(),
            ClientFault::Stop => self
                .dialogue
                .stop()
                .iter()
                .map(|frame| frame.to_vec())
                .collect(),
            ClientFault::Flood => {
                let first = self.command(noise);
                let all = first.iter().flat_map(|first| {
                    (0..12).map(move |ahead| Command {
                        sequence: Sequence(first.sequence.0 + ahead),
                        ..*first
                    })
                });
                all.map(|command| frame(&command)).collect()
            }
            ClientFault::Garbage => vec![noise.bytes(20)],
            ClientFault::Close => {
                self.gone = true;
                Vec::new()
            }
            ClientFault::Silence => Vec::new(),
        }
    }

    fn command(&mut self, noise: &mut Noise) -> Option<Command<N>> {
        let span = usize::try_from(2 * REACH_NM).unwrap();
        let pushes = noise.below(10) == 0;
        let targets = std::array::from_fn(|_| Offsets {
            position: OffsetNm(i32::try_from(noise.below(span)).unwrap() - REACH_NM),
            velocity: VelocityUmS(if pushes { 1_000 } else { 0 }),
            torque: TorquePermille(0),
        });
        // Now and then back to Submit for a while.
        let obtains = self.states > self.obtain_from && self.states % 200 < 170;
        let mode = if obtains { Mode::Obtain } else { Mode::Submit };
        let mut command = self.dialogue.answer(mode, &targets)?.command;
        // Beyond the limit now and then, never twice in a row: it costs the frame.
        if command.sequence.0 % 97 == 50 {
            command
                .targets
                .iter_mut()
                .for_each(|target| target.torque = TorquePermille(51));
        }
        Some(command)
    }
}

fn frame<const N: usize>(command: &Command<N>) -> Vec<u8> {
    encode_client(&ClientMessage::Command(*command)).to_vec()
}
