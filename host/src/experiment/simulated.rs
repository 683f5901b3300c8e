//! A campaign on the simulated machine, without sockets: its springs, its strap, its sensor and its gauges, all drawn by seed.

use gantry_tau_core::model::kinematics::{KinematicsError, Pose};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::OffsetNm;
use nalgebra::{Rotation3, UnitQuaternion, Vector3, Vector6};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::ExperimentError;
use super::prediction::{Prediction, unloaded};
use super::table::Row;
use crate::elastic::{ElasticError, Equilibrium};
use crate::measurements::plan::{Plan, PlannedSeries};
use crate::measurements::springs::SetupNoise;
use crate::model::{Compensator, Held, MachineKind, on_path};
use crate::robot_file::{RobotFile, RobotFileError};
use crate::sim::force_sensor::Mounting;
use crate::sim::gauges::SimulatedGauges;
use crate::sim::springs::TrueSprings;
use crate::springs::compliances::Springs;

/// Streams of the seeded generator, apart from those of springs, sensor and gauges.
const SETUP_STREAM: u64 = 4;
const NOISE_STREAM: u64 = 5;
/// Time of a level, of mounting a strap, and of moving gauges to a pose, s.
const LEVEL_S: f64 = 15.0;
const STRAP_S: f64 = 300.0;
const POSE_S: f64 = 900.0;
/// Samples of a window of 2 s.
const SAMPLES: u64 = 2_000;
/// Largest step of the strap's force on the way to a level, N: play is crossed on the way, not leapt over.
const PULL_N: f64 = 5.0;
/// Rounds in which the client answers the load that its offsets change: each one multiplies the error by a few ten-thousandths.
const CLIENT_ROUNDS: u32 = 4;
/// Rounds in which the hook turns with the platform; each one multiplies the error by a few thousandths.
const HOOK_ROUNDS: u32 = 4;

/// A campaign on the simulated machine.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatedCampaign<const N: usize> {
    /// Springs of the machine: what an identification should find.
    pub truth: Springs<N>,
    /// The windows.
    pub rows: Vec<Row<N>>,
}

/// Measures a plan on the simulated machine of a robot file, whose `[simulation] seed` decides every error. `client` is what is known of the
/// machine: its springs compensate, and predict how far the force sensor turns.
///
/// # Errors
/// [`ExperimentError`].
pub fn simulate<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    client: &RobotFile<K, N>,
    plan: &Plan<N>,
) -> Result<SimulatedCampaign<N>, ExperimentError> {
    let springs = robot.true_springs()?;
    let mut generator = ChaCha8Rng::seed_from_u64(robot.simulation.seed);
    generator.set_stream(NOISE_STREAM);
    let mut bench = Bench {
        plan,
        truth: &springs,
        gauges: SimulatedGauges::new(plan, &robot.simulation),
        sensor: FlawedSensor::new(robot, &plan.setup),
        prediction: Prediction::new(client)?,
        client: Client::new(robot, client)?,
        generator,
        time_s: 0.0,
        rows: Vec::new(),
    };
    let mut before: Option<&PlannedSeries> = None;
    for (index, series) in plan.series.iter().enumerate() {
        let moved = before.is_none_or(|before| before.pose != series.pose);
        bench.time_s += if moved { POSE_S } else { STRAP_S };
        let (name, pose) = &plan.poses[series.pose];
        let q = robot.model.axes_for(pose);
        let q = q.map_err(|error| ExperimentError::Pose { pose: name.clone(), reason: error.to_string() })?;
        bench.measure(index, &q)?;
        before = Some(series);
    }
    Ok(SimulatedCampaign { truth: springs.springs(), rows: bench.rows })
}

/// Machine, instruments and clock.
struct Bench<'a, const N: usize> {
    plan: &'a Plan<N>,
    truth: &'a TrueSprings<N>,
    gauges: SimulatedGauges,
    sensor: FlawedSensor,
    prediction: Prediction<N>,
    client: Client<N>,
    generator: ChaCha8Rng,
    time_s: f64,
    rows: Vec<Row<N>>,
}

