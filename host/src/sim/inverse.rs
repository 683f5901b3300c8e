//! Carts of the unloaded machine for a place of the tool, platform unturned `[T 3.7 to 3.9]`: only the start of a simulation needs it.

use std::fmt;

use gantry_tau_core::robot::{ARM_OF_LINK, ARMS, Robot};
use nalgebra::Vector3;

/// First link of each arm, in link order.
const FIRST_LINK: [usize; ARMS] = [0, 1, 3];
/// How far the links of a cluster may be from equal, in metres.
const CLUSTER_TOLERANCE_M: f64 = 1e-9;

/// Why the carts cannot put the tool there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InverseError {
    /// The link of this arm does not reach its guideway.
    Unreachable {
        /// Arm, from 0.
        arm: usize,
    },
    /// This link does not fit where the first link of its arm does: without the Tau property the platform would turn.
    NotTau {
        /// Link, from 0, link order.
        link: usize,
    },
}

impl fmt::Display for InverseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unreachable { arm } => write!(f, "arm {} does not reach", arm + 1),
            Self::NotTau { link } => write!(
                f,
                "link {link} (from 0) is not parallel to the first link of its cluster"
            ),
        }
    }
}

impl std::error::Error for InverseError {}

/// Carts (q-units) that hold the tool centre point of the unloaded machine at `tool_m` (world axes, metres).
///
/// # Errors
/// [`InverseError`]; a result fits all six links to a nanometre.
pub fn carts_at(robot: &Robot, tool_m: &Vector3<f64>) -> Result<[f64; ARMS], InverseError> {
    let geometry = robot.geometry();
    // From platform joint to cart joint of a link, with the cart at q = 0.
    let at_zero =
        |link: usize| geometry.cart_joints_m[link] - tool_m - geometry.platform_joints_m[link];
    let mut carts = [0.0; ARMS];
    for arm in 0..ARMS {
        // |g + q v| = L, a quadratic in q; the branch is the sign of s . v = (g + q v) . v / L.
        let (g, v) = (at_zero(FIRST_LINK[arm]), geometry.guideways[arm]);
        let length = geometry.lengths_m[arm];
        let along = g.dot(&v);
        let radicand = along * along - v.dot(&v) * (g.dot(&g) - length * length);
        // Written so that NaN fails it as well.
        if !(radicand > 0.0 && radicand.is_finite()) {
            return Err(InverseError::Unreachable { arm });
        }
        let root = geometry.configuration.inverse[arm].sign() * radicand.sqrt();
        carts[arm] = (root - along) / v.dot(&v);
    }
    for (link, &arm) in ARM_OF_LINK.iter().enumerate() {
        let length = (at_zero(link) + geometry.guideways[arm] * carts[arm]).norm();
        if (length - geometry.lengths_m[arm]).abs() > CLUSTER_TOLERANCE_M {
            return Err(InverseError::NotTau { link });
        }
    }
    Ok(carts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::fixture;

    #[test]
    fn agrees_with_the_vectors() {
        for case in fixture::cases() {
            let carts = carts_at(&fixture::robot(), &Vector3::from(case.t)).unwrap();
            for arm in 0..ARMS {
                assert!((carts[arm] - case.q[arm]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn refuses_what_it_cannot_hold() {
        let away = Vector3::new(0.0, 9.0, 0.0);
        assert_eq!(
            carts_at(&fixture::robot(), &away),
            Err(InverseError::Unreachable { arm: 0 })
        );
        let mut skewed = *fixture::robot().geometry();
        skewed.platform_joints_m[4].y += 1e-3;
        let skewed = Robot::new(skewed).unwrap();
        assert_eq!(
            carts_at(&skewed, &Vector3::from(fixture::home_m())),
            Err(InverseError::NotTau { link: 4 })
        );
    }
}
