//! Phases of a session in plots: colours, and the stretches of time they fill.

use gantry_tau_core::control::message::Phase;

use super::Band;
use crate::svg::Colour;

/// Range of the x axis in which one phase lasts.
pub(super) struct Stretch {
    /// Its beginning.
    pub(super) from: f64,
    /// Its end.
    pub(super) to: f64,
    /// The phase.
    pub(super) phase: Phase,
}

/// Splits points into stretches of one phase; each reaches to the beginning of the next.
pub(super) fn stretches(points: impl IntoIterator<Item = (f64, Phase)>) -> Vec<Stretch> {
    let mut stretches: Vec<Stretch> = Vec::new();
    for (x, phase) in points {
        let last = stretches.last_mut();
        let same = last.as_ref().is_some_and(|last| last.phase == phase);
        if let Some(last) = last {
            last.to = x;
        }
        if !same {
            stretches.push(Stretch {
                from: x,
                to: x,
                phase,
            });
        }
    }
    stretches
}

/// Returns the stretches as coloured bands.
pub fn bands(points: impl IntoIterator<Item = (f64, Phase)>) -> Vec<Band> {
    let bands = stretches(points).into_iter().map(|stretch| Band {
        name: stretch.phase.name(),
        from: stretch.from,
        to: stretch.to,
        colour: colour(stretch.phase),
    });
    bands.collect()
}

/// Background colour of a phase.
const fn colour(phase: Phase) -> Colour {
    match phase {
        Phase::Listening => Colour::of(0xe1_e1_e1).named("phase-0"),
        Phase::Handshake => Colour::of(0xfa_f0_be).named("phase-1"),
        Phase::Submit => Colour::of(0xcd_e1_f5).named("phase-2"),
        Phase::Obtain => Colour::of(0xcd_eb_cd).named("phase-3"),
        Phase::SafeDisconnect => Colour::of(0xfa_d7_be).named("phase-4"),
        Phase::Fault => Colour::of(0xf0_be_be).named("phase-5"),
    }
}
