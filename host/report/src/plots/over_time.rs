//! Plots over time, with the phases of the session behind them.

use gantry_tau_core::control::message::Phase;

use super::{Curve, Plot, phases};

/// A value that belongs to a moment of a session.
pub trait Timed {
    /// Time, s.
    fn seconds(&self) -> f64;
    /// State of the server.
    fn phase(&self) -> Phase;
}

/// Returns a plot over time, with the phases as bands.
pub fn plot<S: Timed>(title: &str, y_axis: &str, curves: Vec<Curve>, samples: &[S]) -> Plot {
    Plot::new(title, "time, s", y_axis, curves).with_bands(phases::bands(phases_of(samples)))
}

/// Returns a curve for each of `C` values.
pub fn curves<S: Timed, const C: usize>(
    names: [String; C],
    samples: &[S],
    values: impl Fn(&S) -> [f64; C],
) -> Vec<Curve> {
    let mut curves = names.map(|name| Curve::line(&name, Vec::with_capacity(samples.len())));
    for sample in samples {
        for (curve, value) in curves.iter_mut().zip(values(sample)) {
            curve.points.push((sample.seconds(), value));
        }
    }
    curves.into()
}

/// Returns the state of the server over time.
pub fn states<S: Timed>(title: &str, samples: &[S]) -> Plot {
    // Two points per stretch draw a step, however short.
    let stretches = phases::stretches(phases_of(samples));
    let points = stretches.iter().flat_map(|stretch| {
        let level = f64::from(stretch.phase.code());
        [(stretch.from, level), (stretch.to, level)]
    });
    let curves = vec![
        Curve::line("state", points.collect()),
        // The axis reaches to all six names.
        Curve::frame(vec![(f64::NAN, 0.0), (f64::NAN, 5.0)]),
    ];
    plot(title, "", curves, samples).with_names(Phase::ALL.iter().map(|phase| phase.name()))
}

/// Returns the names of the axes, counted from 1.
#[must_use]
pub fn axis_names<const N: usize>() -> [String; N] {
    std::array::from_fn(|axis| format!("axis {}", axis + 1))
}

fn phases_of<S: Timed>(samples: &[S]) -> impl Iterator<Item = (f64, Phase)> {
    samples
        .iter()
        .map(|sample| (sample.seconds(), sample.phase()))
}
