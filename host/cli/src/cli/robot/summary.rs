//! Summary of a robot file, with units, and of its machine at home.

use gantry_tau_core::control::channel::Limits;
use gantry_tau_core::control::session::config::{AxisConfig, Travel};
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_core::units::PositionNm;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{CorrectionKind, FeedForwardKey, RobotFile, RobotFileError};
use gantry_tau_machine::stability::FilterKind;
use gantry_tau_machine::workspace::Surveyor;
use nalgebra::Vector3;

/// Distance of the places at which the reach is asked for, m.
const REACH_STEP_M: f64 = 0.005;
/// Largest number of these places in one direction.
const MAX_REACH_STEPS: u32 = 2_000;

/// Returns the summary of a robot file.
///
/// # Errors
/// [`RobotFileError`] if home cannot be reached.
pub(super) fn summary<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
) -> Result<String, RobotFileError> {
    let mut lines = vec![format!("{}: no errors\n", robot.name)];
    lines.push(line(
        "model",
        &format!(
            "{}, {N} axes, {} motors; kinematics {:08x}, springs and masses {:08x}",
            K::MODEL,
            robot.motors.axis_of_motor.len(),
            robot.checksum(),
            robot.springs_checksum()
        ),
    ));
    lines.extend(origin(robot));
    lines.push(String::new());
    lines.extend(axes(robot));
    lines.push(String::new());
    lines.extend(springs(robot));
    lines.extend(sensor(robot));
    lines.extend(drives(robot));
    lines.push(masses(robot));
    lines.push(String::new());
    lines.extend(home(robot)?);
    Ok(lines.join("\n"))
}

/// A quantity and its value.
fn line(name: &str, value: &str) -> String {
    format!("{name:<22}{value}")
}

/// A quantity of every axis.
fn row(name: &str, values: impl IntoIterator<Item = String>) -> String {
    let cells = values.into_iter().map(|value| format!("{value:>9}"));
    format!("{name:<22}{}", cells.collect::<String>())
}

/// Numbers of one unit, separated by commas.
fn list(values: &[f64], scale: f64, digits: usize) -> String {
    let texts = values
        .iter()
        .map(|value| format!("{:.digits$}", value * scale));
    texts.collect::<Vec<_>>().join(", ")
}

/// Measurements that the numbers come from.
fn origin<K, const N: usize>(robot: &RobotFile<K, N>) -> [String; 2] {
    let geometry = robot.calibrated.as_ref().map_or_else(
        || "not calibrated".to_owned(),
        |found| {
            format!(
                "from {}, {} poses; expected error of a place {:.0} um",
                found.measurements, found.poses, found.predicted_rms_um
            )
        },
    );
    let springs = robot.identified.as_ref().map_or_else(
        || "not identified".to_owned(),
        |found| format!("from {}, {} windows", found.measurements, found.windows),
    );
    [line("geometry", &geometry), line("springs", &springs)]
}

/// Travel and limits of every axis.
fn axes<K, const N: usize>(robot: &RobotFile<K, N>) -> Vec<String> {
    let limits = &robot.limits;
    let motors = &robot.motors.axis_of_motor;
    let mut rows = vec![row("axis", (1..=N).map(|axis| axis.to_string()))];
    rows.extend(travel(
        "nominal travel, m",
        limits.map(|axis| axis.nominal_travel),
    ));
    rows.extend(travel(
        "travel of drives, m",
        limits.map(|axis| axis.machine_travel),
    ));
    // Nanometres per millisecond.
    let path_m_per_s = limits.map(|axis| f64::from(axis.nominal_step_nm) * 1e-6);
    rows.push(row("path, m/s", path_m_per_s.map(|v| format!("{v:.3}"))));
    rows.extend(channel(
        "offset, um",
        1e3,
        limits.map(|axis| axis.limits.position),
    ));
    rows.extend(agitation(limits));
    rows.extend(channel(
        "velocity, um/s",
        1.0,
        limits.map(|axis| axis.limits.velocity),
    ));
    rows.extend(channel(
        "torque, per mille",
        1.0,
        limits.map(|axis| axis.limits.torque),
    ));
    rows.push(row(
        "motors",
        (0..N).map(|axis| motors.iter().filter(|of| **of == axis).count().to_string()),
    ));
    rows
}

