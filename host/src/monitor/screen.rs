//! The terminal screen: state, counters, axes, force and the last events, as text.

use std::fmt::Write;
use std::time::{SystemTime, UNIX_EPOCH};

use gantry_tau_core::control::message::Phase;

use super::snapshot::{Axis, key_of};
use super::{Entry, Monitor, Snapshot};
use crate::robot_file::CYCLE_US;

/// Events that are shown.
const EVENTS: usize = 10;

/// Words for the machine of a server that does not name it.
const UNKNOWN: &str = "unknown: the port does not publish the sample `machine`";

/// Returns the screen.
pub(super) fn screen(monitor: &Monitor) -> String {
    let mut text = String::new();
    let server = monitor
        .trouble()
        .map_or_else(|| format!("connected to {}", monitor.server()), |trouble| format!("NO TICKS: {trouble}"));
    // Writing to a `String` does not fail.
    let _ = writeln!(text, "{server}");
    if let Some(snapshot) = monitor.last() {
        let machine = snapshot.machine.as_ref().map_or_else(|| UNKNOWN.to_owned(), ToString::to_string);
        let lockstep = snapshot.machine.as_ref().is_some_and(|machine| machine.lockstep);
        let pace = if lockstep { "   LOCK-STEP: times are those of the machine" } else { "" };
        let _ = writeln!(text, "machine {machine}{pace}");
        text.push_str(&tick(snapshot));
    }
    for entry in monitor.events().take(EVENTS) {
        let _ = writeln!(text, "{}", line(entry));
    }
    text
}

/// An event as a line.
pub(super) fn line(entry: &Entry) -> String {
    format!("{} {}", time_of_day(entry.at), entry.text)
}

/// Time of day, UTC.
pub(super) fn time_of_day(at: SystemTime) -> String {
    let since = at.duration_since(UNIX_EPOCH).unwrap_or_default();
    let seconds = since.as_secs();
    let (hours, minutes) = (seconds / 3_600 % 24, seconds / 60 % 60);
    format!("{hours:02}:{minutes:02}:{:02}.{:03}Z", seconds % 60, since.subsec_millis())
}

fn tick(snapshot: &Snapshot) -> String {
    let mut text = String::new();
    let words = |name: &str| key_of(name).replace('_', " ");
    let failed = if snapshot.machine_failed { "   MACHINE FAILED" } else { "" };
    let lost = if snapshot.rows_lost { "   ROWS LOST" } else { "" };
    let ramp_s = f64::from(snapshot.ramp_ticks_left) * f64::from(CYCLE_US) * 1e-6;
    let _ = writeln!(
        text,
        "{:<16}epoch {}   tick {}   on time {}/100   cause of last end: {}   ramp from here {ramp_s:.1} s{failed}{lost}",
        words(snapshot.phase.name()),
        snapshot.epoch,
        grouped(snapshot.tick),
        snapshot.on_time,
        words(snapshot.cause.name()),
    );
    let counts = &snapshot.counters;
    let _ = writeln!(
        text,
        "received {}  missed {} (longest {})  late {}  duplicate {}  stale {}  malformed {}  out of range {}  limited {}  clamped {}  strangers {}",
        grouped(counts.received.into()),
        counts.missed,
        snapshot.longest_miss_run,
        counts.late,
        counts.duplicate,
        counts.stale,
        counts.malformed,
        counts.out_of_range,
        counts.limited,
        counts.clamped,
        counts.strangers,
    );
    let _ = writeln!(
        text,
        "axis      nominal mm    offset µm    shadow µm      actual mm     lag µm     v mm/s  torque %  flags"
    );
    for (number, axis) in (1..).zip(&snapshot.axes) {
        let _ = writeln!(text, "{number:<4}{}", row(axis, snapshot.phase).trim_end());
    }
    if let Some(drives) = &snapshot.drives {
        let states: Vec<String> = drives.iter().map(|state| state.replace('_', " ")).collect();
        let _ = writeln!(text, "drives {}", states.join(", "));
    }
    if let (Some([x, y, z, mx, my, mz]), Some(gauges)) = (snapshot.force, snapshot.gauges_m) {
        let [first, second, third] = gauges.map(|gauge| gauge * 1e6);
        let _ = writeln!(
            text,
            "force {x:7.1} {y:7.1} {z:7.1} N   {mx:6.2} {my:6.2} {mz:6.2} N m   gauges {first:7.1} {second:7.1} {third:7.1} µm",
        );
    }
    text
}

fn row(axis: &Axis, phase: Phase) -> String {
    let micrometres = |nm: i64| nm as f64 * 1e-3;
    let lag = axis.lag_nm.map_or_else(|| "-".to_owned(), |lag| format!("{:.1}", micrometres(lag)));
    let shadow = match phase {
        Phase::Submit => format!("{:.3}", micrometres(axis.shadow_nm.into())),
        _ => "-".to_owned(),
    };
    format!(
        "{:>16} {:>12.3} {shadow:>12} {:>16} {lag:>8} {:>10.3} {:>9.1}  {}",
        millimetres(axis.nominal_nm),
        micrometres(axis.offset.position_nm.into()),
        millimetres(axis.actual.position_nm),
        f64::from(axis.actual.velocity_um_s) * 1e-3,
        f64::from(axis.actual.torque_permille) * 0.1,
        axis.flags.join(" ").replace('_', " "),
    )
}

/// `-696.400 000` of nm.
fn millimetres(nm: i64) -> String {
    let sign = if nm < 0 { "-" } else { "" };
    let nm = nm.unsigned_abs();
    format!("{sign}{}.{:03} {:03}", nm / 1_000_000, nm / 1_000 % 1_000, nm % 1_000)
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
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn numbers_are_grouped_by_thousands() {
        for (number, text) in [(0, "0"), (999, "999"), (-1_000, "-1 000"), (1_234_567, "1 234 567")] {
            assert_eq!(grouped(number), text);
        }
        for (nm, text) in [(624_500_000, "624.500 000"), (-4, "-0.000 004"), (i64::MIN, "-9223372036854.775 808")] {
            assert_eq!(millimetres(nm), text);
        }
    }

    #[test]
    fn the_time_of_day_is_that_of_the_epoch_modulo_a_day() {
        let at = UNIX_EPOCH + Duration::from_millis(86_400_000 * 20_000 + 43_201_123);
        assert_eq!(time_of_day(at), "12:00:01.123Z");
    }
}
