//! Springs as the thesis evaluated them `[T 3.3, 4.2.9]`, for comparison: a straight line per spring through the windows of one series, the
//! platform taken as if it did not turn.
//!
//! With `dT` the translation that the gauges on the platform show, and `dA = v c tau` the displacement of a cart, a link is longer by
//! `s . (dA - dT)` `[T 3.25, 3.29]`. What the platform turns is taken as elongation of links, so values may be far off, or negative `[T Table 5.2]`.

use gantry_tau_core::model::robot::LINKS;
use nalgebra::{DMatrix, DVector, SVector, Vector3, Vector6};

use crate::elastic::backlash::Backlash;
use crate::elastic::{ElasticMachine, Equilibrium};
use crate::fit::least_squares::solve_linear;
use crate::measurements::springs::Window;
use crate::springs::gauge::Gauge;
use crate::springs::lines::Question;

/// Compliances by the thesis' evaluation of one series; `None` where its gauges or its load do not give one.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ThesisSprings {
    /// The series, by its name.
    pub(super) series: String,
    /// Of the links, m/N.
    pub(super) links: [Option<f64>; LINKS],
    /// Of the axes, in the units of their keys.
    pub(super) axes: Vec<Option<f64>>,
}

/// One window as the thesis saw it.
struct Seen<const N: usize> {
    tensions_n: Vector6<f64>,
    axis_loads: SVector<f64, N>,
    elongations_m: Option<Vector6<f64>>,
    axes: Vec<Option<f64>>,
}

/// Evaluates the series with the largest force.
pub(super) fn evaluate<const N: usize>(question: &Question<'_, N>) -> Option<ThesisSprings> {
    let campaign = question.campaign;
    let force = |window: &Window<N>| window.load.fixed_rows::<3>(0).norm();
    let largest = campaign.windows.iter().max_by(|one, other| force(one).total_cmp(&force(other)))?;
    let windows: Vec<&Window<N>> = campaign.windows.iter().filter(|window| window.series == largest.series).collect();
    let first = windows.first()?;
    let machine = ElasticMachine::new(*question.geometry, question.file.machine, Backlash::NONE);
    let began = question.unloaded(&machine, first).ok()?;
    let seen: Vec<Seen<N>> =
        windows.iter().filter_map(|window| see(question, &machine, &began, first, window)).collect();
    let slope_of =
        |values: &dyn Fn(&Seen<N>) -> Option<(f64, f64)>| slope(&seen.iter().filter_map(values).collect::<Vec<_>>());
    Some(ThesisSprings {
        series: campaign.series[largest.series].clone(),
        links: std::array::from_fn(|link| slope_of(&|seen| Some((seen.tensions_n[link], seen.elongations_m?[link])))),
        axes: (0..N).map(|axis| slope_of(&|seen| Some((seen.axis_loads[axis], seen.axes[axis]?)))).collect(),
    })
}

fn see<const N: usize>(
    question: &Question<'_, N>,
    machine: &ElasticMachine<N>,
    began: &Equilibrium<N>,
    first: &Window<N>,
    window: &Window<N>,
) -> Option<Seen<N>> {
    let through = machine.transmission(&first.q, began)?;
    let tensions_n = through.tensions_n(&window.load);
    let pushes = window.pushes_n.component_mul(&SVector::from(question.campaign.metres_per_q));
    let axis_loads = through.axis_loads(&tensions_n, &pushes);
    let mut axes = vec![None; N];
    let (mut normals, mut changes) = (Vec::new(), Vec::new());
    for (gauge, named) in question.campaign.gauges.iter().enumerate() {
        let Some(change) = window.readings_m[gauge].zip(first.readings_m[gauge]).map(|(now, then)| now - then) else {
            continue;
        };
        match named.gauge {
            Gauge::Face { axis, .. } => {
                normals.push(axis);
                changes.push(change);
            }
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
    Some(Seen { tensions_n, axis_loads, elongations_m, axes })
}

/// Slope of a straight line, with an offset; `None` where the abscissae hardly differ.
fn slope(points: &[(f64, f64)]) -> Option<f64> {
    let rows = DMatrix::from_fn(points.len(), 2, |row, column| if column == 0 { points[row].0 } else { 1.0 });
    let spread = points.iter().map(|(x, _)| x.abs()).fold(0.0, f64::max);
    if spread < LEAST_LOAD {
        return None;
    }
    solve_linear(rows, DVector::from_iterator(points.len(), points.iter().map(|(_, y)| *y))).map(|line| line[0])
}

/// Smallest load of a spring that a line is drawn for, N.
const LEAST_LOAD: f64 = 1.0;
