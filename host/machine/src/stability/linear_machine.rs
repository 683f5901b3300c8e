//! A machine about one place, at rest and unloaded: matrices of its motion.

use nalgebra::{DMatrix, Matrix6, SMatrix, Vector3};

use crate::dynamics::{CoordinateMatrix, Coordinates, MassiveMachine, Modes};
use crate::elastic::Pose;

/// A machine about one place, its drives free to move.
///
/// ```text
/// M dnu/dt = -K x + E theta - C (nu - G dtheta/dt)
/// ```
///
/// `E` has the stiffness of the springs of the axes, `G = [W^-T D; 1]` the motion of the rigid
/// machine by its drives. What bends is damped, and nothing else: the path is not braked.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearMachine<const N: usize> {
    /// Modes, with mass and stiffness.
    pub modes: Modes<N>,
    /// `M^-1 K`, `M^-1 E`, `M^-1 C` and `M^-1 C G`: accelerations by places, drives, rates and
    /// rates of the drives.
    pub(super) by_places: DMatrix<f64>,
    pub(super) by_drives: DMatrix<f64>,
    pub(super) by_rates: DMatrix<f64>,
    pub(super) by_drive_rates: DMatrix<f64>,
    /// `G^T C` and `G^T C G`: loads of the drives, along `+q`, by rates and rates of the drives.
    pub(super) load_by_rates: DMatrix<f64>,
    pub(super) load_by_drive_rates: DMatrix<f64>,
    /// Stiffness of the springs of the axes.
    pub(super) axis_stiffness: [f64; N],
    /// Mass matrix of the tool about the tool centre point, 6 x 6, as far as no accelerometer takes it
    /// out of the reading.
    pub(super) tool: DMatrix<f64>,
    /// Load on the tool by places, 6 x (6 + N): that of a workpiece.
    pub(super) load_by_places: DMatrix<f64>,
    /// `P`: offsets (q-units) by a load on the platform, N x 6.
    pub correction: DMatrix<f64>,
}

impl<const N: usize> LinearMachine<N> {
    /// Machine at this place. `None` where the links do not hold the platform, or the masses are
    /// those of no body.
    #[must_use]
    pub fn at(machine: &MassiveMachine<N>, pose: &Pose, axes: &[f64; N]) -> Option<Self> {
        let modes = Modes::of(machine, pose, axes)?;
        let motion = machine.rigid_motion(pose, axes)?;
        let damping = modes.damping(machine.masses.damping_ratio);
        let axis_stiffness = machine.elastic.compliances().axes.map(f64::recip);
        let rigid: Vec<Coordinates<N>> = (0..N)
            .map(|axis| {
                let mut rates = Coordinates::<N>::zeros();
                rates.platform = motion.column(axis).into_owned();
                rates.axes[axis] = 1.0;
                rates
            })
            .collect();
        let drive_rates = columns(rigid.iter().map(|rates| damping.times(rates)));
        let springs = columns((0..N).map(|axis| {
            let mut forces = Coordinates::<N>::zeros();
            forces.axes[axis] = axis_stiffness[axis];
            forces
        }));
        let rigid = columns(rigid.into_iter());
        Some(Self {
            by_places: solved(&modes.mass, &modes.stiffness.to_matrix())?,
            by_drives: solved(&modes.mass, &springs)?,
            by_rates: solved(&modes.mass, &damping.to_matrix())?,
            by_drive_rates: solved(&modes.mass, &drive_rates)?,
            load_by_rates: drive_rates.transpose(),
            load_by_drive_rates: drive_rates.transpose() * &rigid,
            axis_stiffness,
            tool: whole(&machine.felt_tool(&pose.rotation)),
            load_by_places: DMatrix::zeros(6, 6 + N),
            correction: correction(&motion, &machine.compliance(pose, axes)?)?,
            modes,
        })
    }
}

/// An elastic workpiece that the tool is in contact with, all the time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Stiffness, N/m.
    pub stiffness_n_per_m: f64,
    /// Direction in which it holds the tool centre point, world axes; of any length.
    pub direction: Vector3<f64>,
}

impl<const N: usize> LinearMachine<N> {
    /// Returns the machine with its tool on a workpiece. `None` for masses that no body has.
    #[must_use]
    pub fn in_contact(&self, contact: &Contact) -> Option<Self> {
        let normal = contact.direction.normalize();
        let mut load_by_places = DMatrix::zeros(6, 6 + N);
        load_by_places
            .view_mut((0, 0), (3, 3))
            .copy_from(&(normal * normal.transpose() * -contact.stiffness_n_per_m));
        let mut forces = DMatrix::zeros(6 + N, 6 + N);
        forces.rows_mut(0, 6).copy_from(&load_by_places);
        let pushed = solved(&self.modes.mass, &forces)?;
        Some(Self {
            by_places: &self.by_places - pushed,
            load_by_places,
            ..self.clone()
        })
    }
}

/// Returns the offsets by a load that hold the tool to first order: its translation on three axes,
/// its orientation too on six. `None` where the axes do not move it.
fn correction<const N: usize>(
    motion: &SMatrix<f64, 6, N>,
    compliance: &Matrix6<f64>,
) -> Option<DMatrix<f64>> {
    // As many coordinates are held as there are axes.
    let motion = DMatrix::from_fn(N, N, |row, axis| motion[(row, axis)]);
    let compliance = DMatrix::from_fn(N, 6, |row, column| compliance[(row, column)]);
    Some(-motion.try_inverse()? * compliance)
}

fn whole(matrix: &Matrix6<f64>) -> DMatrix<f64> {
    DMatrix::from_column_slice(6, 6, matrix.as_slice())
}

/// Returns the accelerations by forces, both by columns.
fn solved<const N: usize>(
    mass: &CoordinateMatrix<N>,
    forces: &DMatrix<f64>,
) -> Option<DMatrix<f64>> {
    mass.to_matrix()
        .cholesky()
        .map(|factor| factor.solve(forces))
}

fn columns<const N: usize>(all: impl Iterator<Item = Coordinates<N>>) -> DMatrix<f64> {
    let vectors: Vec<_> = all.map(|column| column.to_vector()).collect();
    DMatrix::from_columns(&vectors)
}
