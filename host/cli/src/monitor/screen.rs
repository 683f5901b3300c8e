//! The terminal screen: state, counters, axes, force and the last events, as text that fits.

mod lines;
mod table;

use std::time::{SystemTime, UNIX_EPOCH};

use gantry_tau_machine::robot_file::CYCLE_US;

use super::snapshot::key_of;
use super::{LoggedEvent, ServerMonitor, Snapshot};
use lines::{cut, pack, wrap};

/// Words for the machine of a server that does not name it.
const UNKNOWN: &str = "unknown: the port does not publish the sample `machine`";

/// Size of a screen, characters.
#[derive(Clone, Copy, Debug)]
pub(super) struct Size {
    pub(super) columns: usize,
    pub(super) rows: usize,
}

impl Size {
    /// Size of a terminal that does not tell its own.
    pub(super) const USUAL: Self = Self {
        columns: 80,
        rows: 24,
    };
    /// Size of what goes to a file or a pipe.
    pub(super) const PRINTED: Self = Self {
        columns: 132,
        rows: 24,
    };
}

/// Returns the screen: no more lines than it has rows, and none wider than it.
pub(super) fn screen(monitor: &ServerMonitor, size: Size) -> String {
    let connection = monitor.trouble().map_or_else(
        || format!("connected to {}", monitor.server()),
        |trouble| format!("NO TICKS: {trouble}"),
    );
    rendered(&connection, monitor.last(), monitor.events(), size).join("\n")
}

fn rendered<'e>(
    connection: &str,
    snapshot: Option<&Snapshot>,
    events: impl Iterator<Item = &'e LoggedEvent>,
    size: Size,
) -> Vec<String> {
    let columns = size.columns;
    let mut lines = wrap(connection, columns);
    if let Some(snapshot) = snapshot {
        lines.extend(pack(&machine(snapshot), "   ", columns));
        lines.extend(pack(&state(snapshot), "   ", columns));
        lines.extend(pack(&counters(snapshot), "  ", columns));
        lines.extend(table::axes(snapshot, columns));
        lines.extend(drives(snapshot));
        lines.extend(pack(&load(snapshot), "   ", columns));
    }
    lines.extend(events.map(line));
    lines.truncate(size.rows);
    lines.into_iter().map(|line| cut(line, columns)).collect()
}

/// An event as a line.
fn line(event: &LoggedEvent) -> String {
    format!("{} {}", time_of_day(event.at), event.text)
}

/// Time of day, UTC.
pub(super) fn time_of_day(at: SystemTime) -> String {
    let since = at.duration_since(UNIX_EPOCH).unwrap_or_default();
    let seconds = since.as_secs();
    let hours = seconds / 3_600 % 24;
    let minutes = seconds / 60 % 60;
    format!(
        "{hours:02}:{minutes:02}:{:02}.{:03}Z",
        seconds % 60,
        since.subsec_millis()
    )
}

fn machine(snapshot: &Snapshot) -> Vec<String> {
    let Some(machine) = &snapshot.machine else {
        return vec![format!("machine {UNKNOWN}")];
    };
    let mut parts = vec![
        format!("machine {}", machine.name),
        format!("kinematics {:08x}", machine.kinematics),
    ];
    if machine.lockstep {
        parts.push("LOCK-STEP: times are those of the machine".to_owned());
    }
    parts
}

fn state(snapshot: &Snapshot) -> Vec<String> {
    let ramp_s = f64::from(snapshot.ramp_ticks_left) * f64::from(CYCLE_US) * 1e-6;
    let mut parts = vec![
        format!(
            "{:<16}epoch {}",
            words(snapshot.phase.name()),
            snapshot.epoch
        ),
        format!("tick {}", grouped(snapshot.tick)),
        format!("on time {}/100", snapshot.on_time),
        format!("cause of last end: {}", words(snapshot.cause.name())),
        format!("ramp from here {ramp_s:.1} s"),
    ];
    if snapshot.machine_failed {
        parts.push("MACHINE FAILED".to_owned());
    }
    if snapshot.rows_lost {
        parts.push("ROWS LOST".to_owned());
    }
    parts
}

fn counters(snapshot: &Snapshot) -> [String; 10] {
    let counts = &snapshot.counters;
    [
        format!("received {}", grouped(counts.received.into())),
        format!(
            "missed {} (longest {})",
            counts.missed, snapshot.longest_miss_run
        ),
        format!("late {}", counts.late),
        format!("duplicate {}", counts.duplicate),
        format!("stale {}", counts.stale),
        format!("malformed {}", counts.malformed),
        format!("out of range {}", counts.out_of_range),
        format!("limited {}", counts.limited),
        format!("clamped {}", counts.clamped),
        format!("strangers {}", counts.strangers),
    ]
}

fn drives(snapshot: &Snapshot) -> Option<String> {
    let states: Vec<String> = (snapshot.drives.as_ref()?.iter())
        .map(|state| words(state))
        .collect();
    Some(format!("drives {}", states.join(", ")))
}

fn load(snapshot: &Snapshot) -> Vec<String> {
    let (Some([x, y, z, mx, my, mz]), Some(gauges)) = (snapshot.force, snapshot.gauges_m) else {
        return Vec::new();
    };
    let [first, second, third] = gauges.map(|gauge| gauge * 1e6);
    vec![
        format!("force {x:7.1} {y:7.1} {z:7.1} N   {mx:6.2} {my:6.2} {mz:6.2} N m"),
        format!("gauges {first:7.1} {second:7.1} {third:7.1} µm"),
    ]
}

/// `SafeDisconnect` and `quick_stop` as words.
fn words(name: &str) -> String {
    key_of(name).replace('_', " ")
}

/// `1 234 567`.
fn grouped(number: i64) -> String {
    let digits = number.unsigned_abs().to_string();
    let mut text = String::from(if number < 0 { "-" } else { "" });
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place) % 3 == 0 {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests;
