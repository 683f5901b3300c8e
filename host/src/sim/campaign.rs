//! The simulated machine in a campaign: while a session runs it walks through the poses of a plan, pulls its levels, and shows its gauges on a
//! gauge link. A session that was lost is answered by a slack strap, for the tare, and the level is held again.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use gantry_tau_core::control::axis::{InForce, Reference};
use gantry_tau_core::control::message::Phase;
use gantry_tau_core::units::{Metres, PositionNm};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::gauges::SimulatedGauges;
use super::interpolator::Interpolator;
use super::load_generator::{Load, LoadGenerator};
use super::machine::{MAX_CYCLES_PER_READ, SimulatedMachine};
use super::parameters::{Motion, SimulationError};
use crate::elastic::Pose;
use crate::experiment::prediction::unloaded;
use crate::gauge_link::{GaugePublisher, Lengths};
use crate::measurements::plan::Plan;
use crate::plant::{DriveState, Plant, PlantError, Reading};
use crate::robot_file::Simulation;
use crate::server::cycle::Row;

/// Stream of the seeded generator, apart from those of machine and gauges.
const STREAM: u64 = 6;
/// Cycles in which gauges and strap are mounted; they begin with the machine on its way to the pose.
const MOUNT_CYCLES: u32 = 2_000;
/// Cycles that a level is held, and the strap is slack after a session was lost.
const HOLD_CYCLES: u32 = 12_000;
/// Change of the strap's force in a cycle, N.
const PULL_N: f64 = 0.1;
/// Speed (m/s) and acceleration (m/s^2) on the way to a pose.
const SPEED: (f64, f64) = (0.05, 0.5);
/// Time of a cycle, s.
const CYCLE_S: f64 = 1e-3;

/// Tells the machine of sessions, from another thread. They are counted: one that ends and the next may be seen at once.
#[derive(Clone, Debug, Default)]
pub struct SessionSwitch(Arc<Sessions>);

#[derive(Debug, Default)]
struct Sessions {
    granted: AtomicU64,
    is_running: AtomicBool,
}

impl SessionSwitch {
    /// Takes note of a tick.
    pub fn see<const N: usize>(&self, row: &Row<N>) {
        self.0.granted.fetch_add(row.welcomed.into(), Ordering::Relaxed);
        self.0.is_running.store(matches!(row.state.phase, Phase::Submit | Phase::Obtain), Ordering::Relaxed);
    }
}

/// Behaviour of the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    /// Nothing: no session has begun, or the plan is done.
    Rest,
    /// It walks to the pose of the series, and gauges and strap are mounted.
    Mount { left: u32 },
    /// The strap is slack, before a level is held again.
    Slack { left: u32 },
    /// A level is held.
    Hold { left: u32 },
}

/// The simulated machine, its strap and its gauges.
#[derive(Debug)]
pub struct CampaignMachine<const N: usize, const M: usize> {
    machine: SimulatedMachine<N, M>,
    plan: Plan<N>,
    /// Axes at each pose of the plan, q-units.
    places: Vec<[f64; N]>,
    gauges: SimulatedGauges,
    link: GaugePublisher,
    hand: LoadGenerator,
    switch: SessionSwitch,
    /// Sessions that it has begun for.
    sessions: u64,
    path: Interpolator<N>,
    series: usize,
    level: usize,
    step: Step,
    pull_n: f64,
    /// Unloaded pose and cycle of the first window of the series.
    began: Option<(Pose, u64)>,
    cycle: u64,
    generator: ChaCha8Rng,
    gauge_sd_m: f64,
    resolution_m: f64,
    /// Error with which each gauge repeats at this level, m.
    repeats_m: Vec<f64>,
}

impl<const N: usize, const M: usize> CampaignMachine<N, M> {
    /// Creates the machine; `machine` rests at home under the load of `hand`, and `places` are the axes at each pose of the plan, q-units.
    ///
    /// # Errors
    /// [`SimulationError`]: home or a pose is out of range.
    pub fn new(
        machine: SimulatedMachine<N, M>,
        hand: LoadGenerator,
        plan: Plan<N>,
        places: Vec<[f64; N]>,
        simulation: &Simulation,
        home_q: &[f64; N],
        link: GaugePublisher,
    ) -> Result<Self, SimulationError> {
        let mut generator = ChaCha8Rng::seed_from_u64(simulation.seed);
        generator.set_stream(STREAM);
        let home_m = std::array::from_fn(|axis| home_q[axis] * plan.metres_per_q[axis]);
        Ok(Self {
            machine,
            gauges: SimulatedGauges::new(&plan, simulation),
            link,
            hand,
            switch: SessionSwitch::default(),
            sessions: 0,
            path: Interpolator::new(home_m, &Motion::Hold)?,
            series: 0,
            level: 0,
            step: Step::Rest,
            pull_n: 0.0,
            began: None,
            cycle: 0,
            generator,
            gauge_sd_m: plan.noise.gauge_um * 1e-6,
            resolution_m: simulation.gauge_resolution_m,
            repeats_m: vec![0.0; plan.gauges.len()],
            places,
            plan,
        })
    }

    /// Returns the switch that tells it of sessions.
    #[must_use]
    pub fn switch(&self) -> SessionSwitch {
        self.switch.clone()
    }

