//! Sheet of a plan: a page with pictures and steps to follow at the machine.

mod views;

use std::fmt::Write;

use nalgebra::{UnitQuaternion, Vector3};

use super::springs::{JUMP, Judgement, Predicted};
use super::{PlanError, geometry};
use crate::draw;
use crate::measurements::poses::PosesPlan;
use crate::measurements::springs::{NamedGauge, SeriesEntry, Setup};
use crate::model::MachineKind;
use crate::plots::page::{escape, page};
use crate::robot_file::RobotFile;
use crate::springs::gauge::{Body, Gauge};
use views::{Mark, views};

/// Style of the tables.
const STYLE: &str = "<style>table{border-collapse:collapse;margin:.6em 0}td,th{border:1px solid #ccc;padding:.25em .6em;text-align:left;\
vertical-align:top}td.box{width:5em}li{margin:.3em 0}h2{page-break-after:avoid}table{page-break-inside:avoid}</style>";
/// Direction to the viewer of the picture of the machine, rad.
const VIEW: (f64, f64) = (1.047, 0.524);
/// Length of the arrows of gauges and straps in the pictures, m.
const ARROW_M: f64 = 0.05;

/// The sheet of a plan of straps and gauges; `kind` is `springs` or `verify`.
pub(super) fn straps<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    setup: &Setup,
    judgement: &Judgement,
    kind: &str,
) -> Result<String, PlanError> {
    let mut body = head(robot, kind, &judgement.to_string())?;
    body.push_str("<h2>Hooks and gauges</h2><p>Places are from the tool centre point, in world axes. A gauge stands on a flat face of the \
        platform, its plunger along the arrow: the reading grows when the face comes along it.</p>");
    body.push_str(&picture(robot, setup));
    body.push_str(&gauges(&setup.gauges));
    body.push_str(&before(kind));
    let mut last = None;
    for (series, predicted) in setup.plan.iter().zip(&judgement.series) {
        if last != Some(&series.pose) {
            body.push_str(&pose(robot, setup, &series.pose)?);
            last = Some(&series.pose);
        }
        body.push_str(&steps(setup, series, predicted, kind));
    }
    let _ = write!(
        body,
        "<h2>Afterwards</h2><p>Write one row per level into <code>{}</code>. {}</p>",
        escape(&setup.measurements),
        COLUMNS
    );
    Ok(page(&format!("gantry-tau plan {kind}"), &body))
}

/// Meaning of the columns of a table of springs.
const COLUMNS: &str = "<code>stroke</code>: 0 for the first level, 1 while the force rises, -1 while it falls. <code>q</code>: encoders. \
Force and moment: on the platform, about the tool centre point where it is, world axes, tared. Readings: µm, an empty cell where a gauge was not read.";

fn head<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    kind: &str,
    summary: &str,
) -> Result<String, PlanError> {
    Ok(format!(
        "{STYLE}<h1>Plan of measurements: {kind}</h1><p>{}</p>{}<h2>What to expect</h2><pre>{}</pre>",
        escape(&robot.name),
        draw::picture(robot, VIEW.0, VIEW.1)?,
        escape(summary)
    ))
}

/// Platform, hooks and gauges in three views.
fn picture<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>, setup: &Setup) -> String {
    let joints = robot.model.geometry().platform_joints_m;
    let mut marks: Vec<Mark> = Vec::new();
    for gauge in &setup.gauges {
        if let Gauge::Face { point_m, axis, .. } = gauge.gauge {
            marks.push(Mark { name: gauge.name.to_string(), at_m: point_m, way_m: axis * ARROW_M, is_hook: false });
        }
    }
    for (index, hook) in hooks(setup).iter().enumerate() {
        marks.push(Mark { name: format!("hook {}", index + 1), at_m: *hook, way_m: Vector3::zeros(), is_hook: true });
    }
    views(&joints, &marks)
}

/// The hooks of a plan, each once.
fn hooks(setup: &Setup) -> Vec<Vector3<f64>> {
    let mut hooks: Vec<Vector3<f64>> = Vec::new();
    for hook in setup.plan.iter().map(|series| Vector3::from(series.hook_m)) {
        if !hooks.contains(&hook) {
            hooks.push(hook);
        }
    }
    hooks
}

