//! Gauges on the bus of the drives: their lengths in every cycle, for other programs.

use gantry_tau_ethercat::NoReading;
use gantry_tau_machine::robot_file::EthercatGauge;
use gantry_tau_server::links::gauges::{GaugePublisher, Lengths};

use super::places::lengths_m;

/// The gauges of a bus, and the link on which their lengths are published.
#[derive(Debug)]
pub(super) struct GaugeLink {
    gauges: Vec<EthercatGauge>,
    link: Option<GaugePublisher>,
    tick: u64,
}

impl GaugeLink {
    pub(super) fn of(gauges: &[EthercatGauge]) -> Self {
        Self {
            gauges: gauges.to_vec(),
            link: None,
            tick: 0,
        }
    }

    /// Publishes the lengths from now on.
    pub(super) fn publish_on(&mut self, link: GaugePublisher) {
        self.link = Some(link);
    }

    /// Returns the names, in the order of the robot file.
    pub(super) fn names(&self) -> Vec<String> {
        self.gauges.iter().map(|gauge| gauge.name.clone()).collect()
    }

    /// Counts cycles.
    pub(super) fn begin_cycles(&mut self, elapsed: u64) {
        self.tick = self.tick.saturating_add(elapsed);
    }

    /// Hands the lengths of a cycle on; allocates nothing and never blocks.
    pub(super) fn put(&mut self, counts: impl Iterator<Item = Result<i64, NoReading>>) {
        if let Some(link) = &mut self.link {
            link.publish(&Lengths::new(self.tick, lengths_m(&self.gauges, counts)));
        }
    }
}