    /// Runs one cycle of the campaign.
    fn advance(&mut self) -> Result<(), SimulationError> {
        self.cycle += 1;
        let sessions = self.switch.0.granted.load(Ordering::Relaxed);
        if sessions != self.sessions {
            self.sessions = sessions;
            self.resume()?;
        }
        let has_session = self.switch.0.is_running.load(Ordering::Relaxed);
        match &mut self.step {
            Step::Rest => {}
            Step::Mount { left } | Step::Slack { left } | Step::Hold { left } if *left > 0 => *left -= 1,
            Step::Mount { .. } => {
                if self.path.has_arrived() {
                    self.began = None;
                    self.hold();
                }
            }
            Step::Slack { .. } => self.hold(),
            // Without a session nobody measures.
            Step::Hold { .. } if has_session => self.next()?,
            Step::Hold { .. } => {}
        }
        if !self.path.has_arrived() {
            self.path.advance();
        }
        let wanted_n = match self.step {
            Step::Hold { .. } => self.plan.series[self.series].levels_n[self.level],
            Step::Rest | Step::Mount { .. } | Step::Slack { .. } => 0.0,
        };
        self.pull_n += (wanted_n - self.pull_n).clamp(-PULL_N, PULL_N);
        let series = &self.plan.series[self.series];
        let force = series.direction * self.pull_n;
        let load = Load { step: 0, force_n: force.into(), moment_nm: series.hook_m.cross(&force).into() };
        // Levels of a plan are within the limits of a load; a refused one leaves the load before.
        let _ = self.hand.set(&load);
        Ok(())
    }

    /// A session has begun.
    fn resume(&mut self) -> Result<(), SimulationError> {
        match self.step {
            Step::Rest => {
                (self.series, self.level) = (0, 0);
                self.mount()
            }
            Step::Mount { .. } => self.mount(),
            Step::Hold { .. } if self.level == 0 => self.mount(),
            Step::Hold { .. } | Step::Slack { .. } => {
                self.step = Step::Slack { left: HOLD_CYCLES };
                Ok(())
            }
        }
    }

    /// Walks to the pose of the series, from where the path is.
    fn mount(&mut self) -> Result<(), SimulationError> {
        let place = &self.places[self.plan.series[self.series].pose];
        let to_m: [f64; N] = std::array::from_fn(|axis| place[axis] * self.plan.metres_per_q[axis]);
        let (speed_m_per_s, acceleration_m_per_s2) = SPEED;
        let motion =
            Motion::BackAndForth { waypoints_m: vec![to_m], speed_m_per_s, acceleration_m_per_s2, dwell_cycles: 0 };
        self.path = Interpolator::new(self.path.position_m(), &motion)?;
        self.step = Step::Mount { left: MOUNT_CYCLES };
        Ok(())
    }

    fn hold(&mut self) {
        let random = &mut self.generator;
        self.repeats_m.fill_with(|| self.gauge_sd_m * Distribution::<f64>::sample(&StandardNormal, random));
        self.step = Step::Hold { left: HOLD_CYCLES };
    }

    /// Goes on to the next level, or series.
    fn next(&mut self) -> Result<(), SimulationError> {
        self.level += 1;
        if self.level < self.plan.series[self.series].levels_n.len() {
            self.hold();
            return Ok(());
        }
        self.level = 0;
        if self.series + 1 < self.plan.series.len() {
            self.series += 1;
            return self.mount();
        }
        self.step = Step::Rest;
        Ok(())
    }

    /// Returns what the gauges show; NaN while they are mounted.
    fn lengths(&mut self) -> Lengths {
        let count = self.plan.gauges.len();
        if matches!(self.step, Step::Rest | Step::Mount { .. }) {
            return Lengths::new(self.cycle, (0..count).map(|_| f64::NAN));
        }
        let series = &self.plan.series[self.series];
        let (_, seed) = &self.plan.poses[series.pose];
        let place = &self.places[series.pose];
        let began = self.began.or_else(|| Some((unloaded(self.machine.springs(), place, seed).ok()?.pose, self.cycle)));
        self.began = began;
        let Some((began, since)) = began else {
            return Lengths::new(self.cycle, (0..count).map(|_| f64::NAN));
        };
        let seconds = self.cycle.saturating_sub(since) as f64 * CYCLE_S;
        let loaded = self.machine.seen_from(began, &series.wrist_rad);
        let random = &mut self.generator;
        let shown = (0..count).map(|gauge| {
            let place = (self.series, series.mounting, gauge);
            let length_m = self.gauges.read(place, &loaded, seconds);
            let shaken_m = self.resolution_m * Distribution::<f64>::sample(&StandardNormal, random);
            let length_m = length_m + self.repeats_m[gauge] + shaken_m;
            (length_m / self.resolution_m).round() * self.resolution_m
        });
        Lengths::new(self.cycle, shown)
    }
}

impl<const N: usize, const M: usize> Plant<N, M> for CampaignMachine<N, M> {
    fn in_force(&mut self) -> Result<[InForce; N], PlantError> {
        self.machine.in_force()
    }

    fn read(&mut self, elapsed: u64) -> Result<Reading<N>, PlantError> {
        let failed = |reason| PlantError { operation: "walk through the plan", reason };
        for _ in 0..elapsed.min(MAX_CYCLES_PER_READ) {
            self.advance().map_err(|_| failed("a pose of the plan is out of range"))?;
        }
        let mut reading = self.machine.read(elapsed)?;
        for (nominal, metres) in reading.nominal.iter_mut().zip(self.path.position_m()) {
            *nominal =
                PositionNm::from_metres(Metres(metres)).map_err(|_| failed("a nominal position is out of range"))?;
        }
        let lengths = self.lengths();
        self.link.publish(&lengths);
        Ok(reading)
    }

    fn write(&mut self, references: &[Reference; M], parts: &[InForce; N]) -> Result<(), PlantError> {
        self.machine.write(references, parts)
    }

    fn drives(&self) -> Option<[DriveState; N]> {
        self.machine.drives()
    }

    fn reset(&mut self) {
        self.machine.reset();
    }
}
