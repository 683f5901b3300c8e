//! True springs of one machine: those that an identification should find and a compensation does
//! not know.

use gantry_tau_core::model::f1;
use gantry_tau_core::model::robot::RobotError;
use gantry_tau_machine::elastic::backlash::Backlash;
use gantry_tau_machine::elastic::loaded::Loaded;
use gantry_tau_machine::elastic::springs::Springs;
use gantry_tau_machine::elastic::{ElasticError, ElasticMachine, Equilibrium, Pose};
use gantry_tau_machine::model::{MachineKind, Wrist};
use gantry_tau_machine::robot_file::{RobotFile, RobotFileError, Simulation};
use gantry_tau_server::plant::interpolator::Motion;
use nalgebra::Vector6;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::parameters::{SimulationError, SimulationParameters, springs};

/// The springs of one machine, and the side that the joint of arm 3 is on.
///
/// With `jump_hysteresis_n` the joint follows a falling force late, as friction makes it: it opens
/// at `jump_force_n`, and closes at a force lower by the hysteresis.
#[derive(Clone, Debug, PartialEq)]
pub struct TrueSprings<const N: usize> {
    opening: ElasticMachine<N>,
    closing: ElasticMachine<N>,
    wrist: Wrist,
    is_open: bool,
}

impl<const N: usize> TrueSprings<N> {
    /// Returns the springs of a robot file's simulated machine: those of the file, each deviated by
    /// its seeded share.
    ///
    /// # Errors
    /// As [`SimulatedMachine::from_robot`](crate::machine::SimulatedMachine::from_robot).
    pub fn from_robot<K: MachineKind<N>>(robot: &RobotFile<K, N>) -> Result<Self, RobotFileError> {
        let parameters = SimulationParameters::from_robot(robot, Motion::Hold)?;
        Self::new(&robot.model.geometry(), &springs(robot)?, &parameters)
            .map_err(|error| robot.refuse("simulation", error))
    }

    /// Deviates every nominal spring by its own seeded share, and gives the joint of arm 3 its
    /// backlash.
    ///
    /// # Errors
    /// [`SimulationError`] naming the parameter.
    pub fn new(
        geometry: &f1::Geometry,
        nominal: &Springs<N>,
        parameters: &SimulationParameters<N>,
    ) -> Result<Self, SimulationError> {
        let Springs {
            machine: compliances,
            wrist,
        } = deviated(nominal, &parameters.simulation).map_err(SimulationError::Compliances)?;
        let rigid_joint = ElasticMachine::new(*geometry, compliances, Backlash::NONE);
        let Simulation {
            jump_force_n,
            jump_hysteresis_n,
            ..
        } = parameters.simulation;
        let opening = backlash(&rigid_joint, parameters, jump_force_n)?;
        let closing = if jump_hysteresis_n > 0.0 {
            backlash(&rigid_joint, parameters, jump_force_n - jump_hysteresis_n)?
        } else {
            opening
        };
        let [opening, closing] = [opening, closing]
            .map(|backlash| ElasticMachine::new(*geometry, compliances, backlash));
        Ok(Self {
            opening,
            closing,
            wrist,
            is_open: false,
        })
    }

    /// Returns the machine as its joint stands now.
    #[must_use]
    pub const fn machine(&self) -> &ElasticMachine<N> {
        if self.is_open {
            &self.closing
        } else {
            &self.opening
        }
    }

    /// Returns the compliances of links, axes and wrist.
    #[must_use]
    pub fn springs(&self) -> Springs<N> {
        Springs {
            machine: *self.opening.compliances(),
            wrist: self.wrist.clone(),
        }
    }

    /// Returns the machine as its joint stands now in an equilibrium under a load, since it began
    /// in a pose, with its wrist at these angles (rad; empty: at zero).
    #[must_use]
    pub fn loaded(
        &self,
        began: Pose,
        now: Equilibrium<N>,
        load: Vector6<f64>,
        wrist_rad: &[f64],
    ) -> Loaded<N> {
        Loaded {
            machine: *self.machine(),
            wrist: self.wrist.turned(wrist_rad),
            began,
            now,
            load,
        }
    }

    /// Finds the pose under a load, as [`ElasticMachine::equilibrium`] does, and moves the joint to
    /// the side that it is then on.
    ///
    /// # Errors
    /// As [`ElasticMachine::equilibrium`].
    pub fn settle(
        &mut self,
        axes: &[f64; N],
        load: &Vector6<f64>,
        start: &Equilibrium<N>,
    ) -> Result<Equilibrium<N>, ElasticError> {
        let now = self.machine().equilibrium(axes, load, start)?;
        self.follow(now.cluster_3_n());
        Ok(now)
    }

    /// Moves the joint to the side that it is on under this sum of the tensions of cluster 3, N.
    pub fn follow(&mut self, cluster_3_n: f64) {
        let crossed = self.machine().backlash().crossed(cluster_3_n);
        self.is_open = if self.is_open {
            crossed > 0.0
        } else {
            crossed >= 1.0
        };
    }
}

