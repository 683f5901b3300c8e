//! What all readers get: the latest picture, the events and the last minute of offsets.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::figure::Figures;
use crate::monitor::screen::time_of_day;
use crate::monitor::snapshot::key_of;
use crate::monitor::{Monitor, SAMPLES, Snapshot};

/// Time that the history covers, s.
const HISTORY_S: f64 = 60.0;

/// Bytes that several readers are sent.
pub(super) type Shared = Arc<[u8]>;

/// The latest of everything.
pub(super) struct Latest {
    /// Number of the picture.
    pub(super) number: u64,
    /// The picture as an event.
    pub(super) picture: Shared,
    /// Number of the last entry of the events.
    pub(super) last_entry: u64,
    /// The events as an event.
    pub(super) events: Shared,
    /// The object of `monitor --status`, or the reason for which there is no tick.
    pub(super) status: Result<String, String>,
    /// Points of the plot, JSON, with their times.
    history: VecDeque<(f64, String)>,
    pub(super) has_ended: bool,
}

/// Exchange between the monitor and the readers.
pub(super) struct Hub {
    began: Instant,
    /// The machine as an event.
    pub(super) machine: Shared,
    latest: Mutex<Latest>,
    changed: Condvar,
}

/// A server-sent event of a kind; without one it is a message.
fn event(kind: &str, data: &str) -> Shared {
    let text = if kind.is_empty() { format!("data: {data}\n\n") } else { format!("event: {kind}\ndata: {data}\n\n") };
    Arc::from(text.into_bytes())
}

impl Hub {
    pub(super) fn new(machine: String) -> Self {
        let latest = Latest {
            number: 0,
            picture: Arc::new([]),
            last_entry: 0,
            events: Arc::new([]),
            status: Err(String::new()),
            history: VecDeque::new(),
            has_ended: false,
        };
        let machine = event("machine", &machine);
        Self { began: Instant::now(), machine, latest: Mutex::new(latest), changed: Condvar::new() }
    }

    /// The latest of everything; whoever panicked with it in hand has not left it half written.
    pub(super) fn latest(&self) -> MutexGuard<'_, Latest> {
        self.latest.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for a picture after `number`, or for the end; at most a second.
    pub(super) fn after(&self, number: u64) -> MutexGuard<'_, Latest> {
        let seen = |latest: &mut Latest| latest.number == number && !latest.has_ended;
        let waited = self.changed.wait_timeout_while(self.latest(), Duration::from_secs(1), seen);
        waited.unwrap_or_else(PoisonError::into_inner).0
    }

    /// Encodes the present picture and wakes the readers.
    pub(super) fn publish(&self, monitor: &Monitor, figures: &mut dyn Figures) {
        let at = (self.began.elapsed().as_secs_f64() * 1e3).round() * 1e-3;
        let snapshot = monitor.live();
        let status = snapshot.map(Snapshot::json);
        let point = snapshot.map(|snapshot| point(at, snapshot));
        let picture = match (snapshot, &status, &point) {
            (Some(snapshot), Some(status), Some(point)) => {
                let server = monitor.server();
                let (figure, stranger) = match figure(snapshot, figures) {
                    Ok(figure) => (figure, Value::Null),
                    Err(stranger) => ("null".to_owned(), Value::String(stranger)),
                };
                format!(
                    "{{\"live\":true,\"server\":\"{server}\",\"status\":{status},\"point\":{point},\"figure\":{figure},\"stranger\":{stranger}}}"
                )
            }
            _ => json!({"live": false, "trouble": monitor.trouble()}).to_string(),
        };
        let picture = event("", &picture);
        let mut latest = self.latest();
        let last_entry = monitor.events().next().map_or(0, |entry| entry.number);
        if latest.last_entry != last_entry {
            let entries: Vec<_> = monitor.events().map(|entry| (time_of_day(entry.at), &entry.text)).collect();
            latest.events = event("events", &json!(entries).to_string());
            latest.last_entry = last_entry;
        }
        latest.history.extend(point.map(|point| (at, point)));
        while latest.history.front().is_some_and(|(earlier, _)| *earlier < at - HISTORY_S) {
            latest.history.pop_front();
        }
        latest.status = status.ok_or_else(|| monitor.trouble().unwrap_or_default());
        latest.picture = picture;
        latest.number += 1;
        drop(latest);
        self.changed.notify_all();
    }

    /// The last minute as an event.
    pub(super) fn history(&self) -> Shared {
        let points: Vec<String> = self.latest().history.iter().map(|(_, point)| point.clone()).collect();
        event("history", &format!("[{}]", points.join(",")))
    }

    /// Ends all readers.
    pub(super) fn end(&self) {
        self.latest().has_ended = true;
        self.changed.notify_all();
    }
}

/// Point of the plot: seconds, phase, offsets in µm, tick.
fn point(at: f64, snapshot: &Snapshot) -> String {
    let offsets: Vec<f64> = snapshot.axes.iter().map(|axis| f64::from(axis.offset.position_nm) * 1e-3).collect();
    json!([at, key_of(snapshot.phase.name()), offsets, snapshot.tick]).to_string()
}

/// Points of the machine as JSON.
///
/// # Errors
/// The reason for which the page's machine must not be drawn at the server's positions, for people.
fn figure(snapshot: &Snapshot, figures: &mut dyn Figures) -> Result<String, String> {
    let own = figures.identity();
    let Some(machine) = &snapshot.machine else {
        return Err(format!(
            "Unknown machine: the port does not publish the sample machine, and needs serve --labcomm HOST:PORT={SAMPLES}."
        ));
    };
    if machine.kinematics != own.kinematics || snapshot.axes.len() != figures.axes() {
        return Err(format!(
            "The server's machine is {machine}, this page's is {own}: name its robot file with --robot."
        ));
    }
    figures.figure(snapshot).map_err(|error| format!("The machine cannot be at these positions: {error}."))
}
