//! Motion of a linear machine over one cycle, with its drives: sixteen steps of symplectic Euler,
//! as the simulation integrates, in one matrix.

use std::f64::consts::TAU;

use nalgebra::{ComplexField, DMatrix};

use super::{LinearMachine, eigenvalues};
use crate::drive_cascade::{
    CURRENT_SHARE, CYCLE_S, MASS_KG, SUBSTEP_S, SUBSTEPS, VELOCITY_GAIN, VELOCITY_INTEGRAL_S,
    VISCOUS_FRICTION,
};
use crate::model::MachineKind;
use crate::robot_file::RobotFile;

/// Drives of a machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DriveKind<const N: usize> {
    /// They are where the interpolation of the references is.
    Ideal,
    /// The cascade of the simulated drives.
    Cascade {
        /// Position loop: velocity per position error, 1/s.
        position_gain_per_s: f64,
        /// Motors of each axis.
        motors: [f64; N],
        /// Mass in front of the spring of each axis, kg.
        motors_kg: [f64; N],
        /// Length of one unit of each `q`, m.
        metres_per_q: [f64; N],
    },
}

impl<const N: usize> DriveKind<N> {
    /// Cascade of a robot file's drives with this gain of the position loops, 1/s. `None` without
    /// masses.
    #[must_use]
    pub fn cascade<K: MachineKind<N>>(
        robot: &RobotFile<K, N>,
        position_gain_per_s: f64,
    ) -> Option<Self> {
        Some(Self::Cascade {
            position_gain_per_s,
            motors: robot.motors.per_axis(),
            motors_kg: robot.masses?.motors_kg,
            metres_per_q: robot.metres_per_q,
        })
    }
}

/// Motion over a cycle: `z' = A z + B_1 r_previous + B_2 r_current`, and the reading at its end,
/// `y = H z'`. The references of a cycle are interpolated from the previous to the current one.
#[derive(Clone, Debug, PartialEq)]
pub struct TickMap {
    /// `A`, S x S.
    pub state: DMatrix<f64>,
    /// `B_1`, S x N.
    pub previous: DMatrix<f64>,
    /// `B_2`, S x N.
    pub current: DMatrix<f64>,
    /// `H`: load that the sensor finds, 6 x S.
    pub reading: DMatrix<f64>,
    /// Part of `H` by drives that take a reference at once, 6 x N: in a response to a frequency they
    /// are where the coming cycle puts them. Zero with a cascade.
    pub direct: DMatrix<f64>,
}

/// A linear map of state and references: rows by `[z, r_previous, r_current]`.
struct Rows {
    states: usize,
    axes: usize,
}

impl Rows {
    fn zeros(&self, rows: usize) -> DMatrix<f64> {
        DMatrix::zeros(rows, self.states + 2 * self.axes)
    }

    /// Part `length` of the state from `first` on.
    fn part(&self, first: usize, length: usize) -> DMatrix<f64> {
        let mut rows = self.zeros(length);
        for row in 0..length {
            rows[(row, first + row)] = 1.0;
        }
        rows
    }

    /// `factor_previous r_previous + factor_current r_current`.
    fn references(&self, previous: f64, current: f64) -> DMatrix<f64> {
        let mut rows = self.zeros(self.axes);
        for axis in 0..self.axes {
            rows[(axis, self.states + axis)] = previous;
            rows[(axis, self.states + self.axes + axis)] = current;
        }
        rows
    }
}

/// Multiplies each row by its factor.
fn scaled<const N: usize>(mut rows: DMatrix<f64>, factors: &[f64; N]) -> DMatrix<f64> {
    for (mut row, factor) in rows.row_iter_mut().zip(factors) {
        row *= *factor;
    }
    rows
}

/// Quantities of a machine as rows of a [`Rows`].
struct Quantities {
    places: DMatrix<f64>,
    rates: DMatrix<f64>,
    drives: DMatrix<f64>,
    drive_rates: DMatrix<f64>,
}

