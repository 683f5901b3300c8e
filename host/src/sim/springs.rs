//! True springs of one machine: those that an identification should find and a compensation does not know.

use gantry_tau_core::model::f1;
use gantry_tau_core::model::robot::{Compliances, LINKS};
use nalgebra::{UnitQuaternion, Vector3, Vector6};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::backlash::Backlash;
use super::elastic::{ElasticMachine, Equilibrium, Pose};
use super::parameters::{SimulationError, SimulationParameters, check};

/// Deviates every nominal spring by its own seeded share, and gives the joint of arm 3 its backlash.
///
/// # Errors
/// [`SimulationError`] naming the parameter.
pub fn true_springs<const N: usize>(
    geometry: &f1::Geometry,
    nominal: &Compliances<N>,
    parameters: &SimulationParameters<N>,
) -> Result<ElasticMachine<N>, SimulationError> {
    let deviation = parameters.spring_deviation;
    check("spring_deviation", deviation, 0.0, 0.99)?;
    let mut random = ChaCha8Rng::seed_from_u64(parameters.seed);
    let mut deviated = |value: f64| value * (1.0 + deviation * (2.0 * random.random::<f64>() - 1.0));
    let links: [f64; LINKS] = nominal.link_m_per_n().map(&mut deviated);
    let axes: [f64; N] = nominal.cart_m_per_n().map(&mut deviated);
    let compliances = Compliances::new(links, axes).map_err(SimulationError::Compliances)?;
    let rigid_joint = ElasticMachine::new(*geometry, compliances, Backlash::NONE);
    Ok(rigid_joint.with_backlash(backlash(&rigid_joint, parameters)?))
}

/// Returns the backlash whose preload at rest is cancelled at home by `jump_force_n` in x.
fn backlash<const N: usize>(
    rigid_joint: &ElasticMachine<N>,
    parameters: &SimulationParameters<N>,
) -> Result<Backlash, SimulationError> {
    check("jump_gap_m", parameters.jump_gap_m, 0.0, 1e-2)?;
    check("jump_force_n", parameters.jump_force_n, 0.0, 1e5)?;
    if parameters.jump_gap_m <= 0.0 {
        return Ok(Backlash::NONE);
    }
    let start = Equilibrium::unloaded(Pose {
        translation_m: Vector3::from(parameters.home_m),
        rotation: UnitQuaternion::identity(),
    });
    let load = Vector6::new(parameters.jump_force_n, 0.0, 0.0, 0.0, 0.0, 0.0);
    let at_jump = rigid_joint.equilibrium(&parameters.home_q, &load, &start).map_err(SimulationError::Springs)?;
    Backlash::new(parameters.jump_gap_m, -at_jump.cluster_3_n()).ok_or(SimulationError::NoJump)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::fixture;

    fn springs(seed: u64, spring_deviation: f64) -> Compliances<3> {
        let parameters = SimulationParameters {
            seed,
            spring_deviation,
            ..SimulationParameters::at_home(fixture::home_m(), fixture::home_q())
        };
        let (geometry, nominal) = (fixture::geometry(), fixture::compliances());
        *true_springs(&geometry, &nominal, &parameters).unwrap().compliances()
    }

    #[test]
    fn they_deviate_within_bounds_and_by_seed() {
        let nominal = fixture::compliances();
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
