//! The preload of cluster 3, by which the platform rests on one side of the joint's play.

use gantry_tau_machine::elastic::ElasticMachine;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_sim::springs::preload_n;

/// Share of the preload that a load may take off the side that cluster 3 rests on.
const MAX_PRELOAD: f64 = 0.8;
/// Share of the expected preload at which a play may be found.
const MIN_OF_EXPECTED: f64 = 0.5;

/// The preload of cluster 3: sum of the tensions of its links by weight alone, N.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Preload {
    force_n: f64,
}

impl Preload {
    /// Of a robot file that knows a jump: by what was found, or by the force in x at home that
    /// takes the platform off cart 3.
    pub(crate) fn of<K: MachineKind<N>, const N: usize>(
        robot: &RobotFile<K, N>,
        machine: &ElasticMachine<N>,
    ) -> Option<Self> {
        if let Some(play) = &robot.play {
            let nearest = play
                .preload_ends_n()
                .into_iter()
                .min_by(|one, other| one.abs().total_cmp(&other.abs()))?;
            return Some(Self { force_n: nearest });
        }
        let simulation = &robot.simulation;
        if simulation.jump_gap_m <= 0.0 {
            return None;
        }
        let home_q = robot.home_q().ok()?;
        let force_n =
            preload_n(machine, simulation.home_m, &home_q, simulation.jump_force_n).ok()?;
        Some(Self { force_n })
    }

    /// Sum of the tensions by weight alone, N.
    pub(crate) const fn force_n(&self) -> f64 {
        self.force_n
    }

    /// True if a load whose cluster force is `cluster_n` leaves the platform on cart 3, with a
    /// fifth to spare.
    pub(crate) fn holds(&self, cluster_n: f64) -> bool {
        -cluster_n * self.force_n.signum() <= MAX_PRELOAD * self.force_n.abs()
    }

    /// Share of a load at which the platform leaves cart 3, for a load whose cluster force is
    /// `cluster_n`; `None` if it never does.
    pub(crate) fn share_at_jump(&self, cluster_n: f64) -> Option<f64> {
        let share = -self.force_n / cluster_n;
        (share > 0.0 && share.is_finite()).then_some(share)
    }

    /// True if a play whose preload is in this interval, N, may be the one of the robot file: the
    /// same side, and half of the preload at least.
    pub(crate) fn may_be(&self, found_n: [f64; 2]) -> bool {
        found_n
            .iter()
            .any(|end| end * self.force_n.signum() >= MIN_OF_EXPECTED * self.force_n.abs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_preload_of_either_sign_has_its_mirror_image() {
        for sign in [1.0, -1.0] {
            let preload = Preload {
                force_n: sign * 100.0,
            };
            assert!(
                preload.holds(sign * 500.0)
                    && preload.holds(sign * -79.0)
                    && !preload.holds(sign * -81.0)
            );
            assert_eq!(preload.share_at_jump(sign * -200.0), Some(0.5));
            assert_eq!(
                [50.0, 0.0].map(|force| preload.share_at_jump(sign * force)),
                [None, None]
            );
            assert!(
                preload.may_be([sign * 49.0, sign * 51.0])
                    && !preload.may_be([sign * 49.0, sign * -200.0])
            );
        }
    }
}
