//! Plots over time, with the phases of the session behind them.

use gantry_tau_core::control::message::Phase;

use super::{Corner, Curve, Plot, phases};

/// Largest number of points of a curve; limits the size of the page.
const CURVE_POINTS: usize = 1_500;

/// A value that belongs to a moment of a session.
pub(crate) trait Timed {
    /// Time, s.
    fn seconds(&self) -> f64;
    /// State of the server.
    fn phase(&self) -> Phase;
}

/// Returns a plot over time, with the phases as bands.
pub(crate) fn plot<S: Timed>(y_axis: &'static str, curves: Vec<Curve>, samples: &[S]) -> Plot {
    Plot {
        x_axis: "time, s",
        y_axis,
        curves,
        bands: phases::bands(phases_of(samples)),
        y_names: Vec::new(),
        key: Corner::UpperLeft,
    }
}

/// Returns a curve for each of `C` values, of at most [`CURVE_POINTS`] evenly chosen samples.
pub(crate) fn curves<S: Timed, const C: usize>(
    names: [String; C],
    samples: &[S],
    values: impl Fn(&S) -> [f64; C],
) -> Vec<Curve> {
    let every = samples.len().div_ceil(CURVE_POINTS).max(1);
    let mut curves = names.map(|name| Curve::line(&name, Vec::new()));
    for sample in samples.iter().step_by(every) {
        for (curve, value) in curves.iter_mut().zip(values(sample)) {
            curve.points.push((sample.seconds(), value));
        }
    }
    curves.into()
}

/// Returns the state of the server over time.
pub(crate) fn states<S: Timed>(samples: &[S]) -> Plot {
    // Two points per stretch draw a step, however short.
    let stretches = phases::stretches(phases_of(samples));
    let points = stretches.iter().flat_map(|stretch| {
        let level = f64::from(stretch.phase.code());
        [(stretch.from, level), (stretch.to, level)]
    });
    let curves = vec![
        Curve::line("state", points.collect()),
        // Extends the axis to all six names.
        Curve { no_line: true, ..Curve::line("", vec![(0.0, 0.0), (0.0, 5.0)]) },
    ];
    Plot { y_names: Phase::ALL.iter().map(|phase| phase.name()).collect(), ..plot("", curves, samples) }
}

/// Returns the names of the axes, counted from 1.
pub(crate) fn axis_names<const N: usize>() -> [String; N] {
    std::array::from_fn(|axis| format!("axis {}", axis + 1))
}

fn phases_of<S: Timed>(samples: &[S]) -> impl Iterator<Item = (f64, Phase)> {
    samples.iter().map(|sample| (sample.seconds(), sample.phase()))
}
