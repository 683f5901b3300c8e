//! Four monitors beside a minute of lock-step: each shows what the client was sent, and the session
//! is the same as without them.

use gantry_tau_client::force_sensor::SensorSource;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use gantry_tau::monitor::{AxisSnapshot, Channels, ServerMonitor, Snapshot};
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_labcomm::Version;
use gantry_tau_server::plant::DriveState;
use gantry_tau_server::publication::{Publication, SampleName};
use gantry_tau_server::record::{COUNTERS, TickRecord};
use gantry_tau_tests::server_fixture::LOOPBACK;
use gantry_tau_tests::wait_for;

use super::lockstep::Lockstep;
use super::reader::RESOLUTION_M;

/// Ticks of a minute.
const MINUTE: usize = 60_000;
/// Ticks after which each monitor must have come so far.
const TOGETHER: usize = 500;

/// Input of the monitors.
pub(super) const NAMES: [SampleName; 5] = [
    SampleName::State,
    SampleName::Axes,
    SampleName::Tool,
    SampleName::SessionEvent,
    SampleName::Drives,
];

/// A monitor in a thread of its own.
struct Watch {
    latest: Arc<Mutex<Option<Snapshot>>>,
    quit: Arc<AtomicBool>,
    thread: JoinHandle<Vec<String>>,
}

impl Watch {
    fn of(server: SocketAddr) -> Self {
        let (latest, quit): (Arc<Mutex<Option<Snapshot>>>, Arc<AtomicBool>) = Default::default();
        let (place, asked) = (Arc::clone(&latest), Arc::clone(&quit));
        let (connected, is_connected) = std::sync::mpsc::channel();
        let thread = std::thread::spawn(move || {
            let mut monitor = ServerMonitor::of(server);
            monitor.update();
            connected.send(()).unwrap();
            while !asked.load(Ordering::Relaxed) {
                monitor.update();
                *place.lock().unwrap() = monitor.live().cloned();
                std::thread::sleep(Duration::from_millis(1));
            }
            monitor.events().map(|entry| entry.text.clone()).collect()
        });
        // The server's next tick is one that it sees.
        is_connected.recv().unwrap();
        Self {
            latest,
            quit,
            thread,
        }
    }

    /// Waits until it shows the last of two rows, and compares all that it shows.
    fn assert_shows(&self, before: &TickRecord<ARMS>, row: &TickRecord<ARMS>) {
        let expected = snapshot(before, row);
        let mut shown = None;
        wait_for("a monitor", || {
            shown.clone_from(&self.latest.lock().unwrap());
            shown
                .as_ref()
                .is_some_and(|shown| shown.tick == expected.tick)
        });
        assert_eq!(shown, Some(expected));
    }

    /// Ends it; returns its events.
    fn events(self) -> Vec<String> {
        self.quit.store(true, Ordering::Relaxed);
        self.thread.join().unwrap()
    }
}

/// The row as a monitor shows it.
fn snapshot(before: &TickRecord<ARMS>, row: &TickRecord<ARMS>) -> Snapshot {
    let (state, tool) = (&row.state, row.tool.unwrap());
    let [counters @ .., (_, longest_miss_run)] = COUNTERS;
    let counters = counters.map(|(_, value)| i32::try_from(value(&state.counters)).unwrap());
    let axes = (0..ARMS).map(|number| {
        let axis = &state.axes[number];
        AxisSnapshot {
            nominal_nm: axis.nominal.0,
            reference_nm: row.references[number].position.0,
            offset: Channels {
                position_nm: axis.offsets.position.0,
                velocity_um_s: axis.offsets.velocity.0,
                torque_permille: axis.offsets.torque.0,
            },
            shadow_nm: axis.shadow.position.0,
            actual: Channels {
                position_nm: axis.actual.position.0,
                velocity_um_s: axis.actual.velocity.0,
                torque_permille: axis.actual.torque.0,
            },
            lag_nm: Some(before.references[number].position.0 - axis.actual.position.0),
            flags: [
                "clamped",
                "position_limited",
                "velocity_limited",
                "torque_limited",
                "nominal_step",
            ]
            .into_iter()
            .enumerate()
            .filter(|(bit, _)| axis.flags.bits() >> bit & 1 == 1)
            .map(|(_, name)| name)
            .collect(),
        }
    });
    Snapshot {
        tick: i64::try_from(state.tick.0).unwrap(),
        phase: state.phase,
        epoch: i64::try_from(state.epoch.0).unwrap(),
        cause: state.cause,
        sequence: i64::try_from(state.accepted.0).unwrap(),
        on_time: state.on_time_of_100,
        ramp_ticks_left: i32::try_from(state.ramp_ticks_left).unwrap(),
        counters: counters.into(),
        longest_miss_run: i16::try_from(longest_miss_run(&state.counters)).unwrap(),
        machine_failed: false,
        rows_lost: false,
        axes: axes.collect(),
        drives: row
            .drives
            .map(|drives| drives.map(DriveState::name).to_vec()),
        force: Some(tool.load),
        gauges_m: Some(tool.gauges_m),
        displacement_m: Some(tool.displacement_m),
        turn_rad: Some(tool.turn_rad),
        machine: None,
    }
}

#[test]
fn four_monitors_show_every_number_and_change_none() {
    let port = Publication::bind::<ARMS>(LOOPBACK, Version::V2014, &NAMES, RESOLUTION_M).unwrap();
    let address = port.address().unwrap();
    let mut server = Lockstep::start(vec![port]);
    let monitors = [(); 4].map(|()| Watch::of(address));
    let mut last = None;
    let session = server.session(SensorSource::States, MINUTE, |tick, row| {
        if let Some(before) = last
            .replace(*row)
            .filter(|_| tick % TOGETHER == TOGETHER - 1)
        {
            monitors
                .iter()
                .for_each(|monitor| monitor.assert_shows(&before, row));
        }
    });
    assert!(session.client.is_ok(), "{:?}", session.client);
    session.assert_on_time();
    for monitor in monitors {
        let events = monitor.events();
        assert!(
            events
                .iter()
                .any(|event| event.ends_with("Submit -> Obtain")),
            "{events:?}"
        );
        // None was dropped: the first connection is the only one.
        assert_eq!(
            events
                .iter()
                .filter(|event| event.starts_with("connected to"))
                .count(),
            1,
            "{events:?}"
        );
    }
    let mut alone = Lockstep::start(Vec::new());
    let alone = alone.session(SensorSource::States, MINUTE, |_, _| {});
    session.assert_is(&alone);
}
