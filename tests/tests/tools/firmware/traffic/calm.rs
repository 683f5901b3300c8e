//! A client that follows the protocol.

use gantry_tau_core::control::client::{Client, Requirements};
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{Mode, Phase};
use gantry_tau_core::control::session::Connection;
use gantry_tau_tests::client::Noise;

use super::recorder::{Recorder, along, pushing};
use super::{CYCLES, Recording};
use crate::firmware::machine::{AXES, CycleInput, Motion};
use crate::firmware::no_keys;

/// A session whose cable is pulled; then a second one, which ends with a Goodbye.
pub(super) fn record(name: &'static str, motion: Motion) -> Recording {
    let mut recorder = Recorder::new(motion, along(motion, 0), no_keys::server);
    let mut noise = Noise::new(7);
    let mut client: Option<(Connection, Client<AXES>)> = None;
    while recorder.cycles < CYCLES {
        let cycle = recorder.cycles;
        // For 500 cycles nothing arrives.
        let is_pulled = (7_000..7_500).contains(&cycle);
        match &mut client {
            None if !is_pulled && recorder.phase() == Phase::Listening && cycle < 9_900 => {
                let connection = recorder.open(Transport::Stream).unwrap();
                let (_, one) = client.insert((
                    connection,
                    Client::new(Transport::Stream, Requirements::default()),
                ));
                recorder.feed(connection, &one.hello().unwrap());
            }
            Some((connection, one)) if !is_pulled => {
                let mode = if one.phase() == Some(Phase::Obtain) || cycle % 100 == 99 {
                    Mode::Obtain
                } else {
                    Mode::Submit
                };
                let frame = if cycle >= 9_900 {
                    one.goodbye()
                } else {
                    let answer = one.answer(mode, &recorder.corrections());
                    answer.map(|answer| answer.frame)
                };
                // In two pieces, cut anywhere.
                if let Some(frame) = frame {
                    let (head, tail) = frame.split_at(noise.below(frame.len()));
                    recorder.feed(*connection, head);
                    recorder.feed(*connection, tail);
                }
            }
            _ => {}
        }
        let (frames, closed) = recorder.cycle(&CycleInput {
            load: pushing(cycle, &mut noise),
            ..CycleInput::on_time(motion, along(motion, cycle))
        });
        if let Some((connection, one)) = &mut client {
            for (_, frame) in frames.iter().filter(|(to, _)| to == connection) {
                let mut received = one.feed(frame);
                while let Some(event) = received.poll_event() {
                    event.unwrap();
                }
            }
        }
        client = client.filter(|(connection, _)| !closed.contains(connection));
    }
    recorder.finish(name)
}
