//! Margin of a loop against any phase.

use std::f64::consts::TAU;

use nalgebra::linalg::Hessenberg;
use nalgebra::linalg::balancing::balance_parlett_reinsch;
use nalgebra::{Complex, ComplexField, DMatrix};

use super::{CYCLE_S, Loop, eigenvalues};

/// Frequencies that are looked at, Hz.
const RANGE_HZ: (f64, f64) = (0.2, 490.0);
/// Their number, at equal ratios.
const GRID: u32 = 400;
/// Frequencies about each pole, at equal distances ...
const ABOUT_POLE: u32 = 19;
/// ... up to so many of its half widths away. Without them peaks are missed by factors.
const HALF_WIDTHS: f64 = 8.0;
/// Rounds of the search for the peak between its neighbours: each leaves 0.62 of the way.
const REFINEMENTS: u32 = 24;

/// Smallest distance of a loop from instability by its gain alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margin {
    /// One over the largest spectral radius of the loop over all frequencies. Above 1 the loop is
    /// stable whatever phase all axes share; 2 is required.
    pub any_phase: f64,
    /// Frequency of that radius, Hz.
    pub hz: f64,
}

/// The loop's machine with its matrix in Hessenberg form, which a frequency is solved fast with.
struct Response<'a> {
    of: &'a Loop,
    hessenberg: DMatrix<f64>,
    previous: DMatrix<f64>,
    current: DMatrix<f64>,
    offsets: DMatrix<f64>,
}

impl Loop {
    /// Returns the margin against any phase. `None` if the eigenvalues are not found.
    #[must_use]
    pub fn margin(&self) -> Option<Margin> {
        let response = Response::new(self);
        let grid = self.frequencies()?;
        let radii: Vec<f64> = (grid.iter())
            .map(|hz| response.spectral_radius(*hz))
            .collect::<Option<_>>()?;
        let peak = (0..grid.len()).max_by(|one, other| radii[*one].total_cmp(&radii[*other]))?;
        let mut between = [
            grid[peak.saturating_sub(1)],
            grid[(peak + 1).min(grid.len() - 1)],
        ];
        let (mut hz, mut radius) = (grid[peak], radii[peak]);
        for _ in 0..REFINEMENTS {
            // Golden section, from the better of the two inner points.
            let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
            let width = between[1] - between[0];
            let inner = [between[1] - golden * width, between[0] + golden * width];
            let [low, high] = inner.map(|hz| response.spectral_radius(hz));
            let (low, high) = (low?, high?);
            for (at, found) in [(inner[0], low), (inner[1], high)] {
                if found > radius {
                    (hz, radius) = (at, found);
                }
            }
            between = if low > high {
                [between[0], inner[1]]
            } else {
                [inner[0], between[1]]
            };
        }
        Some(Margin {
            any_phase: radius.recip(),
            hz,
        })
    }

    /// Frequencies that are looked at, Hz, ascending.
    fn frequencies(&self) -> Option<Vec<f64>> {
        let (lowest, highest) = RANGE_HZ;
        let ratio = (highest / lowest).ln();
        let mut all: Vec<f64> = (0..=GRID)
            .map(|step| lowest * (ratio * f64::from(step) / f64::from(GRID)).exp())
            .collect();
        for pole in eigenvalues::of_real(self.map.state.clone())? {
            let centre_hz = pole.argument().abs() / (TAU * CYCLE_S);
            // A pole at zero has no width.
            let half_width_hz = pole.modulus().max(1e-9).ln().abs() / (TAU * CYCLE_S);
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
}

impl<'a> Response<'a> {
    fn new(of: &'a Loop) -> Self {
        let mut balanced = of.map.state.clone();
        let scale = balance_parlett_reinsch(&mut balanced);
        let (basis, hessenberg) = Hessenberg::new(balanced).unpack();
        let into = |columns: &DMatrix<f64>| {
            let mut scaled = columns.clone();
            for (mut row, factor) in scaled.row_iter_mut().zip(scale.iter()) {
                row /= *factor;
            }
            basis.tr_mul(&scaled)
        };
        let mut offsets = of.offsets.clone();
        for (mut column, factor) in offsets.column_iter_mut().zip(scale.iter()) {
            column *= *factor;
        }
        Self {
            previous: into(&of.map.previous),
            current: into(&of.map.current),
            offsets: offsets * &basis,
            hessenberg,
            of,
        }
    }

    /// Returns the spectral radius of the loop at a frequency.
    fn spectral_radius(&self, hz: f64) -> Option<f64> {
        eigenvalues::spectral_radius(self.at(hz))
    }

    /// Returns `L` at a frequency, N x N.
    fn at(&self, hz: f64) -> DMatrix<Complex<f64>> {
        let turn = TAU * hz * CYCLE_S;
        let z = unit(turn);
        let back = z.inv();
        let latency = unit(-turn * self.of.latency_cycles as f64);
        let pushed = self.current.zip_map(&self.previous, |current, previous| {
            back * previous + current
        });
        let states = solve_shifted(&self.hessenberg, z, pushed);
        let filtered = self.of.filter.response(z) * latency;
        self.offsets.map(Complex::from) * states * filtered
    }
}

/// Returns the number of magnitude 1 at an angle, rad.
fn unit(angle: f64) -> Complex<f64> {
    let (sin, cos) = angle.sin_cos();
    Complex::new(cos, sin)
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
