//! A campaign on the simulated machine, without sockets: its springs, its strap, its sensor and its
//! gauges, all drawn by seed.

use gantry_tau_core::model::kinematics::{KinematicsError, Pose};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::OffsetNm;
use gantry_tau_machine::elastic::springs::Springs;
use gantry_tau_machine::elastic::{ElasticError, Equilibrium};
use gantry_tau_machine::model::{Compensate, CorrectedPose, MachineKind, on_path};
use gantry_tau_machine::robot_file::{RobotFile, RobotFileError};
use gantry_tau_machine::sensor::Mounting;
use gantry_tau_sim::springs::TrueSprings;
use nalgebra::{Rotation3, UnitQuaternion, Vector3, Vector6};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::ExperimentError;
use super::noise::normal;
use super::prediction::{Prediction, unloaded};
use super::table::WindowRow;
use crate::experiment::gauges::SimulatedGauges;
use crate::measurements::plan::{Plan, PlannedSeries};
use crate::measurements::springs::SetupNoise;

/// Streams of the seeded generator, apart from those of springs, sensor and gauges.
const SETUP_STREAM: u64 = 4;
const NOISE_STREAM: u64 = 5;
/// Time of a level, of mounting a strap, and of moving gauges to a pose, s.
const LEVEL_S: f64 = 15.0;
const STRAP_S: f64 = 300.0;
const POSE_S: f64 = 900.0;
/// Samples of a window of 2 s.
const SAMPLES: u64 = 2_000;
/// Largest step of the strap's force on the way to a level, N: play is crossed on the way, not
/// leapt over.
const PULL_N: f64 = 5.0;
/// Rounds in which the client answers the load that its offsets change: each one multiplies the
/// error by a few ten-thousandths.
const CLIENT_ROUNDS: u32 = 4;
/// Rounds in which the hook turns with the platform; each one multiplies the error by a few
/// thousandths.
const HOOK_ROUNDS: u32 = 4;

/// A campaign on the simulated machine.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatedCampaign<const N: usize> {
    /// Springs of the machine: what an identification should find.
    pub truth: Springs<N>,
    /// The windows.
    pub rows: Vec<WindowRow<N>>,
}

/// Measures a plan on the simulated machine of a robot file, whose `[simulation] seed` decides
/// every error. `client` is what is known of the machine: its springs compensate, and predict how
/// far the force sensor turns.
///
/// # Errors
/// [`ExperimentError`].
pub fn simulate<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    client: &RobotFile<K, N>,
    plan: &Plan<N>,
) -> Result<SimulatedCampaign<N>, ExperimentError> {
    let springs = TrueSprings::from_robot(robot)?;
    let mut generator = ChaCha8Rng::seed_from_u64(robot.simulation.seed);
    generator.set_stream(NOISE_STREAM);
    let mut experiment = SimulatedExperiment {
        plan,
        truth: &springs,
        gauges: SimulatedGauges::new(plan, &robot.simulation),
        sensor: FlawedSensor::new(robot, &plan.setup),
        prediction: Prediction::new(client)?,
        client: CompensatingClient::new(robot, client)?,
        generator,
        time_s: 0.0,
        rows: Vec::new(),
    };
    let mut before: Option<&PlannedSeries> = None;
    for (index, series) in plan.series.iter().enumerate() {
        let moved = before.is_none_or(|before| before.pose != series.pose);
        experiment.time_s += if moved { POSE_S } else { STRAP_S };
        let (name, pose) = &plan.poses[series.pose];
        let q = robot.model.axes_for(pose);
        let q = q.map_err(|error| ExperimentError::Pose {
            pose: name.clone(),
            reason: error.into(),
        })?;
        experiment.measure(index, &q)?;
        before = Some(series);
    }
    Ok(SimulatedCampaign {
        truth: springs.springs(),
        rows: experiment.rows,
    })
}

/// Machine, instruments and clock.
struct SimulatedExperiment<'a, const N: usize> {
    plan: &'a Plan<N>,
    truth: &'a TrueSprings<N>,
    gauges: SimulatedGauges,
    sensor: FlawedSensor,
    prediction: Prediction<N>,
    client: CompensatingClient<N>,
    generator: ChaCha8Rng,
    time_s: f64,
    rows: Vec<WindowRow<N>>,
}

