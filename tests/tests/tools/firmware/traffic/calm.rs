//! Clients that do everything right.

use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{Capabilities, ClientMessage, Hello, Mode, Phase};
use gantry_tau_core::control::session::fsm::Connection;
use gantry_tau_core::control::wire::encode_client;
use gantry_tau_core::units::Epoch;
use gantry_tau_tests::client::Noise;

use super::author::{Author, along, moment, pushing};
use super::{Recording, TICKS};
use crate::firmware::machine::{Moment, Motion};

/// A client that does everything right, but for a pulled cable; then a second session, which ends with a Goodbye.
pub(super) fn record(name: &'static str, motion: Motion) -> Recording {
    let mut author = Author::new(&motion, along(&motion, 0));
    let mut noise = Noise::new(7);
    let mut client = None;
    while author.ticks < TICKS {
        let tick = author.ticks;
        // Pulled without a word; nobody hears of it for 500 ticks.
        let pulled = (7_000..7_500).contains(&tick);
        match client {
            None if !pulled && author.phase() == Phase::Listening && tick < 9_900 => {
                client = author.open(Transport::Stream);
                let hello = Hello {
                    axes: 6,
                    capabilities: Capabilities::NONE,
                };
                author.say(client.unwrap(), &ClientMessage::Hello(hello));
            }
            Some(connection) if !pulled => author.answer_calmly(connection, &mut noise),
            _ => {}
        }
        let next_epoch = Epoch(author.next_epoch);
        let gone = author.tick(&Moment {
            next_epoch,
            load: pushing(tick, &mut noise),
            ..moment(motion, along(&motion, tick))
        });
        client = client.filter(|connection| !gone.contains(connection));
    }
    author.finish(name)
}

impl Author {
    fn answer_calmly(&mut self, connection: Connection, noise: &mut Noise) {
        let tick = self.ticks;
        if tick == 9_900 {
            let epoch = self.session().parts().discrete.epoch;
            return self.say(connection, &ClientMessage::Goodbye(epoch));
        }
        let mode = match self.phase() {
            Phase::Submit if tick % 100 == 99 => Mode::Obtain,
            Phase::Obtain => Mode::Obtain,
            _ => Mode::Submit,
        };
        let targets = self.corrections();
        let command = ClientMessage::Command(self.command(mode, targets));
        let bytes = encode_client(&command);
        // In two pieces, wherever they are cut.
        let (one, other) = bytes.split_at(noise.below(bytes.len()));
        self.feed(connection, one);
        self.feed(connection, other);
    }
}
