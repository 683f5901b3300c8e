//! Checks of a robot file, one per section.

use std::num::NonZeroU32;

use gantry_tau_core::control::agitation::AgitationBudget;
use gantry_tau_core::control::channel::{LimitValues, Limits, LimitsError};
use gantry_tau_core::control::message::AxisLimits;
use gantry_tau_core::control::session::config::{AxisConfig, NominalAccel, Travel};
use gantry_tau_core::model::linalg::rotation_deviation;
use gantry_tau_core::model::load_filter::{MAX_FREQUENCY, MAX_NOTCHES};
use gantry_tau_core::model::sensor::{MAX_LEVER_M, MAX_WEIGHT_N, NOTCH_Q};
use gantry_tau_core::units::{Metres, OffsetNm, PositionNm};
use nalgebra::Matrix3;

use super::problems::{Problem, Problems};
use super::sections::{Axes, Each};
use super::{
    CYCLE_US, ClientKeys, FeedForwardKey, FilterKey, Keys, Motors, Sensor, Simulation, matrix,
};

/// Largest deviation of `metres_per_q`, the length of a unit of `q` by the drive's count, from
/// `|v_i|`, which calibration finds; relative. More is a wrong unit.
const SCALE_TOLERANCE: f64 = 0.01;
/// Range of a compliance, m/N: what is stiffer is rigid, what is softer is not a machine.
const COMPLIANCE_M_PER_N: (f64, f64) = (1e-13, 1e-2);
/// Largest distance of a micrometre value from a whole nanometre, nm: rounding of the decimal.
const WHOLE_NM_TOLERANCE: f64 = 1e-3;
/// Highest cut-off of a low-pass of first order, Hz.
const MAX_CUTOFF_HZ: f64 = 1e5;
/// Range of a motor's rated force, N.
const RATED_N: (f64, f64) = (1.0, 1e6);
/// Largest number of motors.
const MAX_MOTORS: usize = 32;

/// Checks the scale and returns the nominal travel in q-units. Where the geometry gives the length
/// of a unit (of a guideway), the file must agree with it.
pub(super) fn travel_in_q<const N: usize>(
    axes: &Axes<N>,
    lengths_m: &[Option<f64>; N],
    problems: &mut Problems,
) -> Option<[(f64, f64); N]> {
    let mut travel = [(0.0, 0.0); N];
    let is_right = problems.none_in(|problems| {
        for (index, ((entry, length), (metres, [lower, upper]))) in travel
            .iter_mut()
            .zip(lengths_m)
            .zip(axes.metres_per_q.0.iter().zip(&axes.nominal_travel_m.0))
            .enumerate()
        {
            let key = format!("axes.metres_per_q[{index}]");
            problems.range(&key, *metres, 1e-6, 1e3);
            // Not `deviation > ..`: a guideway that is NaN is named by the robot's own check.
            if let Some(scale) = length.filter(|l| (metres - l).abs() > SCALE_TOLERANCE * l) {
                let reason = format!("is {metres}, but V[{index}] is {scale:.6} m long");
                problems.add(key, reason);
            }
            *entry = (lower / metres, upper / metres);
        }
    });
    is_right.then_some(travel)
}

/// Returns every axis in the units of the reference path.
pub(super) fn limits<const N: usize>(
    axes: &Axes<N>,
    problems: &mut Problems,
) -> Option<[AxisConfig; N]> {
    let limits: Vec<_> = (0..N).map(|index| axis(axes, index, problems)).collect();
    let limits: Option<Vec<_>> = limits.into_iter().collect();
    limits?.try_into().ok()
}

fn axis<const N: usize>(
    axes: &Axes<N>,
    index: usize,
    problems: &mut Problems,
) -> Option<AxisConfig> {
    let limits = axis_limits(axes, index, problems);
    let step_nm = positive_nm("nominal_step_um", &axes.nominal_step_um, index, problems);
    let accel = nominal_accel(axes, index, problems);
    let agitation = agitation(axes, index, problems);
    let machine_travel = travel("machine_travel_m", &axes.machine_travel_m, index, problems);
    let nominal_travel = travel("nominal_travel_m", &axes.nominal_travel_m, index, problems);
    let config = AxisConfig {
        limits: limits?,
        nominal_travel: nominal_travel?,
        machine_travel: machine_travel?,
        nominal_step_nm: step_nm?.get(),
        nominal_accel: accel?,
        agitation: agitation?,
    };
    let AxisConfig {
        nominal_travel: nominal,
        machine_travel: machine,
        ..
    } = &config;
    let margin = i64::from(config.limits.position.max());
    let below = nominal.lower.0.saturating_sub(margin) < machine.lower.0;
    if below || nominal.upper.0.saturating_add(margin) > machine.upper.0 {
        let reason = "must lie inside machine_travel_m by position.max_um on either side";
        problems.add(axis_key("nominal_travel_m", index), reason);
        return None;
    }
    Some(config)
}

