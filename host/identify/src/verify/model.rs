//! Prediction of one robot file: displacement of the tool under a load, and how well the file knows
//! it.

use gantry_tau_core::units::OffsetNm;
use gantry_tau_machine::elastic::backlash::Backlash;
use gantry_tau_machine::elastic::loaded::Loaded;
use gantry_tau_machine::elastic::springs::Springs;
use gantry_tau_machine::elastic::{ElasticMachine, Equilibrium};
use gantry_tau_machine::model::{Compensate, MachineKind};
use gantry_tau_machine::robot_file::{RobotFile, RobotFileError};
use gantry_tau_sim::springs::preload_n;
use nalgebra::{DMatrix, Matrix3, Vector6};

use super::VerifyError;

/// The elastic machine of a robot file, with the compensator of its client.
pub(super) struct FileModel<const N: usize> {
    pub(super) machine: ElasticMachine<N>,
    pub(super) compensator: Box<dyn Compensate<N>>,
    pub(super) springs: Springs<N>,
    /// `F` of the covariance `F F^T` of the compliances (links, axes, wrist); without a column
    /// where the file has none.
    pub(super) factor: DMatrix<f64>,
    sides: Sides,
}

impl<const N: usize> FileModel<N> {
    /// Prepares a file. Without `[identified]` its compliances count as exact.
    pub(super) fn new<K: MachineKind<N>>(file: &RobotFile<K, N>) -> Result<Self, VerifyError> {
        let compensator =
            file.compensator(file.limits.map(|axis| OffsetNm(axis.limits.position.max())))?;
        let springs = Springs::of(file).ok_or_else(|| RobotFileError {
            file: file.name.clone(),
            key: "c_link".to_owned(),
            reason: "is missing; a prediction needs compliances".to_owned(),
        })?;
        let machine = ElasticMachine::new(file.model.geometry(), springs.machine, Backlash::NONE);
        let sides = Sides::of(file, &machine)?;
        Ok(Self {
            factor: factor(file, &springs),
            machine,
            compensator,
            springs,
            sides,
        })
    }

    /// The machine under a load, with its wrist at zero.
    pub(super) fn loaded(
        &self,
        began: &Equilibrium<N>,
        now: &Equilibrium<N>,
        load: &Vector6<f64>,
    ) -> Loaded<N> {
        Loaded {
            machine: self.machine,
            wrist: self.springs.wrist.clone(),
            began: began.pose,
            now: *now,
            load: *load,
        }
    }

    /// Covariance of rows by the uncertainty of the springs.
    pub(super) fn covariance(&self, rows: &DMatrix<f64>) -> DMatrix<f64> {
        let rows = rows * &self.factor;
        &rows * rows.transpose()
    }

    /// True where the joint of cluster 3 may be at the other end of its play than at rest.
    pub(super) fn changes_sides(&self, now: &Equilibrium<N>) -> bool {
        self.sides.changed(now.cluster_3_n())
    }
}

/// Preload of cluster 3: one of these values, N; `None` where the file knows no play.
struct Sides(Option<[f64; 2]>);

impl Sides {
    /// `[play]` of the file, else the jump of its simulation.
    fn of<K: MachineKind<N>, const N: usize>(
        file: &RobotFile<K, N>,
        machine: &ElasticMachine<N>,
    ) -> Result<Self, VerifyError> {
        if let Some(play) = &file.play {
            let ends = play
                .preload_ends_n()
                .into_iter()
                .fold([f64::MAX, f64::MIN], |[low, high], value| {
                    [low.min(value), high.max(value)]
                });
            return Ok(Self(Some(ends)));
        }
        if file.simulation.jump_gap_m <= 0.0 {
            return Ok(Self(None));
        }
        let simulation = &file.simulation;
        let home_q = file.home_q()?;
        let preload = preload_n(machine, simulation.home_m, &home_q, simulation.jump_force_n)
            .map_err(VerifyError::Home)?;
        Ok(Self(Some([preload, preload])))
    }

    fn changed(&self, cluster_3_n: f64) -> bool {
        self.0.is_some_and(|ends| {
            ends.into_iter()
                .any(|preload| (cluster_3_n + preload) * preload <= 0.0)
        })
    }
}

/// `F`: square root of the covariance, by its eigenvectors in units of the compliances: a direction
/// without variance has none here.
fn factor<K: MachineKind<N>, const N: usize>(
    file: &RobotFile<K, N>,
    springs: &Springs<N>,
) -> DMatrix<f64> {
    let units = springs
        .vector()
        .map(|unit| if unit > 0.0 { unit } else { 1.0 });
    let Some(identified) = &file.identified else {
        return DMatrix::zeros(units.len(), 0);
    };
    let size = units.len();
    let shares = DMatrix::from_fn(size, size, |row, column| {
        let entry = identified
            .covariance
            .get(row)
            .and_then(|row| row.get(column))
            .copied()
            .unwrap_or(0.0);
        entry / (units[row] * units[column])
    });
    let decomposed = shares.symmetric_eigen();
    let roots = decomposed.eigenvalues.map(|value| value.max(0.0).sqrt());
    let scaled = decomposed.eigenvectors * DMatrix::from_diagonal(&roots);
    DMatrix::from_fn(size, size, |row, column| scaled[(row, column)] * units[row])
}

/// Three rows and columns of a matrix.
pub(super) fn three(matrix: &DMatrix<f64>) -> Matrix3<f64> {
    Matrix3::from_fn(|row, column| matrix.get((row, column)).copied().unwrap_or(0.0))
}