/// Agitation budgets, if any axis has one. At a cycle of 1 ms, 1 nm per tick is 1 um/s.
fn agitation<const N: usize>(limits: &[AxisConfig; N]) -> Option<String> {
    let budgets = limits.map(|axis| axis.agitation);
    let texts = budgets.map(|budget| {
        budget.map_or_else(
            || "none".to_owned(),
            |budget| budget.nm_per_tick.to_string(),
        )
    });
    let is_budgeted = budgets.iter().any(Option::is_some);
    is_budgeted.then(|| row("  agitation, um/s", texts))
}

fn travel<const N: usize>(name: &str, travels: [Travel; N]) -> [String; 2] {
    [
        row(name, travels.map(|travel| metres(travel.lower))),
        row("  to", travels.map(|travel| metres(travel.upper))),
    ]
}

fn metres(position: PositionNm) -> String {
    format!("{:.3}", position.0 as f64 * 1e-9)
}

/// Limits of a channel of offsets, so many of whose counts are a unit; nothing of one that is
/// disabled.
fn channel<U, const N: usize>(name: &str, per_unit: f64, limits: [Limits<U>; N]) -> Vec<String> {
    if limits.iter().all(|limits| limits.max() == 0) {
        return Vec::new();
    }
    [
        (name, limits.each_ref().map(|of| f64::from(of.max()))),
        (
            "  change per ms",
            limits.each_ref().map(|of| of.step().into()),
        ),
        (
            "  its change per ms",
            limits.each_ref().map(|of| of.accel().into()),
        ),
        (
            "  ramp per ms",
            limits.each_ref().map(|of| of.ramp().into()),
        ),
    ]
    .map(|(name, values)| row(name, values.map(|value| (value / per_unit).to_string())))
    .into()
}

fn springs<K, const N: usize>(robot: &RobotFile<K, N>) -> Vec<String> {
    let mut lines = Vec::new();
    match &robot.compliances {
        None => lines.push(line("compliances", "none: kinematics only")),
        Some(springs) => {
            let (carts, plates) = springs.cart_m_per_n().split_at(ARMS.min(N));
            let links = list(springs.link_m_per_n(), 1e6, 3);
            lines.push(line("links, um/N", &links));
            lines.push(line("carts, um/N", &list(carts, 1e6, 4)));
            if !plates.is_empty() {
                lines.push(line("plates, urad/(N m)", &list(plates, 1e6, 4)));
            }
        }
    }
    if !robot.wrist.is_empty() {
        let joints: Vec<f64> = robot.wrist.iter().map(|joint| joint.c_rad_per_nm).collect();
        lines.push(line("wrist, urad/(N m)", &list(&joints, 1e6, 3)));
    }
    if let Some(play) = &robot.play {
        let text = format!("{:.1} um in cluster 3", play.gap_m * 1e6);
        lines.push(line("play", &text));
    }
    lines
}

fn filter(filter: &FilterKind) -> String {
    match filter {
        FilterKind::FirstOrder { cutoff_hz } => format!("{cutoff_hz} Hz"),
        FilterKind::SecondOrder { cutoff_hz } => format!("{cutoff_hz} Hz of second order"),
        FilterKind::Auto {
            cutoff_hz,
            notches,
            notch_q,
        } => format!("{cutoff_hz} Hz of second order, {notches} notches (Q {notch_q})"),
    }
}

