//! Lines that the operator types.

use super::{CampaignStage, LiveCampaign};
use crate::experiment::ExperimentError;

/// Largest reading, um.
const MAX_READING_UM: f64 = 1e5;

impl<const N: usize> LiveCampaign<N> {
    /// Takes a line that was typed.
    pub(in crate::experiment::live) fn key(&mut self, line: &str) -> Result<(), ExperimentError> {
        match (line, &self.stage) {
            (_, CampaignStage::Done) => {}
            ("", CampaignStage::Mounting) => self.is_confirmed = true,
            ("", _) => {}
            ("again", _) => match self.last_taken {
                Some((series, level)) if series == self.series && self.tare.is_some() => {
                    self.level = level;
                    self.collector.restart();
                    self.stage = CampaignStage::Level;
                }
                _ => tracing::warn!("no window of this series was taken since the tare"),
            },
            ("skip", CampaignStage::Level | CampaignStage::Typing { .. }) => {
                self.skipped.insert((self.series, self.level));
                self.collector.restart();
                self.seek();
            }
            ("skip", _) => self.give_up(),
            ("remount", _) => {
                self.plan.remount(self.series);
                self.skipped = self
                    .skipped
                    .iter()
                    .map(|&(s, l)| (s + usize::from(s > self.series), l))
                    .collect();
                self.give_up();
            }
            (_, CampaignStage::Typing { .. }) => return self.type_in(line),
            _ => tracing::warn!(
                "unknown command {line:?}: expected again, skip, remount, quit or Enter"
            ),
        }
        Ok(())
    }

    /// Takes the readings of the gauges, um.
    fn type_in(&mut self, line: &str) -> Result<(), ExperimentError> {
        let CampaignStage::Typing { means, load } = self.stage.clone() else {
            return Ok(());
        };
        let read = &self.plan.series[self.series].gauges;
        let typed: Vec<f64> = line
            .split_whitespace()
            .filter_map(|word| word.parse().ok())
            .collect();
        let is_usable = typed.len() == read.len() && line.split_whitespace().count() == read.len();
        if !is_usable || !typed.iter().all(|um| um.abs() <= MAX_READING_UM) {
            tracing::warn!(
                "expected {} numbers in um: {}",
                read.len(),
                self.names_of_gauges().join(" ")
            );
            return Ok(());
        }
        let mut lengths = vec![0.0; self.plan.gauges.len()];
        for (gauge, um) in read.iter().zip(typed) {
            lengths[*gauge] = um * 1e-6;
        }
        let sds = vec![None; lengths.len()];
        let time_s = self.clock.now_s;
        self.write(&means, load, &lengths, &sds, time_s)
    }
}
