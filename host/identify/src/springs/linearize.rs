//! A campaign, linearized window by window at a state of the machine and its set-up.

use gantry_tau_core::model::robot::LINKS;
use gantry_tau_machine::elastic::backlash::Backlash;
use gantry_tau_machine::elastic::gauge::Gauge;
use gantry_tau_machine::elastic::loaded::Loaded;
use gantry_tau_machine::elastic::{ElasticError, ElasticMachine, Equilibrium, Pose, Transmission};
use gantry_tau_machine::model::Wrist;
use nalgebra::{DMatrix, DVector, Matrix6, SVector, UnitQuaternion, Vector6};

use super::post_jump::{CLUSTER_3, longer};
use super::problem::SpringsProblem;
use super::smooth_loads::smooth_loads;
use super::state::FitState;
use crate::measurements::springs::Window;

/// A window, linearized: one row per gauge that was read.
#[derive(Clone, Debug)]
pub(crate) struct LinearizedWindow {
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
    /// Sum of the tensions of cluster 3 by the load, N, and its standard deviation by the noise of
    /// the load.
    pub(crate) cluster_3_n: [f64; 2],
}

/// Reason why a campaign cannot be linearized.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LinearizationError {
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

impl LinearizationError {
    fn of<const N: usize>(window: &Window<N>, error: ElasticError) -> Self {
        Self::Window {
            line: window.line,
            error,
        }
    }
}

