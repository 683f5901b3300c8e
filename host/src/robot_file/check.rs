//! Checks of a robot file, one per section.

use gantry_tau_core::control::channel::{LimitValues, Limits, LimitsError};
use gantry_tau_core::control::message::AxisLimits;
use gantry_tau_core::control::session::config::{AxisConfig, Travel};
use gantry_tau_core::model::linalg::rotation_deviation;
use gantry_tau_core::model::sensor::{MAX_LEVER_M, MAX_WEIGHT_N};
use gantry_tau_core::units::{Metres, OffsetNm, PositionNm};
use toml::de::DeTable;

use super::sections::{Axes, Each, Sections};
use super::{Keys, Motors, Problem, Sensor, Simulation};

/// Largest deviation of `metres_per_q`, the length of a unit of `q` by the drive's count, from `|v_i|`, which calibration finds; relative.
/// More is a wrong unit.
const SCALE_TOLERANCE: f64 = 0.01;
/// Range of a compliance, m/N: what is stiffer is rigid, what is softer is no machine.
const COMPLIANCE_M_PER_N: (f64, f64) = (1e-13, 1e-2);
/// Largest distance of a micrometre value from a whole nanometre, nm: rounding of the decimal.
const WHOLE_NM_TOLERANCE: f64 = 1e-3;
/// Largest number of motors.
const MAX_MOTORS: usize = 32;

/// Kind of machine, which decides the keys of a file.
pub(super) enum Kind {
    L2,
    F1,
}

/// Reads `model` before anything else: another machine's keys would only be called unknown.
pub(super) fn model(text: &str) -> Result<Kind, Problem> {
    let table: toml::Table = toml::from_str(text).map_err(|error| syntax(text, &error))?;
    match table.get("model").map(|model| model.as_str()) {
        Some(Some("l2")) => Ok(Kind::L2),
        Some(Some("f1")) => Ok(Kind::F1),
        Some(_) => Err(Problem::new("model", "must be \"l2\" or \"f1\"")),
        None => Err(Problem::new("model", "is missing")),
    }
}

/// Reads the keys of the machine, then the sections; neither knows the other's names.
pub(super) fn tables<K: Keys<N>, const N: usize>(text: &str) -> Result<(K, Sections<N>), Problem> {
    let refused = |error| syntax(text, &error);
    let root = DeTable::parse(text).map_err(refused)?;
    let names: Vec<&str> = ["model"].iter().chain(K::NAMES).chain(&Sections::<N>::NAMES).copied().collect();
    if let Some(unknown) = root.get_ref().keys().find(|name| !names.contains(&name.get_ref().as_ref())) {
        let (name, line) = (unknown.get_ref(), line_of(text, unknown.span().start));
        let reason = format!("unknown field `{name}`, expected one of `{}` (line {line})", names.join("`, `"));
        return Err(Problem::new(name.as_ref(), reason));
    }
    Ok((toml::from_str(text).map_err(refused)?, toml::from_str(text).map_err(refused)?))
}

/// Returns the error of the TOML reader with the key that it concerns.
fn syntax(text: &str, error: &toml::de::Error) -> Problem {
    let reason = error.message();
    let before = (error.span()).map_or("", |span| text.get(..span.start).unwrap_or(""));
    let line_start = before.rfind('\n').map_or(0, |end| end.saturating_add(1));
    let line = text.get(line_start..).and_then(|rest| rest.lines().next());
    let section = (before.lines().chain(line))
        .filter_map(|line| line.trim().strip_prefix('[')?.strip_suffix(']'))
        .rfind(|name| name.chars().all(|c| c.is_alphanumeric() || "._".contains(c)));
    // A missing key has no line of its own, the others have.
    let quoted = reason.split('`').nth(1);
    let key = if reason.starts_with("missing field") || reason.starts_with("unknown field") {
        quoted
    } else {
        (before.lines().chain(line).rev()).find_map(|line| line.split_once('=').map(|(key, _)| key.trim()))
    };
    let key = match (section, key) {
        (Some(section), Some(key)) if key != section => format!("{section}.{key}"),
        (None, Some(key)) => key.to_owned(),
        (Some(section), _) => section.to_owned(),
        (None, None) => String::new(),
    };
    Problem::new(key, format!("{reason} (line {})", line_of(text, before.len())))
}

/// Number of the line of a byte, from 1.
fn line_of(text: &str, byte: usize) -> usize {
    text.get(..byte).unwrap_or("").matches('\n').count().saturating_add(1)
}

/// Checks `lower <= value <= upper`; NaN is refused.
pub(super) fn range(key: &str, value: f64, lower: f64, upper: f64) -> Result<(), Problem> {
    if (lower..=upper).contains(&value) {
        Ok(())
    } else {
        let reason = format!("is {value}; expected from {lower} to {upper}");
        Err(Problem::new(key, reason))
    }
}

