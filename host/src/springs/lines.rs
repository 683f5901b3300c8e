//! A campaign, linearised window by window at a state of the machine and its set-up.

use gantry_tau_core::model::f1;
use gantry_tau_core::model::robot::LINKS;
use nalgebra::{DMatrix, DVector, Matrix6, SVector, UnitQuaternion, Vector6};

use super::beyond::{CLUSTER_3, longer};
use super::blocks::Eliminated;
use super::choice::Choice;
use super::compliances::Springs;
use super::gauge::Gauge;
use super::loaded::Loaded;
use super::setup::SetupConstants;
use crate::elastic::backlash::Backlash;
use crate::elastic::{ElasticError, ElasticMachine, Equilibrium, Pose, Transmission};
use crate::fit::statistics::float;
use crate::fit::svd::Svd;
use crate::measurements::springs::{Campaign, Window};
use crate::model::Wrist;
use crate::robot_file::Identified;

/// A campaign, and the machine that it was made on.
#[derive(Clone)]
pub(crate) struct Question<'a, const N: usize> {
    pub(crate) geometry: &'a f1::Geometry,
    /// Springs that the search starts from, and that stay where nothing is seen.
    pub(crate) file: &'a Springs<N>,
    pub(crate) campaign: &'a Campaign<N>,
    pub(crate) setup: SetupConstants,
    /// Compliances that changes are relative to.
    pub(crate) relative_to: DVector<f64>,
    /// Covariance of the file's compliances, in those: of what the campaign does not show.
    pub(crate) prior: DMatrix<f64>,
}

/// Unknowns of a fit.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct State<const N: usize> {
    pub(crate) springs: Springs<N>,
    /// Elongation of the links of cluster 3 in windows beyond the jump, m.
    pub(crate) elongation_m: f64,
    /// Further parameters of the links there, by [`Beyond`](super::beyond::Beyond).
    pub(crate) beyond: DVector<f64>,
    /// Half-widths of the hysteresis, m, of the gauges whose is fitted.
    pub(crate) hysteresis_m: DVector<f64>,
    /// Constants of the set-up, in standard deviations of their priors.
    pub(crate) setup: DVector<f64>,
    /// True load of each window.
    pub(crate) loads: Vec<Vector6<f64>>,
}

/// A window, linearised: one row per gauge that was read.
#[derive(Clone, Debug)]
pub(crate) struct Lines {
    /// Index of the window.
    pub(crate) window: usize,
    /// Gauges that were read.
    pub(crate) gauges: Vec<usize>,
    /// `y - h - H (w - S z - w*)`, the zeros not taken off; m.
    pub(crate) misclosures: DVector<f64>,
    /// By the compliances of links, axes and joints of the wrist, at the load as it is estimated.
    pub(crate) springs: DMatrix<f64>,
    /// The same at the load without its noise: noise of a load shows no spring.
    pub(crate) springs_shown: DMatrix<f64>,
    /// By the lengths of the links.
    pub(crate) lengths: DMatrix<f64>,
    /// By the constants of the mounting.
    pub(crate) mounting: DMatrix<f64>,
    /// By the constants of the sensor.
    pub(crate) sensor: DMatrix<f64>,
    /// `H`, by the load.
    pub(crate) load: DMatrix<f64>,
    /// Variances of the readings, m^2.
    pub(crate) variances: Vec<f64>,
    /// Sum of the tensions of cluster 3 by the load, N, and its standard deviation by the noise of the load.
    pub(crate) cluster_3_n: [f64; 2],
}

/// Reason why a campaign cannot be linearised.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LinesError {
    /// A window has no equilibrium.
    #[error(
        "line {line}: under this load {error}: the machine would buckle or come apart; check units and signs of forces and moments, and the robot file's springs"
    )]
    Window {
        /// Line of the table.
        line: u64,
        /// Error of the elastic model.
        error: ElasticError,
    },
}

