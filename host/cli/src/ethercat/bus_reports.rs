//! News of a bus that are no faults: its clock, and the instruments on it. Told by the thread of the
//! cycles, logged by another.

use gantry_tau_ethercat::{Drives, NoReading, Wire};

use super::told::Told;

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
    /// A gauge counts, or not, for this reason.
    Gauge {
        index: usize,
        without: Option<NoReading>,
    },
}

impl BusReport {
    /// Writes it to the log. `gauges`: names of the gauges.
    pub(super) fn log(self, gauges: &[String]) {
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
            Self::Gauge { index, without } => {
                let name = gauges.get(index).map_or("", String::as_str);
                match without {
                    None => tracing::info!("EtherCAT: {name}: counts"),
                    Some(reason) => tracing::warn!("EtherCAT: {name}: no count: {reason}"),
                }
            }
        }
    }
}

/// Reports about each, at most one in a second.
#[derive(Debug)]
pub(super) struct BusReports {
    reports: Option<rtrb::Producer<BusReport>>,
    clock: Told<bool>,
    force_sensor: Told<Option<NoReading>>,
    gauges: Vec<Told<Option<NoReading>>>,
}

impl BusReports {
    /// Reports of a bus with so many gauges.
    pub(super) fn of_gauges(gauges: usize) -> Self {
        Self {
            reports: None,
            clock: Told::default(),
            force_sensor: Told::default(),
            gauges: std::iter::repeat_with(Told::default).take(gauges).collect(),
        }
    }

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
        let gauges = self
            .gauges
            .iter_mut()
            .zip(drives.gauge_counts())
            .enumerate();
        let gauges = gauges.filter_map(|(index, (told, count))| {
            let without = told.news(Some(count.err()))?;
            Some(BusReport::Gauge { index, without })
        });
        for report in [clock, sensor].into_iter().flatten().chain(gauges) {
            if let Some(reports) = &mut self.reports {
                // A full queue has enough to log.
                let _full = reports.push(report);
            }
        }
    }
}
