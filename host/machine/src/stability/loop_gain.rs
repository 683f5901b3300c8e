//! Gain of a loop over all frequencies, and its margin.
//!
//! Filter and latency have one gain and one phase on all axes, so that the spectral radius of the
//! loop is that of the machine and its correction times the magnitude of the filter: it is found
//! once, and a filter is judged by multiplications.

use std::f64::consts::TAU;

use nalgebra::linalg::Hessenberg;
use nalgebra::linalg::balancing::balance_parlett_reinsch;
use nalgebra::{Complex, ComplexField, DMatrix};

use super::{Filter, LinearMachine, TickMap, eigenvalues};
use crate::drive_cascade::CYCLE_S;

/// Frequencies that are looked at, Hz.
const RANGE_HZ: (f64, f64) = (0.2, 490.0);
/// Their number, at equal ratios.
const GRID: u32 = 250;
/// Frequencies about each weakly damped pole, at equal distances ...
const ABOUT_POLE: u32 = 19;
/// ... up to so many of its half widths away. Without them peaks are missed by factors.
const HALF_WIDTHS: f64 = 8.0;
/// Half width of a pole that the grid alone sees, as a share of its frequency.
const BROAD: f64 = 0.15;

/// Distance of a loop from instability by its gain, for every phase.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margin {
    /// One over the largest spectral radius of the loop over all frequencies: above 1 it is stable
    /// for every phase that all axes share. 2 is required.
    pub any_phase: f64,
    /// Frequency of that radius, Hz.
    pub hz: f64,
    /// The same of the magnitudes of the loop's entries, which bounds it for a phase of its own on
    /// each axis. 1 is required.
    pub phase_per_axis: f64,
}

impl Margin {
    /// Returns the smaller of each.
    #[must_use]
    pub fn least(&self, other: &Self) -> Self {
        let worse = if other.any_phase < self.any_phase {
            other
        } else {
            self
        };
        Self {
            phase_per_axis: self.phase_per_axis.min(other.phase_per_axis),
            ..*worse
        }
    }
}

/// Spectral radii of a machine and its correction at one frequency.
#[derive(Clone, Copy, Debug)]
struct Radii {
    hz: f64,
    /// Of the matrix.
    shared: f64,
    /// Of the magnitudes of its entries.
    per_axis: f64,
}

/// Response of a loop to a frequency, without filter and latency.
#[derive(Clone, Debug)]
pub struct LoopResponse {
    /// `A` in Hessenberg form, which a frequency is solved fast with.
    hessenberg: DMatrix<f64>,
    previous: DMatrix<f64>,
    current: DMatrix<f64>,
    offsets: DMatrix<f64>,
    /// `P` times the direct part of the reading, N x N.
    direct: DMatrix<f64>,
}

/// Gain of a loop over all frequencies, without filter and latency.
#[derive(Clone, Debug)]
pub struct LoopGain {
    response: LoopResponse,
    /// Ascending.
    curve: Vec<Radii>,
}

impl LoopResponse {
    /// Response of a machine's correction. `None` of a map that is not finite.
    #[must_use]
    pub fn of<const N: usize>(machine: &LinearMachine<N>, map: &TickMap) -> Option<Self> {
        Self::with(map, &machine.correction)
    }

    /// Response of a map and a correction `P`, N x 6.
    fn with(map: &TickMap, correction: &DMatrix<f64>) -> Option<Self> {
        let mut offsets = correction * &map.reading;
        // Balancing would not end.
        if !map.state.iter().all(|entry| entry.is_finite()) {
            return None;
        }
        let mut balanced = map.state.clone();
        let scale = balance_parlett_reinsch(&mut balanced);
        let (basis, hessenberg) = Hessenberg::new(balanced).unpack();
        let [previous, current] = [&map.previous, &map.current].map(|columns| {
            let mut scaled = columns.clone();
            for (mut row, factor) in scaled.row_iter_mut().zip(scale.iter()) {
                row /= *factor;
            }
            basis.tr_mul(&scaled)
        });
        for (mut column, factor) in offsets.column_iter_mut().zip(scale.iter()) {
            column *= *factor;
        }
        Some(Self {
            previous,
            current,
            offsets: offsets * &basis,
            direct: correction * &map.direct,
            hessenberg,
        })
    }

    /// Returns the spectral radius at a frequency. `None` if eigenvalues are not found.
    #[must_use]
    pub fn radius(&self, hz: f64) -> Option<f64> {
        eigenvalues::spectral_radius(self.at(hz))
    }

    fn radii(&self, hz: f64) -> Option<Radii> {
        let matrix = self.at(hz);
        let magnitudes = matrix.map(ComplexField::modulus);
        let per_axis = (eigenvalues::of_real(magnitudes)?.into_iter())
            .fold(0.0, |most: f64, value| most.max(value.modulus()));
        Some(Radii {
            hz,
            shared: eigenvalues::spectral_radius(matrix)?,
            per_axis,
        })
    }

