//! A campaign, linearised window by window at a state of the machine and its set-up.

use gantry_tau_core::model::f1;
use gantry_tau_core::model::robot::{Compliances, LINKS, RobotError};
use nalgebra::{DMatrix, DVector, Matrix6, SVector, UnitQuaternion, Vector6};

use super::beyond::{CLUSTER_3, longer};
use super::gauge::Gauge;
use super::setup::SetupConstants;
use crate::elastic::backlash::Backlash;
use crate::elastic::{ElasticError, ElasticMachine, Equilibrium, Pose};
use crate::measurements::springs::{Campaign, Window};

/// A campaign, and the machine that it was made on.
pub(super) struct Question<'a, const N: usize> {
    pub(super) geometry: &'a f1::Geometry,
    /// Compliances that the search starts from, and that stay where nothing is seen.
    pub(super) file: &'a Compliances<N>,
    pub(super) campaign: &'a Campaign<N>,
    pub(super) setup: SetupConstants,
}

/// What a fit varies.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct State<const N: usize> {
    pub(super) compliances: Compliances<N>,
    /// Elongation of the links of cluster 3 in windows beyond the jump, m.
    pub(super) elongation_m: f64,
    /// What else the links do there, by [`Beyond`](super::beyond::Beyond).
    pub(super) beyond: DVector<f64>,
    /// Constants of the set-up, in standard deviations of their priors.
    pub(super) setup: DVector<f64>,
    /// True load of each window.
    pub(super) loads: Vec<Vector6<f64>>,
}

/// A window, linearised: one row per gauge that was read.
#[derive(Clone, Debug)]
pub(super) struct Lines {
    /// Index of the window.
    pub(super) window: usize,
    /// Gauges that were read.
    pub(super) gauges: Vec<usize>,
    /// `y - h - H (w - S z - w*)`, the zeros not taken off; m.
    pub(super) misclosures: DVector<f64>,
    /// By the compliances of links and axes.
    pub(super) springs: DMatrix<f64>,
    /// By the lengths of the links.
    pub(super) lengths: DMatrix<f64>,
    /// By the constants of the mounting.
    pub(super) mounting: DMatrix<f64>,
    /// By the constants of the sensor.
    pub(super) sensor: DMatrix<f64>,
    /// `H`, by the load.
    pub(super) load: DMatrix<f64>,
    /// Variances of the readings, m^2.
    pub(super) variances: Vec<f64>,
    /// Sum of the tensions of cluster 3 by the load, N, and its standard deviation by the noise of the load.
    pub(super) cluster_3_n: [f64; 2],
}

/// Reason why a campaign cannot be linearised.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LinesError {
    /// The compliances have left their range.
    #[error("the compliances leave their range: {0}")]
    Compliances(#[from] RobotError),
    /// A window has no equilibrium.
    #[error("line {line}: {error}")]
    Window {
        /// Line of the table.
        line: u64,
        /// What the elastic model says.
        error: ElasticError,
    },
}

impl<const N: usize> State<N> {
    /// The robot file's springs, a set-up as assumed, and loads as measured.
    pub(super) fn start(question: &Question<'_, N>) -> Self {
        Self {
            compliances: *question.file,
            elongation_m: 0.0,
            beyond: DVector::zeros(0),
            setup: DVector::zeros(question.setup.count()),
            loads: question.campaign.windows.iter().map(|window| window.load).collect(),
        }
    }
}

/// Compliances of links, then axes.
pub(super) fn vector<const N: usize>(compliances: &Compliances<N>) -> DVector<f64> {
    let all = compliances.link_m_per_n().iter().chain(compliances.cart_m_per_n());
    DVector::from_iterator(LINKS + N, all.copied())
}

/// Compliances from the first entries of a vector.
pub(super) fn compliances_of<const N: usize>(vector: &DVector<f64>) -> Result<Compliances<N>, RobotError> {
    Compliances::new(std::array::from_fn(|link| vector[link]), std::array::from_fn(|axis| vector[LINKS + axis]))
}