impl Quantities {
    fn accelerations<const N: usize>(&self, machine: &LinearMachine<N>) -> DMatrix<f64> {
        &machine.by_drives * &self.drives - &machine.by_places * &self.places
            + &machine.by_drive_rates * &self.drive_rates
            - &machine.by_rates * &self.rates
    }

    /// Load that the sensor finds: that of a workpiece, less what the tool's acceleration takes.
    fn reading<const N: usize>(&self, machine: &LinearMachine<N>) -> DMatrix<f64> {
        let accelerations = self.accelerations(machine);
        &machine.load_by_places * &self.places - &machine.tool * accelerations.rows(0, 6)
    }
}

impl TickMap {
    /// Motion of a machine with these drives.
    #[must_use]
    pub fn of<const N: usize>(machine: &LinearMachine<N>, drives: &DriveKind<N>) -> Self {
        match drives {
            DriveKind::Ideal => ideal(machine),
            DriveKind::Cascade {
                position_gain_per_s,
                motors,
                motors_kg,
                metres_per_q,
            } => Cascade {
                machine,
                position_gain_per_s: *position_gain_per_s,
                velocity_gain: motors.map(|motors| motors * MASS_KG * VELOCITY_GAIN),
                friction: motors.map(|motors| motors * VISCOUS_FRICTION),
                motors_kg: *motors_kg,
                metres_per_q: *metres_per_q,
            }
            .tick_map(),
        }
    }

    /// Returns frequency (Hz) and damping ratio of every vibration of the machine with its drives,
    /// lowest first. `None` if the eigenvalues are not found.
    #[must_use]
    pub fn vibrations(&self) -> Option<Vec<(f64, f64)>> {
        let mut all: Vec<(f64, f64)> = (eigenvalues::of_real(self.state.clone())?.into_iter())
            .filter(|pole| pole.argument() > 0.0 && pole.modulus() > 1e-9)
            .map(|pole| {
                // By z = exp(s T).
                let (decay, turn) = (-pole.modulus().ln(), pole.argument());
                (turn / (TAU * CYCLE_S), decay / decay.hypot(turn))
            })
            .collect();
        all.sort_by(|one, other| one.0.total_cmp(&other.0));
        Some(all)
    }

    /// Runs the steps of a cycle. Each is `[z, r_previous, r_current] -> z'`.
    fn composed(rows: &Rows, step: impl Fn(f64) -> DMatrix<f64>, reading: DMatrix<f64>) -> Self {
        let Rows { states, axes } = *rows;
        let mut whole = rows.part(0, states);
        for number in 0..SUBSTEPS {
            let step = step(f64::from(number) / f64::from(SUBSTEPS));
            let before = step.columns(0, states) * &whole;
            whole = before;
            let mut references = whole.columns_mut(states, 2 * axes);
            references += step.columns(states, 2 * axes);
        }
        Self {
            state: whole.columns(0, states).into_owned(),
            previous: whole.columns(states, axes).into_owned(),
            current: whole.columns(states + axes, axes).into_owned(),
            reading: reading.columns(0, states).into_owned(),
            direct: DMatrix::zeros(6, axes),
        }
    }
}

/// State of a machine with ideal drives: places, rates, and the reference of the cycle that ended.
fn ideal<const N: usize>(machine: &LinearMachine<N>) -> TickMap {
    let half = 6 + N;
    let rows = Rows {
        states: 2 * half + N,
        axes: N,
    };
    let (places, rates) = (rows.part(0, half), rows.part(half, half));
    let step = |share: f64| {
        let motion = Quantities {
            places: places.clone(),
            rates: rates.clone(),
            drives: rows.references(1.0 - share, share),
            drive_rates: rows.references(-1.0 / CYCLE_S, 1.0 / CYCLE_S),
        };
        let rates = &rates + motion.accelerations(machine) * SUBSTEP_S;
        let places = &places + &rates * SUBSTEP_S;
        stacked(&[places, rates, rows.references(0.0, 1.0)])
    };
    // Between two cycles the drives change their velocity at once; they count as at rest.
    let at_end = Quantities {
        places: places.clone(),
        rates: rates.clone(),
        drives: rows.part(2 * half, N),
        drive_rates: rows.zeros(N),
    };
    let map = TickMap::composed(&rows, step, at_end.reading(machine));
    TickMap {
        direct: map.reading.columns(2 * half, N).into_owned(),
        ..map
    }
}

