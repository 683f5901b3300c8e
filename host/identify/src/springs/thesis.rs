//! Springs as the thesis evaluated them `[T 3.3, 4.2.9]`, for comparison: a straight line per
//! spring through the windows of one series, the platform taken as if it did not turn.
//!
//! With `dT` the translation that the gauges on the platform show, and `dA = v c tau` the
//! displacement of a cart, a link is longer by `s . (dA - dT)` `[T 3.25, 3.29]`. What the platform
//! turns is taken as elongation of links, so values may be far off, or negative `[T Table 5.2]`.

mod page;
mod printed;

use gantry_tau_core::model::robot::LINKS;
use gantry_tau_machine::elastic::backlash::Backlash;
use gantry_tau_machine::elastic::gauge::{Body, Gauge};
use gantry_tau_machine::elastic::{ElasticMachine, Equilibrium};
use gantry_tau_system::output::Name;
use nalgebra::{DMatrix, DVector, SVector, Vector3, Vector6};

use crate::fit::least_squares::solve_linear;
use crate::fit::statistics::{float, students_t_95};
use crate::measurements::springs::Window;
use crate::springs::problem::SpringsProblem;
pub use page::page;

/// Lines of one series.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ThesisSprings {
    /// The series, by its name.
    pub(super) series: Name,
    /// Of the links: elongation, m, by tension, N.
    pub(super) links: [SpringLine; LINKS],
    /// Of the axes: displacement by load, in the units of their keys.
    pub(super) axes: Vec<SpringLine>,
}

/// Load and displacement of one spring, and the straight line through them.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct SpringLine {
    /// Load and displacement, window by window; empty where the gauges do not show it.
    pub(super) points: Vec<(f64, f64)>,
    /// Slope of the line; `None` where the load does not give one.
    pub(super) compliance: Option<f64>,
}

impl SpringLine {
    fn through(points: Vec<(f64, f64)>) -> Self {
        Self {
            compliance: slope(&points),
            points,
        }
    }

    /// Mean of load and displacement, which the line goes through.
    fn middle(&self) -> (f64, f64) {
        let count = float(self.points.len());
        let sums = self.points.iter().fold((0.0, 0.0), |(load, moved), point| {
            (load + point.0, moved + point.1)
        });
        (sums.0 / count, sums.1 / count)
    }

    /// Ends of the line, at the smallest and the largest load.
    fn ends(&self) -> Option<[(f64, f64); 2]> {
        let compliance = self.compliance?;
        let (load, moved) = self.middle();
        let loads = self.points.iter().map(|(load, _)| *load);
        let ends = [
            loads.clone().fold(f64::INFINITY, f64::min),
            loads.fold(f64::NEG_INFINITY, f64::max),
        ];
        Some(ends.map(|end| (end, moved + compliance * (end - load))))
    }

    /// Half-width of the 95 % interval of the slope, by the scatter about the line.
    fn half_width(&self) -> Option<f64> {
        let compliance = self.compliance?;
        let degrees = self
            .points
            .len()
            .checked_sub(2)
            .filter(|degrees| *degrees > 0)?;
        let (middle, moved) = self.middle();
        let spread: f64 = self
            .points
            .iter()
            .map(|(load, _)| (load - middle).powi(2))
            .sum();
        let left: f64 = self
            .points
            .iter()
            .map(|point| (point.1 - moved - compliance * (point.0 - middle)).powi(2))
            .sum();
        Some(students_t_95(degrees) * (left / float(degrees) / spread).sqrt())
    }
}

/// One window, evaluated as the thesis does.
struct ThesisWindow<const N: usize> {
    tensions_n: Vector6<f64>,
    axis_loads: SVector<f64, N>,
    elongations_m: Option<Vector6<f64>>,
    axes: Vec<Option<f64>>,
}

/// Evaluates the series with the largest force.
pub(super) fn evaluate_largest<const N: usize>(
    problem: &SpringsProblem<'_, N>,
) -> Option<ThesisSprings> {
    let of_windows = problem
        .campaign
        .windows
        .iter()
        .map(|window| (window.load.fixed_rows::<3>(0).norm(), window.series));
    let (_, series) = of_windows.max_by(|(one, _), (other, _)| one.total_cmp(other))?;
    evaluate(problem, series)
}