impl<const N: usize> Question<'_, N> {
    /// Variances of a load's components: N^2, (N m)^2.
    pub(super) fn load_variances(&self) -> Vector6<f64> {
        let (force, moment) = (self.campaign.noise.force_n.powi(2), self.campaign.noise.moment_nm.powi(2));
        Vector6::new(force, force, force, moment, moment, moment)
    }

    /// Linearises every window; `is_crossed` says which are beyond the jump.
    pub(super) fn lines(&self, state: &State<N>, is_crossed: &[bool]) -> Result<Vec<Lines>, LinesError> {
        let machine = ElasticMachine::new(*self.geometry, state.compliances, Backlash::NONE);
        let mut began: Vec<Option<Equilibrium<N>>> = vec![None; self.campaign.series.len()];
        let mut last = began.clone();
        let mut lines = Vec::with_capacity(self.campaign.windows.len());
        for (index, window) in self.campaign.windows.iter().enumerate() {
            let failed = |error| LinesError::Window { line: window.line, error };
            let first = match began[window.series] {
                Some(first) => first,
                None => self.unloaded(&machine, window).map_err(failed)?,
            };
            began[window.series] = Some(first);
            let start = last[window.series].unwrap_or(first);
            let pushes = window.pushes_n.component_mul(&SVector::from(self.campaign.metres_per_q));
            let found = |machine: &ElasticMachine<N>| {
                machine.pushed_equilibrium(&window.q, &state.loads[index], &pushes, &start).map_err(failed)
            };
            let machine = if is_crossed[index] {
                let tensions_n = if state.beyond.is_empty() { Vector6::zeros() } else { found(&machine)?.tensions_n };
                let longer = longer(self.geometry, state.elongation_m, &state.beyond, &tensions_n);
                ElasticMachine::new(longer, state.compliances, Backlash::NONE)
            } else {
                machine
            };
            let now = found(&machine)?;
            last[window.series] = Some(now);
            let line = self.window_lines(&machine, state, index, &first.pose, &now);
            lines.push(line.ok_or_else(|| failed(ElasticError::Singular))?);
        }
        Ok(lines)
    }

    /// The machine in the pose of a window, unloaded.
    pub(super) fn unloaded(
        &self,
        machine: &ElasticMachine<N>,
        window: &Window<N>,
    ) -> Result<Equilibrium<N>, ElasticError> {
        let (_, seed) = &self.campaign.poses[window.pose];
        let rotation = UnitQuaternion::from_matrix(&seed.rotation);
        let start = Equilibrium::unloaded(Pose { translation_m: seed.position_m, rotation });
        machine.equilibrium(&window.q, &Vector6::zeros(), &start)
    }

    fn window_lines(
        &self,
        machine: &ElasticMachine<N>,
        state: &State<N>,
        index: usize,
        began: &Pose,
        now: &Equilibrium<N>,
    ) -> Option<Lines> {
        let (campaign, setup) = (self.campaign, &self.setup);
        let window = &campaign.windows[index];
        let through = machine.transmission(&window.q, now)?;
        let gauges: Vec<usize> =
            (0..campaign.gauges.len()).filter(|gauge| window.readings_m[*gauge].is_some()).collect();
        let count = gauges.len();
        let effect = setup.effect(&state.loads[index]);
        let of_sensor = state.setup.rows(setup.first_of_sensor(), setup.of_sensor());
        let surplus = window.load - state.loads[index] - Vector6::from_iterator((&effect * of_sensor).iter().copied());
        let unit = Matrix6::from_columns(&std::array::from_fn::<_, 6, _>(|component| {
            through.tensions_n(&Vector6::ith(component, 1.0))
        }));
        let per_component = unit.fixed_rows::<3>(CLUSTER_3).row_sum();
        let cluster_sd =
            per_component.transpose().component_mul(&per_component.transpose()).dot(&self.load_variances());
        let mut lines = Lines {
            window: index,
            misclosures: DVector::zeros(count),
            springs: DMatrix::zeros(count, LINKS + N),
            lengths: DMatrix::zeros(count, LINKS),
            mounting: DMatrix::zeros(count, setup.per_mounting()),
            sensor: DMatrix::zeros(count, setup.of_sensor()),
            load: DMatrix::zeros(count, 6),
            variances: Vec::with_capacity(count),
            cluster_3_n: [now.cluster_3_n(), cluster_sd.sqrt()],
            gauges,
        };
        for (row, &gauge) in lines.gauges.iter().enumerate() {
            let placed = setup.placed(campaign, &state.setup, window.mounting, gauge);
            let reading = placed.read(machine, began, now);
            let derivatives = reading.derivatives(machine, &through, now);
            lines.springs.view_mut((row, 0), (1, LINKS)).copy_from(&derivatives.links.transpose());
            lines.springs.view_mut((row, LINKS), (1, N)).copy_from(&derivatives.axes.transpose());
            lines.load.view_mut((row, 0), (1, 6)).copy_from(&derivatives.load.transpose());
            lines.lengths.set_row(row, &derivatives.lengths.transpose());
            let read = |gauge: &Gauge| gauge.read(machine, began, now).length_m;
            if let Some((place, by)) = setup.derivatives(campaign, &state.setup, window.mounting, gauge, read) {
                lines.mounting.view_mut((row, place), (1, by.len())).copy_from_slice(&by);
            }
            lines.misclosures[row] = window.readings_m[gauge]? - reading.length_m - derivatives.load.dot(&surplus);
            lines.variances.push(window.sds_m[gauge].unwrap_or(campaign.noise.gauge_um * 1e-6).powi(2));
        }
        lines.sensor.copy_from(&(-&lines.load * effect));
        Some(lines)
    }
}

impl Lines {
    /// Derivatives by an elongation of all three links of cluster 3, which is what the play of its joint makes.
    pub(super) fn play(&self) -> DVector<f64> {
        self.lengths.columns(CLUSTER_3, LINKS - CLUSTER_3).column_sum()
    }

    /// The same lines with the constants of the set-up as they are found.
    pub(super) fn without_setup(&self) -> Self {
        let rows = self.gauges.len();
        Self { mounting: DMatrix::zeros(rows, 0), sensor: DMatrix::zeros(rows, 0), ..self.clone() }
    }
}
