//! Prompts of a campaign: what the operator is to do, and what is waited for.

use gantry_tau_core::units::PositionNm;
use gantry_tau_system::output::Name;

use super::LiveCampaign;

/// Ticks between two reminders.
const REMIND_TICKS: u64 = 5_000;

impl<const N: usize> LiveCampaign<N> {
    pub(super) fn names_of_gauges(&self) -> Vec<Name> {
        let series = &self.plan.series[self.series];
        series
            .gauges
            .iter()
            .map(|gauge| self.plan.gauges[*gauge].name.clone())
            .collect()
    }

    pub(super) fn window_text(&self) -> String {
        let series = &self.plan.series[self.series];
        format!(
            "series {}, window {} of {}",
            series.name,
            self.level + 1,
            series.levels_n.len()
        )
    }

    pub(super) fn pull_text(&self) -> String {
        let series = &self.plan.series[self.series];
        let [x, y, z]: [f64; 3] = series.hook_m.into();
        let [u, v, w]: [f64; 3] = series.direction.into();
        format!(
            "{}: pull to {} N along ({u}, {v}, {w}) at the hook ({x}, {y}, {z}) m: now {} N",
            self.window_text(),
            self.level_n(),
            // Not "-0".
            self.pull.force_n.round() + 0.0,
        )
    }

    pub(super) fn pose_text(&self, nominal: &[PositionNm; N]) -> String {
        let series = &self.plan.series[self.series];
        let (name, _) = &self.plan.poses[series.pose];
        let place = &self.places[series.pose];
        let off = nominal
            .iter()
            .zip(&place.nominal)
            .map(|(is, planned)| is.0.abs_diff(planned.0))
            .max()
            .unwrap_or(0);
        format!(
            "series {}: waiting for pose {name}; the farthest axis is {:.2} mm away",
            series.name,
            off as f64 * 1e-6
        )
    }

    pub(super) fn mounting_text(&self) -> String {
        let series = &self.plan.series[self.series];
        let mounting = &self.plan.mountings[series.mounting];
        let state = if series.compensated {
            ", compensation on"
        } else {
            ""
        };
        let wait = if self.is_unattended {
            "waiting for the gauges"
        } else {
            "press Enter with the strap slack"
        };
        format!("series {}{state}: mount {mounting}; {wait}", series.name)
    }

    /// Says what is waited for, now and then.
    pub(super) fn remind_at(&mut self, tick: u64, text: &dyn Fn(&Self) -> String) {
        if tick.abs_diff(self.reminded) >= REMIND_TICKS {
            self.reminded = tick;
            tracing::info!("{}", text(self));
        }
    }
}
