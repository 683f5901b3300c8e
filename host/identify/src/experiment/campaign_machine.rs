//! The simulated machine in a campaign: while a session runs it walks through the poses of a plan,
//! pulls its levels, and shows its gauges on a gauge link. A session that was lost is answered by a
//! slack strap, for the tare, and the level is held again.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use gantry_tau_core::control::axis::{InForce, Reference};
use gantry_tau_core::control::message::Phase;
use gantry_tau_core::units::{Metres, PositionNm};
use gantry_tau_machine::drive_cascade::CYCLE_S;
use gantry_tau_machine::elastic::Pose;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{RobotFile, RobotFileError, Simulation};
use gantry_tau_server::links::gauges::{GaugePublisher, Lengths};
use gantry_tau_server::plant::interpolator::Interpolator;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::plant::{DriveState, Plant, PlantError, Reading};
use gantry_tau_server::record::TickRecord;
use gantry_tau_sim::load_generator::{Load, LoadGenerator, load_generator};
use gantry_tau_sim::machine::{MAX_CYCLES_PER_READ, SimulatedMachine};
use gantry_tau_sim::parameters::SimulationError;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::gauges::SimulatedGauges;
use super::noise::normal;
use crate::experiment::prediction::unloaded;
use crate::measurements::plan::Plan;

/// Stream of the seeded generator, apart from those of machine and gauges.
const STREAM: u64 = 6;
/// Cycles in which gauges and strap are mounted; they begin with the machine on its way to the
/// pose.
const MOUNT_CYCLES: u32 = 2_000;
/// Cycles that a level is held, and the strap is slack after a session was lost.
const HOLD_CYCLES: u32 = 12_000;
/// Change of the strap's force in a cycle, N.
const PULL_N: f64 = 0.1;
/// Speed (m/s) and acceleration (m/s^2) on the way to a pose.
const SPEED: (f64, f64) = (0.05, 0.5);

/// Reports sessions to the machine, from another thread. They are counted: one that ends and the
/// next may be seen at once.
#[derive(Clone, Debug, Default)]
pub struct SessionSwitch(Arc<Sessions>);

#[derive(Debug, Default)]
struct Sessions {
    granted: AtomicU64,
    is_running: AtomicBool,
}

impl SessionSwitch {
    /// Takes note of a tick.
    pub fn see<const N: usize>(&self, row: &TickRecord<N>) {
        self.0
            .granted
            .fetch_add(row.welcomed.into(), Ordering::Relaxed);
        self.0.is_running.store(
            matches!(row.state.phase, Phase::Submit | Phase::Obtain),
            Ordering::Relaxed,
        );
    }
}

