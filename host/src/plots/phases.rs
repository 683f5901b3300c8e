//! Phases of a session in plots: colours, and the stretches of time they fill.

use gantry_tau_core::control::message::Phase;
use plotters::style::RGBColor;

use super::Band;

/// Background colours, in the order of [`Phase::ALL`].
const COLOURS: [RGBColor; 6] = [
    RGBColor(225, 225, 225),
    RGBColor(250, 240, 190),
    RGBColor(205, 225, 245),
    RGBColor(205, 235, 205),
    RGBColor(250, 215, 190),
    RGBColor(240, 190, 190),
];

/// Range of the x axis in which one phase lasts.
pub(crate) struct Stretch {
    pub(crate) from: f64,
    pub(crate) to: f64,
    pub(crate) phase: Phase,
}

/// Splits points into stretches of one phase; each reaches to the beginning of the next.
pub(crate) fn stretches(points: impl IntoIterator<Item = (f64, Phase)>) -> Vec<Stretch> {
    let mut stretches: Vec<Stretch> = Vec::new();
    for (x, phase) in points {
        let last = stretches.last_mut();
        let same = last.as_ref().is_some_and(|last| last.phase == phase);
        if let Some(last) = last {
            last.to = x;
        }
        if !same {
            let (from, to) = (x, x);
            stretches.push(Stretch { from, to, phase });
        }
    }
    stretches
}

/// Returns the stretches as coloured bands.
pub(crate) fn bands(points: impl IntoIterator<Item = (f64, Phase)>) -> Vec<Band> {
    let band = |stretch: Stretch| Band {
        from: stretch.from,
        to: stretch.to,
        colour: COLOURS.get(usize::from(stretch.phase.code())).copied().unwrap_or_default(),
    };
    stretches(points).into_iter().map(band).collect()
}

/// Returns name and CSS colour of every phase.
pub(crate) fn key() -> impl Iterator<Item = (&'static str, String)> {
    let css = |RGBColor(r, g, b): RGBColor| format!("rgb({r},{g},{b})");
    let names = Phase::ALL.iter().map(|phase| phase.name());
    names.zip(COLOURS.map(css))
}
