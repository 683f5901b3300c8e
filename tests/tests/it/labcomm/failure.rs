//! A machine that does not answer: monitors that connect later hear of it as well.

use std::net::SocketAddr;

use gantry_tau::monitor::{ServerMonitor, Snapshot};
use gantry_tau_core::control::message::Phase;
use gantry_tau_labcomm::Version;
use gantry_tau_server::publication::Publication;
use gantry_tau_server::server::event_log::EventLog;
use gantry_tau_tests::server_fixture::{LOOPBACK, ServerFixture};
use gantry_tau_tests::session_fixture::SessionFixture;
use gantry_tau_tests::wait_for;

use super::monitors::NAMES;
use super::reader::RESOLUTION_M;

/// A server whose machine fails when it is asked to, with a port.
struct Served {
    server: ServerFixture<3>,
    log: EventLog,
    port: Publication,
}

impl Served {
    fn tick(&mut self, rearmed: bool) -> Phase {
        self.server.receive();
        let row = if rearmed {
            self.server.step_rearmed()
        } else {
            self.server.step()
        };
        let events = self.log.see(&row);
        self.port.publish(&row, &events);
        self.port.flush();
        row.state.phase
    }

    /// A stop without a failure is a fault, and no more. The server listens afterwards.
    fn assert_stop_is_no_failure(&mut self, address: SocketAddr) {
        let row = self.server.step_stopped();
        let events = self.log.see(&row);
        self.port.publish(&row, &events);
        self.port.flush();
        let shown = newcomer(self, address);
        assert_eq!(
            (shown.phase, shown.machine_failed, shown.exit_status()),
            (Phase::Fault, false, 4)
        );
        while self.tick(true) != Phase::Listening {}
    }

    /// Ticks until a monitor has come so far; returns what it shows.
    fn shown_by(&mut self, monitor: &mut ServerMonitor) -> Snapshot {
        let began = self.server.bus.writes();
        wait_for("a monitor", || {
            let phase = self.tick(false);
            monitor.update();
            // A monitor that has read all is one tick behind.
            let is_late = self.server.bus.writes() < began + 10;
            !is_late && monitor.live().is_some_and(|shown| shown.phase == phase)
        });
        monitor.live().unwrap().clone()
    }
}

/// Output of a monitor that connects now.
fn newcomer(served: &mut Served, address: SocketAddr) -> Snapshot {
    served.shown_by(&mut ServerMonitor::of(address))
}

#[test]
fn a_failure_is_known_to_monitors_that_come_later_until_the_server_listens() {
    for version in [Version::V2006, Version::V2014] {
        let port = Publication::bind::<3>(LOOPBACK, version, &NAMES[..4], RESOLUTION_M).unwrap();
        let address = port.address().unwrap();
        let session = SessionFixture::submitted_on(ServerFixture::default()).obtain([2_000; 3]);
        let mut served = Served {
            server: session.server,
            log: EventLog::default(),
            port,
        };
        let mut first = ServerMonitor::of(address);
        served.shown_by(&mut first);
        served.assert_stop_is_no_failure(address);
        for _failure in 0..2 {
            served.server.bus.record().read_fails = true;
            served.tick(false);
            served.server.bus.record().read_fails = false;
            for shown in [
                newcomer(&mut served, address),
                served.shown_by(&mut first),
                newcomer(&mut served, address),
            ] {
                assert_eq!(
                    (shown.phase, shown.machine_failed, shown.exit_status()),
                    (Phase::Fault, true, 5)
                );
            }
            while served.tick(true) != Phase::Listening {}
            for shown in [newcomer(&mut served, address), served.shown_by(&mut first)] {
                assert_eq!(
                    (shown.phase, shown.machine_failed, shown.exit_status()),
                    (Phase::Listening, false, 0)
                );
            }
            // The failure before it is forgotten.
            served.assert_stop_is_no_failure(address);
        }
    }
}