/// Checks the scale and returns the nominal travel in q-units. Where the geometry gives the length of a unit (of a guideway), the file
/// must agree with it.
pub(super) fn travel_in_q<const N: usize>(
    axes: &Axes<N>,
    lengths_m: &[Option<f64>; N],
) -> Result<[(f64, f64); N], Problem> {
    let mut travel = [(0.0, 0.0); N];
    for (index, ((entry, length), (metres, [lower, upper]))) in
        travel.iter_mut().zip(lengths_m).zip(axes.metres_per_q.0.iter().zip(&axes.nominal_travel_m.0)).enumerate()
    {
        let key = format!("axes.metres_per_q[{index}]");
        range(&key, *metres, 1e-6, 1e3)?;
        // Not `deviation > ..`: a guideway that is NaN is named by the robot's own check.
        if let Some(scale) = length.filter(|l| (metres - l).abs() > SCALE_TOLERANCE * l) {
            let reason = format!("is {metres}, but V[{index}] is {scale:.6} m long");
            return Err(Problem::new(key, reason));
        }
        *entry = (lower / metres, upper / metres);
    }
    Ok(travel)
}

/// Returns every axis in the units of the reference path.
pub(super) fn limits<const N: usize>(axes: &Axes<N>) -> Result<[AxisConfig; N], Problem> {
    let limits: Vec<_> = (0..N).map(|index| axis(axes, index)).collect::<Result<_, _>>()?;
    limits.try_into().map_err(|_| Problem::new("axes", "has another number of axes"))
}

fn axis<const N: usize>(axes: &Axes<N>, index: usize) -> Result<AxisConfig, Problem> {
    let keyed = |key: &str| format!("axes.{key}[{index}]");
    let (p, v, t) = (&axes.position, &axes.velocity, &axes.torque);
    let um = |key: &str, values: &Each<f64, N>| whole_nm(&keyed(key), pick(values, index, f64::NAN));
    let position = LimitValues {
        max: um("position.max_um", &p.max_um)?,
        step: um("position.step_um", &p.step_um)?,
        accel: um("position.accel_um", &p.accel_um)?,
        ramp: um("position.ramp_um", &p.ramp_um)?,
    };
    let velocity = LimitValues {
        max: pick(&v.max_um_s, index, -1),
        step: pick(&v.step_um_s, index, 0),
        accel: pick(&v.accel_um_s, index, 0),
        ramp: pick(&v.ramp_um_s, index, 0),
    };
    let torque = LimitValues {
        max: pick(&t.max_permille, index, -1).into(),
        step: pick(&t.step_permille, index, 0).into(),
        accel: pick(&t.accel_permille, index, 0).into(),
        ramp: pick(&t.ramp_permille, index, 0).into(),
    };
    let limits = AxisLimits {
        position: channel("position", "um", index, position)?,
        velocity: channel("velocity", "um_s", index, velocity)?,
        torque: channel("torque", "permille", index, torque)?,
    };
    let machine_travel = travel(&keyed("machine_travel_m"), &axes.machine_travel_m, index)?;
    let nominal_travel = travel(&keyed("nominal_travel_m"), &axes.nominal_travel_m, index)?;
    let margin = i64::from(position.max);
    let below = nominal_travel.lower.0.saturating_sub(margin) < machine_travel.lower.0;
    if below || nominal_travel.upper.0.saturating_add(margin) > machine_travel.upper.0 {
        let reason = "must lie inside machine_travel_m by position.max_um on either side";
        return Err(Problem::new(keyed("nominal_travel_m"), reason));
    }
    match u32::try_from(um("nominal_step_um", &axes.nominal_step_um)?) {
        Ok(nominal_step_nm @ 1..) => Ok(AxisConfig { limits, nominal_travel, machine_travel, nominal_step_nm }),
        _ => Err(Problem::new(keyed("nominal_step_um"), "must be positive")),
    }
}

/// Checks the limits of a channel as core does, and names the key that breaks them.
fn channel<U>(section: &str, unit: &str, index: usize, values: LimitValues) -> Result<Limits<U>, Problem> {
    Limits::new(values).map_err(|error| {
        let (name, reason) = match error {
            LimitsError::NegativeMax { .. } => ("max", "must not be negative; 0 disables the channel"),
            LimitsError::RampNotPositive { .. } => ("ramp", "must be positive"),
            LimitsError::RampAboveStep { .. } => ("ramp", "must not be above step"),
            _ => ("accel", "must be at least step + ramp"),
        };
        Problem::new(format!("axes.{section}.{name}_{unit}[{index}]"), reason)
    })
}

/// Returns entry `index`, or a value that its check refuses.
fn pick<T: Copy, const N: usize>(values: &Each<T, N>, index: usize, refused: T) -> T {
    values.0.get(index).copied().unwrap_or(refused)
}

fn travel<const N: usize>(key: &str, ends_m: &Each<[f64; 2], N>, index: usize) -> Result<Travel, Problem> {
    let [lower, upper] = pick(ends_m, index, [f64::NAN; 2]);
    let cross = |value| PositionNm::from_metres(Metres(value)).map_err(|error| Problem::new(key, error));
    let travel = Travel { lower: cross(lower)?, upper: cross(upper)? };
    if travel.lower > travel.upper {
        return Err(Problem::new(key, "has its lower end above its upper end"));
    }
    Ok(travel)
}

