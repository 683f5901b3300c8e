//! The holder of a key, and strangers.

use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::keys::{Cookie, Key, MacKey, Role, SessionOf};
use gantry_tau_core::control::message::{
    Capabilities, ClientMessage, Hello, KeyedHello, Mode, Phase,
};
use gantry_tau_core::control::session::Connection;
use gantry_tau_core::control::wire::{FrameBytes, HEADER_LEN, Kind, enclose, encode_client};
use gantry_tau_core::units::Sequence;
use gantry_tau_tests::client::Noise;

use super::recorder::{Recorder, along, pushing};
use super::{CYCLES, Recording};
use crate::firmware::keys;
use crate::firmware::machine::{CycleInput, Motion};

const NONCE: [u8; 16] = [7; 16];

/// Circumstances of a recording.
pub(super) struct Terms {
    pub(super) name: &'static str,
    pub(super) motion: Motion,
    /// The client wants its States with tags.
    pub(super) tags_states: bool,
    /// Others try what they can.
    pub(super) strangers: bool,
}

/// A session whose cable is pulled; then a second one, which ends with a Goodbye.
pub(super) fn record(terms: &Terms) -> Recording {
    let motion = terms.motion;
    let mut recorder = Recorder::new(motion, along(motion, 0), keys::server);
    let mut noise = Noise::new(11);
    let mut holder: Option<Holder> = None;
    let (mut heard, mut strangers) = (Vec::<FrameBytes>::new(), Vec::new());
    while recorder.cycles < CYCLES {
        let cycle = recorder.cycles;
        let is_pulled = (7_000..7_500).contains(&cycle);
        match &mut holder {
            None if !is_pulled && recorder.phase() == Phase::Listening && cycle < 9_900 => {
                if let Some(connection) = recorder.open(Transport::Stream) {
                    let one = holder.insert(Holder::new(connection, terms.tags_states));
                    recorder.feed(connection, &one.hello());
                }
            }
            Some(one) if !is_pulled => one.speak(&mut recorder, &mut noise, terms.strangers),
            _ => {}
        }
        if terms.strangers {
            heard.extend(holder.as_ref().map(Holder::hello));
            let kept = heard.len().saturating_sub(4);
            heard.drain(..kept);
            disturb(&mut recorder, &mut noise, &mut strangers, &heard);
        }
        let (frames, closed) = recorder.cycle(&CycleInput {
            load: pushing(cycle, &mut noise),
            ..CycleInput::on_time(motion, along(motion, cycle))
        });
        if let Some(one) = &mut holder {
            let own = one.connection;
            for (_, frame) in frames.iter().filter(|(to, _)| *to == own) {
                one.hear(&mut recorder, frame);
            }
        }
        strangers.retain(|one| !closed.contains(one));
        holder = holder.filter(|one| !closed.contains(&one.connection));
    }
    recorder.finish(terms.name)
}

/// One of the strangers, who have heard these Hellos, says what opens nothing.
fn disturb(
    recorder: &mut Recorder,
    noise: &mut Noise,
    strangers: &mut Vec<Connection>,
    heard: &[FrameBytes],
) {
    strangers.extend(recorder.open(Transport::Stream));
    if strangers.is_empty() {
        return;
    }
    let stranger = strangers[noise.below(strangers.len())];
    let hello = heard
        .get(noise.below(heard.len().max(1)))
        .map(|hello| hello.to_vec());
    let bytes = match (noise.below(4), hello) {
        (0, Some(mut forged)) => {
            let place = HEADER_LEN + noise.below(forged.len() - HEADER_LEN);
            forged[place] ^= 1;
            forged
        }
        (1 | 2, Some(recorded)) => recorded,
        _ => noise.bytes(64),
    };
    recorder.feed(stranger, &bytes);
}

/// The client that has the key.
struct Holder {
    connection: Connection,
    key: Key,
    tags_states: bool,
    cookie: Cookie,
    is_challenged: bool,
    session: Option<MacKey>,
}

impl Holder {
    fn new(connection: Connection, tags_states: bool) -> Self {
        Self {
            connection,
            key: Key::new(&keys::SECRET, Role::Control),
            tags_states,
            cookie: [0; 16],
            is_challenged: false,
            session: None,
        }
    }

    fn hello(&self) -> FrameBytes {
        let capabilities = if self.tags_states {
            Capabilities::TAGGED_STATES
        } else {
            Capabilities::NONE
        };
        let hello = Hello {
            axes: 6,
            capabilities,
        };
        let mut frame = enclose(
            Kind::KeyedHello,
            &KeyedHello {
                hello,
                key: self.key.id(),
                nonce: NONCE,
                cookie: self.cookie,
            },
        );
        frame.tag(self.key.greeting(), &[]);
        frame
    }

    /// Takes note of a frame: a Challenge, a Welcome.
    fn hear(&mut self, recorder: &mut Recorder, frame: &[u8]) {
        if frame[3] == Kind::Challenge.code() {
            self.cookie = *frame[HEADER_LEN..].first_chunk().unwrap();
            self.is_challenged = true;
        } else if frame[3] == Kind::Welcome.code() {
            let welcome = recorder.session().welcome();
            self.session = Some(self.key.session(&SessionOf {
                nonce: NONCE,
                cookie: self.cookie,
                epoch: welcome.epoch,
                axes: 6,
                kinematics_checksum: welcome.kinematics_checksum,
            }));
        }
    }

    /// Answers a Challenge, or the last State. A client of bad manners sends three Commands at once now
    /// and then.
    fn speak(&mut self, recorder: &mut Recorder, noise: &mut Noise, is_rude: bool) {
        if std::mem::take(&mut self.is_challenged) {
            return recorder.feed(self.connection, &self.hello());
        }
        let Some(session) = &self.session else {
            return;
        };
        let cycle = recorder.cycles;
        if cycle >= 9_900 {
            let epoch = recorder.session().epoch();
            let mut frame = encode_client::<6>(&ClientMessage::Goodbye(epoch));
            frame.tag(session, &[]);
            return recorder.feed(self.connection, &frame);
        }
        let mode = if recorder.phase() == Phase::Obtain || cycle % 100 == 99 {
            Mode::Obtain
        } else {
            Mode::Submit
        };
        let commands = if is_rude && noise.below(50) == 0 {
            3
        } else {
            1
        };
        for ahead in 0..commands {
            let mut command = recorder.command(mode, recorder.corrections());
            command.sequence = Sequence(command.sequence.0 + ahead);
            let mut frame = encode_client(&ClientMessage::Command(command));
            frame.tag(session, &[]);
            // In two pieces, cut anywhere.
            let (head, tail) = frame.split_at(noise.below(frame.len()));
            recorder.feed(self.connection, head);
            recorder.feed(self.connection, tail);
        }
    }
}