impl<const N: usize> Bench<'_, N> {
    /// Measures one series with the axes at `q`, without the offsets.
    fn measure(&mut self, index: usize, q: &[f64; N]) -> Result<(), ExperimentError> {
        let series = &self.plan.series[index];
        let (_, pose) = &self.plan.poses[series.pose];
        let failed = |level_n| move |error| ExperimentError::Load { series: series.name.clone(), level_n, error };
        let mut springs = self.truth.clone();
        let began = unloaded(springs.machine(), q, pose).map_err(failed(0.0))?;
        let assumed = self.prediction.unloaded(q, pose).map_err(failed(0.0))?;
        let shown = self.sensor.shown(&Vector6::zeros(), &began.pose.rotation);
        let tare = shown - self.prediction.weight_seen(&assumed.pose.rotation);
        let (mut now, mut pulled_n, mut held_q) = (began, 0.0, *q);
        let begin_s = self.time_s;
        for (level, &level_n) in series.levels_n.iter().enumerate() {
            let mut load = Vector6::zeros();
            for force_n in steps(pulled_n, level_n) {
                (now, load) = pulled(&mut springs, &held_q, series, &began, &now, force_n).map_err(failed(level_n))?;
            }
            pulled_n = level_n;
            let noise = self.load_noise();
            // The strap is pulled slowly: what the offsets change on the way, a few ten-thousandths of the load, does not matter to the play.
            // At the first level the sensor is tared, and the client asks for nothing.
            for _ in 0..if series.compensated && level > 0 { CLIENT_ROUNDS } else { 0 } {
                let seen = self.sensor.shown(&load, &now.pose.rotation) - shown;
                held_q = self
                    .client
                    .held(pose, q, &seen, &noise)
                    .map_err(|reason| ExperimentError::Pose { pose: self.plan.poses[series.pose].0.clone(), reason })?;
                (now, load) = pulled(&mut springs, &held_q, series, &began, &now, level_n).map_err(failed(level_n))?;
            }
            let seen = self.sensor.shown(&load, &now.pose.rotation) - tare;
            let indicated = self.prediction.load(&seen, &held_q, &assumed);
            let indicated = indicated.map_err(|error| {
                let series = series.name.clone();
                ExperimentError::Sensor { series, level_n, error }
            })? + noise;
            let seconds = self.time_s - begin_s;
            let place = |gauge| (index, series.mounting, gauge);
            let loaded = springs.loaded(began.pose, now, load, &series.wrist_rad);
            let read = |gauge| self.gauges.read(place(gauge), &loaded, seconds);
            let exact: Vec<f64> = (0..self.plan.gauges.len()).map(read).collect();
            let row = self.disturbed((index, level), &held_q, &indicated, &exact);
            self.rows.push(row);
            self.time_s += LEVEL_S;
        }
        Ok(())
    }

    /// Draws the noise of a window's mean load, world axes.
    fn load_noise(&mut self) -> Vector6<f64> {
        let noise = self.plan.noise;
        let sd = |component: usize| if component < 3 { noise.force_n } else { noise.moment_nm };
        Vector6::from_fn(|component, _| {
            sd(component) * Distribution::<f64>::sample(&StandardNormal, &mut self.generator)
        })
    }

    /// Adds the noise of a window's mean to the gauges. It is drawn for those that are not read, too, so that a plan may leave one out.
    fn disturbed(
        &mut self,
        (series, level): (usize, usize),
        q: &[f64; N],
        load: &Vector6<f64>,
        exact: &[f64],
    ) -> Row<N> {
        let noise = self.plan.noise;
        let random = &mut self.generator;
        let mut normal = |sd: f64| sd * Distribution::<f64>::sample(&StandardNormal, random);
        let read = &self.plan.series[series].gauges;
        let shown = exact.iter().map(|length_m| length_m + normal(noise.gauge_um * 1e-6)).collect::<Vec<f64>>();
        let readings_m = shown.iter().enumerate().map(|(gauge, length)| read.contains(&gauge).then_some(*length));
        let readings_m: Vec<Option<f64>> = readings_m.collect();
        let sds_m = vec![None; readings_m.len()];
        Row { series, level, q: *q, load: *load, readings_m, sds_m, time_s: self.time_s, samples: SAMPLES }
    }
}

/// The compensating client: a robot file's springs, the limits of the machine's server.
struct Client<const N: usize> {
    compensator: Box<dyn Compensator<N>>,
    mounting: Mounting,
    metres_per_q: [f64; N],
}

impl<const N: usize> Client<N> {
    fn new<K: MachineKind<N>>(machine: &RobotFile<K, N>, client: &RobotFile<K, N>) -> Result<Self, RobotFileError> {
        let compensator = client.compensator(machine.limits.map(|axis| OffsetNm(axis.limits.position.max())))?;
        Ok(Self { compensator, mounting: (&client.sensor).into(), metres_per_q: client.metres_per_q })
    }