/// Key of a value of an axis.
fn axis_key(key: &str, index: usize) -> String {
    format!("axes.{key}[{index}]")
}

fn axis_limits<const N: usize>(
    axes: &Axes<N>,
    index: usize,
    problems: &mut Problems,
) -> Option<AxisLimits> {
    let position = position(axes, index, problems);
    let v = &axes.velocity;
    let t = &axes.torque;
    let velocity = LimitValues {
        max: pick(&v.max_um_s, index, -1),
        step: pick(&v.step_um_s, index, 0),
        accel: pick(&v.accel_um_s, index, 0),
        ramp: pick(&v.ramp_um_s, index, 0),
    };
    if let Some(rated_n) = &t.rated_n {
        let (lower, upper) = RATED_N;
        let key = axis_key("torque.rated_n", index);
        problems.range(&key, pick(rated_n, index, 0.0), lower, upper);
    }
    let torque = LimitValues {
        max: pick(&t.max_permille, index, -1).into(),
        step: pick(&t.step_permille, index, 0).into(),
        accel: pick(&t.accel_permille, index, 0).into(),
        ramp: pick(&t.ramp_permille, index, 0).into(),
    };
    let position =
        position.and_then(|values| problems.keep(channel("position", "um", index, values)));
    let velocity = problems.keep(channel("velocity", "um_s", index, velocity));
    let torque = problems.keep(channel("torque", "permille", index, torque));
    Some(AxisLimits {
        position: position?,
        velocity: velocity?,
        torque: torque?,
    })
}

/// Reads the limits of the position offset.
fn position<const N: usize>(
    axes: &Axes<N>,
    index: usize,
    problems: &mut Problems,
) -> Option<LimitValues> {
    let p = &axes.position;
    let [max, step, accel, ramp] = [
        ("position.max_um", &p.max_um),
        ("position.step_um", &p.step_um),
        ("position.accel_um", &p.accel_um),
        ("position.ramp_um", &p.ramp_um),
    ]
    .map(|(key, values)| {
        problems.keep(whole_nm(
            &axis_key(key, index),
            pick(values, index, f64::NAN),
        ))
    });
    Some(LimitValues {
        max: max?,
        step: step?,
        accel: accel?,
        ramp: ramp?,
    })
}

fn positive_nm<const N: usize>(
    key: &str,
    values_um: &Each<f64, N>,
    index: usize,
    problems: &mut Problems,
) -> Option<NonZeroU32> {
    let key = axis_key(key, index);
    let nm = problems.keep(whole_nm(&key, pick(values_um, index, f64::NAN)))?;
    let nm = u32::try_from(nm).ok().and_then(NonZeroU32::new);
    if nm.is_none() {
        problems.add(key, "must be positive");
    }
    nm
}

/// Reads the limit of the nominal acceleration; `Some(None)` without one.
fn nominal_accel<const N: usize>(
    axes: &Axes<N>,
    index: usize,
    problems: &mut Problems,
) -> Option<Option<NominalAccel>> {
    let is_fault = axes.nominal_accel_is_fault;
    let Some(values) = &axes.nominal_accel_um else {
        if is_fault && index == 0 {
            let reason = "needs nominal_accel_um, of which it says what more does";
            problems.add("axes.nominal_accel_is_fault", reason);
        }
        return Some(None);
    };
    let nm = positive_nm("nominal_accel_um", values, index, problems)?;
    Some(Some(NominalAccel { nm, is_fault }))
}

/// Reads the agitation budget; `Some(None)` without one. At a cycle of 1 ms, 1 µm/s is 1 nm per tick.
fn agitation<const N: usize>(
    axes: &Axes<N>,
    index: usize,
    problems: &mut Problems,
) -> Option<Option<AgitationBudget>> {
    let Some(values) = &axes.position.agitation_um_per_s else {
        return Some(None);
    };
    let budget = AgitationBudget::new(pick(values, index, 0)).filter(AgitationBudget::is_valid);
    if budget.is_none() {
        let most = AgitationBudget::MAX_NM_PER_TICK;
        let reason = format!("must be 1 to {most}; without the key there is no budget");
        problems.add(axis_key("position.agitation_um_per_s", index), reason);
    }
    budget.map(Some)
}

