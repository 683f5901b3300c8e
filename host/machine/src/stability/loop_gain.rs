//! Gain of a loop over all frequencies, and its margin.
//!
//! Filter and latency have one gain and one phase on all axes, so that the spectral radius of the
//! loop is that of the machine and its correction times the magnitude of the filter: it is found
//! once, and a filter is judged by multiplications.

use std::f64::consts::TAU;
use std::sync::OnceLock;

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
    /// Of the matrix.
    shared: f64,
    /// Of the magnitudes of its entries.
    per_axis: f64,
}

/// Response to one frequency, whose radii are found when they may be the largest.
#[derive(Clone, Debug)]
struct FrequencyResponse {
    hz: f64,
    /// Bound of both radii: the smaller of the largest sums of magnitudes over a row and a column.
    bound: f64,
    /// `None` if eigenvalues are not found.
    radii: OnceLock<Option<Radii>>,
}

/// Response of a loop to a frequency, without filter and latency.
#[derive(Clone, Debug)]
pub struct LoopResponse<const N: usize> {
    /// `A` in Hessenberg form, which a frequency is solved fast with; transposed.
    hessenberg: DMatrix<f64>,
    /// `B_1` and `B_2`, by rows.
    previous: Vec<[f64; N]>,
    current: Vec<[f64; N]>,
    /// `P H`, by columns.
    offsets: Vec<[f64; N]>,
    /// `P` times the direct part of the reading, N x N.
    direct: DMatrix<f64>,
}

/// Gain of a loop over all frequencies, without filter and latency.
#[derive(Clone, Debug)]
pub struct LoopGain<const N: usize> {
    response: LoopResponse<N>,
    /// Frequencies ascending.
    curve: Vec<FrequencyResponse>,
}

impl<const N: usize> LoopResponse<N> {
    /// Response of a machine's correction. `None` of a map that is not finite.
    #[must_use]
    pub fn of(machine: &LinearMachine<N>, map: &TickMap) -> Option<Self> {
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
            let rows = basis.tr_mul(&scaled);
            (rows.row_iter())
                .map(|row| std::array::from_fn(|axis| row[axis]))
                .collect()
        });
        for (mut column, factor) in offsets.column_iter_mut().zip(scale.iter()) {
            column *= *factor;
        }
        let offsets = offsets * &basis;
        Some(Self {
            previous,
            current,
            offsets: (offsets.column_iter())
                .map(|column| std::array::from_fn(|axis| column[axis]))
                .collect(),
            direct: correction * &map.direct,
            hessenberg: hessenberg.transpose(),
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
            shared: eigenvalues::spectral_radius(matrix)?,
            per_axis,
        })
    }

    fn bounded(&self, hz: f64) -> FrequencyResponse {
        let magnitudes = self.at(hz).map(ComplexField::modulus);
        let [rows, columns] = [magnitudes.column_sum(), magnitudes.row_sum_tr()];
        FrequencyResponse {
            hz,
            bound: rows.max().min(columns.max()),
            radii: OnceLock::new(),
        }
    }

    /// Returns `P H (e^jw - A)^-1 (B_2 + B_1 e^-jw)`, N x N, with the drives that take a reference
    /// at once a cycle earlier than in the state.
    fn at(&self, hz: f64) -> DMatrix<Complex<f64>> {
        let (sin, cos) = (TAU * hz * CYCLE_S).sin_cos();
        let z = Complex::new(cos, sin);
        let back = z.inv();
        let pushed = self.current.iter().zip(&self.previous);
        let pushed = pushed.map(|(current, previous)| ComplexRow {
            real: std::array::from_fn(|axis| current[axis] + back.re * previous[axis]),
            imaginary: previous.map(|previous| back.im * previous),
        });
        let states = solve_shifted(&self.hessenberg, z, pushed.collect());
        let mut moved = [ComplexRow::ZERO; N];
        for (offsets, state) in self.offsets.iter().zip(&states) {
            for (moved, offset) in moved.iter_mut().zip(offsets) {
                moved.subtract(Complex::from(-offset), state);
            }
        }
        let earlier = Complex::from(1.0) - back;
        DMatrix::from_fn(N, N, |row, column| {
            moved[row].at(column) + earlier * self.direct[(row, column)]
        })
    }
}

impl<const N: usize> LoopGain<N> {
    /// Gain of a machine's correction. `None` if eigenvalues are not found.
    #[must_use]
    pub fn of(machine: &LinearMachine<N>, map: &TickMap) -> Option<Self> {
        Self::with(map, &machine.correction)
    }

    /// Gain of a map and a correction `P`, N x 6.
    pub(super) fn with(map: &TickMap, correction: &DMatrix<f64>) -> Option<Self> {
        let response = LoopResponse::with(map, correction)?;
        let curve = (frequencies(&map.state)?.into_iter())
            .map(|hz| response.bounded(hz))
            .collect();
        Some(Self { response, curve })
    }

