//! True springs of one machine: those that an identification should find and a compensation does not know.

use gantry_tau_core::model::f1;
use gantry_tau_core::model::robot::{Compliances, LINKS, RobotError};
use nalgebra::Vector6;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::parameters::{SimulationError, SimulationParameters};
use crate::elastic::backlash::Backlash;
use crate::elastic::{ElasticError, ElasticMachine, Equilibrium};
use crate::robot_file::Simulation;

/// Deviates every nominal spring by its own seeded share, and gives the joint of arm 3 its backlash.
///
/// # Errors
/// [`SimulationError`] naming the parameter.
pub fn true_springs<const N: usize>(
    geometry: &f1::Geometry,
    nominal: &Compliances<N>,
    parameters: &SimulationParameters<N>,
) -> Result<ElasticMachine<N>, SimulationError> {
    let compliances = deviated(nominal, &parameters.simulation).map_err(SimulationError::Compliances)?;
    let rigid_joint = ElasticMachine::new(*geometry, compliances, Backlash::NONE);
    Ok(ElasticMachine::new(*geometry, compliances, backlash(&rigid_joint, parameters)?))
}

/// Deviates every nominal spring by its own seeded share.
///
/// # Errors
/// A spring leaves the range of compliances.
pub(crate) fn deviated<const N: usize>(
    nominal: &Compliances<N>,
    simulation: &Simulation,
) -> Result<Compliances<N>, RobotError> {
    let deviation = simulation.spring_deviation;
    let mut random = ChaCha8Rng::seed_from_u64(simulation.seed);
    let mut deviated = |value: f64| value * (1.0 + deviation * (2.0 * random.random::<f64>() - 1.0));
    let links: [f64; LINKS] = nominal.link_m_per_n().map(&mut deviated);
    let axes: [f64; N] = nominal.cart_m_per_n().map(&mut deviated);
    Compliances::new(links, axes)
}

/// Returns the backlash whose preload at rest is cancelled at home by `jump_force_n` in x.
fn backlash<const N: usize>(
    rigid_joint: &ElasticMachine<N>,
    parameters: &SimulationParameters<N>,
) -> Result<Backlash, SimulationError> {
    let gap_m = parameters.simulation.jump_gap_m;
    if gap_m <= 0.0 {
        return Ok(Backlash::NONE);
    }
    let preload_n = preload_n(rigid_joint, &parameters.simulation, &parameters.home_q);
    Backlash::new(gap_m, preload_n.map_err(SimulationError::Springs)?).ok_or(SimulationError::NoJump)
}

/// Returns the sum of the tensions of cluster 3 that a force of `jump_force_n` in x cancels at home, N.
pub(crate) fn preload_n<const N: usize>(
    rigid_joint: &ElasticMachine<N>,
    simulation: &Simulation,
    home_q: &[f64; N],
) -> Result<f64, ElasticError> {
    let load = Vector6::new(simulation.jump_force_n, 0.0, 0.0, 0.0, 0.0, 0.0);
    let at_jump = rigid_joint.equilibrium(home_q, &load, &Equilibrium::at_home(simulation.home_m))?;
    Ok(-at_jump.cluster_3_n())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::fixture::{self, Vectors};

    fn springs(seed: u64, spring_deviation: f64) -> Compliances<3> {
        let mut parameters = fixture::parameters();
        (parameters.simulation.seed, parameters.simulation.spring_deviation) = (seed, spring_deviation);
        let l2 = Vectors::l2();
        *true_springs(&l2.geometry, &l2.compliances, &parameters).unwrap().compliances()
    }

    #[test]
    fn they_deviate_within_bounds_and_by_seed() {
        let nominal = Vectors::l2().compliances;
        assert_eq!(springs(1, 0.15), springs(1, 0.15));
        assert_ne!(springs(1, 0.15), springs(2, 0.15));
        assert_eq!(springs(1, 0.0), nominal);
        for seed in 0..200 {
            let found = springs(seed, 0.15);
            let links = found.link_m_per_n().iter().zip(nominal.link_m_per_n());
            let carts = found.cart_m_per_n().iter().zip(nominal.cart_m_per_n());
            for (true_value, value) in links.chain(carts) {
                assert!((true_value / value - 1.0).abs() <= 0.15 + 1e-12);
            }
        }
    }
}
