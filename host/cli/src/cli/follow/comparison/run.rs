//! Runs of one loop on the simulated machine: along the path, and under the force step.

use gantry_tau_core::control::axis::{Actual, InForce, Offsets, Reference};
use gantry_tau_core::control::endpoint::MotorMap;
use gantry_tau_core::control::position_loop::config::{LoopConfig, LoopValues};
use gantry_tau_core::control::position_loop::{Enable, LoopInput, PositionLoops};
use gantry_tau_core::units::PositionNm;
use gantry_tau_machine::elastic::{ElasticMachine, Equilibrium};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::Interface;
use gantry_tau_machine::robot_file::position_loop::gain_per_s;
use gantry_tau_machine::robot_file::{DriveKeys, PositionLoopKeys, RobotFile};
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::plant::{Plant, VelocityPlant};
use gantry_tau_server::server::velocity_interface::spread;
use gantry_tau_sim::load_generator::{Load, LoadGenerator, load_generator};
use gantry_tau_sim::machine::SimulatedMachine;
use nalgebra::Vector6;

use super::{FORCE_STEP_N, FollowError, Latency, LoopNumbers, MASS_ERROR, SPEED_M_PER_S};

/// Axes that move: the carts.
const CARTS: usize = 3;
/// Cycles of acceleration, of the way at full speed, and of rest at the end.
const RAMP: i64 = 250;
const CRUISE: i64 = 250;
const REST: i64 = 150;
/// Length of the path, nm.
const WAY_NM: i64 = way_nm(i64::MAX);
/// Cycles before the force step, and after it; a machine with masses rings.
const SETTLED: u32 = 300;
const PUSHED: u32 = 200;
const RUNG: u32 = 3_000;
/// Force that shows what loads the axes, N.
const PROBE_N: f64 = 100.0;
/// Displacement at which a cart counts as settled, µm.
const SETTLED_UM: f64 = 1.0;
/// Following error that trips nothing here, um, and the time outside of it, ms: a slow loop lags by
/// more.
const WIDE_UM: f64 = 16_000.0;
const LONG_MS: u32 = 10_000;
/// Encoder of drives without `[drives]`: as good as none.
const FINE_COUNTS: u32 = 1 << 30;

/// All runs of a loop. The fields of [`LoopNumbers`] have the same names.
pub(super) struct Measured {
    pub(super) latency: Option<Latency>,
    gain_per_s: f64,
    pub(super) plain: Run,
    misaligned: Option<Run>,
    pub(super) velocity: Run,
    pub(super) torque: Option<Run>,
    wrong_mass: Option<Run>,
    /// Displacement of the cart after the force step, one sample per cycle, µm.
    pub(super) pushed_um: Vec<f64>,
}

impl Measured {
    /// Returns the numbers of the table.
    pub(super) fn numbers(&self) -> LoopNumbers {
        LoopNumbers {
            latency: self.latency,
            gain_per_s: self.gain_per_s,
            plain_um: self.plain.worst_um,
            misaligned_um: self.misaligned.as_ref().map(|run| run.worst_um),
            velocity_um: self.velocity.worst_um,
            torque_um: self.torque.as_ref().map(|run| run.worst_um),
            wrong_mass_um: self.wrong_mass.as_ref().map(|run| run.worst_um),
            tool_um: self.velocity.tool_um.iter().copied().reduce(f64::max),
            pushed_um: self
                .pushed_um
                .iter()
                .fold(0.0, |most: f64, um| most.max(*um)),
            settled_ms: (1..)
                .zip(&self.pushed_um)
                .filter(|(_, um)| **um >= SETTLED_UM)
                .last()
                .map_or(0, |(ms, _)| ms),
        }
    }
}

/// One run along the path. Curves have one sample per cycle, of the first cart.
pub(super) struct Run {
    pub(super) lag_um: Vec<f64>,
    /// Distance of the tool from its place on the rigid machine, µm; empty without masses.
    pub(super) tool_um: Vec<f64>,
    /// Torque of a motor, per mille.
    pub(super) permille: Vec<f64>,
    /// Largest lag of all carts.
    worst_um: f64,
}

/// Machine of all runs.
pub(super) struct FollowBench<K, const N: usize, const M: usize> {
    robot: RobotFile<K, N>,
    keys: PositionLoopKeys,
    motors: MotorMap<N, M>,
    home: [PositionNm; N],
    /// 1 or -1: the way along which all carts have room.
    direction: i64,
}