/// Loads of a campaign's windows, in each series without what noise explains: a strap pulls along one line.
pub(super) fn smooth_loads<const N: usize>(campaign: &Campaign<N>, loads: &[Vector6<f64>]) -> Vec<Vector6<f64>> {
    let sds = campaign.noise.load_variances().map(f64::sqrt);
    let mut smooth = loads.to_vec();
    for series in 0..campaign.series.len() {
        let windows: Vec<usize> =
            (0..campaign.windows.len()).filter(|window| campaign.windows[*window].series == series).collect();
        let count = float(windows.len());
        let mean = windows.iter().map(|window| smooth[*window]).sum::<Vector6<f64>>() / count;
        let whitened = |window: usize| (smooth[window] - mean).component_div(&sds);
        let svd = Svd::new(DMatrix::from_fn(windows.len(), 6, |row, column| whitened(windows[row])[column]));
        // Largest singular value that noise alone has, but for one in some thousands.
        let noise = count.sqrt() + 6.0_f64.sqrt() + 2.0;
        let directions = svd.values.iter().zip(svd.directions.column_iter()).filter(|(value, _)| **value > noise);
        let along: Vec<Vector6<f64>> =
            directions.map(|(_, direction)| Vector6::from_iterator(direction.iter().copied())).collect();
        for window in windows {
            let load = (smooth[window] - mean).component_div(&sds);
            let kept: Vector6<f64> = along.iter().map(|direction| direction * direction.dot(&load)).sum();
            smooth[window] = mean + kept.component_mul(&sds);
        }
    }
    smooth
}

impl<const N: usize> State<N> {
    /// The robot file's springs, a set-up as assumed, and loads as measured.
    pub(crate) fn start(question: &Question<'_, N>) -> Self {
        Self {
            springs: question.file.clone(),
            elongation_m: 0.0,
            beyond: DVector::zeros(0),
            hysteresis_m: DVector::zeros(0),
            setup: DVector::zeros(question.setup.count()),
            loads: question.campaign.windows.iter().map(|window| window.load).collect(),
        }
    }

    /// The same with zeros for those unknowns of a choice that it does not have.
    pub(super) fn sized(mut self, choice: &Choice) -> Self {
        for (unknowns, count) in
            [(&mut self.beyond, choice.of_links()), (&mut self.hysteresis_m, choice.hysteresis.len())]
        {
            if unknowns.len() != count {
                *unknowns = DVector::zeros(count);
            }
        }
        self
    }

    /// The state after a step of the parameters, and with what was eliminated as it then is.
    pub(super) fn stepped(&self, choice: &Choice, step: &DVector<f64>, eliminated: Eliminated) -> Self {
        let (springs, of_links, hysteresis) = (self.springs.count(), self.beyond.len(), self.hysteresis_m.len());
        let play = if choice.has_play() { step[springs] } else { 0.0 };
        Self {
            springs: self.springs.with(&(self.springs.vector() + step.rows(0, springs))),
            elongation_m: self.elongation_m + play,
            beyond: &self.beyond + step.rows((springs + 1).min(step.len() - of_links), of_links),
            hysteresis_m: &self.hysteresis_m + step.rows(step.len() - hysteresis, hysteresis),
            setup: &self.setup + eliminated.setup,
            loads: eliminated.loads,
        }
    }
}

impl<'a, const N: usize> Question<'a, N> {
    /// A campaign, and the springs that the search starts from, which changes are relative to.
    pub(crate) fn new(geometry: &'a f1::Geometry, file: &'a Springs<N>, campaign: &'a Campaign<N>) -> Self {
        let (relative_to, count) = (file.vector(), file.count());
        let (setup, prior) = (SetupConstants::of(campaign), DMatrix::identity(count, count));
        Self { geometry, file, campaign, setup, relative_to, prior }
    }