/// A machine with the cascade of the simulated drives. State: places, rates, drives (q-units) and
/// their rates, integral parts of the velocity loops and forces (N).
struct Cascade<'a, const N: usize> {
    machine: &'a LinearMachine<N>,
    position_gain_per_s: f64,
    /// N s/m, of all motors of an axis.
    velocity_gain: [f64; N],
    /// N s/m, of all motors of an axis.
    friction: [f64; N],
    motors_kg: [f64; N],
    metres_per_q: [f64; N],
}

impl<const N: usize> Cascade<'_, N> {
    fn tick_map(&self) -> TickMap {
        let half = 6 + N;
        let rows = Rows {
            states: 2 * half + 4 * N,
            axes: N,
        };
        let now = Quantities {
            places: rows.part(0, half),
            rates: rows.part(half, half),
            drives: rows.part(2 * half, N),
            drive_rates: rows.part(2 * half + N, N),
        };
        let integral = rows.part(2 * half + 2 * N, N);
        let force = rows.part(2 * half + 3 * N, N);
        TickMap::composed(
            &rows,
            |share| self.step(&rows, &now, &integral, &force, share),
            now.reading(self.machine),
        )
    }

    /// One step, `share` of the cycle after its beginning: loops and current, then velocities, then
    /// places.
    fn step(
        &self,
        rows: &Rows,
        now: &Quantities,
        integral: &DMatrix<f64>,
        force: &DMatrix<f64>,
        share: f64,
    ) -> DMatrix<f64> {
        let error = (rows.references(1.0 - share, share) - &now.drives) * self.position_gain_per_s
            + rows.references(-1.0 / CYCLE_S, 1.0 / CYCLE_S)
            - &now.drive_rates;
        let proportional = scaled(scaled(error, &self.metres_per_q), &self.velocity_gain);
        let integral = integral + &proportional * (SUBSTEP_S / VELOCITY_INTEGRAL_S);
        let force = force * (1.0 - CURRENT_SHARE) + (proportional + &integral) * CURRENT_SHARE;
        let metres_per_q = self.metres_per_q;
        let moved = &force + self.load(now)
            - scaled(
                scaled(now.drive_rates.clone(), &metres_per_q),
                &self.friction,
            );
        let inertia: [f64; N] =
            std::array::from_fn(|axis| 1.0 / (self.motors_kg[axis] * metres_per_q[axis]));
        let drive_rates = &now.drive_rates + scaled(moved, &inertia) * SUBSTEP_S;
        let drives = &now.drives + &drive_rates * SUBSTEP_S;
        let rates = &now.rates + now.accelerations(self.machine) * SUBSTEP_S;
        let places = &now.places + &rates * SUBSTEP_S;
        stacked(&[places, rates, drives, drive_rates, integral, force])
    }

    /// Load of the machine on the drives of each axis, N.
    fn load(&self, now: &Quantities) -> DMatrix<f64> {
        let axes = now.places.rows(6, N);
        let along_q = scaled(axes - &now.drives, &self.machine.axis_stiffness)
            + &self.machine.load_by_rates * &now.rates
            - &self.machine.load_by_drive_rates * &now.drive_rates;
        scaled(along_q, &self.metres_per_q.map(f64::recip))
    }
}

fn stacked(parts: &[DMatrix<f64>]) -> DMatrix<f64> {
    let all: Vec<_> = parts.iter().flat_map(|part| part.row_iter()).collect();
    DMatrix::from_rows(&all)
}
