//! Prediction of one robot file: displacement of the tool under a load, and how well the file knows it.

use gantry_tau_core::model::robot::LINKS;
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::model::stiffness::Displacement;
use gantry_tau_core::units::OffsetNm;
use nalgebra::{DMatrix, Matrix3, Vector3, Vector6};

use super::VerifyError;
use crate::elastic::backlash::Backlash;
use crate::elastic::{ElasticMachine, Equilibrium};
use crate::model::{Compensator, MachineKind, Wrist};
use crate::robot_file::{RobotFile, RobotFileError, WristJoint};
use crate::sim::springs::preload_n;
use crate::springs::gauge::Gauge;

/// The elastic machine of a robot file, with the compensator of its client.
pub(super) struct FileModel<const N: usize> {
    pub(super) machine: ElasticMachine<N>,
    pub(super) compensator: Box<dyn Compensator<N>>,
    pub(super) joints: Vec<WristJoint>,
    pub(super) wrist: Wrist,
    /// `F` of the covariance `F F^T` of the compliances (links, axes, wrist); without a column where the file has none.
    pub(super) factor: DMatrix<f64>,
    /// World axes from those of the sensor, platform unturned.
    pub(super) sensor_axes: Matrix3<f64>,
    sides: Sides,
}

impl<const N: usize> FileModel<N> {
    /// Prepares a file. Without `[identified]` its compliances count as exact.
    pub(super) fn new<K: MachineKind<N>>(file: &RobotFile<K, N>) -> Result<Self, VerifyError> {
        let compensator = file.compensator(file.limits.map(|axis| OffsetNm(axis.limits.position.max())))?;
        let compliances = file.compliances.ok_or_else(|| RobotFileError {
            file: file.name.clone(),
            key: "c_link".to_owned(),
            reason: "is missing; a prediction needs compliances".to_owned(),
        })?;
        let machine = ElasticMachine::new(file.model.geometry(), compliances, Backlash::NONE);
        let sides = Sides::of(file, &machine)?;
        let joints = file.wrist.clone();
        let wrist = Wrist::new(&joints);
        let sensor_axes = file.sensor.rotation_matrix();
        Ok(Self { factor: factor(file, &machine), machine, compensator, joints, wrist, sensor_axes, sides })
    }

    /// Number of compliances: links, axes, joints of the wrist.
    pub(super) fn springs(&self) -> usize {
        LINKS + N + self.joints.len()
    }

    /// Displacement of the tool from where it was without load.
    pub(super) fn tool(&self, began: &Equilibrium<N>, now: &Equilibrium<N>, load: &Vector6<f64>) -> Displacement {
        let rotation = now.pose.rotation.to_rotation_matrix().into_inner();
        let wrist = self.wrist.displacement(&rotation, &Wrench::from_array((*load).into()));
        Displacement {
            translation_m: now.pose.translation_m - began.pose.translation_m + wrist.translation_m,
            rotation_rad: (now.pose.rotation * began.pose.rotation.inverse()).scaled_axis() + wrist.rotation_rad,
        }
    }

    /// Derivative of the displacement of the tool centre point by the compliances, 3 rows.
    pub(super) fn tool_by_springs(
        &self,
        q: &[f64; N],
        began: &Equilibrium<N>,
        now: &Equilibrium<N>,
        load: &Vector6<f64>,
    ) -> Option<DMatrix<f64>> {
        let through = self.machine.transmission(q, now)?;
        let mut rows = DMatrix::zeros(3, self.springs());
        for (row, axis) in [Vector3::x(), Vector3::y(), Vector3::z()].into_iter().enumerate() {
            let gauge = Gauge::Platform { point_m: Vector3::zeros(), axis };
            let by = gauge.read(&self.machine, &began.pose, now).derivatives(&self.machine, &through, now);
            rows.view_mut((row, 0), (1, LINKS)).copy_from(&by.links.transpose());
            rows.view_mut((row, LINKS), (1, N)).copy_from(&by.axes.transpose());
        }
        let rotation = now.pose.rotation.to_rotation_matrix().into_inner();
        let load = Wrench::from_array((*load).into());
        for (index, joint) in self.joints.iter().enumerate() {
            let unit = Wrist::new(&[WristJoint { c_rad_per_nm: 1.0, ..*joint }]);
            let column = unit.displacement(&rotation, &load).translation_m;
            rows.view_mut((0, LINKS + N + index), (3, 1)).copy_from(&column);
        }
        Some(rows)
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
            let all = play.preload_rising_n.into_iter().chain(play.preload_falling_n);
            let ends = all.fold([f64::MAX, f64::MIN], |[low, high], value| [low.min(value), high.max(value)]);
            return Ok(Self(Some(ends)));
        }
        if file.simulation.jump_gap_m <= 0.0 {
            return Ok(Self(None));
        }
        let (home_m, force_n) = (file.simulation.home_m, file.simulation.jump_force_n);
        let preload = preload_n(machine, home_m, &file.home_q()?, force_n).map_err(VerifyError::Home)?;
        Ok(Self(Some([preload, preload])))
    }

    fn changed(&self, cluster_3_n: f64) -> bool {
        self.0.is_some_and(|ends| ends.into_iter().any(|preload| (cluster_3_n + preload) * preload <= 0.0))
    }
}

/// `F`: square root of the covariance, by its eigenvectors in units of the compliances: a direction without variance has none here.
fn factor<K: MachineKind<N>, const N: usize>(file: &RobotFile<K, N>, machine: &ElasticMachine<N>) -> DMatrix<f64> {
    let (links, axes) = (machine.compliances().link_m_per_n(), machine.compliances().cart_m_per_n());
    let joints = file.wrist.iter().map(|joint| joint.c_rad_per_nm);
    let units: Vec<f64> =
        links.iter().chain(axes).copied().chain(joints).map(|unit| if unit > 0.0 { unit } else { 1.0 }).collect();
    let Some(identified) = &file.identified else { return DMatrix::zeros(units.len(), 0) };
    let unit = |index: usize| units.get(index).copied().unwrap_or(1.0);
    let entry = |row: usize, column: usize| {
        identified.covariance.get(row).and_then(|row| row.get(column)).copied().unwrap_or(0.0)
    };
    let size = units.len();
    let shares = DMatrix::from_fn(size, size, |row, column| entry(row, column) / (unit(row) * unit(column)));
    let decomposed = shares.symmetric_eigen();
    let roots = decomposed.eigenvalues.map(|value| value.max(0.0).sqrt());
    let scaled = decomposed.eigenvectors * DMatrix::from_diagonal(&roots);
    DMatrix::from_fn(size, size, |row, column| scaled.get((row, column)).copied().unwrap_or(0.0) * unit(row))
}

/// Three rows and columns of a matrix.
pub(super) fn three(matrix: &DMatrix<f64>) -> Matrix3<f64> {
    Matrix3::from_fn(|row, column| matrix.get((row, column)).copied().unwrap_or(0.0))
}
