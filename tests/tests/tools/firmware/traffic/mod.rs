//! Recordings. They are made by playing, because a client's frames depend on the server's.

mod calm;
mod hostile;
mod keyed;
mod recorder;
mod socket;

use std::f64::consts::FRAC_PI_2;
use std::sync::OnceLock;

use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::Phase;
use gantry_tau_core::control::session::Session;

use super::host::{Floats, play};
use super::machine::{AXES, Motion, Server};
use keyed::Terms;

use super::recording::{MAX_RECORD, Record, transfer};

/// Cycles of a recording.
pub(crate) const CYCLES: u32 = 10_000;

/// Input of host and target.
pub(crate) struct Recording {
    /// Its name.
    pub(crate) name: &'static str,
    /// As `recording.rs` reads it.
    pub(crate) bytes: Vec<u8>,
    /// The outcome while it was made.
    pub(crate) output: Vec<u8>,
    /// For every cycle: true if its floats are those of the F1.
    pub(crate) f1: Vec<bool>,
    /// For every cycle: true if it greets under a key: no session runs, or one is granted.
    pub(crate) greetings: Vec<bool>,
    /// Its server.
    pub(crate) serve: Serve,
}

/// Maker of the server of a session.
pub(crate) type Serve = fn(Session<AXES>) -> Server;

/// Two calm sessions with the L2's kinematics; the first ends with a pulled cable.
pub(crate) fn calm() -> &'static Recording {
    static MADE: OnceLock<Recording> = OnceLock::new();
    MADE.get_or_init(|| calm::record("calm", Motion::L2))
}

/// The same with the F1's.
pub(crate) fn calm_f1() -> &'static Recording {
    static MADE: OnceLock<Recording> = OnceLock::new();
    MADE.get_or_init(|| calm::record("calm_f1", Motion::F1))
}

/// Everything that clients, drives, a sensor and a machine can do wrong.
pub(crate) fn hostile() -> &'static Recording {
    static MADE: OnceLock<Recording> = OnceLock::new();
    MADE.get_or_init(hostile::record)
}

/// Sessions under a key: of the L2 with and without tags of States, of the F1, and one that strangers
/// disturb.
pub(crate) fn keyed() -> &'static [Recording; 4] {
    static MADE: OnceLock<[Recording; 4]> = OnceLock::new();
    let terms = [
        ("commands", Motion::L2, false, false),
        ("calm", Motion::L2, true, false),
        ("calm_f1", Motion::F1, true, false),
        ("hostile", Motion::L2, true, true),
    ];
    MADE.get_or_init(|| {
        terms.map(|(name, motion, tags_states, strangers)| {
            keyed::record(&Terms {
                name,
                motion,
                tags_states,
                strangers,
            })
        })
    })
}

/// Returns a record as it stands in a recording.
pub(crate) fn encode(record: &Record<'_>) -> Vec<u8> {
    let bytes = match record {
        Record::Open(Transport::Stream) => vec![0],
        Record::Open(Transport::Datagram) => vec![1],
        Record::Close(connection) => [&[2][..], &connection.0.to_le_bytes()].concat(),
        Record::Bytes(from, bytes) => [&[3][..], &from.0.to_le_bytes(), bytes].concat(),
        Record::Cycle(input) => {
            let (mut input, mut bytes) = (**input, vec![4]);
            let written = transfer(&mut input, &mut |word| {
                bytes.extend(word);
                Some(word)
            });
            written.unwrap();
            bytes
        }
        Record::End => vec![5],
    };
    assert!(bytes.len() <= MAX_RECORD);
    let length = u16::try_from(bytes.len()).unwrap();
    [&length.to_le_bytes(), &*bytes].concat()
}

/// All recordings.
pub(crate) fn all() -> [&'static Recording; 3] {
    [calm(), calm_f1(), hostile()]
}

fn ticks_in(phases: &[Phase], phase: Phase) -> usize {
    phases.iter().filter(|one| **one == phase).count()
}

/// The recordings reach every phase.
pub(crate) fn recordings_show_every_phase() {
    for recording in [calm(), calm_f1()] {
        let phases = play(&recording.bytes, recording.serve).seen.phases;
        assert_eq!(phases.len(), 10_000);
        assert!(ticks_in(&phases, Phase::Obtain) > 5_000);
        for phase in [Phase::Listening, Phase::Submit, Phase::SafeDisconnect] {
            assert!(
                ticks_in(&phases, phase) > 0,
                "{}: no {phase:?}",
                recording.name
            );
        }
    }
    let phases = play(&hostile().bytes, hostile().serve).seen.phases;
    assert!(phases.len() >= 10_000);
    for phase in [
        Phase::Listening,
        Phase::Handshake,
        Phase::Submit,
        Phase::Obtain,
        Phase::SafeDisconnect,
        Phase::Fault,
    ] {
        let ticks = ticks_in(&phases, phase);
        println!("hostile: {ticks} ticks in {phase:?}");
        assert!(ticks > 50, "hostile: hardly any {phase:?}");
    }
}

/// Under a key sessions run as they do without one, strangers or not; who has no key is counted.
pub(crate) fn recordings_with_keys_show_strangers() {
    for recording in keyed() {
        let seen = play(&recording.bytes, recording.serve).seen;
        let obtained = ticks_in(&seen.phases, Phase::Obtain);
        println!(
            "{}: {obtained} ticks in Obtain, {} not authentic",
            recording.name, seen.not_authentic
        );
        assert!(
            obtained > 5_000,
            "{}: {obtained} ticks in Obtain",
            recording.name
        );
        let is_disturbed = seen.not_authentic > 300;
        assert_eq!(
            is_disturbed,
            recording.name == "hostile",
            "{}",
            recording.name
        );
    }
}

/// The hostile recording has the deepest cycles of the F1: plates beyond a quarter turn, whose sine
/// is reduced first, and results after an error.
pub(crate) fn the_f1_turns_far_and_recovers() {
    let floats = play(&hostile().bytes, hostile().serve).seen.floats;
    let far = floats
        .iter()
        .filter(|one| matches!(one, Floats::F1 { turned_rad } if *turned_rad > FRAC_PI_2))
        .count();
    let recovered = floats
        .windows(2)
        .filter(|pair| matches!(pair, [Floats::F1Error, Floats::F1 { .. }]))
        .count();
    println!(
        "hostile: {far} ticks of the F1 beyond a quarter turn, {recovered} results after an error"
    );
    assert!(far > 100 && recovered > 10);
}