/// Checks the limits of a channel as core does, and names the key that breaks them.
fn channel<U>(
    section: &str,
    unit: &str,
    index: usize,
    values: LimitValues,
) -> Result<Limits<U>, Problem> {
    Limits::new(values).map_err(|error| {
        let (name, reason) = match error {
            LimitsError::NegativeMax { .. } => {
                ("max", "must not be negative; 0 disables the channel")
            }
            LimitsError::RampNotPositive { .. } => ("ramp", "must be positive"),
            LimitsError::RampAboveStep { .. } => ("ramp", "must not be above step"),
            _ => ("accel", "must be at least step + ramp"),
        };
        Problem::new(axis_key(&format!("{section}.{name}_{unit}"), index), reason)
    })
}

/// Returns entry `index`, or a value that its check refuses.
fn pick<T: Copy, const N: usize>(values: &Each<T, N>, index: usize, refused: T) -> T {
    values.0.get(index).copied().unwrap_or(refused)
}

fn travel<const N: usize>(
    key: &str,
    ends_m: &Each<[f64; 2], N>,
    index: usize,
    problems: &mut Problems,
) -> Option<Travel> {
    let key = axis_key(key, index);
    let [lower, upper] = pick(ends_m, index, [f64::NAN; 2]).map(|end_m| {
        let crossed = PositionNm::from_metres(Metres(end_m));
        problems.keep(crossed.map_err(|error| Problem::new(&key, error)))
    });
    let travel = Travel {
        lower: lower?,
        upper: upper?,
    };
    if travel.lower > travel.upper {
        problems.add(key, "has its lower end above its upper end");
        return None;
    }
    Some(travel)
}

/// Converts micrometres that are a whole number of nanometres.
fn whole_nm(key: &str, value_um: f64) -> Result<i32, Problem> {
    let crossed =
        OffsetNm::from_metres(Metres(value_um * 1e-6)).map_err(|error| Problem::new(key, error))?;
    if (f64::from(crossed.0) - value_um * 1e3).abs() > WHOLE_NM_TOLERANCE {
        return Err(Problem::new(key, "must be a whole number of nanometres"));
    }
    Ok(crossed.0)
}

/// Compliances are given of links and axes, or of neither, and are those of springs.
pub(super) fn springs<K: Keys<N>, const N: usize>(keys: &K, problems: &mut Problems) {
    let key = K::AXIS_COMPLIANCES;
    match keys.springs() {
        (None, Some(_)) => problems.add("c_link", format!("is missing beside {key}")),
        (Some(_), None) => problems.add(key, "is missing beside c_link"),
        (None, None) => {}
        (Some(links), Some(axes)) => {
            compliances("c_link", &links, problems);
            compliances(key, &axes, problems);
        }
    }
}

fn compliances(key: &str, values: &[f64], problems: &mut Problems) {
    let (least, most) = COMPLIANCE_M_PER_N;
    for (index, value) in values.iter().enumerate() {
        if !(least..=most).contains(value) {
            let reason = format!(
                "is {value:e}; a compliance is positive, in m/N, from {least:e} to {most:e} ([T Table 5.2] has other numbers: docs/identification.md)"
            );
            problems.add(format!("{key}[{index}]"), reason);
        }
    }
}

pub(super) fn motors(motors: &Motors, axes: usize, problems: &mut Problems) {
    let key = "motors.axis_of_motor";
    if motors.axis_of_motor.len() > MAX_MOTORS {
        problems.add(key, format!("has more than {MAX_MOTORS} motors"));
        problems.distrust("motors");
    }
    if let Some(axis) = motors.axis_of_motor.iter().find(|axis| **axis >= axes) {
        problems.add(key, format!("names axis {axis} of {axes}, counted from 0"));
    }
    for axis in (0..axes).filter(|axis| !motors.axis_of_motor.contains(axis)) {
        problems.add(key, format!("leaves axis {axis} without a motor"));
    }
}

pub(super) fn sensor(sensor: &Sensor, problems: &mut Problems) {
    rotation("sensor.rotation", &sensor.rotation_matrix(), problems);
    for (key, values, most) in [
        ("lever_m", sensor.lever_m, MAX_LEVER_M),
        ("tool.weight_n", sensor.tool.weight_n, MAX_WEIGHT_N),
        ("tool.centre_m", sensor.tool.centre_m, MAX_LEVER_M),
    ] {
        for (index, value) in values.into_iter().enumerate() {
            problems.range(&format!("sensor.{key}[{index}]"), value, -most, most);
        }
    }
    let highest_hz = if sensor.filter == Some(FilterKey::FirstOrder) || sensor.filter.is_none() {
        MAX_CUTOFF_HZ
    } else {
        highest_hz()
    };
    problems.range("sensor.cutoff_hz", sensor.cutoff_hz, 1e-3, highest_hz);
    problems.range(
        "sensor.notches",
        sensor.notches.into(),
        0.0,
        MAX_NOTCHES as f64,
    );
    problems.range("sensor.notch_q", sensor.notch_q, NOTCH_Q.0, NOTCH_Q.1);
    problems.range("sensor.tare_samples", sensor.tare_samples.into(), 1.0, 1e6);
}