/// Converts micrometres that are a whole number of nanometres.
fn whole_nm(key: &str, value_um: f64) -> Result<i32, Problem> {
    let crossed = OffsetNm::from_metres(Metres(value_um * 1e-6)).map_err(|error| Problem::new(key, error))?;
    if (f64::from(crossed.0) - value_um * 1e3).abs() > WHOLE_NM_TOLERANCE {
        return Err(Problem::new(key, "must be a whole number of nanometres"));
    }
    Ok(crossed.0)
}

/// Compliances are given of links and axes, or of neither, and are those of springs.
pub(super) fn springs<K: Keys<N>, const N: usize>(keys: &K) -> Result<(), Problem> {
    let key = K::AXIS_COMPLIANCES;
    match keys.springs() {
        (None, Some(_)) => Err(Problem::new("c_link", format!("is missing beside {key}"))),
        (Some(_), None) => Err(Problem::new(key, "is missing beside c_link")),
        (None, None) => Ok(()),
        (Some(links), Some(axes)) => {
            let links = links.into_iter().enumerate().map(|(index, value)| ("c_link", index, value));
            let axes = axes.into_iter().enumerate().map(|(index, value)| (key, index, value));
            links.chain(axes).try_for_each(|(key, index, value)| {
                let (least, most) = COMPLIANCE_M_PER_N;
                if (least..=most).contains(&value) {
                    return Ok(());
                }
                let reason = format!("is {value:e}; a compliance is positive, in m/N, from {least:e} to {most:e} ([T Table 5.2] has other numbers: docs/identification.md)");
                Err(Problem::new(format!("{key}[{index}]"), reason))
            })
        }
    }
}

pub(super) fn motors(motors: &Motors, axes: usize) -> Result<(), Problem> {
    let key = "motors.axis_of_motor";
    if motors.axis_of_motor.len() > MAX_MOTORS {
        return Err(Problem::new(key, format!("has more than {MAX_MOTORS} motors")));
    }
    if let Some(axis) = motors.axis_of_motor.iter().find(|axis| **axis >= axes) {
        return Err(Problem::new(key, format!("names axis {axis} of {axes}, counted from 0")));
    }
    match (0..axes).find(|axis| !motors.axis_of_motor.contains(axis)) {
        Some(axis) => Err(Problem::new(key, format!("leaves axis {axis} without a motor"))),
        None => Ok(()),
    }
}

pub(super) fn sensor(sensor: &Sensor) -> Result<(), Problem> {
    let deviation = rotation_deviation(&sensor.rotation_matrix());
    if deviation > 1e-9 {
        let reason = format!("is not a rotation matrix (deviation {deviation:.0e})");
        return Err(Problem::new("sensor.rotation", reason));
    }
    for (index, value) in sensor.lever_m.iter().enumerate() {
        range(&format!("sensor.lever_m[{index}]"), *value, -MAX_LEVER_M, MAX_LEVER_M)?;
    }
    for (index, value) in sensor.tool.weight_n.iter().enumerate() {
        range(&format!("sensor.tool.weight_n[{index}]"), *value, -MAX_WEIGHT_N, MAX_WEIGHT_N)?;
    }
    for (index, value) in sensor.tool.centre_m.iter().enumerate() {
        range(&format!("sensor.tool.centre_m[{index}]"), *value, -MAX_LEVER_M, MAX_LEVER_M)?;
    }
    range("sensor.cutoff_hz", sensor.cutoff_hz, 1e-3, 1e5)?;
    range("sensor.tare_samples", sensor.tare_samples.into(), 1.0, 1e6)
}

pub(super) fn simulation(simulation: &Simulation) -> Result<(), Problem> {
    let s = simulation;
    range("simulation.spring_deviation", s.spring_deviation, 0.0, 0.9)?;
    range("simulation.force_noise_n", s.force_noise_n, 0.0, 1e3)?;
    range("simulation.moment_noise_nm", s.moment_noise_nm, 0.0, 1e3)?;
    range("simulation.gauge_resolution_m", s.gauge_resolution_m, 1e-9, 1e-3)?;
    range("simulation.jump_force_n", s.jump_force_n, 1.0, 1e5)?;
    range("simulation.jump_gap_m", s.jump_gap_m, 0.0, 1e-2)?;
    range("simulation.geometry_mm", s.geometry_mm, 0.0, 100.0)?;
    range("simulation.gauge_point_mm", s.gauge_point_mm, 0.0, 100.0)?;
    range("simulation.gauge_axis_mrad", s.gauge_axis_mrad, 0.0, 100.0)?;
    range("simulation.jump_hysteresis_n", s.jump_hysteresis_n, 0.0, s.jump_force_n)?;
    range("simulation.drift_um_per_min", s.drift_um_per_min, 0.0, 100.0)
}