impl<K: MachineKind<N>, const N: usize, const M: usize> FollowBench<K, N, M> {
    /// Prepares the machine of a robot file: its jump is left out, and no drive trips.
    pub(super) fn new(robot: &RobotFile<K, N>) -> Result<Self, FollowError> {
        let mut robot = robot.clone();
        robot.simulation.jump_gap_m = 0.0;
        let usual = DriveKeys {
            encoder_counts_per_turn: FINE_COUNTS,
            ..DriveKeys::default()
        };
        robot.drives = Some(DriveKeys {
            following_error_um: WIDE_UM,
            following_error_ms: LONG_MS,
            ..robot.drives.unwrap_or(usual)
        });
        // The gain is by the latency, also where a file asks for its own.
        let keys = PositionLoopKeys {
            gain_per_s: None,
            ..robot.position_loop.clone().unwrap_or_default()
        };
        if keys.max_m_per_s < 1.1 * SPEED_M_PER_S {
            let reason = format!(
                "the path moves at {SPEED_M_PER_S} m/s; position_loop.max_m_per_s must be larger"
            );
            return Err(FollowError::Machine(format!("{}: {reason}", robot.name)));
        }
        let motors = robot.motor_map()?;
        let home_q = robot.home_q()?;
        let mut home = [PositionNm(0); N];
        for (home, (q, metres)) in home.iter_mut().zip(home_q.iter().zip(&robot.metres_per_q)) {
            *home = PositionNm((q * metres * 1e9).round() as i64);
        }
        let direction = [1, -1]
            .into_iter()
            .find(|direction| {
                let mut carts = home.iter().zip(&robot.limits).take(CARTS);
                carts.all(|(home, limits)| {
                    let end = home.0 + direction * WAY_NM;
                    (limits.nominal_travel.lower.0..=limits.nominal_travel.upper.0).contains(&end)
                })
            })
            .ok_or_else(|| {
                let way_mm = WAY_NM / 1_000_000;
                FollowError::Machine(format!(
                    "{}: the carts have no room for a way of {way_mm} mm from home",
                    robot.name
                ))
            })?;
        Ok(Self {
            robot,
            keys,
            motors,
            home,
            direction,
        })
    }

    /// Measures the loop in the drive, without latency.
    pub(super) fn inside(&self) -> Result<Measured, FollowError> {
        let plain = Loop::Inside {
            feed_forward_percent: 0.0,
        };
        let with_feed_forward = Loop::Inside {
            feed_forward_percent: 100.0,
        };
        Ok(Measured {
            latency: None,
            gain_per_s: self.robot.position_gain_per_s(),
            plain: self.path(&plain)?,
            misaligned: None,
            velocity: self.path(&with_feed_forward)?,
            torque: None,
            wrong_mass: None,
            pushed_um: self.push(&with_feed_forward)?,
        })
    }

    /// Measures the loop outside the drive.
    pub(super) fn outside(&self, latency: Latency) -> Result<Measured, FollowError> {
        let drives = self.drives(Interface::Velocity, latency, 0.0);
        let values = self.keys.values(&drives).map_err(|problem| {
            FollowError::Machine(format!(
                "{}: {}: {}",
                self.robot.name, problem.key, problem.reason
            ))
        })?;
        let without_torque = LoopValues {
            torque_feed_forward: 0,
            ..values
        };
        let plain = LoopValues {
            velocity_feed_forward: 0,
            ..without_torque
        };
        let misaligned = LoopValues {
            lag: 0,
            ..without_torque
        };
        let heavier = (f64::from(values.torque_feed_forward) * (1.0 + MASS_ERROR)).round() as u16;
        let wrong_mass = LoopValues {
            torque_feed_forward: heavier,
            ..values
        };
        Ok(Measured {
            latency: Some(latency),
            gain_per_s: gain_per_s(latency.command_cycles.saturating_add(latency.actual_cycles)),
            plain: self.path(&Loop::outside(plain, latency)?)?,
            misaligned: Some(self.path(&Loop::outside(misaligned, latency)?)?),
            velocity: self.path(&Loop::outside(without_torque, latency)?)?,
            torque: Some(self.path(&Loop::outside(values, latency)?)?),
            wrong_mass: Some(self.path(&Loop::outside(wrong_mass, latency)?)?),
            pushed_um: self.push(&Loop::outside(values, latency)?)?,
        })
    }

    fn drives(
        &self,
        interface: Interface,
        latency: Latency,
        feed_forward_percent: f64,
    ) -> DriveKeys {
        DriveKeys {
            interface,
            command_delay_cycles: latency.command_cycles,
            actual_delay_cycles: latency.actual_cycles,
            velocity_feed_forward_percent: feed_forward_percent,
            ..self.robot.drives.clone().unwrap_or_default()
        }
    }

    /// Returns the way of a cart, from where it starts, one sample per cycle.
    pub(super) fn reference_mm(&self) -> Vec<f64> {
        (1..=cycles())
            .map(|cycle| self.direction as f64 * way_nm(cycle) as f64 * 1e-6)
            .collect()
    }

