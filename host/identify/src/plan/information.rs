//! Information of one series about the springs, at the file's values.

use gantry_tau_core::model::robot::LINKS;
use gantry_tau_machine::elastic::backlash::Backlash;
use gantry_tau_machine::elastic::gauge::Gauge;
use gantry_tau_machine::elastic::loaded::Loaded;
use gantry_tau_machine::elastic::springs::Springs;
use gantry_tau_machine::elastic::{ElasticError, ElasticMachine, Equilibrium, Pose};
use gantry_tau_machine::model::{MachineKind, Wrist};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_machine::scene::LINK_NAMES;
use nalgebra::{DMatrix, DVector, UnitQuaternion, Vector3, Vector6};

use super::expected::Parameters;
use crate::fit::least_squares::Rows;
use crate::measurements::springs::Noise;
use crate::springs::blocks::{covariance, whitening};

/// The machine, of which each strap shows something: rigid joints, the file's compliances.
#[derive(Clone, Debug)]
pub(super) struct SpringInformation<const N: usize> {
    machine: ElasticMachine<N>,
    wrist: Wrist,
    noise: Noise,
    /// Compliances that are asked for: of the links alone, or of axes and wrist too.
    scales: DVector<f64>,
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
pub(super) struct SeriesInformation {
    /// Whitened derivatives by the springs, in shares of the file's; the zeros of its gauges are
    /// projected out.
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

impl<const N: usize> SpringInformation<N> {
    pub(super) fn new<K: MachineKind<N>>(
        robot: &RobotFile<K, N>,
        springs: Springs<N>,
        noise: Noise,
        is_links_only: bool,
    ) -> Self {
        let machine = ElasticMachine::new(robot.model.geometry(), springs.machine, Backlash::NONE);
        let all = springs.vector();
        let scales = if is_links_only {
            all.rows(0, LINKS).into_owned()
        } else {
            all
        };
        Self {
            machine,
            wrist: springs.wrist,
            noise,
            scales,
        }
    }

    pub(super) const fn machine(&self) -> &ElasticMachine<N> {
        &self.machine
    }

    /// The springs that are asked for, in shares of the file's.
    pub(super) fn parameters(&self) -> Parameters {
        let axes = (0..N).map(|axis| {
            let kind = if axis < 3 { "cart" } else { "plate" };
            format!("{kind} {}", axis + 1)
        });
        let wrist = (0..self.wrist.joints()).map(|joint| format!("wrist {}", joint + 1));
        let all = LINK_NAMES
            .map(|name| format!("link {name}"))
            .into_iter()
            .chain(axes)
            .chain(wrist);
        let names: Vec<String> = all.take(self.scales.len()).collect();
        Parameters {
            shown: vec![(100.0, "%"); names.len()],
            names,
            basis: DMatrix::identity(self.scales.len(), self.scales.len()),
            index_unit: "of the file's value",
        }
    }

    /// Predicts one series: a strap, its levels in N, the gauges that are read, and the angles of
    /// the wrist (rad; empty: at zero).
    pub(super) fn series(
        &self,
        stand: &Stand<N>,
        strap: &Strap,
        levels_n: &[f64],
        gauges: &[Gauge],
        wrist_rad: &[f64],
    ) -> Result<SeriesInformation, ElasticError> {
        let began = self.unloaded(stand)?;
        let count = gauges.len();
        let size = count * levels_n.len();
        let mut rows = DMatrix::zeros(size, self.scales.len());
        let mut zeros = DMatrix::zeros(size, count);
        let mut series = SeriesInformation {
            rows: DMatrix::zeros(0, self.scales.len()),
            readings: size,
            largest_m: 0.0,
            displacement_m: 0.0,
            cluster_n: 0.0,
        };
        let mut last = began;
        let mut largest_n = 0.0;
        for (window, level) in levels_n.iter().enumerate() {
            let load = strap.load(*level);
            last = self.machine.equilibrium(&stand.q, &load, &last)?;
            let loaded = self.loaded(&began, &last, load, wrist_rad);
            let view = self.window(&stand.q, &loaded, gauges)?;
            rows.rows_mut(window * count, count)
                .copy_from(&view.springs);
            zeros
                .rows_mut(window * count, count)
                .copy_from(&view.whitening);
            series.largest_m = series.largest_m.max(view.largest_m);
            if *level >= largest_n {
                largest_n = *level;
                series.displacement_m = loaded.displacement().translation_m.norm();
                series.cluster_n = last.cluster_3_n();
            }
        }
        let left = Rows::new(DVector::zeros(size), rows)
            .without(zeros)
            .derivatives;
        // As many rows as springs hold the same.
        series.rows = if left.nrows() > left.ncols() {
            left.qr().r()
        } else {
            left
        };
        Ok(series)
    }