/// Evaluates a series; `None` where the machine does not stand in its pose.
pub(super) fn evaluate<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    series: usize,
) -> Option<ThesisSprings> {
    let campaign = problem.campaign;
    let windows: Vec<&Window<N>> = campaign
        .windows
        .iter()
        .filter(|window| window.series == series)
        .collect();
    let first = windows.first()?;
    let machine = ElasticMachine::new(*problem.geometry, problem.file.machine, Backlash::NONE);
    let began = problem.unloaded(&machine, first).ok()?;
    let evaluated: Vec<ThesisWindow<N>> = windows
        .iter()
        .filter_map(|window| evaluate_window(problem, &machine, &began, first, window))
        .collect();
    Some(ThesisSprings {
        series: campaign.series[series].clone(),
        links: std::array::from_fn(|link| {
            let points = evaluated
                .iter()
                .filter_map(|window| Some((window.tensions_n[link], window.elongations_m?[link])));
            SpringLine::through(points.collect())
        }),
        axes: (0..N)
            .map(|axis| {
                let points = evaluated
                    .iter()
                    .filter_map(|window| Some((window.axis_loads[axis], window.axes[axis]?)));
                SpringLine::through(points.collect())
            })
            .collect(),
    })
}

fn evaluate_window<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    machine: &ElasticMachine<N>,
    began: &Equilibrium<N>,
    first: &Window<N>,
    window: &Window<N>,
) -> Option<ThesisWindow<N>> {
    let through = machine.transmission(&first.q, began)?;
    let tensions_n = through.tensions_n(&window.load);
    let pushes = window
        .pushes_n
        .component_mul(&SVector::from(problem.campaign.metres_per_q));
    let axis_loads = through.axis_loads(&tensions_n, &pushes);
    let mut axes = vec![None; N];
    let mut normals = Vec::new();
    let mut changes = Vec::new();
    for (gauge, named) in problem.campaign.gauges.iter().enumerate() {
        let Some(change) = window.readings_m[gauge]
            .zip(first.readings_m[gauge])
            .map(|(now, then)| now - then)
        else {
            continue;
        };
        match named.gauge {
            Gauge::Face {
                body: Body::Platform,
                axis,
                ..
            } => {
                normals.push(axis);
                changes.push(change);
            }
            // The thesis knows no wrist.
            Gauge::Face {
                body: Body::Tool, ..
            } => {}
            Gauge::Axis { axis, metres_per_q } => axes[axis] = Some(change / metres_per_q),
        }
    }
    let moved = solve_linear(
        DMatrix::from_fn(normals.len(), 3, |row, column| normals[row][column]),
        DVector::from_vec(changes),
    );
    let elongations_m = moved.map(|moved| {
        let moved = Vector3::new(moved[0], moved[1], moved[2]);
        let shifts = SVector::<f64, N>::from_fn(|axis, _| axes[axis].unwrap_or(0.0));
        through.elongations_m(&moved, &shifts)
    });
    Some(ThesisWindow {
        tensions_n,
        axis_loads,
        elongations_m,
        axes,
    })
}

/// Smallest load of a spring that a line is drawn for, N.
const MIN_LOAD_N: f64 = 1.0;

/// Slope of a straight line, with an offset; `None` where the abscissae hardly differ.
fn slope(points: &[(f64, f64)]) -> Option<f64> {
    let rows = DMatrix::from_fn(points.len(), 2, |row, column| {
        if column == 0 { points[row].0 } else { 1.0 }
    });
    let spread = points.iter().map(|(x, _)| x.abs()).fold(0.0, f64::max);
    if spread < MIN_LOAD_N {
        return None;
    }
    solve_linear(
        rows,
        DVector::from_iterator(points.len(), points.iter().map(|(_, y)| *y)),
    )
    .map(|line| line[0])
}

#[cfg(test)]
mod tests;
