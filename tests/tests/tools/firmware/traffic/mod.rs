//! Recordings: they are made by playing, for what a client says depends on what it is told.

mod author;
mod calm;
mod hostile;
mod socket;

use std::f64::consts::FRAC_PI_2;
use std::sync::OnceLock;

use gantry_tau_core::control::message::Phase;

use super::host::{Floats, play};
use super::machine::Motion;

/// Ticks of a recording.
pub(crate) const TICKS: u32 = 10_000;

/// What is played on host and target.
pub(crate) struct Recording {
    /// Its name.
    pub(crate) name: &'static str,
    /// As `recording.rs` reads it.
    pub(crate) bytes: Vec<u8>,
    /// The output while it was made.
    pub(crate) output: Vec<u8>,
    /// Of every tick, whether its floats are those of the F1.
    pub(crate) f1: Vec<bool>,
}

/// A calm session with the L2's kinematics, towards the end of which the cable is pulled.
pub(crate) fn calm() -> &'static Recording {
    static MADE: OnceLock<Recording> = OnceLock::new();
    MADE.get_or_init(|| calm::record("calm", Motion::L2))
}

/// The same with the F1's.
pub(crate) fn calm_f1() -> &'static Recording {
    static MADE: OnceLock<Recording> = OnceLock::new();
    MADE.get_or_init(|| calm::record("calm_f1", Motion::F1))
}

/// Whatever a client, a stranger, a sensor and a machine can do wrong.
pub(crate) fn hostile() -> &'static Recording {
    static MADE: OnceLock<Recording> = OnceLock::new();
    MADE.get_or_init(hostile::record)
}

/// All of them.
pub(crate) fn all() -> [&'static Recording; 3] {
    [calm(), calm_f1(), hostile()]
}

/// A recording that never leaves Listening would compare nothing.
pub(crate) fn recordings_show_every_phase() {
    let ticks_in = |phases: &[Phase], phase| phases.iter().filter(|one| **one == phase).count();
    for recording in [calm(), calm_f1()] {
        let phases = play(&recording.bytes).seen.phases;
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
    let phases = play(&hostile().bytes).seen.phases;
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

/// Where a cycle of the F1 is deepest, and where it begins anew: plates beyond a quarter turn, whose sine is reduced first, and an answer
/// after a refusal.
pub(crate) fn the_f1_turns_far_and_recovers() {
    let floats = play(&hostile().bytes).seen.floats;
    let is_far =
        |one: &&Floats| matches!(one, Floats::F1 { turned_rad } if *turned_rad > FRAC_PI_2);
    let far = floats.iter().filter(is_far).count();
    let recovers = |pair: &&[Floats]| matches!(pair, [Floats::F1Refused, Floats::F1 { .. }]);
    let recovered = floats.windows(2).filter(recovers).count();
    println!(
        "hostile: {far} ticks of the F1 beyond a quarter turn, {recovered} answers after a refusal"
    );
    assert!(far > 100 && recovered > 10);
}
