//! News of a bus that are no faults: its clock, and the instruments on it. Told by the thread of the
//! cycles, logged by another.

use gantry_tau_ethercat::{Drives, NoReading, Wire};

/// Cycles between two reports about the same.
const CYCLES_PER_REPORT: u32 = 1_000;

/// News of a bus.
#[derive(Clone, Copy, Debug)]
pub(super) enum BusReport {
    /// The cycle is in phase with SYNC0, or not.
    Clock {
        is_locked: bool,
        phase_ns: Option<i64>,
    },
    /// The force sensor gives readings, or not, for this reason.
    ForceSensor(Option<NoReading>),
}

impl BusReport {
    pub(super) fn log(self) {
        match self {
            Self::Clock {
                is_locked,
                phase_ns,
            } => {
                let phase = phase_ns.map_or_else(
                    || "unknown".to_owned(),
                    |ns| format!("{:.1} us", ns as f64 / 1e3),
                );
                if is_locked {
                    tracing::info!("EtherCAT: the cycle is in phase with SYNC0 (phase {phase})");
                } else {
                    tracing::warn!(
                        "EtherCAT: the cycle is not in phase with SYNC0 (phase {phase})"
                    );
                }
            }
            Self::ForceSensor(None) => tracing::info!("EtherCAT: the force sensor gives readings"),
            Self::ForceSensor(Some(reason)) => {
                tracing::warn!("EtherCAT: no reading of the force sensor: {reason}");
            }
        }
    }
}

/// Reports about each, at most one in a second.
#[derive(Debug, Default)]
pub(super) struct BusReports {
    reports: Option<rtrb::Producer<BusReport>>,
    clock: Told<bool>,
    force_sensor: Told<Option<NoReading>>,
}

impl BusReports {
    /// Sends the reports to a log.
    pub(super) fn report_to(&mut self, reports: rtrb::Producer<BusReport>) {
        self.reports = Some(reports);
    }

    /// Reports what is another than in the last report.
    pub(super) fn see<W: Wire, const M: usize>(&mut self, drives: &Drives<W, M>) {
        let clock = self.clock.news(drives.is_locked());
        let clock = clock.map(|is_locked| BusReport::Clock {
            is_locked,
            phase_ns: drives.phase_ns(),
        });
        let sensor = drives.force().map(Result::err);
        let sensor = self.force_sensor.news(sensor).map(BusReport::ForceSensor);
        if let Some(reports) = &mut self.reports {
            for report in [clock, sensor].into_iter().flatten() {
                // A full queue has enough to log.
                let _full = reports.push(report);
            }
        }
    }
}

/// The last thing that was told about something.
#[derive(Debug)]
struct Told<T> {
    last: Option<T>,
    cycles: u32,
}

impl<T> Default for Told<T> {
    fn default() -> Self {
        Self {
            last: None,
            cycles: CYCLES_PER_REPORT,
        }
    }
}

impl<T: Copy + PartialEq> Told<T> {
    /// Returns what is to be told in this cycle; `None` for what a bus has not got.
    fn news(&mut self, now: Option<T>) -> Option<T> {
        self.cycles = self.cycles.saturating_add(1);
        let news = now.filter(|now| self.last != Some(*now))?;
        if self.cycles < CYCLES_PER_REPORT {
            return None;
        }
        (self.last, self.cycles) = (Some(news), 0);
        Some(news)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_is_told_once_and_at_most_once_in_a_second() {
        let mut told = Told::default();
        assert_eq!(told.news(None), None);
        assert_eq!(told.news(Some(true)), Some(true));
        // It flaps: the state at the end of the second is told.
        let told_in_a_second = (0..999).filter(|cycle| told.news(Some(cycle % 2 == 0)).is_some());
        assert_eq!(told_in_a_second.count(), 0);
        assert_eq!(told.news(Some(true)), None, "as it was told");
        assert_eq!(told.news(Some(false)), Some(false));
        assert_eq!(told.news(Some(false)), None);
    }
}