    /// Returns the response to a frequency.
    #[must_use]
    pub const fn response(&self) -> &LoopResponse<N> {
        &self.response
    }

    /// Returns the margin of the loop with a filter. `None` if eigenvalues are not found.
    #[must_use]
    pub fn margin(&self, filter: &Filter) -> Option<Margin> {
        let (most, hz) = self.peak(filter, |radii| radii.shared)?;
        let (most_per_axis, _) = self.peak(filter, |radii| radii.per_axis)?;
        Some(Margin {
            any_phase: most.recip(),
            hz,
            phase_per_axis: most_per_axis.recip(),
        })
    }

    /// Returns the largest radius behind a filter over all frequencies, and its frequency, Hz. `None`
    /// if eigenvalues are not found.
    fn peak(&self, filter: &Filter, radius: impl Fn(&Radii) -> f64) -> Option<(f64, f64)> {
        let mut all: Vec<(f64, &FrequencyResponse)> = (self.curve.iter())
            .map(|at| (at.bound * filter.gain(at.hz), at))
            .collect();
        all.sort_by(|one, other| other.0.total_cmp(&one.0));
        let (mut most, mut most_hz) = (0.0, f64::NAN);
        for (bound, at) in all {
            if bound <= most {
                break;
            }
            let radii = (*at.radii.get_or_init(|| self.response.radii(at.hz)))?;
            let behind = radius(&radii) * filter.gain(at.hz);
            if behind > most {
                (most, most_hz) = (behind, at.hz);
            }
        }
        Some((most, most_hz))
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

/// A row of `N` complex numbers, which are computed several at once.
#[derive(Clone, Copy, Debug)]
struct ComplexRow<const N: usize> {
    real: [f64; N],
    imaginary: [f64; N],
}

impl<const N: usize> ComplexRow<N> {
    const ZERO: Self = Self {
        real: [0.0; N],
        imaginary: [0.0; N],
    };

    fn at(&self, column: usize) -> Complex<f64> {
        Complex::new(self.real[column], self.imaginary[column])
    }

    /// Subtracts a multiple of another row.
    fn subtract(&mut self, factor: Complex<f64>, other: &Self) {
        for column in 0..N {
            let (real, imaginary) = (other.real[column], other.imaginary[column]);
            self.real[column] -= factor.re * real - factor.im * imaginary;
            self.imaginary[column] -= factor.re * imaginary + factor.im * real;
        }
    }
}

/// Solves `(z - H) x = b` of an upper Hessenberg matrix, which is given transposed, so that its rows
/// are contiguous: an elimination with one row below each.
fn solve_shifted<const N: usize>(
    hessenberg: &DMatrix<f64>,
    z: Complex<f64>,
    mut right: Vec<ComplexRow<N>>,
) -> Vec<ComplexRow<N>> {
    let size = hessenberg.nrows();
    let mut left = hessenberg.map(|entry| Complex::from(-entry));
    for row in 0..size {
        left[(row, row)] += z;
    }
    let left = left.as_mut_slice();
    for row in 1..size {
        let (above, below) = left.split_at_mut(row * size);
        let above = &mut above[(row - 1) * size + row - 1..];
        let below = &mut below[row - 1..size];
        if below[0].norm_sqr() > above[0].norm_sqr() {
            above.swap_with_slice(below);
            right.swap(row - 1, row);
        }
        let factor = below[0] / above[0];
        for (entry, above) in below.iter_mut().zip(above.iter()) {
            *entry -= factor * above;
        }
        let above = right[row - 1];
        right[row].subtract(factor, &above);
    }
    for row in (0..size).rev() {
        let mut rest = right[row];
        let entries = &left[row * size + row..(row + 1) * size];
        for (entry, solved) in entries.iter().zip(&right[row..]).skip(1) {
            rest.subtract(*entry, solved);
        }
        right[row] = ComplexRow::ZERO;
        right[row].subtract(-entries[0].inv(), &rest);
    }
    right
}

#[cfg(test)]
mod tests {
    use gantry_tau_core::model::kinematics::Pose as RigidPose;

    use super::super::{DriveKind, NotchFinder};
    use super::*;
    use crate::elastic::Pose;
    use crate::robot_file::RobotFile;

    /// The L2 of its file at home, and its drives.
    fn l2_at_home() -> (LinearMachine<3>, DriveKind<3>) {
        let robot = RobotFile::builtin_l2().unwrap();
        let finder = NotchFinder::of(&robot).unwrap();
        let home = Pose::from(&RigidPose::at(robot.home_m()));
        let machine = LinearMachine::at(&finder.machine, &home, &robot.home_q().unwrap());
        (machine.unwrap(), finder.drives)
    }

    #[test]
    fn the_smaller_of_each_margin_is_the_least() {
        let margin = |any_phase, hz, phase_per_axis| Margin {
            any_phase,
            hz,
            phase_per_axis,
        };
        let (one, other) = (margin(2.0, 10.0, 1.5), margin(3.0, 20.0, 1.2));
        for least in [one.least(&other), other.least(&one)] {
            assert_eq!(least, margin(2.0, 10.0, 1.2));
        }
    }

    /// At equal ratios over the whole range; closer about a pole, which is at 20 Hz with a half width
    /// of 1 Hz, and about none that is broad or does not turn.
    #[test]
    fn frequencies_are_close_about_a_weakly_damped_pole() {
        let pole = |hz: f64, half_width_hz: f64| {
            let (sin, cos) = (TAU * CYCLE_S * hz).sin_cos();
            DMatrix::from_row_slice(2, 2, &[cos, -sin, sin, cos])
                * (-TAU * CYCLE_S * half_width_hz).exp()
        };
        let grid = frequencies(&pole(20.0, 10.0)).unwrap();
        assert_eq!(grid.len(), 251);
        assert!((grid[0] - 0.2).abs() < 1e-12 && (grid[250] - 490.0).abs() < 1e-9);
        let ratio = (490.0_f64 / 0.2).powf(1.0 / 250.0);
        assert!((grid.windows(2)).all(|pair| (pair[1] / pair[0] / ratio - 1.0).abs() < 1e-12));
        assert_eq!(frequencies(&DMatrix::identity(2, 2)).unwrap(), grid);

        let mut near = frequencies(&pole(20.0, 1.0)).unwrap();
        near.retain(|hz| !grid.contains(hz));
        assert_eq!(near.len(), 19);
        for (step, hz) in near.iter().enumerate() {
            let expected = 12.0 + 16.0 * step as f64 / 18.0;
            assert!((hz - expected).abs() < 1e-9, "{hz} {expected}");
        }
    }

    /// Ideal drives, as a map of a state that holds the reference of the coming cycle: its input is one
    /// cycle ahead, which turns the response and leaves the radius.
    #[test]
    fn ideal_drives_take_a_reference_at_once() {
        let (machine, _) = l2_at_home();
        let map = TickMap::of(&machine, &DriveKind::Ideal);
        let (size, before) = (map.state.nrows(), map.state.nrows() - 3);
        let mut ahead = TickMap {
            state: DMatrix::zeros(size + 3, size + 3),
            previous: DMatrix::zeros(size + 3, 3),
            current: DMatrix::zeros(size + 3, 3),
            reading: DMatrix::zeros(6, size + 3),
            direct: DMatrix::zeros(6, 3),
        };
        let mut of_state = ahead.state.view_mut((0, 0), (size, size));
        of_state.copy_from(&map.state);
        let mut of_last = of_state.columns_mut(before, 3);
        of_last += &map.previous;
        (ahead.state.view_mut((0, size), (size, 3))).copy_from(&map.current);
        (ahead.current.view_mut((size, 0), (3, 3))).fill_with_identity();
        let places = map.reading.columns(0, before);
        (ahead.reading.columns_mut(0, before)).copy_from(&places);
        (ahead.reading.columns_mut(size, 3)).copy_from(&map.reading.columns(before, 3));
        let [found, expected] =
            [&map, &ahead].map(|map| LoopResponse::<3>::with(map, &machine.correction).unwrap());
        for hz in [1.0, 15.0, 21.0, 40.0, 150.0, 400.0] {
            let [found, expected] =
                [&found, &expected].map(|response| response.radius(hz).unwrap());
            assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
        }
    }

    /// Against the largest radius of all frequencies.
    #[test]
    fn no_frequency_is_overlooked_for_its_bound() {
        let (machine, drives) = l2_at_home();
        let gain = LoopGain::of(&machine, &TickMap::of(&machine, &drives)).unwrap();
        for filter in [
            Filter::first_order(20.0),
            Filter::butterworth(6.0),
            Filter::butterworth(6.0).with_notch(20.7, 0.7),
            Filter::butterworth(100.0).with_notch(57.6, 0.7),
        ] {
            let mut most = [0.0; 2];
            for at in &gain.curve {
                let radii = gain.response.radii(at.hz).unwrap();
                let behind = filter.gain(at.hz);
                most[0] = f64::max(most[0], radii.shared * behind);
                most[1] = f64::max(most[1], radii.per_axis * behind);
            }
            let margin = gain.margin(&filter).unwrap();
            assert!((margin.any_phase * most[0] - 1.0).abs() < 1e-12);
            assert!((margin.phase_per_axis * most[1] - 1.0).abs() < 1e-12);
        }
    }
}