impl<const N: usize> SimulatedExperiment<'_, N> {
    /// Measures one series with the axes at `q`, without the offsets.
    fn measure(&mut self, index: usize, q: &[f64; N]) -> Result<(), ExperimentError> {
        let series = &self.plan.series[index];
        let (_, pose) = &self.plan.poses[series.pose];
        let mut springs = self.truth.clone();
        let began =
            unloaded(springs.machine(), q, pose).map_err(|error| load_error(series, 0.0, error))?;
        let assumed = self
            .prediction
            .unloaded(q, pose)
            .map_err(|error| load_error(series, 0.0, error))?;
        let shown = self.sensor.shown(&Vector6::zeros(), &began.pose.rotation);
        let tare = shown - self.prediction.weight_seen(&assumed.pose.rotation);
        let mut now = began;
        let mut pulled_n = 0.0;
        let mut held_q = *q;
        let begin_s = self.time_s;
        for (level, &level_n) in series.levels_n.iter().enumerate() {
            let mut load = Vector6::zeros();
            for force_n in steps(pulled_n, level_n) {
                (now, load) = pulled(&mut springs, &held_q, series, &began, &now, force_n)
                    .map_err(|error| load_error(series, level_n, error))?;
            }
            pulled_n = level_n;
            let noise = self.load_noise();
            // The strap is pulled slowly: what the offsets change on the way, a few ten-thousandths
            // of the load, does not matter to the play. At the first level the sensor is tared, and
            // the client asks for nothing.
            for _ in 0..if series.compensated && level > 0 {
                CLIENT_ROUNDS
            } else {
                0
            } {
                let seen = self.sensor.shown(&load, &now.pose.rotation) - shown;
                held_q = self.client.held(pose, q, &seen, &noise).map_err(|error| {
                    ExperimentError::Pose {
                        pose: self.plan.poses[series.pose].0.clone(),
                        reason: error.into(),
                    }
                })?;
                (now, load) = pulled(&mut springs, &held_q, series, &began, &now, level_n)
                    .map_err(|error| load_error(series, level_n, error))?;
            }
            let seen = self.sensor.shown(&load, &now.pose.rotation) - tare;
            let indicated = self.prediction.load(&seen, &held_q, &assumed);
            let indicated = indicated.map_err(|error| {
                let series = series.name.clone();
                ExperimentError::Sensor {
                    series,
                    level_n,
                    error,
                }
            })? + noise;
            let seconds = self.time_s - begin_s;
            let loaded = springs.loaded(began.pose, now, load, &series.wrist_rad);
            let exact: Vec<f64> = (0..self.plan.gauges.len())
                .map(|gauge| {
                    let place = (index, series.mounting, gauge);
                    self.gauges.read(place, &loaded, seconds)
                })
                .collect();
            let row = self.disturbed((index, level), &held_q, &indicated, &exact);
            self.rows.push(row);
            self.time_s += LEVEL_S;
        }
        Ok(())
    }

    /// Draws the noise of a window's mean load, world axes.
    fn load_noise(&mut self) -> Vector6<f64> {
        let noise = self.plan.noise;
        Vector6::from_fn(|component, _| {
            let sd = if component < 3 {
                noise.force_n
            } else {
                noise.moment_nm
            };
            normal(&mut self.generator, sd)
        })
    }

    /// Adds the noise of a window's mean to the gauges. It is drawn for those that are not read,
    /// too, so that a plan may leave one out.
    fn disturbed(
        &mut self,
        (series, level): (usize, usize),
        q: &[f64; N],
        load: &Vector6<f64>,
        exact: &[f64],
    ) -> WindowRow<N> {
        let noise = self.plan.noise;
        let read = &self.plan.series[series].gauges;
        let readings_m: Vec<Option<f64>> = exact
            .iter()
            .enumerate()
            .map(|(gauge, length_m)| {
                let shown_m = length_m + normal(&mut self.generator, noise.gauge_um * 1e-6);
                read.contains(&gauge).then_some(shown_m)
            })
            .collect();
        let sds_m = vec![None; readings_m.len()];
        WindowRow {
            series,
            level,
            q: *q,
            load: *load,
            readings_m,
            sds_m,
            time_s: self.time_s,
            samples: SAMPLES,
        }
    }
}

fn load_error(series: &PlannedSeries, level_n: f64, error: ElasticError) -> ExperimentError {
    ExperimentError::Load {
        series: series.name.clone(),
        level_n,
        error,
    }
}

/// The compensating client: a robot file's springs, the limits of the machine's server.
struct CompensatingClient<const N: usize> {
    compensator: Box<dyn Compensate<N>>,
    mounting: Mounting,
    metres_per_q: [f64; N],
}

impl<const N: usize> CompensatingClient<N> {
    fn new<K: MachineKind<N>>(
        machine: &RobotFile<K, N>,
        client: &RobotFile<K, N>,
    ) -> Result<Self, RobotFileError> {
        let compensator = client.compensator(
            machine
                .limits
                .map(|axis| OffsetNm(axis.limits.position.max())),
        )?;
        Ok(Self {
            compensator,
            mounting: (&client.sensor).into(),
            metres_per_q: client.metres_per_q,
        })
    }