fn rotation(key: &str, matrix: &Matrix3<f64>, problems: &mut Problems) {
    let deviation = rotation_deviation(matrix);
    if deviation > 1e-9 {
        let reason = format!("is not a rotation matrix (deviation {deviation:.0e})");
        problems.add(key, reason);
    }
}

/// Checks the accelerometer with the presence of `[masses]`.
pub(super) fn accelerometer(sensor: &Sensor, has_masses: bool, problems: &mut Problems) {
    let Some(keys) = &sensor.accelerometer else {
        return;
    };
    let section = "sensor.accelerometer";
    if !has_masses {
        let reason =
            "needs a section [masses]: what it takes out of the load is the tool's inertia";
        problems.add(section, reason);
    }
    let key = format!("{section}.rotation");
    rotation(&key, &matrix(keys.rotation), problems);
    for (index, value) in keys.place_m.into_iter().enumerate() {
        let key = format!("{section}.place_m[{index}]");
        problems.range(&key, value, -MAX_LEVER_M, MAX_LEVER_M);
    }
    if ![3, 6].contains(&keys.axes) {
        let reason = format!(
            "is {}; expected 3 (the linear acceleration) or 6 (the angular one as well)",
            keys.axes
        );
        problems.add(format!("{section}.axes"), reason);
    }
    problems.range(&format!("{section}.share"), keys.share, 0.0, 1.0);
}

/// Checks what a client feeds forward with the presence of `[masses]` and of rated forces.
pub(super) fn feed_forward<const N: usize>(
    client: &ClientKeys,
    axes: &Axes<N>,
    has_masses: bool,
    problems: &mut Problems,
) {
    let (name, needs_torque) = match client.feed_forward {
        FeedForwardKey::None => return,
        FeedForwardKey::Inertia => ("inertia", false),
        FeedForwardKey::InertiaAndTorque => ("inertia_and_torque", true),
    };
    let key = "client.feed_forward";
    if !has_masses {
        let reason = format!("is \"{name}\", which needs a section [masses]");
        problems.add(key, reason);
    } else if needs_torque && axes.torque.rated_n.is_none() {
        let reason = format!("is \"{name}\", which needs axes.torque.rated_n");
        problems.add(key, reason);
    }
}

/// Checks the filter of the load with the presence of `[masses]`.
pub(super) fn filter(sensor: &Sensor, has_masses: bool, problems: &mut Problems) {
    match sensor.filter {
        Some(FilterKey::Auto) if !has_masses => {
            let reason = "is \"auto\", which needs a section [masses]";
            problems.add("sensor.filter", reason);
        }
        // What no filter has was refused before.
        None if has_masses
            && sensor.cutoff_hz > highest_hz()
            && sensor.cutoff_hz <= MAX_CUTOFF_HZ =>
        {
            let reason = format!(
                "is {}; with [masses] the filter is \"auto\", and its cut-off at most {} Hz",
                sensor.cutoff_hz,
                highest_hz()
            );
            problems.add("sensor.cutoff_hz", reason);
        }
        _ => {}
    }
}

/// Highest cut-off of a low-pass of second order, Hz.
fn highest_hz() -> f64 {
    MAX_FREQUENCY / (f64::from(CYCLE_US) * 1e-6)
}

pub(super) fn simulation(simulation: &Simulation, problems: &mut Problems) {
    let s = simulation;
    for (key, value, lower, upper) in [
        ("spring_deviation", s.spring_deviation, 0.0, 0.9),
        ("force_noise_n", s.force_noise_n, 0.0, 1e3),
        ("moment_noise_nm", s.moment_noise_nm, 0.0, 1e3),
        (
            "acceleration_noise_m_per_s2",
            s.acceleration_noise_m_per_s2,
            0.0,
            10.0,
        ),
        ("gauge_resolution_m", s.gauge_resolution_m, 1e-9, 1e-3),
        ("jump_force_n", s.jump_force_n, 1.0, 1e5),
        ("jump_gap_m", s.jump_gap_m, 0.0, 1e-2),
        ("geometry_mm", s.geometry_mm, 0.0, 100.0),
        ("gauge_point_mm", s.gauge_point_mm, 0.0, 100.0),
        ("gauge_axis_mrad", s.gauge_axis_mrad, 0.0, 100.0),
        (
            "jump_hysteresis_n",
            s.jump_hysteresis_n,
            0.0,
            s.jump_force_n,
        ),
        ("drift_um_per_min", s.drift_um_per_min, 0.0, 100.0),
    ] {
        problems.range(&format!("simulation.{key}"), value, lower, upper);
    }
}
