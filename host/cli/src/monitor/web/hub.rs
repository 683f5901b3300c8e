//! Data for all readers: the latest picture, the events and the last minute of offsets.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::drawing::Drawing;
use crate::monitor::screen::time_of_day;
use crate::monitor::snapshot::key_of;
use crate::monitor::{ServerMonitor, Snapshot};

/// Time that the history covers, s.
const HISTORY_S: f64 = 60.0;

/// Bytes that several readers are sent.
pub(super) type Shared = Arc<[u8]>;

/// Answer to a request for the status.
#[derive(Clone)]
pub(super) enum StatusAnswer {
    /// The object of `monitor --status`.
    Object(String),
    /// Reason why there is no tick.
    Trouble(String),
}

/// The latest of everything.
pub(super) struct Latest {
    /// Number of the machine.
    pub(super) machine_number: u64,
    /// The machine as an event.
    pub(super) machine: Shared,
    /// Number of the picture.
    pub(super) number: u64,
    /// The picture as an event.
    pub(super) picture: Shared,
    /// Number of the last entry of the events.
    pub(super) last_entry: u64,
    /// The events as an event.
    pub(super) events: Shared,
    /// The status.
    pub(super) status: StatusAnswer,
    /// Points of the plot, JSON, with their times.
    history: VecDeque<(f64, String)>,
    pub(super) has_ended: bool,
}

impl Latest {
    /// Encodes the events, if there are new ones.
    fn set_events(&mut self, monitor: &ServerMonitor) {
        let last_entry = monitor.events().next().map_or(0, |entry| entry.number);
        if self.last_entry == last_entry {
            return;
        }
        let entries: Vec<_> = monitor
            .events()
            .map(|entry| (time_of_day(entry.at), &entry.text))
            .collect();
        self.events = event("events", &json!(entries).to_string());
        self.last_entry = last_entry;
    }

    /// Adds a point, and drops those that are too old.
    fn add_point(&mut self, at: f64, point: Option<String>) {
        self.history.extend(point.map(|point| (at, point)));
        while (self.history.front()).is_some_and(|(earlier, _)| *earlier < at - HISTORY_S) {
            self.history.pop_front();
        }
    }
}

/// Exchange between the monitor and the readers.
pub(super) struct Hub {
    began: Instant,
    latest: Mutex<Latest>,
    changed: Condvar,
}

/// A server-sent event of a kind; without one it is a message.
fn event(kind: &str, data: &str) -> Shared {
    let text = if kind.is_empty() {
        format!("data: {data}\n\n")
    } else {
        format!("event: {kind}\ndata: {data}\n\n")
    };
    Arc::from(text.into_bytes())
}

impl Hub {
    pub(super) fn new() -> Self {
        let latest = Latest {
            machine_number: 0,
            machine: Arc::new([]),
            number: 0,
            picture: Arc::new([]),
            last_entry: 0,
            events: Arc::new([]),
            status: StatusAnswer::Trouble(String::new()),
            history: VecDeque::new(),
            has_ended: false,
        };
        Self {
            began: Instant::now(),
            latest: Mutex::new(latest),
            changed: Condvar::new(),
        }
    }

    /// The latest of everything; a thread that panicked with it in hand has not left it half
    /// written.
    pub(super) fn latest(&self) -> MutexGuard<'_, Latest> {
        self.latest.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for a picture after `number`, or for the end; at most a second.
    pub(super) fn after(&self, number: u64) -> MutexGuard<'_, Latest> {
        self.changed
            .wait_timeout_while(self.latest(), Duration::from_secs(1), |latest| {
                latest.number == number && !latest.has_ended
            })
            .unwrap_or_else(PoisonError::into_inner)
            .0
    }

    /// Encodes the present picture and wakes the readers.
    pub(super) fn publish(&self, monitor: &ServerMonitor, drawing: &mut Drawing) {
        let at = (self.began.elapsed().as_secs_f64() * 1e3).round() * 1e-3;
        let mut status = StatusAnswer::Trouble(monitor.trouble().unwrap_or_default());
        let mut picture = json!({"live": false, "trouble": monitor.trouble()}).to_string();
        let mut new_point = None;
        if let Some(snapshot) = monitor.live() {
            let object = snapshot.json();
            let point = point(at, snapshot);
            let (figure, stranger) = match drawing.figure(snapshot, monitor.machine()) {
                Ok(figure) => (figure, Value::Null),
                Err(stranger) => ("null".to_owned(), Value::String(stranger.to_string())),
            };
            let server = monitor.server();
            picture = format!(
                "{{\"live\":true,\"server\":\"{server}\",\"status\":{object},\"point\":{point},\"figure\":{figure},\"stranger\":{stranger}}}"
            );
            status = StatusAnswer::Object(object);
            new_point = Some(point);
        }
        let mut latest = self.latest();
        if let Some((number, machine)) = drawing.machine_after(latest.machine_number) {
            latest.machine = event("machine", &machine);
            latest.machine_number = number;
        }
        latest.set_events(monitor);
        latest.add_point(at, new_point);
        latest.status = status;
        latest.picture = event("", &picture);
        latest.number += 1;
        drop(latest);
        self.changed.notify_all();
    }

    /// The last minute as an event.
    pub(super) fn history(&self) -> Shared {
        let points: Vec<String> = self
            .latest()
            .history
            .iter()
            .map(|(_, point)| point.clone())
            .collect();
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
    let offsets: Vec<f64> = snapshot
        .axes
        .iter()
        .map(|axis| f64::from(axis.offset.position_nm) * 1e-3)
        .collect();
    json!([at, key_of(snapshot.phase.name()), offsets, snapshot.tick]).to_string()
}