    /// References of a cycle.
    fn references(&self, cycle: i64) -> [PositionNm; N] {
        let mut references = self.home;
        for reference in references.iter_mut().take(CARTS) {
            reference.0 += self.direction * way_nm(cycle);
        }
        references
    }

    /// Follows the path.
    fn path(&self, of: &Loop) -> Result<Run, FollowError> {
        let (_hand, tool) = load_generator();
        let mut machine = of.machine(self, tool)?;
        let mut follower = CycleFollower::new(self, of);
        let mut run = Run {
            lag_um: Vec::new(),
            tool_um: Vec::new(),
            permille: Vec::new(),
            worst_um: 0.0,
        };
        let mut rigid = Equilibrium::at_home(self.robot.simulation.home_m);
        let command_cycles = i64::from(of.latency().command_cycles);
        for cycle in 1..=cycles() {
            let actual = follower.cycle(&mut machine, &self.references(cycle))?;
            // The reference that could have acted by now.
            let acted = self.references(cycle - command_cycles);
            let lags = acted.iter().zip(machine.carts_m()).take(CARTS);
            let lags: Vec<f64> = lags
                .map(|(reference, metres)| reference.0 as f64 * 1e-3 - metres * 1e6)
                .collect();
            run.worst_um = lags
                .iter()
                .fold(run.worst_um, |worst, lag| worst.max(lag.abs()));
            run.lag_um
                .push(lags.first().map_or(0.0, |lag| lag * self.direction as f64));
            run.permille
                .push(actual.first().map_or(0.0, |axis| f64::from(axis.torque.0)));
            if self.robot.masses.is_some() {
                rigid = self.rigid(machine.springs(), &acted, &rigid)?;
                let off_m = machine.seen_from(rigid.pose, &[]).displacement();
                run.tool_um.push(off_m.translation_m.norm() * 1e6);
            }
        }
        Ok(run)
    }

    /// Returns the rigid machine at these references.
    fn rigid(
        &self,
        machine: &ElasticMachine<N>,
        references: &[PositionNm; N],
        start: &Equilibrium<N>,
    ) -> Result<Equilibrium<N>, FollowError> {
        let mut axes = self.robot.metres_per_q;
        for (axis, reference) in axes.iter_mut().zip(references) {
            *axis = reference.to_metres().0 / *axis;
        }
        machine
            .equilibrium(&axes, &Vector6::zeros(), start)
            .map_err(|error| FollowError::Machine(error.to_string()))
    }

    /// Stands at home, and takes the force step. Returns the displacements of the cart that takes
    /// most, µm.
    fn push(&self, of: &Loop) -> Result<Vec<f64>, FollowError> {
        let (mut hand, tool) = load_generator();
        let mut machine = of.machine(self, tool)?;
        let mut follower = CycleFollower::new(self, of);
        pull(&mut hand, PROBE_N)?;
        let (settled, pushed) = match self.robot.masses {
            Some(_) => (RUNG, RUNG),
            None => (SETTLED, PUSHED),
        };
        follower.rest(&mut machine, &self.home, settled)?;
        let loads_n = machine.motor_loads_n();
        let carts = loads_n
            .iter()
            .take(CARTS)
            .map(|load| load.abs())
            .enumerate();
        let (cart, most_n) = carts
            .max_by(|one, other| one.1.total_cmp(&other.1))
            .unwrap_or((0, PROBE_N));
        pull(&mut hand, 0.0)?;
        follower.rest(&mut machine, &self.home, settled)?;
        let before_m = machine.positions_m();
        pull(&mut hand, PROBE_N * FORCE_STEP_N / most_n)?;
        let mut pushed_um = Vec::new();
        for _ in 0..pushed {
            follower.cycle(&mut machine, &self.home)?;
            let now_m = machine.positions_m();
            let off_m = now_m.get(cart).unwrap_or(&0.0) - before_m.get(cart).unwrap_or(&0.0);
            pushed_um.push(off_m.abs() * 1e6);
        }
        Ok(pushed_um)
    }
}

/// Pulls with a force in x, N.
fn pull(hand: &mut LoadGenerator, newtons: f64) -> Result<(), FollowError> {
    let load = Load {
        step: 1,
        force_n: [newtons, 0.0, 0.0],
        moment_nm: [0.0; 3],
    };
    hand.set(&load)
        .map_err(|refused| FollowError::Machine(refused.to_string()))
}

/// A loop to be measured.
enum Loop {
    Inside {
        feed_forward_percent: f64,
    },
    Outside {
        config: LoopConfig,
        latency: Latency,
    },
}

impl Loop {
    fn outside(values: LoopValues, latency: Latency) -> Result<Self, FollowError> {
        let config =
            LoopConfig::new(values).map_err(|error| FollowError::Machine(error.to_string()))?;
        Ok(Self::Outside { config, latency })
    }