    pub(super) fn unloaded(&self, stand: &Stand<N>) -> Result<Equilibrium<N>, ElasticError> {
        let pose = Pose {
            translation_m: stand.tool_m,
            rotation: UnitQuaternion::identity(),
        };
        self.machine
            .equilibrium(&stand.q, &Vector6::zeros(), &Equilibrium::unloaded(pose))
    }

    fn loaded(
        &self,
        began: &Equilibrium<N>,
        now: &Equilibrium<N>,
        load: Vector6<f64>,
        wrist_rad: &[f64],
    ) -> Loaded<N> {
        Loaded {
            machine: self.machine,
            wrist: self.wrist.turned(wrist_rad),
            began: began.pose,
            now: *now,
            load,
        }
    }

    /// Linearises and whitens one window.
    fn window(
        &self,
        q: &[f64; N],
        loaded: &Loaded<N>,
        gauges: &[Gauge],
    ) -> Result<WindowInformation, ElasticError> {
        let through = self
            .machine
            .transmission(q, &loaded.now)
            .ok_or(ElasticError::Singular)?;
        let mut springs = DMatrix::zeros(gauges.len(), self.scales.len());
        let mut by_load = DMatrix::zeros(gauges.len(), 6);
        let mut largest_m: f64 = 0.0;
        for (row, gauge) in gauges.iter().enumerate() {
            let reading = gauge.read(loaded);
            let derivatives = reading.derivatives(loaded, &through);
            let asked = derivatives
                .springs
                .rows(0, self.scales.len())
                .component_mul(&self.scales);
            springs.row_mut(row).copy_from(&asked.transpose());
            by_load
                .row_mut(row)
                .copy_from(&derivatives.load.transpose());
            largest_m = largest_m.max(reading.length_m.abs());
        }
        let variances = vec![(self.noise.gauge_um * 1e-6).powi(2); gauges.len()];
        let covariance = covariance(&by_load, &variances, &self.noise.load_variances());
        let whitening = whitening(covariance).ok_or(ElasticError::NotFinite)?;
        Ok(WindowInformation {
            springs: &whitening * springs,
            whitening,
            largest_m,
        })
    }

    /// Displacement of the tool under a load, by the springs, in shares of the file's: 3 rows, m.
    pub(super) fn displacement(
        &self,
        stand: &Stand<N>,
        load: &Vector6<f64>,
    ) -> Result<DMatrix<f64>, ElasticError> {
        let loaded = self.under(stand, load)?;
        let through = self
            .machine
            .transmission(&stand.q, &loaded.now)
            .ok_or(ElasticError::Singular)?;
        let all = loaded.displacement_by_springs(&through);
        let scaled = all.columns(0, self.scales.len()) * DMatrix::from_diagonal(&self.scales);
        Ok(scaled)
    }

    fn under(&self, stand: &Stand<N>, load: &Vector6<f64>) -> Result<Loaded<N>, ElasticError> {
        let began = self.unloaded(stand)?;
        let now = self.machine.equilibrium(&stand.q, load, &began)?;
        Ok(self.loaded(&began, &now, *load, &[]))
    }

    /// Displacement of the tool that a load causes, m.
    pub(super) fn moved_m(
        &self,
        stand: &Stand<N>,
        load: &Vector6<f64>,
    ) -> Result<f64, ElasticError> {
        Ok(self.under(stand, load)?.displacement().translation_m.norm())
    }
}

/// One window: whitened derivatives, and the columns of the zeros.
struct WindowInformation {
    springs: DMatrix<f64>,
    whitening: DMatrix<f64>,
    largest_m: f64,
}