fn gauges(gauges: &[NamedGauge]) -> String {
    let mut table = "<table><tr><th>gauge</th><th>where</th><th>plunger</th></tr>".to_owned();
    for NamedGauge { name, gauge } in gauges {
        let name = escape(name);
        let _ = match gauge {
            Gauge::Face { body, point_m, axis } => {
                let body = if *body == Body::Tool { "tool" } else { "platform" };
                let (at, way) = (mm(point_m), direction(axis));
                write!(table, "<tr><td>{name}</td><td>{body}, {at} mm</td><td>{way}</td></tr>")
            }
            Gauge::Axis { axis, .. } => {
                let what = if *axis < 3 { "cart against its rail" } else { "plate, where its screw takes hold" };
                write!(table, "<tr><td>{name}</td><td>axis {}: {what}</td><td>along +q</td></tr>", axis + 1)
            }
        };
    }
    table + "</table>"
}

fn before(kind: &str) -> String {
    let running = if kind == "verify" {
        "Each strap is measured twice without touching it: with compensation off (Submit), then on (Obtain)."
    } else {
        "Compensation may be on or off; the encoders' positions of each level go into the table."
    };
    format!(
        "<h2>Before</h2><ol><li>Switch on two hours before, so that temperatures settle.</li>\
         <li>Touch one gauge after the other: the reading grows along its arrow, by the right amount, in µm.</li>\
         <li>Pull by hand along +x, +y, +z: the force sensor shows the same sign.</li><li>{running}</li></ol>"
    )
}

fn pose<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    setup: &Setup,
    name: &str,
) -> Result<String, PlanError> {
    let place =
        setup.poses.iter().find(|(other, _)| other == name).map(|(_, pose)| pose.position_m).unwrap_or_default();
    let q = robot.model.axes_at(&place).map_err(|error| PlanError::NoCandidate {
        robot: robot.name.clone(),
        reason: format!("pose {name:?}: {error}"),
    })?;
    Ok(format!(
        "<h2>Pose {}</h2><p>Tool centre point at ({:.4}, {:.4}, {:.4}) m, platform unturned: q = {}. Move there without a strap, mount all \
         gauges in the middle of their range, wait until the readings stand still, and write down their names and places.</p>",
        escape(name),
        place.x,
        place.y,
        place.z,
        axes(&q)
    ))
}

fn axes(q: &[f64]) -> String {
    let numbers: Vec<String> = q.iter().map(|q| format!("{q:.4}")).collect();
    format!("({})", numbers.join(", "))
}

fn steps(setup: &Setup, series: &SeriesEntry, predicted: &Predicted, kind: &str) -> String {
    let hook = Vector3::from(series.hook_m);
    let number = hooks(setup).iter().position(|other| *other == hook).map_or(0, |index| index + 1);
    let mut text = format!("<h3>Series {}</h3><ol>", escape(&series.name));
    let way = direction(&series.direction.into());
    let _ = write!(
        text,
        "<li>Strap at hook {number}, {} mm from the tool centre point, pulling along {way}. Let it hang loose, and tare the sensor.</li>",
        mm(&hook)
    );
    if kind == "verify" {
        let state = if series.compensated { "on" } else { "off" };
        let _ = write!(text, "<li>Compensation <b>{state}</b>.</li>");
    }
    if series.name == *JUMP {
        text.push_str("<li>In this series the platform leaves cart 3, which can be felt. Approach every level from below while the force rises, \
            and from above while it falls.</li>");
    }
    text.push_str(
        "<li>Take the levels one after the other, without going beyond any: after each change wait 3 s and until force and gauges stand \
         still, then average over 2 s.</li>",
    );
    // With compensation the readings tell what the plan is to find out.
    if !series.compensated {
        let most = series.levels_n.iter().copied().fold(0.0, f64::max);
        let _ = write!(
            text,
            "<li>At {most} N the tool should have moved by {:.0} µm, and the largest reading have changed by {:.0} µm.</li>",
            predicted.displacement_m * 1e6,
            predicted.largest_m * 1e6
        );
    }
    text.push_str("</ol>");
    text.push_str("<table><tr><th>window</th>");
    for (window, _) in series.levels_n.iter().enumerate() {
        let _ = write!(text, "<td>{}</td>", window + 1);
    }
    text.push_str("</tr><tr><th>force, N</th>");
    for level in &series.levels_n {
        let _ = write!(text, "<td>{level}</td>");
    }
    text.push_str("</tr><tr><th>done</th>");
    text.push_str(&"<td>☐</td>".repeat(series.levels_n.len()));
    text.push_str("</tr></table>");
    text
}

