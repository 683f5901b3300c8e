//! Log of a bus: faults, and the clock, told by the thread of the cycles and written by another.

use gantry_tau_core::control::message::Phase;
use gantry_tau_ethercat::{Drives, Fault, Wire, check_link};

/// Faults that may wait to be logged: one in each row of a server that waits.
const FAULTS: usize = 4_096;
/// Reports of the clock that may wait to be logged, and cycles between two of them.
const REPORTS: usize = 64;
const CYCLES_PER_REPORT: u32 = 1_000;

/// News of the clock of the bus: the cycle is in phase with it, or not.
#[derive(Clone, Copy, Debug)]
pub(super) struct ClockReport {
    is_locked: bool,
    phase_ns: Option<i64>,
}

/// Reports of the clock, at most one in a second.
#[derive(Debug, Default)]
pub(super) struct ClockReports {
    reports: Option<rtrb::Producer<ClockReport>>,
    /// State of the last report.
    told: Option<bool>,
    /// Cycles since then.
    cycles: u32,
}

impl ClockReports {
    /// Sends the reports to a log.
    pub(super) fn report_to(&mut self, reports: rtrb::Producer<ClockReport>) {
        self.reports = Some(reports);
    }

    /// Reports the state if it is another than that of the last report.
    pub(super) fn see<W: Wire, const M: usize>(&mut self, drives: &Drives<W, M>) {
        self.cycles = self.cycles.saturating_add(1);
        let is_due = self.told.is_none() || self.cycles >= CYCLES_PER_REPORT;
        let locked = drives.is_locked().filter(|_| is_due);
        let Some(is_locked) = locked.filter(|locked| self.told != Some(*locked)) else {
            return;
        };
        (self.told, self.cycles) = (Some(is_locked), 0);
        if let Some(reports) = &mut self.reports {
            // A full queue has enough to log.
            let _full = reports.push(ClockReport {
                is_locked,
                phase_ns: drives.phase_ns(),
            });
        }
    }
}

/// The faults of a bus, for the log of another thread.
#[derive(Debug)]
pub struct FaultLog {
    faults: rtrb::Consumer<Fault>,
    clock: rtrb::Consumer<ClockReport>,
    /// Faults logged since the last re-arm, and the cycles in which each came again.
    logged: Vec<(Fault, u64)>,
    phase: Phase,
    /// Network interface, whose link explains missing answers.
    interface: Option<String>,
}

impl FaultLog {
    /// Returns a log, with the queues of faults and of reports of the clock.
    pub(super) fn new() -> (Self, rtrb::Producer<Fault>, rtrb::Producer<ClockReport>) {
        let (producer, faults) = rtrb::RingBuffer::new(FAULTS);
        let (reports, clock) = rtrb::RingBuffer::new(REPORTS);
        let log = Self {
            faults,
            clock,
            logged: Vec::new(),
            phase: Phase::Listening,
            interface: None,
        };
        (log, producer, reports)
    }

    /// Names the network interface: a fault is logged with the state of its link, if that is not
    /// up.
    #[must_use]
    pub fn of_interface(self, interface: &str) -> Self {
        Self {
            interface: Some(interface.to_owned()),
            ..self
        }
    }

    /// Logs faults with their motors and codes, each cause once until the server's phase has left
    /// Fault; then how often it came again. Returns the lines.
    pub fn see(&mut self, phase: Phase) -> Vec<String> {
        let mut lines = Vec::new();
        if self.phase == Phase::Fault && phase != Phase::Fault {
            for (fault, again) in self.logged.drain(..).filter(|(_, again)| *again > 0) {
                lines.push(format!(
                    "EtherCAT: {fault}: in {again} more cycles until the re-arm"
                ));
                tracing::info!("{}", lines.last().map_or("", String::as_str));
            }
            self.logged.clear();
        }
        self.phase = phase;
        self.log_clock();
        while let Some(fault) = self.next() {
            match self.logged.iter_mut().find(|(logged, _)| {
                logged.name() == fault.name() && logged.motor() == fault.motor()
            }) {
                Some((_, again)) => *again = again.saturating_add(1),
                None if fault == Fault::Rearming => {}
                None => {
                    let link = self
                        .interface
                        .as_deref()
                        .and_then(|interface| check_link(interface).err());
                    let because = link.map_or_else(String::new, |link| format!(": {link}"));
                    lines.push(format!("EtherCAT: {fault}{because}"));
                    tracing::error!("{}", lines.last().map_or("", String::as_str));
                    self.logged.push((fault, 0));
                }
            }
        }
        lines
    }
}

impl FaultLog {
    /// Logs what the clock of the bus does.
    fn log_clock(&mut self) {
        while let Ok(report) = self.clock.pop() {
            let phase = report.phase_ns.map_or_else(
                || "unknown".to_owned(),
                |ns| format!("{:.1} us", ns as f64 / 1e3),
            );
            if report.is_locked {
                tracing::info!("EtherCAT: the cycle is in phase with SYNC0 (phase {phase})");
            } else {
                tracing::warn!("EtherCAT: the cycle is not in phase with SYNC0 (phase {phase})");
            }
        }
    }
}

/// The faults that were not taken yet.
impl Iterator for FaultLog {
    type Item = Fault;

    fn next(&mut self) -> Option<Fault> {
        self.faults.pop().ok()
    }
}