impl<const N: usize> SpringsProblem<'_, N> {
    /// Linearizes every window; `is_crossed` says which are beyond the jump.
    pub(crate) fn linearize(
        &self,
        state: &FitState<N>,
        is_crossed: &[bool],
    ) -> Result<Vec<LinearizedWindow>, LinearizationError> {
        let loaded = self.loaded(state, is_crossed)?;
        let mut linearized: Vec<LinearizedWindow> = Vec::with_capacity(loaded.len());
        let smooth = smooth_loads(self.campaign, &state.loads);
        for (index, (loaded, smooth)) in loaded.iter().zip(&smooth).enumerate() {
            linearized.push(self.linearize_shown(state, index, loaded, smooth)?);
        }
        Ok(linearized)
    }

    /// Finds the equilibrium of every window; `is_crossed` says which are beyond the jump.
    pub(crate) fn loaded(
        &self,
        state: &FitState<N>,
        is_crossed: &[bool],
    ) -> Result<Vec<Loaded<N>>, LinearizationError> {
        let machine = ElasticMachine::new(*self.geometry, state.springs.machine, Backlash::NONE);
        let wrists = self.wrists(&state.springs.wrist);
        let mut began: Vec<Option<Equilibrium<N>>> = vec![None; self.campaign.series.len()];
        let mut last = began.clone();
        let mut all = Vec::with_capacity(self.campaign.windows.len());
        for (index, window) in self.campaign.windows.iter().enumerate() {
            let first = match began[window.series] {
                Some(first) => first,
                None => self
                    .unloaded(&machine, window)
                    .map_err(|error| LinearizationError::of(window, error))?,
            };
            began[window.series] = Some(first);
            let start = last[window.series].unwrap_or(first);
            let load = state.loads[index];
            let machine = if is_crossed[index] {
                self.beyond_jump(&machine, state, index, &start)?
            } else {
                machine
            };
            let now = self.equilibrium(&machine, window, &load, &start)?;
            last[window.series] = Some(now);
            all.push(Loaded {
                machine,
                wrist: wrists[window.series].clone(),
                began: first.pose,
                now,
                load,
            });
        }
        Ok(all)
    }

    /// The machine beyond the jump, in a window.
    fn beyond_jump(
        &self,
        machine: &ElasticMachine<N>,
        state: &FitState<N>,
        index: usize,
        start: &Equilibrium<N>,
    ) -> Result<ElasticMachine<N>, LinearizationError> {
        let tensions_n = if state.post_jump.is_empty() {
            Vector6::zeros()
        } else {
            let window = &self.campaign.windows[index];
            self.equilibrium(machine, window, &state.loads[index], start)?
                .tensions_n
        };
        let longer = longer(
            self.geometry,
            state.elongation_m,
            &state.post_jump,
            &tensions_n,
        );
        Ok(ElasticMachine::new(
            longer,
            state.springs.machine,
            Backlash::NONE,
        ))
    }

    /// The machine in a window, under a load.
    fn equilibrium(
        &self,
        machine: &ElasticMachine<N>,
        window: &Window<N>,
        load: &Vector6<f64>,
        start: &Equilibrium<N>,
    ) -> Result<Equilibrium<N>, LinearizationError> {
        let pushes = window
            .pushes_n
            .component_mul(&SVector::from(self.campaign.metres_per_q));
        machine
            .pushed_equilibrium(&window.q, load, &pushes, start)
            .map_err(|error| LinearizationError::of(window, error))
    }

    /// The wrist at the angles of each series.
    fn wrists(&self, wrist: &Wrist) -> Vec<Wrist> {
        let campaign = self.campaign;
        campaign
            .series
            .iter()
            .map(|series| wrist.turned(campaign.wrist_rad(series)))
            .collect()
    }

    /// The machine in the pose of a window, unloaded.
    pub(crate) fn unloaded(
        &self,
        machine: &ElasticMachine<N>,
        window: &Window<N>,
    ) -> Result<Equilibrium<N>, ElasticError> {
        let (_, seed) = &self.campaign.poses[window.pose];
        let rotation = UnitQuaternion::from_matrix(&seed.rotation);
        let start = Equilibrium::unloaded(Pose {
            translation_m: seed.position_m,
            rotation,
        });
        machine.equilibrium(&window.q, &Vector6::zeros(), &start)
    }

    /// Linearizes one window.
    pub(crate) fn linearize_window(
        &self,
        state: &FitState<N>,
        index: usize,
        at: &Loaded<N>,
    ) -> Result<LinearizedWindow, LinearizationError> {
        self.linearize_shown(state, index, at, &state.loads[index])
    }

    /// As [`linearize_window`](Self::linearize_window), and shown by another load.
    fn linearize_shown(
        &self,
        state: &FitState<N>,
        index: usize,
        at: &Loaded<N>,
        smooth: &Vector6<f64>,
    ) -> Result<LinearizedWindow, LinearizationError> {
        let window = &self.campaign.windows[index];
        let through = at
            .machine
            .transmission(&window.q, &at.now)
            .ok_or_else(|| LinearizationError::of(window, ElasticError::Singular))?;
        Ok(self.through(state, index, at, &through, smooth))
    }

    /// Standard deviation of the sum of the tensions of cluster 3 by the noise of the load, N.
    fn cluster_sd_n(&self, through: &Transmission<N>) -> f64 {
        let unit = Matrix6::from_columns(&std::array::from_fn::<_, 6, _>(|component| {
            through.tensions_n(&Vector6::ith(component, 1.0))
        }));
        let per_component = unit.fixed_rows::<3>(CLUSTER_3).row_sum().transpose();
        per_component
            .component_mul(&per_component)
            .dot(&self.load_variances())
            .sqrt()
    }

    fn through(
        &self,
        state: &FitState<N>,
        index: usize,
        at: &Loaded<N>,
        through: &Transmission<N>,
        smooth: &Vector6<f64>,
    ) -> LinearizedWindow {
        let campaign = self.campaign;
        let setup = &self.setup;
        let window = &campaign.windows[index];
        let gauges: Vec<usize> = (0..campaign.gauges.len())
            .filter(|gauge| window.readings_m[*gauge].is_some())
            .collect();
        let count = gauges.len();
        let effect = setup.effect(&state.loads[index]);
        let of_sensor = state.setup.rows(setup.first_of_sensor(), setup.of_sensor());
        let surplus = window.load
            - state.loads[index]
            - Vector6::from_iterator((&effect * of_sensor).iter().copied());
        let mut linearized = LinearizedWindow {
            window: index,
            misclosures: DVector::zeros(count),
            springs: DMatrix::zeros(count, self.file.count()),
            springs_shown: DMatrix::zeros(count, self.file.count()),
            lengths: DMatrix::zeros(count, LINKS),
            mounting: DMatrix::zeros(count, setup.per_mounting()),
            sensor: DMatrix::zeros(count, setup.of_sensor()),
            load: DMatrix::zeros(count, 6),
            variances: Vec::with_capacity(count),
            cluster_3_n: [at.now.cluster_3_n(), self.cluster_sd_n(through)],
            gauges,
        };
        let smooth_tensions_n = through.tensions_n(smooth);
        let pushes = window
            .pushes_n
            .component_mul(&SVector::from(campaign.metres_per_q));
        let smooth_axes = through.axis_loads(&smooth_tensions_n, &pushes);
        for (row, &gauge) in linearized.gauges.iter().enumerate() {
            let placed = setup.placed(campaign, &state.setup, window.mounting, gauge);
            let reading = placed.read(at);
            let derivatives = reading.derivatives(at, through);
            linearized
                .springs
                .row_mut(row)
                .copy_from(&derivatives.springs.transpose());
            let shown = reading.by_springs(at, through, [&smooth_tensions_n, smooth], &smooth_axes);
            linearized
                .springs_shown
                .row_mut(row)
                .copy_from(&shown.transpose());
            linearized
                .load
                .view_mut((row, 0), (1, 6))
                .copy_from(&derivatives.load.transpose());
            linearized
                .lengths
                .set_row(row, &derivatives.lengths.transpose());
            let by_mounting = setup.derivatives(
                campaign,
                &state.setup,
                window.mounting,
                gauge,
                |gauge: &Gauge| gauge.read(at).length_m,
            );
            if let Some((place, by)) = by_mounting {
                linearized
                    .mounting
                    .view_mut((row, place), (1, by.len()))
                    .copy_from_slice(&by);
            }
            let shown_m = window.readings_m[gauge].unwrap_or_default();
            linearized.misclosures[row] =
                shown_m - reading.length_m - derivatives.load.dot(&surplus);
            linearized.variances.push(
                window.sds_m[gauge]
                    .unwrap_or(campaign.noise.gauge_um * 1e-6)
                    .powi(2),
            );
        }
        linearized.sensor.copy_from(&(-&linearized.load * effect));
        linearized
    }
}

impl LinearizedWindow {
    /// Row of a gauge; `None` where it was not read.
    pub(crate) fn row_of(&self, gauge: usize) -> Option<usize> {
        self.gauges.iter().position(|other| *other == gauge)
    }

    /// The same window at the loads without their noise.
    pub(super) fn shown(&self) -> Self {
        Self {
            springs: self.springs_shown.clone(),
            ..self.clone()
        }
    }

    /// Derivatives by an elongation of all three links of cluster 3, which is what the play of its
    /// joint makes.
    pub(super) fn play(&self) -> DVector<f64> {
        self.lengths
            .columns(CLUSTER_3, LINKS - CLUSTER_3)
            .column_sum()
    }

    /// The same window with the constants of the set-up as they are found.
    pub(crate) fn without_setup(&self) -> Self {
        let rows = self.gauges.len();
        Self {
            mounting: DMatrix::zeros(rows, 0),
            sensor: DMatrix::zeros(rows, 0),
            ..self.clone()
        }
    }
}