/// Force sensor, accelerometer, tool, and what the client makes of them.
fn sensor<K, const N: usize>(robot: &RobotFile<K, N>) -> Vec<String> {
    let sensor = &robot.sensor;
    let mounted = format!(
        "{} mm from the tool centre point; low-pass {}, tare over {} samples",
        list(&sensor.lever_m, 1e3, 1),
        filter(&FilterKind::of(robot)),
        sensor.tare_samples
    );
    let weight_n = Vector3::from(sensor.tool.weight_n).norm();
    let tool = if weight_n > 0.0 {
        format!(
            "{weight_n:.2} N ({}), centre of gravity at {} mm",
            list(&sensor.tool.weight_n, 1.0, 2),
            list(&sensor.tool.centre_m, 1e3, 1)
        )
    } else {
        "without weight: it is part of the tare".to_owned()
    };
    let method = match robot.correction() {
        CorrectionKind::FirstOrder => "to first order",
        CorrectionKind::Exact => "exact",
    };
    let feed_forward = match robot.client.feed_forward {
        FeedForwardKey::None => "",
        FeedForwardKey::Inertia => ", feed-forward of inertia",
        FeedForwardKey::InertiaAndTorque => ", feed-forward of inertia and torque",
    };
    let client = format!(
        "gain {}, corrections {method}{feed_forward}",
        robot.client.gain
    );
    let mut lines = vec![line("sensor", &mounted)];
    if let Some(accelerometer) = &sensor.accelerometer {
        let text = format!(
            "{} mm from the tool centre point, {} axes; takes {} % of the tool's inertia out of the load",
            list(&accelerometer.place_m, 1e3, 1),
            accelerometer.axes,
            accelerometer.share * 1e2
        );
        lines.push(line("accelerometer", &text));
    }
    lines.extend([line("tool", &tool), line("client", &client)]);
    lines
}

fn drives<K, const N: usize>(robot: &RobotFile<K, N>) -> Vec<String> {
    let mut lines = Vec::new();
    if let Some(drives) = &robot.drives {
        let takes = if robot.position_loops.is_some() {
            "velocities, position loops in the server"
        } else {
            "positions"
        };
        let text = format!("{}, take {takes}", drives.profile.name());
        lines.push(line("drives", &text));
    }
    if let Some(bus) = &robot.ethercat {
        let text = format!("{} drives over EtherCAT", bus.drives.len());
        lines.push(line("bus", &text));
    }
    lines
}

/// Masses, and the damping of the modes.
fn masses<K, const N: usize>(robot: &RobotFile<K, N>) -> String {
    let Some(masses) = &robot.masses else {
        return line("masses", "none: nothing is known of motion and stability");
    };
    let text = format!(
        "platform {} kg, tool {:.2}, links {}, carts {}, motors {}; damping {} %",
        masses.platform.mass_kg,
        masses.tool.mass_kg,
        list(&masses.links_kg, 1.0, 1),
        list(&masses.carts_kg, 1.0, 1),
        list(&masses.motors_kg, 1.0, 1),
        masses.damping_ratio * 1e2
    );
    line("masses", &text)
}

/// The machine with its tool at home.
fn home<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
) -> Result<Vec<String>, RobotFileError> {
    let surveyor = Surveyor::new(robot);
    let home_m = robot.home_m();
    let reached = surveyor.survey(home_m).reached;
    let reached = reached.map_err(|error| robot.refuse("simulation.home_m", error))?;
    let mut axes_m = reached.q;
    for (place, scale) in axes_m.iter_mut().zip(robot.metres_per_q) {
        *place *= scale;
    }
    let mut lines = vec![
        line("home, m", &list(home_m.as_slice(), 1.0, 3)),
        line("  axes, m", &list(&axes_m, 1.0, 4)),
    ];
    for (name, direction) in [
        ("  reach in x, m", Vector3::x()),
        ("  reach in y, m", Vector3::y()),
        ("  reach in z, m", Vector3::z()),
    ] {
        let down_m = reach_m(&surveyor, &home_m, &-direction);
        let up_m = reach_m(&surveyor, &home_m, &direction);
        lines.push(line(name, &format!("-{down_m:.3} to +{up_m:.3}")));
    }
    let condition = format!("{:.2}", reached.condition);
    lines.push(line("  condition number", &condition));
    if let Some(m_per_n) = reached.compliance_m_per_n {
        let text = format!("{:.3} in the softest direction", m_per_n * 1e6);
        lines.push(line("  compliance, um/N", &text));
    }
    Ok(lines)
}

/// Distance that the tool can go from home, with the platform unturned, m.
fn reach_m<K: MachineKind<N>, const N: usize>(
    surveyor: &Surveyor<'_, K, N>,
    home_m: &Vector3<f64>,
    direction: &Vector3<f64>,
) -> f64 {
    let steps = (1..=MAX_REACH_STEPS)
        .take_while(|steps| {
            let place_m = home_m + direction * (f64::from(*steps) * REACH_STEP_M);
            surveyor.survey(place_m).reached.is_ok()
        })
        .last();
    f64::from(steps.unwrap_or(0)) * REACH_STEP_M
}