fn mm(place_m: &Vector3<f64>) -> String {
    let rounded = place_m.map(|coordinate| (coordinate * 1e4).round() / 10.0 + 0.0);
    format!("({}, {}, {})", rounded.x, rounded.y, rounded.z)
}

/// A direction by its axis, where it is one.
fn direction(axis: &Vector3<f64>) -> String {
    let names = ["x", "y", "z"];
    let main = axis.iamax();
    if (axis[main].abs() - 1.0).abs() < 1e-9 {
        return format!("{}{}", if axis[main] > 0.0 { "+" } else { "-" }, names[main]);
    }
    format!("({:.4}, {:.4}, {:.4})", axis.x, axis.y, axis.z)
}

/// The sheet of a plan of poses.
pub(super) fn poses<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    plan: &PosesPlan,
    judgement: &geometry::Judgement,
) -> Result<String, PlanError> {
    let mut body = head(robot, "geometry", &judgement.to_string())?;
    // Thirty names would hide the places.
    let is_named = |index: usize| index == 0 || index + 1 == plan.poses.len();
    let marks: Vec<Mark> = (plan.poses.iter().enumerate())
        .map(|(index, pose)| Mark {
            name: if is_named(index) { pose.name.to_string() } else { String::new() },
            at_m: pose.position_m.into(),
            way_m: Vector3::zeros(),
            is_hook: true,
        })
        .collect();
    body.push_str(
        "<h2>Where to measure</h2><p>Places of the tool centre point in world axes, in the order of short ways.</p>",
    );
    body.push_str(&views(&[], &marks));
    let turned = if plan.rotation_urad.is_some() { " and its axes" } else { "" };
    let _ = write!(
        body,
        "<h2>Steps</h2><ol><li>Mount the target at the tool centre point; the device must see its centre{turned} from all poses. The device's \
         frame need not be the robot's.</li><li>Move to each pose, wait until it stands still, and measure without touching anything.</li>\
         <li>Write the <em>encoders'</em> positions, which need not be the planned ones to the last digit, and what the device says into \
         <code>{}</code>.</li><li>Measure the first pose again at the end: a difference beyond the noise is drift of device or \
         machine.</li></ol>",
        escape(&plan.measurements)
    );
    body.push_str("<table><tr><th>pose</th><th>place, m</th>");
    body.push_str(if plan.rotation_urad.is_some() { "<th>rotation vector, rad</th>" } else { "" });
    body.push_str("<th>q</th><th>done</th></tr>");
    for pose in &plan.poses {
        let [x, y, z] = pose.position_m;
        let _ = write!(body, "<tr><td>{}</td><td>({x:.3}, {y:.3}, {z:.3})</td>", escape(&pose.name));
        if plan.rotation_urad.is_some() {
            let turn = UnitQuaternion::from_matrix(&pose.pose().rotation).scaled_axis();
            let _ = write!(body, "<td>({:.2}, {:.2}, {:.2})</td>", turn.x, turn.y, turn.z);
        }
        let _ = write!(body, "<td>{}</td><td>☐</td></tr>", axes(&pose.q));
    }
    body.push_str("</table>");
    Ok(page("gantry-tau plan geometry", &body))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_have_tenths_of_a_millimetre_and_no_negative_zero() {
        assert_eq!(mm(&Vector3::new(-1e-6, 0.123_46, -0.08)), "(0, 123.5, -80)");
    }
}