    /// Returns `P H (e^jw - A)^-1 (B_2 + B_1 e^-jw)`, N x N, with the drives that take a reference
    /// at once a cycle earlier than in the state.
    fn at(&self, hz: f64) -> DMatrix<Complex<f64>> {
        let (sin, cos) = (TAU * hz * CYCLE_S).sin_cos();
        let z = Complex::new(cos, sin);
        let back = z.inv();
        let pushed = self.current.zip_map(&self.previous, |current, previous| {
            back * previous + current
        });
        let states = solve_shifted(&self.hessenberg, z, pushed);
        let earlier = Complex::from(1.0) - back;
        self.offsets.map(Complex::from) * states + self.direct.map(|entry| earlier * entry)
    }
}

impl LoopGain {
    /// Gain of a machine's correction. `None` if eigenvalues are not found.
    #[must_use]
    pub fn of<const N: usize>(machine: &LinearMachine<N>, map: &TickMap) -> Option<Self> {
        Self::with(map, &machine.correction)
    }

    /// Gain of a map and a correction `P`, N x 6.
    pub(super) fn with(map: &TickMap, correction: &DMatrix<f64>) -> Option<Self> {
        let response = LoopResponse::with(map, correction)?;
        let curve = (frequencies(&map.state)?.into_iter())
            .map(|hz| response.radii(hz))
            .collect::<Option<_>>()?;
        Some(Self { response, curve })
    }

    /// Returns the response to a frequency.
    #[must_use]
    pub const fn response(&self) -> &LoopResponse {
        &self.response
    }

    /// Returns the margin of the loop with a filter. `None` if eigenvalues are not found.
    #[must_use]
    pub fn margin(&self, filter: &Filter) -> Option<Margin> {
        let (most, hz) = self.peak(|radii| radii.shared * filter.gain(radii.hz))?;
        let (most_per_axis, _) = self.peak(|radii| radii.per_axis * filter.gain(radii.hz))?;
        Some(Margin {
            any_phase: most.recip(),
            hz,
            phase_per_axis: most_per_axis.recip(),
        })
    }

    /// Returns the largest value over all frequencies, and its frequency, Hz.
    fn peak(&self, value: impl Fn(&Radii) -> f64) -> Option<(f64, f64)> {
        let all = self.curve.iter().map(|radii| (value(radii), radii.hz));
        all.max_by(|one, other| one.0.total_cmp(&other.0))
    }
}

/// Frequencies that are looked at for a machine with this map, Hz, ascending.
fn frequencies(map: &DMatrix<f64>) -> Option<Vec<f64>> {
    let (lowest, highest) = RANGE_HZ;
    let ratio = (highest / lowest).ln();
    let mut all: Vec<f64> = (0..=GRID)
        .map(|step| lowest * (ratio * f64::from(step) / f64::from(GRID)).exp())
        .collect();
    for pole in eigenvalues::of_real(map.clone())? {
        let centre_hz = pole.argument() / (TAU * CYCLE_S);
        // A pole at zero has no width; the other one of a pair has the same frequency.
        let half_width_hz = pole.modulus().max(1e-9).ln().abs() / (TAU * CYCLE_S);
        if centre_hz <= 0.0 || half_width_hz > BROAD * centre_hz {
            continue;
        }
        all.extend((0..ABOUT_POLE).map(|step| {
            let share = 2.0 * f64::from(step) / f64::from(ABOUT_POLE - 1) - 1.0;
            centre_hz + share * HALF_WIDTHS * half_width_hz
        }));
    }
    all.retain(|hz| (lowest..=highest).contains(hz));
    all.sort_by(f64::total_cmp);
    all.dedup();
    Some(all)
}

/// Solves `(z - H) x = b`, of an upper Hessenberg matrix: an elimination with one row below each.
fn solve_shifted(
    hessenberg: &DMatrix<f64>,
    z: Complex<f64>,
    mut right: DMatrix<Complex<f64>>,
) -> DMatrix<Complex<f64>> {
    let size = hessenberg.nrows();
    let mut left = hessenberg.map(|entry| Complex::from(-entry));
    for row in 0..size {
        left[(row, row)] += z;
    }
    for row in 0..size.saturating_sub(1) {
        let below = row + 1;
        if left[(below, row)].norm_sqr() > left[(row, row)].norm_sqr() {
            left.swap_rows(row, below);
            right.swap_rows(row, below);
        }
        let factor = left[(below, row)] / left[(row, row)];
        for column in row..size {
            let above = left[(row, column)];
            left[(below, column)] -= factor * above;
        }
        for column in 0..right.ncols() {
            let above = right[(row, column)];
            right[(below, column)] -= factor * above;
        }
    }
    for row in (0..size).rev() {
        for column in 0..right.ncols() {
            let mut rest = right[(row, column)];
            for inner in row + 1..size {
                rest -= left[(row, inner)] * right[(inner, column)];
            }
            right[(row, column)] = rest / left[(row, row)];
        }
    }
    right
}
