//! What a strap tells of the springs: the information of one series, at the file's values.

use gantry_tau_core::model::robot::{Compliances, LINKS};
use nalgebra::{DMatrix, DVector, SVector, UnitQuaternion, Vector3, Vector6};

use super::expected::Parameters;
use crate::elastic::backlash::Backlash;
use crate::elastic::{ElasticError, ElasticMachine, Equilibrium, Pose};
use crate::fit::least_squares::Rows;
use crate::measurements::springs::Noise;
use crate::model::MachineKind;
use crate::robot_file::RobotFile;
use crate::springs::gauge::Gauge;

/// Names of the links, in link order.
const LINK_NAMES: [&str; LINKS] = ["link 11", "link 21", "link 22", "link 31", "link 32", "link 33"];

/// The machine on its bench: rigid joints, the file's compliances.
#[derive(Clone, Debug)]
pub(super) struct Bench<const N: usize> {
    machine: ElasticMachine<N>,
    noise: Noise,
    /// Springs that are asked for: of the links alone, or of the axes too.
    springs: usize,
}

/// A place where the machine stands, platform unturned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stand<const N: usize> {
    pub(super) tool_m: Vector3<f64>,
    pub(super) q: [f64; N],
}

/// A strap: where it pulls, from the tool centre point, and in which direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Strap {
    pub(super) hook_m: Vector3<f64>,
    pub(super) direction: Vector3<f64>,
}

impl Strap {
    /// Its load at a force, about the tool centre point.
    pub(super) fn load(&self, force_n: f64) -> Vector6<f64> {
        let force = self.direction * force_n;
        let moment = self.hook_m.cross(&force);
        Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z)
    }
}

/// One series, as far as it can be known before.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Series {
    /// Whitened derivatives by the springs, in shares of the file's; the zeros of its gauges are projected out.
    pub(super) rows: DMatrix<f64>,
    /// Number of readings.
    pub(super) readings: usize,
    /// Largest reading, m.
    pub(super) largest_m: f64,
    /// Displacement of the tool centre point at the largest level, m.
    pub(super) displacement_m: f64,
    /// Force of cluster 3 at the largest level, N.
    pub(super) cluster_n: f64,
}

impl<const N: usize> Bench<N> {
    pub(super) fn new<K: MachineKind<N>>(
        robot: &RobotFile<K, N>,
        compliances: Compliances<N>,
        noise: Noise,
        is_links_only: bool,
    ) -> Self {
        let machine = ElasticMachine::new(robot.model.geometry(), compliances, Backlash::NONE);
        Self { machine, noise, springs: if is_links_only { LINKS } else { LINKS + N } }
    }

    pub(super) const fn machine(&self) -> &ElasticMachine<N> {
        &self.machine
    }

    /// The springs that are asked for, in shares of the file's.
    pub(super) fn parameters(&self) -> Parameters {
        let kind = |axis: usize| if axis < 3 { "cart" } else { "plate" };
        let axes = (0..N).map(|axis| format!("{} {}", kind(axis), axis + 1));
        let names: Vec<String> = LINK_NAMES.map(str::to_owned).into_iter().chain(axes).take(self.springs).collect();
        Parameters {
            shown: vec![(100.0, "%"); names.len()],
            names,
            basis: DMatrix::identity(self.springs, self.springs),
            index_unit: "of the file's value",
        }
    }

    fn scales(&self) -> DVector<f64> {
        let compliances = self.machine.compliances();
        let all = compliances.link_m_per_n().iter().chain(compliances.cart_m_per_n());
        DVector::from_iterator(self.springs, all.take(self.springs).copied())
    }

    /// Predicts one series: a strap, its levels in N, and the gauges that are read.
    pub(super) fn series(
        &self,
        stand: &Stand<N>,
        strap: &Strap,
        levels_n: &[f64],
        gauges: &[Gauge],
    ) -> Result<Series, ElasticError> {
        let began = self.unloaded(stand)?;
        let (count, size) = (gauges.len(), gauges.len() * levels_n.len());
        let (mut rows, mut zeros) = (DMatrix::zeros(size, self.springs), DMatrix::zeros(size, count));
        let mut series = Series {
            rows: DMatrix::zeros(0, self.springs),
            readings: size,
            largest_m: 0.0,
            displacement_m: 0.0,
            cluster_n: 0.0,
        };
        let (mut last, mut largest_n) = (began, 0.0);
        for (window, level) in levels_n.iter().enumerate() {
            last = self.machine.equilibrium(&stand.q, &strap.load(*level), &last)?;
            let view = self.window(&stand.q, &began.pose, &last, gauges)?;
            rows.rows_mut(window * count, count).copy_from(&view.springs);
            zeros.rows_mut(window * count, count).copy_from(&view.whitening);
            series.largest_m = series.largest_m.max(view.largest_m);
            if *level >= largest_n {
                largest_n = *level;
                series.displacement_m = (last.pose.translation_m - began.pose.translation_m).norm();
                series.cluster_n = last.cluster_3_n();
            }
        }
        let left = Rows::new(DVector::zeros(size), rows).without(zeros).derivatives;
        // As many rows as springs tell the same.
        series.rows = if left.nrows() > left.ncols() { left.qr().r() } else { left };
        Ok(series)
    }