/// Behaviour of the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Activity {
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
    step: Activity,
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
    /// Creates the simulated machine of a robot file in a campaign; its gauges are shown on `link`.
    ///
    /// # Errors
    /// As [`SimulatedMachine::from_robot`], and for a pose of the plan that the machine cannot
    /// take.
    pub fn from_robot<K: MachineKind<N>>(
        robot: &RobotFile<K, N>,
        plan: Plan<N>,
        link: GaugePublisher,
    ) -> Result<Self, RobotFileError> {
        let (hand, tool) = load_generator();
        let machine = SimulatedMachine::moving_from_robot(robot, tool, Motion::Hold)?;
        let places = plan.poses.iter().map(|(name, pose)| {
            robot
                .model
                .axes_for(pose)
                .map_err(|error| robot.refuse(&format!("pose {name} of the plan"), error))
        });
        let places = places.collect::<Result<Vec<[f64; N]>, RobotFileError>>()?;
        Self::new(
            machine,
            hand,
            plan,
            places,
            &robot.simulation,
            &robot.home_q()?,
            link,
        )
        .map_err(|error| robot.refuse("simulation", error))
    }

    /// Creates the machine; `machine` rests at home under the load of `hand`, and `places` are the
    /// axes at each pose of the plan, q-units.
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
            step: Activity::Rest,
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

    /// Returns the switch that reports sessions to it.
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
            Activity::Rest => {}
            Activity::Mount { left } | Activity::Slack { left } | Activity::Hold { left }
                if *left > 0 =>
            {
                *left -= 1
            }
            Activity::Mount { .. } => {
                if self.path.has_arrived() {
                    self.began = None;
                    self.hold();
                }
            }
            Activity::Slack { .. } => self.hold(),
            // Without a session nothing is measured.
            Activity::Hold { .. } if has_session => self.next()?,
            Activity::Hold { .. } => {}
        }
        if !self.path.has_arrived() {
            self.path.advance();
        }
        let wanted_n = match self.step {
            Activity::Hold { .. } => self.plan.series[self.series].levels_n[self.level],
            Activity::Rest | Activity::Mount { .. } | Activity::Slack { .. } => 0.0,
        };
        self.pull_n += (wanted_n - self.pull_n).clamp(-PULL_N, PULL_N);
        let series = &self.plan.series[self.series];
        let force = series.direction * self.pull_n;
        let load = Load {
            step: 0,
            force_n: force.into(),
            moment_nm: series.hook_m.cross(&force).into(),
        };
        // Levels of a plan are within the limits of a load; a refused one leaves the load before.
        let _ = self.hand.set(&load);
        Ok(())
    }

    /// A session has begun.
    fn resume(&mut self) -> Result<(), SimulationError> {
        match self.step {
            Activity::Rest => {
                self.series = 0;
                self.level = 0;
                self.mount()
            }
            Activity::Mount { .. } => self.mount(),
            Activity::Hold { .. } if self.level == 0 => self.mount(),
            Activity::Hold { .. } | Activity::Slack { .. } => {
                self.step = Activity::Slack { left: HOLD_CYCLES };
                Ok(())
            }
        }
    }

    /// Walks to the pose of the series, from where the path is.
    fn mount(&mut self) -> Result<(), SimulationError> {
        let place = &self.places[self.plan.series[self.series].pose];
        let to_m: [f64; N] = std::array::from_fn(|axis| place[axis] * self.plan.metres_per_q[axis]);
        let (speed_m_per_s, acceleration_m_per_s2) = SPEED;
        let motion = Motion::BackAndForth {
            waypoints_m: vec![to_m],
            speed_m_per_s,
            acceleration_m_per_s2,
            dwell_cycles: 0,
        };
        self.path = Interpolator::new(self.path.position_m(), &motion)?;
        self.step = Activity::Mount { left: MOUNT_CYCLES };
        Ok(())
    }

    fn hold(&mut self) {
        self.repeats_m
            .fill_with(|| normal(&mut self.generator, self.gauge_sd_m));
        self.step = Activity::Hold { left: HOLD_CYCLES };
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
        self.step = Activity::Rest;
        Ok(())
    }

    /// Returns what the gauges show; NaN while they are mounted.
    fn lengths(&mut self) -> Lengths {
        let count = self.plan.gauges.len();
        if matches!(self.step, Activity::Rest | Activity::Mount { .. }) {
            return Lengths::new(self.cycle, (0..count).map(|_| f64::NAN));
        }
        let series = &self.plan.series[self.series];
        let (_, seed) = &self.plan.poses[series.pose];
        let place = &self.places[series.pose];
        // With masses the gauges are zeroed where the platform has sagged to.
        let stands = || match self.machine.moving_pose() {
            Some(pose) => Some(pose),
            None => Some(unloaded(self.machine.springs(), place, seed).ok()?.pose),
        };
        let began = self.began.or_else(|| Some((stands()?, self.cycle)));
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
            let shaken_m = normal(random, self.resolution_m);
            let length_m = length_m + self.repeats_m[gauge] + shaken_m;
            (length_m / self.resolution_m).round() * self.resolution_m
        });
        Lengths::new(self.cycle, shown)
    }
}

const fn failed(reason: &'static str) -> PlantError {
    PlantError {
        operation: "walk through the plan",
        reason,
    }
}

impl<const N: usize, const M: usize> Plant<N, M> for CampaignMachine<N, M> {
    type Error = PlantError;

    fn in_force(&mut self) -> Result<[InForce; N], PlantError> {
        self.machine.in_force()
    }

    fn read(&mut self, elapsed: u64) -> Result<Reading<N>, PlantError> {
        for _ in 0..elapsed.min(MAX_CYCLES_PER_READ) {
            self.advance()
                .map_err(|_| failed("a pose of the plan is out of range"))?;
        }
        let mut reading = self.machine.read(elapsed)?;
        for (nominal, metres) in reading.nominal.iter_mut().zip(self.path.position_m()) {
            *nominal = PositionNm::from_metres(Metres(metres))
                .map_err(|_| failed("a nominal position is out of range"))?;
        }
        let lengths = self.lengths();
        self.link.publish(&lengths);
        Ok(reading)
    }

    fn write(
        &mut self,
        references: &[Reference; M],
        parts: &[InForce; N],
    ) -> Result<(), PlantError> {
        self.machine.write(references, parts)
    }

    fn drives(&self) -> Option<[DriveState; N]> {
        self.machine.drives()
    }

    fn reset(&mut self) {
        self.machine.reset();
    }
}

#[cfg(test)]
mod tests;
