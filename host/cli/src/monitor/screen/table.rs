//! The table of the axes, as wide as there is room; the flags beside it, or else below it.

use gantry_tau_core::control::message::Phase;

use super::lines::{length, pack};
use crate::monitor::{AxisSnapshot, Snapshot};

/// Width of the wide table without flags.
const WIDE: usize = 94;

/// Returns head, a line for each axis, and where they have no room beside their axes, the flags.
pub(super) fn axes(snapshot: &Snapshot, columns: usize) -> Vec<String> {
    let rows: Vec<Cells> = (1..)
        .zip(&snapshot.axes)
        .map(|(number, axis)| Cells::of(number, axis, snapshot.phase))
        .collect();
    if columns < WIDE {
        let head =
            "      nominal mm  offset µm  shadow µm     actual mm   lag µm    v mm/s torque %";
        let lines = std::iter::once(head.to_owned()).chain(rows.iter().map(Cells::narrow));
        return lines.chain(flags_below(snapshot, columns)).collect();
    }
    let head = "axis      nominal mm    offset µm    shadow µm        actual mm   lag µm     v mm/s  torque %";
    let with_flags: Vec<String> = std::iter::once(format!("{head}  flags"))
        .chain(rows.iter().map(Cells::wide_with_flags))
        .collect();
    if with_flags.iter().all(|line| length(line) <= columns) {
        return with_flags;
    }
    std::iter::once(head.to_owned())
        .chain(rows.iter().map(Cells::wide))
        .chain(flags_below(snapshot, columns))
        .collect()
}

/// Numbers of an axis as texts.
struct Cells {
    number: usize,
    nominal: String,
    offset: String,
    shadow: String,
    actual: String,
    lag: String,
    velocity: String,
    torque: String,
    flags: String,
}

impl Cells {
    fn of(number: usize, axis: &AxisSnapshot, phase: Phase) -> Self {
        Self {
            number,
            nominal: millimetres(axis.nominal_nm),
            offset: format!("{:.3}", micrometres(axis.offset.position_nm.into())),
            // Nothing acts on it outside Submit.
            shadow: match phase {
                Phase::Submit => format!("{:.3}", micrometres(axis.shadow_nm.into())),
                _ => "-".to_owned(),
            },
            actual: millimetres(axis.actual.position_nm),
            lag: axis
                .lag_nm
                .map_or_else(|| "-".to_owned(), |lag| format!("{:.1}", micrometres(lag))),
            velocity: format!("{:.3}", f64::from(axis.actual.velocity_um_s) * 1e-3),
            torque: format!("{:.1}", f64::from(axis.actual.torque_permille) * 0.1),
            flags: axis.flags.join(" ").replace('_', " "),
        }
    }

    fn wide(&self) -> String {
        format!(
            "{:<4}{:>16} {:>12} {:>12} {:>16} {:>8} {:>10} {:>9}",
            self.number,
            self.nominal,
            self.offset,
            self.shadow,
            self.actual,
            self.lag,
            self.velocity,
            self.torque,
        )
    }

    fn wide_with_flags(&self) -> String {
        let line = format!("{}  {}", self.wide(), self.flags);
        line.trim_end().to_owned()
    }

    fn narrow(&self) -> String {
        format!(
            "{:<2}{:>14} {:>10} {:>10} {:>13} {:>8} {:>9} {:>8}",
            self.number,
            self.nominal,
            self.offset,
            self.shadow,
            self.actual,
            self.lag,
            self.velocity,
            self.torque,
        )
    }
}

/// `position limited 1 3`: axes of each flag that is set.
fn flags_below(snapshot: &Snapshot, columns: usize) -> Vec<String> {
    let mut flags: Vec<(&str, Vec<String>)> = Vec::new();
    for (number, axis) in (1_u8..).zip(&snapshot.axes) {
        for flag in &axis.flags {
            match flags.iter_mut().find(|(name, _)| name == flag) {
                Some((_, numbers)) => numbers.push(number.to_string()),
                None => flags.push((flag, vec![number.to_string()])),
            }
        }
    }
    let parts: Vec<String> = flags
        .into_iter()
        .map(|(flag, numbers)| format!("{} {}", flag.replace('_', " "), numbers.join(" ")))
        .collect();
    pack(&parts, "   ", columns)
}

fn micrometres(nm: i64) -> f64 {
    nm as f64 * 1e-3
}

/// `-696.400 000` of nm.
pub(super) fn millimetres(nm: i64) -> String {
    let sign = if nm < 0 { "-" } else { "" };
    let nm = nm.unsigned_abs();
    format!(
        "{sign}{}.{:03} {:03}",
        nm / 1_000_000,
        nm / 1_000 % 1_000,
        nm % 1_000
    )
}