    pub(super) fn unloaded(&self, stand: &Stand<N>) -> Result<Equilibrium<N>, ElasticError> {
        let pose = Pose { translation_m: stand.tool_m, rotation: UnitQuaternion::identity() };
        self.machine.equilibrium(&stand.q, &Vector6::zeros(), &Equilibrium::unloaded(pose))
    }

    /// Linearises and whitens one window. Its load is measured too, and its gauges share that error:
    /// `Cov = diag(sigma^2) + H Sigma_w H^T = L L^T`.
    fn window(
        &self,
        q: &[f64; N],
        began: &Pose,
        now: &Equilibrium<N>,
        gauges: &[Gauge],
    ) -> Result<Window, ElasticError> {
        let through = self.machine.transmission(q, now).ok_or(ElasticError::Singular)?;
        let scales = self.scales();
        let mut springs = DMatrix::zeros(gauges.len(), self.springs);
        let mut by_load = DMatrix::zeros(gauges.len(), 6);
        let mut largest_m: f64 = 0.0;
        for (row, gauge) in gauges.iter().enumerate() {
            let reading = gauge.read(&self.machine, began, now);
            let derivatives = reading.derivatives(&self.machine, &through, now);
            let all = derivatives.links.iter().chain(derivatives.axes.iter());
            for (column, (derivative, scale)) in all.zip(&scales).enumerate() {
                springs[(row, column)] = derivative * scale;
            }
            by_load.row_mut(row).copy_from(&derivatives.load.transpose());
            largest_m = largest_m.max(reading.length_m.abs());
        }
        let (force, moment) = (self.noise.force_n.powi(2), self.noise.moment_nm.powi(2));
        let load = DVector::from_vec(vec![force, force, force, moment, moment, moment]);
        let mut covariance = &by_load * DMatrix::from_diagonal(&load) * by_load.transpose();
        covariance += DMatrix::from_diagonal_element(gauges.len(), gauges.len(), (self.noise.gauge_um * 1e-6).powi(2));
        let factor = covariance.cholesky().ok_or(ElasticError::NotFinite)?;
        let whitening = factor.l().try_inverse().ok_or(ElasticError::NotFinite)?;
        Ok(Window { springs: &whitening * springs, whitening, largest_m })
    }

    /// Displacement of the tool centre point under a load, by the springs, in shares of the file's: 3 rows, m.
    pub(super) fn displacement(&self, stand: &Stand<N>, load: &Vector6<f64>) -> Result<DMatrix<f64>, ElasticError> {
        let began = self.unloaded(stand)?;
        let now = self.machine.equilibrium(&stand.q, load, &began)?;
        let through = self.machine.transmission(&stand.q, &now).ok_or(ElasticError::Singular)?;
        let scales = self.scales();
        let mut rows = DMatrix::zeros(3, self.springs);
        for component in 0..3 {
            let axis = Vector3::ith(component, 1.0);
            let gauge = Gauge::Platform { point_m: Vector3::zeros(), axis };
            let derivatives = gauge.read(&self.machine, &began.pose, &now).derivatives(&self.machine, &through, &now);
            let all = derivatives.links.iter().chain(derivatives.axes.iter());
            for (column, (derivative, scale)) in all.zip(&scales).enumerate() {
                rows[(component, column)] = derivative * scale;
            }
        }
        Ok(rows)
    }

    /// Largest displacement that a load causes, m: of the tool centre point.
    pub(super) fn moved_m(&self, stand: &Stand<N>, load: &Vector6<f64>) -> Result<f64, ElasticError> {
        let began = self.unloaded(stand)?;
        let now = self.machine.pushed_equilibrium(&stand.q, load, &SVector::zeros(), &began)?;
        Ok((now.pose.translation_m - began.pose.translation_m).norm())
    }
}

/// One window: whitened derivatives, and the columns of the zeros.
struct Window {
    springs: DMatrix<f64>,
    whitening: DMatrix<f64>,
    largest_m: f64,
}
