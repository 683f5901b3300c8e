//! Lines between a program and the pacing client.

use gantry_tau_core::control::message::{AxisLimits, Mode, Phase, State};
use gantry_tau_core::control::pacer::Target;
use gantry_tau_core::units::{OffsetNm, Tick};
use serde::{Deserialize, Serialize};

/// Line of a program.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Wanted {
    mode: WantedMode,
    /// The server's time, s.
    t: f64,
    offset_um: Vec<f64>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum WantedMode {
    Submit,
    Obtain,
}

/// Reads a line: the mode, and the target.
///
/// # Errors
/// A text that names the field.
pub(super) fn read<const N: usize>(
    line: &[u8],
    cycle_s: f64,
    limits: &[AxisLimits; N],
) -> Result<(Mode, Target<N>), String> {
    let wanted: Wanted = serde_json::from_slice(line).map_err(|error| error.to_string())?;
    let mode = match wanted.mode {
        WantedMode::Submit => Mode::Submit,
        WantedMode::Obtain => Mode::Obtain,
    };
    let tick = (wanted.t / cycle_s).round();
    // Beyond 2^53 not every tick is a number.
    if !(0.0..9.0e15).contains(&tick) {
        return Err(format!("t: {} is no time of the server", wanted.t));
    }
    let given = wanted.offset_um.len();
    let Ok(offsets) = <[f64; N]>::try_from(wanted.offset_um) else {
        return Err(format!("offset_um: {given} numbers for {N} axes"));
    };
    let mut target = Target {
        at: Tick(tick as u64),
        offsets: [OffsetNm(0); N],
    };
    let axes = offsets.iter().zip(limits).zip(&mut target.offsets);
    for (axis, ((um, limits), offset)) in (1..).zip(axes) {
        let nm = (um * 1e3).round();
        let max = f64::from(limits.position.max());
        if !(-max..=max).contains(&nm) {
            return Err(format!(
                "offset_um: {um} of axis {axis} is not within ±{}",
                max / 1e3
            ));
        }
        *offset = OffsetNm(nm as i32);
    }
    Ok((mode, target))
}

/// Line to a program.
#[derive(Debug, Serialize)]
pub(super) struct Row {
    t: f64,
    phase: &'static str,
    nominal_mm: Vec<f64>,
    offset_um: Vec<f64>,
    actual_mm: Vec<f64>,
    force_n: Option<[f64; 3]>,
    moment_nm: Option<[f64; 3]>,
    /// Targets of the session that came too late.
    late: u64,
    /// Targets of the session that the server limited.
    limited: u32,
}

impl Row {
    pub(super) fn of<const N: usize>(state: &State<N>, cycle_s: f64, late: u64) -> Self {
        let wrench = state.sensor.map(|sample| sample.to_si());
        let parts = wrench.map(|[x, y, z, a, b, c]| ([x, y, z], [a, b, c]));
        let mm = |nm: i64| nm as f64 / 1e6;
        Self {
            t: state.tick.0 as f64 * cycle_s,
            phase: name(state.phase),
            nominal_mm: state.axes.iter().map(|axis| mm(axis.nominal.0)).collect(),
            offset_um: (state.axes.iter())
                .map(|axis| f64::from(axis.offsets.position.0) / 1e3)
                .collect(),
            actual_mm: (state.axes.iter())
                .map(|axis| mm(axis.actual.position.0))
                .collect(),
            force_n: parts.map(|(force, _)| force),
            moment_nm: parts.map(|(_, moment)| moment),
            late,
            limited: state.counters.limited,
        }
    }
}

const fn name(phase: Phase) -> &'static str {
    match phase {
        Phase::Listening => "listening",
        Phase::Handshake => "handshake",
        Phase::Submit => "submit",
        Phase::Obtain => "obtain",
        Phase::SafeDisconnect => "safe_disconnect",
        Phase::Fault => "fault",
    }
}

/// Line to a program whose line cannot be used.
#[derive(Debug, Serialize)]
pub(super) struct Refused<'a> {
    pub(super) error: &'a str,
}
