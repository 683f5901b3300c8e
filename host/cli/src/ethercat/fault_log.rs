//! Log of a bus: faults and other news, told by the thread of the cycles and written by another.

use gantry_tau_core::control::message::Phase;
use gantry_tau_ethercat::{Fault, check_link};

use super::bus_reports::BusReport;

/// Faults that may wait to be logged: one in each row of a server that waits.
const FAULTS: usize = 4_096;
/// Reports that may wait to be logged.
const REPORTS: usize = 64;

/// The faults of a bus, for the log of another thread.
#[derive(Debug)]
pub struct FaultLog {
    faults: rtrb::Consumer<Fault>,
    reports: rtrb::Consumer<BusReport>,
    /// Faults logged since the last re-arm, and the cycles in which each came again.
    logged: Vec<(Fault, u64)>,
    phase: Phase,
    /// Names of the gauges on the bus.
    gauges: Vec<String>,
    /// Network interface, whose link explains missing answers.
    interface: Option<String>,
}

impl FaultLog {
    /// Returns a log, with the queues of faults and of other reports.
    pub(super) fn new(
        gauges: Vec<String>,
    ) -> (Self, rtrb::Producer<Fault>, rtrb::Producer<BusReport>) {
        let (producer, faults) = rtrb::RingBuffer::new(FAULTS);
        let (sender, reports) = rtrb::RingBuffer::new(REPORTS);
        let log = Self {
            faults,
            reports,
            logged: Vec::new(),
            phase: Phase::Listening,
            gauges,
            interface: None,
        };
        (log, producer, sender)
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
        while let Ok(report) = self.reports.pop() {
            report.log(&self.gauges);
        }
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

/// The faults that were not taken yet.
impl Iterator for FaultLog {
    type Item = Fault;

    fn next(&mut self) -> Option<Fault> {
        self.faults.pop().ok()
    }
}