    /// Positions of the axes, q-units, with the offsets that hold the tool in a pose whose axes are
    /// at `q`. `change` is that of what the sensor shows since it was tared in the nominal pose; as
    /// in the client, the sensor turns along with the platform under the load.
    fn held(
        &self,
        pose: &Pose,
        q: &[f64; N],
        change: &Vector6<f64>,
        noise: &Vector6<f64>,
    ) -> Result<[f64; N], KinematicsError> {
        let nominal = on_path(q, &self.metres_per_q)?;
        let unturned = UnitQuaternion::from_matrix(&pose.rotation);
        let raw = change + self.mounting.seen(&Vector6::zeros(), &unturned);
        let mut platform = unturned;
        let mut load = Wrench::zero();
        for _ in 0..CLIENT_ROUNDS {
            load = Wrench::from_array((self.mounting.load(&raw, &platform) + noise).into());
            let turned_rad = self.compensator.turned_rad(pose, &nominal, &load)?;
            platform = UnitQuaternion::from_scaled_axis(turned_rad) * unturned;
        }
        let held = CorrectedPose::new(&*self.compensator, &self.metres_per_q, pose, q, &load)?;
        Ok(held.corrected)
    }
}

/// Forces on the way from one level to the next, the last of which is the level.
fn steps(from_n: f64, to_n: f64) -> impl Iterator<Item = f64> {
    let count = ((to_n - from_n).abs() / PULL_N).ceil().max(1.0);
    (1..=count as u32).map(move |step| from_n + (to_n - from_n) * (f64::from(step) / count))
}

/// Pulls at the hook, which moves with the platform, while the direction stays: the other end of
/// the strap is far away. Returns the equilibrium and the load about the tool centre point where it
/// then is.
fn pulled<const N: usize>(
    springs: &mut TrueSprings<N>,
    q: &[f64; N],
    series: &PlannedSeries,
    began: &Equilibrium<N>,
    start: &Equilibrium<N>,
    force_n: f64,
) -> Result<(Equilibrium<N>, Vector6<f64>), ElasticError> {
    let mut now = *start;
    for _ in 0..HOOK_ROUNDS {
        let load = load_at_hook(series, began, &now, force_n);
        now = springs.machine().equilibrium(q, &load, &now)?;
    }
    let load = load_at_hook(series, began, &now, force_n);
    Ok((springs.settle(q, &load, &now)?, load))
}

/// Load of a pull about the tool centre point, with the hook where the platform has turned it.
fn load_at_hook<const N: usize>(
    series: &PlannedSeries,
    began: &Equilibrium<N>,
    now: &Equilibrium<N>,
    force_n: f64,
) -> Vector6<f64> {
    let force = series.direction * force_n;
    let arm = now.pose.rotation * began.pose.rotation.inverse() * series.hook_m;
    let moment = arm.cross(&force);
    Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z)
}

/// Force sensor whose mounting and gains are not quite what the robot file says.
#[derive(Clone, Debug)]
struct FlawedSensor {
    mounting: Mounting,
    gains: Vector6<f64>,
}

impl FlawedSensor {
    /// Draws the errors that `[setup]` states: of the lever (platform axes), of the axes (turned
    /// about those of the platform), and of the gains (sensor axes, about the sensor's origin).
    fn new<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>, setup: &SetupNoise) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(robot.simulation.seed);
        random.set_stream(SETUP_STREAM);
        let [lever_sd_mm, axes_sd_mrad, gain_sd] = [
            setup.sensor_lever_mm,
            setup.sensor_axes_mrad,
            setup.sensor_gain,
        ]
        .map(Option::unwrap_or_default);
        let lever_m = Vector3::from_fn(|_, _| normal(&mut random, lever_sd_mm) * 1e-3);
        let turn = Rotation3::new(Vector3::from_fn(|_, _| {
            normal(&mut random, axes_sd_mrad) * 1e-3
        }));
        let gains = Vector6::from_fn(|_, _| 1.0 + normal(&mut random, gain_sd));
        let nominal = Mounting::from(&robot.sensor);
        let mounting = Mounting {
            rotation: turn * nominal.rotation,
            lever_m: nominal.lever_m + lever_m,
            ..nominal
        };
        Self { mounting, gains }
    }

    /// Returns what it shows of load and weight, sensor axes.
    fn shown(&self, load: &Vector6<f64>, platform: &UnitQuaternion<f64>) -> Vector6<f64> {
        self.mounting
            .seen(load, platform)
            .component_mul(&self.gains)
    }
}

#[cfg(test)]
mod tests;
