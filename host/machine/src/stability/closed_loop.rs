//! The loop from the sensor's reading to the references, closed.

use std::f64::consts::TAU;

use nalgebra::{ComplexField, DMatrix, DVector};

use super::filter::Past;
use super::{Filter, LinearMachine, LoopGain, Margin, TickMap, eigenvalues};
use crate::drive_cascade::CYCLE_S;

/// The loop of a compensation of first order.
#[derive(Clone, Debug, PartialEq)]
pub struct Loop<const N: usize> {
    /// The machine with its drives.
    map: TickMap,
    /// `P`, N x 6.
    correction: DMatrix<f64>,
    /// Offsets by the state, `P H`, N x S.
    offsets: DMatrix<f64>,
    filter: Filter,
    /// Cycles from a reading to the reference that answers it.
    latency_cycles: usize,
}

/// Slowest decay, or fastest growth, of a loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Growth {
    /// Growth of the logarithm of the amplitude, 1/s; negative: it decays.
    pub per_s: f64,
    /// Its frequency, Hz.
    pub hz: f64,
}

impl<const N: usize> Loop<N> {
    /// Loop of a machine: its reading goes through `filter`, and acts in the references
    /// `latency_cycles` after it.
    #[must_use]
    pub fn new(
        machine: &LinearMachine<N>,
        map: TickMap,
        filter: Filter,
        latency_cycles: usize,
    ) -> Self {
        Self {
            correction: machine.correction.clone(),
            offsets: &machine.correction * &map.reading,
            map,
            filter,
            latency_cycles,
        }
    }

    /// Returns the growth of the closed loop: `ln(max |eigenvalue|)` of its map over a cycle, per
    /// second. `None` if the eigenvalues are not found.
    #[must_use]
    pub fn growth(&self) -> Option<Growth> {
        let values = eigenvalues::of_real(self.closed())?;
        let slowest =
            (values.into_iter()).max_by(|one, other| one.modulus().total_cmp(&other.modulus()))?;
        Some(Growth {
            per_s: slowest.modulus().ln() / CYCLE_S,
            hz: slowest.argument().abs() / (TAU * CYCLE_S),
        })
    }

    /// Returns the margin against any phase in free air. `None` if the eigenvalues are not found.
    #[must_use]
    pub fn margin(&self) -> Option<Margin> {
        LoopGain::<N>::with(&self.map, &self.correction)?.margin(&self.filter)
    }

    /// Matrix of the closed loop over a cycle, column by column.
    fn closed(&self) -> DMatrix<f64> {
        let start = self.start();
        let columns: Vec<_> = (0..start.len())
            .map(|column| {
                let mut state = start.clone();
                state[column] = 1.0;
                self.next(&state)
            })
            .collect();
        DMatrix::from_columns(&columns)
    }

    /// Returns the closed loop at rest, for [`next`](Self::next): the state of the machine, then of
    /// each axis the past of the filter and the offsets of the last cycles, newest first.
    #[must_use]
    pub fn start(&self) -> DVector<f64> {
        let per_axis = 2 * self.filter.order() + self.latency_cycles + 1;
        DVector::zeros(self.map.state.nrows() + N * per_axis)
    }

    /// Returns the closed loop a cycle after a state.
    #[must_use]
    pub fn next(&self, state: &DVector<f64>) -> DVector<f64> {
        let (machine, rest) = (self.map.state.nrows(), 2 * self.filter.order());
        let kept = self.latency_cycles + 1;
        let own = state.rows(0, machine);
        let wanted = &self.offsets * own;
        let mut next = DVector::zeros(state.len());
        let (mut previous, mut current) = (DVector::zeros(N), DVector::zeros(N));
        for axis in 0..N {
            let first = machine + axis * (rest + kept);
            let mut past: Vec<Past> = (0..self.filter.order())
                .map(|section| {
                    let place = first + 2 * section;
                    [state[place], state[place + 1]]
                })
                .collect();
            let offset = self.filter.next(&mut past, wanted[axis]);
            let mut offsets = vec![offset];
            offsets.extend((0..kept).map(|age| state[first + rest + age]));
            current[axis] = offsets[self.latency_cycles];
            previous[axis] = offsets[self.latency_cycles + 1];
            let kept_now = past.into_iter().flatten().chain(offsets);
            for (place, value) in (first..first + rest + kept).zip(kept_now) {
                next[place] = value;
            }
        }
        let moved =
            &self.map.state * own + &self.map.previous * previous + &self.map.current * current;
        next.rows_mut(0, machine).copy_from(&moved);
        next
    }
}