    const fn latency(&self) -> Latency {
        match self {
            Self::Inside { .. } => Latency::new(0, 0),
            Self::Outside { latency, .. } => *latency,
        }
    }

    fn machine<K: MachineKind<N>, const N: usize, const M: usize>(
        &self,
        bench: &FollowBench<K, N, M>,
        tool: gantry_tau_sim::load_generator::AppliedLoad,
    ) -> Result<SimulatedMachine<N, M>, FollowError> {
        let (interface, percent) = match self {
            Self::Inside {
                feed_forward_percent,
            } => (Interface::Position, *feed_forward_percent),
            Self::Outside { .. } => (Interface::Velocity, 0.0),
        };
        let drives = Some(bench.drives(interface, self.latency(), percent));
        let robot = RobotFile {
            drives,
            ..bench.robot.clone()
        };
        Ok(SimulatedMachine::moving_from_robot(
            &robot,
            tool,
            Motion::Hold,
        )?)
    }
}

/// Hands references to a machine, as a server's cycle does.
struct CycleFollower<const N: usize, const M: usize> {
    motors: MotorMap<N, M>,
    loops: Option<PositionLoops<N>>,
    has_run: bool,
    actual: [Actual; N],
}

impl<const N: usize, const M: usize> CycleFollower<N, M> {
    fn new<K>(bench: &FollowBench<K, N, M>, of: &Loop) -> Self {
        let loops = match of {
            Loop::Inside { .. } => None,
            Loop::Outside { config, .. } => Some(PositionLoops::at_rest([*config; N], bench.home)),
        };
        let actual = bench.home.map(|position| Actual {
            position,
            ..Actual::ZERO
        });
        Self {
            motors: bench.motors,
            loops,
            has_run: false,
            actual,
        }
    }

    /// Holds the references until everything has settled.
    fn rest(
        &mut self,
        machine: &mut SimulatedMachine<N, M>,
        positions: &[PositionNm; N],
        cycles: u32,
    ) -> Result<(), FollowError> {
        (0..cycles).try_for_each(|_| self.cycle(machine, positions).map(|_| ()))
    }

    /// Writes the references of a cycle, and runs it. Returns what was measured at its end.
    fn cycle(
        &mut self,
        machine: &mut SimulatedMachine<N, M>,
        positions: &[PositionNm; N],
    ) -> Result<[Actual; N], FollowError> {
        let Offsets {
            velocity, torque, ..
        } = Offsets::ZERO;
        let references = positions.map(|position| Reference {
            position,
            velocity_offset: velocity,
            torque_offset: torque,
        });
        let parts = positions.map(InForce::at);
        if let Some(loops) = &mut self.loops {
            let permit = if self.has_run {
                Enable::Run
            } else {
                Enable::Rearm
            };
            let mut inputs = references.map(|reference| LoopInput {
                reference,
                actual: None,
                permit,
            });
            for (input, actual) in inputs.iter_mut().zip(&self.actual) {
                input.actual = Some(actual.position);
            }
            let axes = loops.tick(&inputs, true);
            self.has_run = true;
            if let Some((axis, stop)) = loops.stop() {
                return Err(FollowError::Machine(format!(
                    "the loop of axis {} has stopped: {stop:?}",
                    axis + 1
                )));
            }
            machine
                .write_velocity(&spread(&self.motors, &axes), Some(&parts))
                .map_err(|error| FollowError::Machine(error.to_string()))?;
        } else if let Some(motors) = self.motors.spread(&references) {
            machine
                .write(&motors, &parts)
                .map_err(|error| FollowError::Machine(error.to_string()))?;
        }
        self.actual = machine
            .read(1)
            .map_err(|error| FollowError::Machine(error.to_string()))?
            .actual;
        Ok(self.actual)
    }
}

const fn cycles() -> i64 {
    RAMP + CRUISE + RAMP + REST
}

/// Way along the path at a cycle, nm: integers, so nothing is rounded. 2 m/s^2 are 2 nm per ms^2 in
/// a thousand.
const fn way_nm(cycle: i64) -> i64 {
    let ramp_nm = RAMP * RAMP * 1_000;
    let speed = 2 * RAMP * 1_000;
    if cycle <= 0 {
        0
    } else if cycle <= RAMP {
        cycle * cycle * 1_000
    } else if cycle <= RAMP + CRUISE {
        ramp_nm + (cycle - RAMP) * speed
    } else if cycle <= 2 * RAMP + CRUISE {
        let left = 2 * RAMP + CRUISE - cycle;
        2 * ramp_nm + CRUISE * speed - left * left * 1_000
    } else {
        2 * ramp_nm + CRUISE * speed
    }
}