    /// Positions of the axes, q-units, with the offsets that hold the tool in a pose whose axes are at `q`. `change` is that of what the sensor
    /// shows since it was tared in the nominal pose; as in the client, the sensor turns along with the platform under the load.
    fn held(&self, pose: &Pose, q: &[f64; N], change: &Vector6<f64>, noise: &Vector6<f64>) -> Result<[f64; N], String> {
        self.corrected(pose, q, change, noise).map_err(|error| error.to_string())
    }

    fn corrected(
        &self,
        pose: &Pose,
        q: &[f64; N],
        change: &Vector6<f64>,
        noise: &Vector6<f64>,
    ) -> Result<[f64; N], KinematicsError> {
        let nominal = on_path(q, &self.metres_per_q)?;
        let unturned = UnitQuaternion::from_matrix(&pose.rotation);
        let raw = change + self.mounting.seen(&Vector6::zeros(), &unturned);
        let (mut platform, mut load) = (unturned, Wrench::zero());
        for _ in 0..CLIENT_ROUNDS {
            load = Wrench::from_array((self.mounting.load(&raw, &platform) + noise).into());
            let turned_rad = self.compensator.turned_rad(pose, &nominal, &load)?;
            platform = UnitQuaternion::from_scaled_axis(turned_rad) * unturned;
        }
        let held = Held::new(&*self.compensator, &self.metres_per_q, pose, q, &load)?;
        Ok(held.corrected)
    }
}

/// Forces on the way from one level to the next, the last of which is the level.
fn steps(from_n: f64, to_n: f64) -> impl Iterator<Item = f64> {
    let count = ((to_n - from_n).abs() / PULL_N).ceil().max(1.0);
    (1..=count as u32).map(move |step| from_n + (to_n - from_n) * (f64::from(step) / count))
}

/// Pulls at the hook, which moves with the platform, while the direction stays: the other end of the strap is far away. Returns the
/// equilibrium and the load about the tool centre point where it then is.
fn pulled<const N: usize>(
    springs: &mut TrueSprings<N>,
    q: &[f64; N],
    series: &PlannedSeries,
    began: &Equilibrium<N>,
    start: &Equilibrium<N>,
    force_n: f64,
) -> Result<(Equilibrium<N>, Vector6<f64>), ElasticError> {
    let force = series.direction * force_n;
    let load = |now: &Equilibrium<N>| {
        let arm = now.pose.rotation * began.pose.rotation.inverse() * series.hook_m;
        let moment = arm.cross(&force);
        Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z)
    };
    let mut now = *start;
    for _ in 0..HOOK_ROUNDS {
        now = springs.machine().equilibrium(q, &load(&now), &now)?;
    }
    let load = load(&now);
    Ok((springs.settle(q, &load, &now)?, load))
}

/// Force sensor whose mounting and gains are not quite what the robot file says.
#[derive(Clone, Debug)]
struct FlawedSensor {
    mounting: Mounting,
    gains: Vector6<f64>,
}

impl FlawedSensor {
    /// Draws the errors that `[setup]` states: of the lever (platform axes), of the axes (turned about those of the platform), and of the
    /// gains (sensor axes, about the sensor's origin).
    fn new<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>, setup: &SetupNoise) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(robot.simulation.seed);
        random.set_stream(SETUP_STREAM);
        let mut normal =
            |sd: Option<f64>| sd.unwrap_or(0.0) * Distribution::<f64>::sample(&StandardNormal, &mut random);
        let lever_m = Vector3::from_fn(|_, _| normal(setup.sensor_lever_mm) * 1e-3);
        let turn = Rotation3::new(Vector3::from_fn(|_, _| normal(setup.sensor_axes_mrad) * 1e-3));
        let gains = Vector6::from_fn(|_, _| 1.0 + normal(setup.sensor_gain));
        let nominal = Mounting::from(&robot.sensor);
        let mounting = Mounting { rotation: turn * nominal.rotation, lever_m: nominal.lever_m + lever_m, ..nominal };
        Self { mounting, gains }
    }

    /// Returns what it shows of load and weight, sensor axes.
    fn shown(&self, load: &Vector6<f64>, platform: &UnitQuaternion<f64>) -> Vector6<f64> {
        self.mounting.seen(load, platform).component_mul(&self.gains)
    }
}

#[cfg(test)]
mod tests;