    /// The same of another campaign with the same gauges.
    pub(crate) fn on<'b>(&self, campaign: &'b Campaign<N>) -> Question<'b, N>
    where
        'a: 'b,
    {
        let Self { geometry, file, relative_to, prior, .. } = self.clone();
        Question { relative_to, prior, ..Question::new(geometry, file, campaign) }
    }

    /// The same with what the file says of its compliances, where it was identified.
    pub(crate) fn known(self, identified: &Identified) -> Self {
        let count = self.file.count();
        let relative_to = match identified.relative_to.as_slice() {
            [] => self.relative_to,
            stated => DVector::from_column_slice(stated),
        };
        let prior = DMatrix::from_fn(count, count, |row, column| {
            let of = |row: usize, column: usize| {
                let entry = identified.covariance.get(row).and_then(|row| row.get(column)).copied().unwrap_or(0.0);
                entry / (relative_to[row] * relative_to[column])
            };
            // Files of earlier versions say nothing of what they kept.
            if row == column && of(row, row) <= 0.0 { 1.0 } else { of(row, column) }
        });
        Self { relative_to, prior, ..self }
    }

    /// The same with the constants of the set-up as they were found.
    pub(crate) fn exact(&self) -> Self {
        Self { setup: self.setup.exact(), ..self.clone() }
    }

    /// Variances of a load's components: N^2, (N m)^2.
    pub(crate) fn load_variances(&self) -> Vector6<f64> {
        self.campaign.noise.load_variances()
    }

    /// Linearises every window; `is_crossed` says which are beyond the jump.
    pub(crate) fn lines(&self, state: &State<N>, is_crossed: &[bool]) -> Result<Vec<Lines>, LinesError> {
        let loaded = self.loaded(state, is_crossed)?;
        let mut lines: Vec<Lines> = Vec::with_capacity(loaded.len());
        let smooth = smooth_loads(self.campaign, &state.loads);
        for (index, (loaded, smooth)) in loaded.iter().zip(&smooth).enumerate() {
            lines.push(self.linearised_for(state, index, loaded, smooth)?);
        }
        Ok(lines)
    }

    /// Finds the equilibrium of every window; `is_crossed` says which are beyond the jump.
    pub(crate) fn loaded(&self, state: &State<N>, is_crossed: &[bool]) -> Result<Vec<Loaded<N>>, LinesError> {
        let machine = ElasticMachine::new(*self.geometry, state.springs.machine, Backlash::NONE);
        let wrists = self.wrists(&state.springs.wrist);
        let mut began: Vec<Option<Equilibrium<N>>> = vec![None; self.campaign.series.len()];
        let mut last = began.clone();
        let mut all = Vec::with_capacity(self.campaign.windows.len());
        for (index, window) in self.campaign.windows.iter().enumerate() {
            let failed = |error| LinesError::Window { line: window.line, error };
            let first = match began[window.series] {
                Some(first) => first,
                None => self.unloaded(&machine, window).map_err(failed)?,
            };
            began[window.series] = Some(first);
            let start = last[window.series].unwrap_or(first);
            let pushes = window.pushes_n.component_mul(&SVector::from(self.campaign.metres_per_q));
            let load = state.loads[index];
            let found = |machine: &ElasticMachine<N>| {
                machine.pushed_equilibrium(&window.q, &load, &pushes, &start).map_err(failed)
            };
            let machine = if is_crossed[index] {
                let tensions_n = if state.beyond.is_empty() { Vector6::zeros() } else { found(&machine)?.tensions_n };
                let longer = longer(self.geometry, state.elongation_m, &state.beyond, &tensions_n);
                ElasticMachine::new(longer, state.springs.machine, Backlash::NONE)
            } else {
                machine
            };
            let now = found(&machine)?;
            last[window.series] = Some(now);
            all.push(Loaded { machine, wrist: wrists[window.series].clone(), began: first.pose, now, load });
        }
        Ok(all)
    }

    /// The wrist at the angles of each series.
    fn wrists(&self, wrist: &Wrist) -> Vec<Wrist> {
        let campaign = self.campaign;
        campaign.series.iter().map(|series| wrist.turned(campaign.wrist_rad(series))).collect()
    }

    /// The machine in the pose of a window, unloaded.
    pub(crate) fn unloaded(
        &self,
        machine: &ElasticMachine<N>,
        window: &Window<N>,
    ) -> Result<Equilibrium<N>, ElasticError> {
        let (_, seed) = &self.campaign.poses[window.pose];
        let rotation = UnitQuaternion::from_matrix(&seed.rotation);
        let start = Equilibrium::unloaded(Pose { translation_m: seed.position_m, rotation });
        machine.equilibrium(&window.q, &Vector6::zeros(), &start)
    }

    /// Linearises one window.
    pub(crate) fn linearised(&self, state: &State<N>, index: usize, at: &Loaded<N>) -> Result<Lines, LinesError> {
        self.linearised_for(state, index, at, &state.loads[index])
    }

    /// As [`linearised`](Self::linearised), and shown by another load.
    fn linearised_for(
        &self,
        state: &State<N>,
        index: usize,
        at: &Loaded<N>,
        smooth: &Vector6<f64>,
    ) -> Result<Lines, LinesError> {
        let line = self.campaign.windows[index].line;
        let through = at.machine.transmission(&self.campaign.windows[index].q, &at.now);
        let through = through.ok_or(LinesError::Window { line, error: ElasticError::Singular })?;
        Ok(self.through(state, index, at, &through, smooth))
    }

    fn through(
        &self,
        state: &State<N>,
        index: usize,
        at: &Loaded<N>,
        through: &Transmission<N>,
        smooth: &Vector6<f64>,
    ) -> Lines {
        let (campaign, setup) = (self.campaign, &self.setup);
        let window = &campaign.windows[index];
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
            springs: DMatrix::zeros(count, self.file.count()),
            springs_shown: DMatrix::zeros(count, self.file.count()),
            lengths: DMatrix::zeros(count, LINKS),
            mounting: DMatrix::zeros(count, setup.per_mounting()),
            sensor: DMatrix::zeros(count, setup.of_sensor()),
            load: DMatrix::zeros(count, 6),
            variances: Vec::with_capacity(count),
            cluster_3_n: [at.now.cluster_3_n(), cluster_sd.sqrt()],
            gauges,
        };
        let smooth_tensions_n = through.tensions_n(smooth);
        let pushes = window.pushes_n.component_mul(&SVector::from(campaign.metres_per_q));
        let smooth_axes = through.axis_loads(&smooth_tensions_n, &pushes);
        for (row, &gauge) in lines.gauges.iter().enumerate() {
            let placed = setup.placed(campaign, &state.setup, window.mounting, gauge);
            let reading = placed.read(at);
            let derivatives = reading.derivatives(at, through);
            lines.springs.row_mut(row).copy_from(&derivatives.springs.transpose());
            let shown = reading.by_springs(at, through, [&smooth_tensions_n, smooth], &smooth_axes);
            lines.springs_shown.row_mut(row).copy_from(&shown.transpose());
            lines.load.view_mut((row, 0), (1, 6)).copy_from(&derivatives.load.transpose());
            lines.lengths.set_row(row, &derivatives.lengths.transpose());
            let read = |gauge: &Gauge| gauge.read(at).length_m;
            if let Some((place, by)) = setup.derivatives(campaign, &state.setup, window.mounting, gauge, read) {
                lines.mounting.view_mut((row, place), (1, by.len())).copy_from_slice(&by);
            }
            let shown_m = window.readings_m[gauge].unwrap_or_default();
            lines.misclosures[row] = shown_m - reading.length_m - derivatives.load.dot(&surplus);
            lines.variances.push(window.sds_m[gauge].unwrap_or(campaign.noise.gauge_um * 1e-6).powi(2));
        }
        lines.sensor.copy_from(&(-&lines.load * effect));
        lines
    }
}

impl Lines {
    /// The same lines at the loads without their noise.
    pub(super) fn shown(&self) -> Self {
        Self { springs: self.springs_shown.clone(), ..self.clone() }
    }

    /// Derivatives by an elongation of all three links of cluster 3, which is what the play of its joint makes.
    pub(super) fn play(&self) -> DVector<f64> {
        self.lengths.columns(CLUSTER_3, LINKS - CLUSTER_3).column_sum()
    }

    /// The same lines with the constants of the set-up as they are found.
    pub(crate) fn without_setup(&self) -> Self {
        let rows = self.gauges.len();
        Self { mounting: DMatrix::zeros(rows, 0), sensor: DMatrix::zeros(rows, 0), ..self.clone() }
    }
}