/// Deviates every nominal spring by its own seeded share.
///
/// # Errors
/// A spring leaves the range of compliances.
pub fn deviated<const N: usize>(
    nominal: &Springs<N>,
    simulation: &Simulation,
) -> Result<Springs<N>, RobotError> {
    let deviation = simulation.spring_deviation;
    let mut random = ChaCha8Rng::seed_from_u64(simulation.seed);
    let deviated = nominal.with(
        &nominal
            .vector()
            .map(|value| value * (1.0 + deviation * (2.0 * random.random::<f64>() - 1.0))),
    );
    deviated.machine.checked().map(|_| deviated)
}

/// Returns the backlash whose preload at rest is cancelled at home by `force_n` in x.
fn backlash<const N: usize>(
    rigid_joint: &ElasticMachine<N>,
    parameters: &SimulationParameters<N>,
    force_n: f64,
) -> Result<Backlash, SimulationError> {
    let Simulation {
        jump_gap_m, home_m, ..
    } = parameters.simulation;
    if jump_gap_m <= 0.0 {
        return Ok(Backlash::NONE);
    }
    let preload_n = preload_n(rigid_joint, home_m, &parameters.home_q, force_n)
        .map_err(SimulationError::Springs)?;
    Backlash::new(jump_gap_m, preload_n).ok_or(SimulationError::NoJump)
}

/// Returns the sum of the tensions of cluster 3 that a force of `force_n` in x cancels at home, N.
pub fn preload_n<const N: usize>(
    rigid_joint: &ElasticMachine<N>,
    home_m: [f64; 3],
    home_q: &[f64; N],
    force_n: f64,
) -> Result<f64, ElasticError> {
    let load = Vector6::new(force_n, 0.0, 0.0, 0.0, 0.0, 0.0);
    let at_jump = rigid_joint.equilibrium(home_q, &load, &Equilibrium::at_home(home_m))?;
    Ok(-at_jump.cluster_3_n())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::{self, Vectors};
    use gantry_tau_machine::elastic::RawCompliances;

    fn springs(seed: u64, spring_deviation: f64) -> RawCompliances<3> {
        let mut parameters = fixture::parameters();
        (
            parameters.simulation.seed,
            parameters.simulation.spring_deviation,
        ) = (seed, spring_deviation);
        let l2 = Vectors::l2();
        *TrueSprings::new(&l2.geometry, &fixture::springs(&l2), &parameters)
            .unwrap()
            .machine()
            .compliances()
    }

    #[test]
    fn they_deviate_within_bounds_and_by_seed() {
        let nominal = RawCompliances::from(Vectors::l2().compliances);
        assert_eq!(springs(1, 0.15), springs(1, 0.15));
        assert_ne!(springs(1, 0.15), springs(2, 0.15));
        assert_eq!(springs(1, 0.0), nominal);
        for seed in 0..200 {
            let found = springs(seed, 0.15);
            let links = found.links_m_per_n.iter().zip(&nominal.links_m_per_n);
            let carts = found.axes.iter().zip(&nominal.axes);
            for (true_value, value) in links.chain(carts) {
                assert!((true_value / value - 1.0).abs() <= 0.15 + 1e-12);
            }
        }
    }

    /// Forces in x at which the joint has moved, while the force rises to 420 N and falls again.
    fn jumps(hysteresis_n: f64) -> (f64, f64) {
        let mut parameters = fixture::parameters();
        parameters.simulation.jump_hysteresis_n = hysteresis_n;
        let l2 = Vectors::l2();
        let mut springs =
            TrueSprings::new(&l2.geometry, &fixture::springs(&l2), &parameters).unwrap();
        let mut now = Equilibrium::at_home(parameters.simulation.home_m);
        let (mut opened, mut closed) = (f64::NAN, f64::NAN);
        for step in (0..=420).chain((0..420).rev()) {
            let force = f64::from(step);
            let was_open = springs.is_open;
            let load = Vector6::new(force, 0.0, 0.0, 0.0, 0.0, 0.0);
            now = springs.settle(&parameters.home_q, &load, &now).unwrap();
            match (was_open, springs.is_open) {
                (false, true) => opened = force,
                (true, false) => closed = force,
                _ => {}
            }
        }
        (opened, closed)
    }

    /// The joint crosses within 4 N of cluster force, some 9 N in x: half before and half after the
    /// force of the file.
    #[test]
    fn the_joint_closes_later_than_it_opened() {
        let (opened, closed) = jumps(0.0);
        assert!(
            (opened - 360.0).abs() < 10.0 && (closed - 360.0).abs() < 10.0,
            "{opened} {closed}"
        );
        let (opened, closed) = jumps(25.0);
        assert!(
            (opened - 360.0).abs() < 10.0 && (closed - 335.0).abs() < 10.0,
            "{opened} {closed}"
        );
    }
}
