//! Further straps that would measure a spring which a campaign does not.

use gantry_tau_system::output::Name;
use nalgebra::{Vector3, Vector6};

use super::IdentifiedSprings;
use crate::measurements::springs::{Campaign, Window};
use crate::springs::active_set::ActiveSet;
use crate::springs::decision::NotPositive;
use crate::springs::fit::rounds;

/// Directions of a strap.
const DIRECTIONS: [(&str, Vector3<f64>); 3] = [
    ("x", Vector3::new(1.0, 0.0, 0.0)),
    ("y", Vector3::new(0.0, 1.0, 0.0)),
    ("z", Vector3::new(0.0, 0.0, 1.0)),
];
/// Standard deviation of a compliance, in file's values, up to which it counts as measured.
const MEASURED: f64 = 0.2;

impl<const N: usize> IdentifiedSprings<'_, N> {
    /// Information in the campaign about a spring whose best value is not positive.
    pub(super) fn not_measured(&self, spring: &NotPositive) -> String {
        let (name, _) = self.problem.file.names().swap_remove(spring.spring);
        let NotPositive { factor, sd, .. } = spring;
        let advice = match self.directions(spring.spring).join(" or ") {
            directions if directions.is_empty() => {
                "add straps, gauges or poses (gantry-tau plan)".to_owned()
            }
            directions => format!("a strap in {directions} would"),
        };
        format!(
            "the best value of {name} would be negative, {factor:.1} +- {sd:.1} of the file's: this campaign does not measure it, and the file's value stays; {advice}"
        )
    }

    /// Directions in which one more strap, as strong as the strongest and at its hook, would
    /// measure a spring.
    fn directions(&self, spring: usize) -> Vec<&'static str> {
        DIRECTIONS
            .iter()
            .filter(|(_, direction)| {
                with_strap(self.problem.campaign, direction)
                    .is_some_and(|campaign| self.is_measured_by(&campaign, spring))
            })
            .map(|(name, _)| *name)
            .collect()
    }

    /// True if another campaign would measure a spring.
    fn is_measured_by(&self, campaign: &Campaign<N>, spring: usize) -> bool {
        let problem = self.problem.with_campaign(campaign);
        let mut state = self.robust_fit.solution.state.clone();
        state.loads = campaign.windows.iter().map(|window| window.load).collect();
        let Ok(solution) = rounds(&problem, &ActiveSet::all(campaign), state, 1) else {
            return false;
        };
        let file = problem.file.vector()[spring];
        let lost = solution.seen.lost_directions().row(spring).norm_squared();
        let variance = solution.seen.covariance()[(spring, spring)] + lost * file.powi(2);
        variance.sqrt() < MEASURED * file
    }
}

/// A campaign with one more series: a strap in a direction, up and down, read by all gauges. `None`
/// without a force.
fn with_strap<const N: usize>(
    campaign: &Campaign<N>,
    direction: &Vector3<f64>,
) -> Option<Campaign<N>> {
    let (most_n, strongest) = campaign
        .windows
        .iter()
        .map(|window| (window.load.fixed_rows::<3>(0).norm(), window))
        .max_by(|(one, _), (other, _)| one.total_cmp(other))?;
    if most_n <= 0.0 {
        return None;
    }
    let pull_n = strongest.load.fixed_rows::<3>(0);
    let moment = strongest.load.fixed_rows::<3>(3);
    let hook_m: Vector3<f64> = pull_n.cross(&moment) / pull_n.norm_squared();
    let mut campaign = campaign.clone();
    let series = campaign.series.len();
    campaign.series.push(Name::made("strap"));
    for share in [0.0, 0.25, 0.5, 0.75, 1.0, 0.75, 0.5, 0.25, 0.0] {
        let force_n = direction * (share * most_n);
        let moment = hook_m.cross(&force_n);
        campaign.windows.push(Window {
            series,
            load: Vector6::new(
                force_n.x, force_n.y, force_n.z, moment.x, moment.y, moment.z,
            ),
            readings_m: vec![Some(0.0); campaign.gauges.len()],
            sds_m: vec![None; campaign.gauges.len()],
            ..strongest.clone()
        });
    }
    Some(campaign)
}
