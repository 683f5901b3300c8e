//! Lines in the log: one for each outage and cause, of any kind of outage, and one again
//! after a re-arm.

use gantry_tau_core::control::message::Phase;
use gantry_tau_ethercat::emulation::Faults;
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::record::{Event, EventKind};
use gantry_tau_server::server::cycle::OperatorInputs;
use gantry_tau_server::server::event_log::EventLog;

use super::Server;
use super::faults::moving;

/// The lines of a server about its machine.
#[derive(Default)]
struct Lines {
    events: EventLog,
    machine: Vec<Event>,
    bus: Vec<String>,
}

impl Lines {
    fn see(&mut self, server: &mut Server<3, 3>, row: &TickRecord<3>) {
        let happened = self.events.see(row);
        self.machine.extend(
            happened
                .into_iter()
                .filter(|event| event.kind == EventKind::MachineFailed),
        );
        self.bus.extend(server.log.see(row.state.phase));
    }

    /// Drains the lines: numbers of those about failures of the machine, and those about the bus.
    fn drain(&mut self) -> (usize, Vec<String>) {
        (
            std::mem::take(&mut self.machine).len(),
            std::mem::take(&mut self.bus),
        )
    }
}

#[test]
fn an_outage_is_logged_once_and_the_next_one_again() {
    let (mut server, _client) = moving();
    let mut lines = Lines::default();
    // Ten seconds without a bus; two frames that are lost, with a re-arm between; a cable that
    // loses one frame in four.
    let gone: fn(u32) -> bool = |_| true;
    let once: fn(u32) -> bool = |tick| tick == 0;
    let flaps: fn(u32) -> bool = |tick| tick % 4 == 0;
    for (outage, ticks) in [(gone, 10_000), (once, 10), (once, 10), (flaps, 10_000)] {
        let mut lost = 0_u32;
        for tick in 0..ticks {
            let lost_out = u32::from(outage(tick));
            lost += lost_out;
            server.next_frames(Faults {
                lost_out,
                ..Faults::default()
            });
            let row = server.tick();
            lines.see(&mut server, &row);
        }
        let no_answer = vec!["EtherCAT: no answer on the bus in time".to_owned()];
        assert_eq!(lines.drain(), (1, no_answer), "{lost} frames");
        server.next_frames(Faults::default());
        while server.cycle.phase() == Phase::Fault {
            let row = server.step(OperatorInputs {
                stop: false,
                rearm: true,
                ..OperatorInputs::default()
            });
            lines.see(&mut server, &row);
        }
        let (machine, bus) = lines.drain();
        assert_eq!(machine, 0, "the re-arm");
        let expected = format!(
            "EtherCAT: no answer on the bus in time: in {} more cycles until the re-arm",
            lost - 1
        );
        assert_eq!(bus, if lost == 1 { vec![] } else { vec![expected] });
    }
}
