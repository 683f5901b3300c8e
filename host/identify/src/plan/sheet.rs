//! Sheet of a plan: a page with pictures and steps to follow at the machine.

mod views;

use gantry_tau_machine::elastic::gauge::{Body, Gauge};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_report::page::{Cell, Page, Table, Text};
use gantry_tau_report::svg::Svg;
use gantry_tau_report::wireframe;
use nalgebra::{UnitQuaternion, Vector3};

use super::springs::{JUMP, Judgement, Predicted};
use super::{PlanError, geometry};
use crate::measurements::poses::PosesPlan;
use crate::measurements::springs::{NamedGauge, SeriesEntry, Setup};
use views::{Mark, views};

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
    let mut page = begin(robot, kind, &judgement.to_string())?;
    page.section("Hooks and gauges");
    page.paragraph(
        "Places are from the tool centre point, in world axes. A gauge stands on a flat face of the \
         platform, its plunger along the arrow: the reading grows when the face comes along it.",
    );
    page.picture(&picture(robot, setup));
    page.table(gauges(&setup.gauges));
    add_preparations(&mut page, kind);
    let mut last = None;
    for (series, predicted) in setup.plan.iter().zip(&judgement.series) {
        if last != Some(&series.pose) {
            add_pose(&mut page, robot, setup, &series.pose)?;
            last = Some(&series.pose);
        }
        page.together(|page| add_series(page, setup, series, predicted, kind));
    }
    page.section("Afterwards");
    page.paragraph(columns(&setup.measurements));
    Ok(page.html())
}

/// Meaning of the columns of a table of springs.
fn columns(table: &str) -> Text {
    Text::from("Write one row per level into ")
        .and(Text::code(table))
        .and(". ")
        .and(Text::code("stroke"))
        .and(": 0 for the first level, 1 while the force rises, -1 while it falls. ")
        .and(Text::code("q"))
        .and(
            ": encoders. Force and moment: on the platform, about the tool centre point where it is, world axes, tared. \
             Readings: µm, an empty cell where a gauge was not read.",
        )
}

fn begin<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    kind: &str,
    summary: &str,
) -> Result<Page, PlanError> {
    let mut page = Page::new(
        &format!("gantry-tau plan {kind}"),
        format!("Plan of measurements: {kind}"),
    );
    page.paragraph(&robot.name);
    page.picture(&wireframe::picture(robot, VIEW.0, VIEW.1)?);
    page.section("What to expect");
    page.preformatted(summary);
    Ok(page)
}

/// Platform, hooks and gauges in three views.
fn picture<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>, setup: &Setup) -> Svg {
    let joints = robot.model.geometry().platform_joints_m;
    let mut marks: Vec<Mark> = Vec::new();
    for gauge in &setup.gauges {
        if let Gauge::Face { point_m, axis, .. } = gauge.gauge {
            marks.push(Mark {
                name: gauge.name.to_string(),
                at_m: point_m,
                way_m: axis * ARROW_M,
                is_hook: false,
            });
        }
    }
    for (index, hook) in hooks(setup).iter().enumerate() {
        marks.push(Mark {
            name: format!("hook {}", index + 1),
            at_m: *hook,
            way_m: Vector3::zeros(),
            is_hook: true,
        });
    }
    views("Hooks and gauges", &joints, &marks)
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

fn gauges(gauges: &[NamedGauge]) -> Table {
    let mut table = Table::new(["gauge", "where", "plunger"]).framed();
    for NamedGauge { name, gauge } in gauges {
        let [place, way] = match gauge {
            Gauge::Face {
                body,
                point_m,
                axis,
            } => {
                let body = if *body == Body::Tool {
                    "tool"
                } else {
                    "platform"
                };
                [format!("{body}, {} mm", mm(point_m)), direction(axis)]
            }
            Gauge::Axis { axis, .. } => {
                let what = if *axis < 3 {
                    "cart against its rail"
                } else {
                    "plate, where its screw takes hold"
                };
                [format!("axis {}: {what}", axis + 1), "along +q".to_owned()]
            }
        };
        table.row([name.to_string(), place, way]);
    }
    table
}

fn add_preparations(page: &mut Page, kind: &str) {
    let running = if kind == "verify" {
        "Each strap is measured twice without touching it: with compensation off (Submit), then on (Obtain)."
    } else {
        "Compensation may be on or off; the encoders' positions of each level go into the table."
    };
    page.section("Before");
    page.steps([
        "Switch on two hours before, so that temperatures settle.",
        "Touch one gauge after the other: the reading grows along its arrow, by the right amount, in µm.",
        "Pull by hand along +x, +y, +z: the force sensor shows the same sign.",
        running,
    ]);
}

fn add_pose<K: MachineKind<N>, const N: usize>(
    page: &mut Page,
    robot: &RobotFile<K, N>,
    setup: &Setup,
    name: &str,
) -> Result<(), PlanError> {
    let place = setup
        .poses
        .iter()
        .find(|(other, _)| other == name)
        .map(|(_, pose)| pose.position_m)
        .unwrap_or_default();
    let q = robot
        .model
        .axes_at(&place)
        .map_err(|error| PlanError::NoCandidate {
            robot: robot.name.clone(),
            reason: format!("pose {name:?}: {error}"),
        })?;
    page.section(format!("Pose {name}"));
    page.paragraph(format!(
        "Tool centre point at ({:.4}, {:.4}, {:.4}) m, platform unturned: q = {}. Move there without a strap, mount all \
         gauges in the middle of their range, wait until the readings stand still, and write down their names and places.",
        place.x,
        place.y,
        place.z,
        axes(&q)
    ));
    Ok(())
}

fn axes(q: &[f64]) -> String {
    let numbers: Vec<String> = q.iter().map(|q| format!("{q:.4}")).collect();
    format!("({})", numbers.join(", "))
}

/// Adds a series: its steps, and a form for its levels.
fn add_series(
    page: &mut Page,
    setup: &Setup,
    series: &SeriesEntry,
    predicted: &Predicted,
    kind: &str,
) {
    page.subsection(format!("Series {}", &*series.name));
    page.steps(steps(setup, series, predicted, kind));
    let windows = (1..=series.levels_n.len()).map(|window| window.to_string());
    let mut form = Table::unnamed().framed();
    form.named_row("window", windows);
    form.named_row("force, N", series.levels_n.iter().map(f64::to_string));
    form.named_row("done", series.levels_n.iter().map(|_| Cell::tick_box()));
    page.table(form);
}

fn steps(setup: &Setup, series: &SeriesEntry, predicted: &Predicted, kind: &str) -> Vec<Text> {
    let hook = Vector3::from(series.hook_m);
    let number = hooks(setup)
        .iter()
        .position(|other| *other == hook)
        .map_or(0, |index| index + 1);
    let way = direction(&series.direction.into());
    let mut steps: Vec<Text> = vec![
        format!(
            "Strap at hook {number}, {} mm from the tool centre point, pulling along {way}. Let it hang loose, and tare the sensor.",
            mm(&hook)
        )
        .into(),
    ];
    if kind == "verify" {
        let state = if series.compensated { "on" } else { "off" };
        let state = Text::from("Compensation ").and(Text::strong(state));
        steps.push(state.and("."));
    }
    if series.name == *JUMP {
        steps.push(
            "In this series the platform leaves cart 3, which can be felt. Approach every level from below while the force rises, \
             and from above while it falls."
                .into(),
        );
    }
    steps.push(
        "Take the levels one after the other, without going beyond any: after each change wait 3 s and until force and gauges stand \
         still, then average over 2 s."
            .into(),
    );
    // With compensation the readings tell what the plan is to find out.
    if !series.compensated {
        let most = series.levels_n.iter().copied().fold(0.0, f64::max);
        steps.push(
            format!(
                "At {most} N the tool should have moved by {:.0} µm, and the largest reading have changed by {:.0} µm.",
                predicted.displacement_m * 1e6,
                predicted.largest_m * 1e6
            )
            .into(),
        );
    }
    steps
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
        return format!(
            "{}{}",
            if axis[main] > 0.0 { "+" } else { "-" },
            names[main]
        );
    }
    format!("({:.4}, {:.4}, {:.4})", axis.x, axis.y, axis.z)
}

/// The sheet of a plan of poses.
pub(super) fn poses<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    plan: &PosesPlan,
    judgement: &geometry::Judgement,
) -> Result<String, PlanError> {
    let mut page = begin(robot, "geometry", &judgement.to_string())?;
    page.section("Where to measure");
    page.paragraph("Places of the tool centre point in world axes, in the order of short ways.");
    page.picture(&places(plan));
    page.section("Steps");
    let is_turned = plan.rotation_urad.is_some();
    let turned = if is_turned { " and its axes" } else { "" };
    page.steps([
        Text::from(format!(
            "Mount the target at the tool centre point; the device must see its centre{turned} from all poses. The device's \
             frame need not be the robot's."
        )),
        "Move to each pose, wait until it stands still, and measure without touching anything.".into(),
        Text::from("Write the ")
            .and(Text::emphasis("encoders'"))
            .and(" positions, which need not be the planned ones to the last digit, and what the device says into ")
            .and(Text::code(&plan.measurements))
            .and("."),
        "Measure the first pose again at the end: a difference beyond the noise is drift of device or machine.".into(),
    ]);
    page.table(form(plan));
    Ok(page.html())
}

fn places(plan: &PosesPlan) -> Svg {
    let last = plan.poses.len().saturating_sub(1);
    let marks = plan.poses.iter().enumerate().map(|(index, pose)| Mark {
        // Thirty names would hide the places.
        name: if index == 0 || index == last {
            pose.name.to_string()
        } else {
            String::new()
        },
        at_m: pose.position_m.into(),
        way_m: Vector3::zeros(),
        is_hook: true,
    });
    views("Where to measure", &[], &marks.collect::<Vec<_>>())
}

/// A form with all poses.
fn form(plan: &PosesPlan) -> Table {
    let is_turned = plan.rotation_urad.is_some();
    let mut columns = vec!["pose", "place, m", "rotation vector, rad", "q", "done"];
    columns.retain(|column| is_turned || *column != "rotation vector, rad");
    let mut table = Table::new(columns).framed();
    for pose in &plan.poses {
        let [x, y, z] = pose.position_m;
        let mut cells: Vec<Cell> = vec![
            pose.name.to_string().into(),
            format!("({x:.3}, {y:.3}, {z:.3})").into(),
        ];
        if is_turned {
            let turn = UnitQuaternion::from_matrix(&pose.pose().rotation).scaled_axis();
            cells.push(format!("({:.2}, {:.2}, {:.2})", turn.x, turn.y, turn.z).into());
        }
        cells.extend([axes(&pose.q).into(), Cell::tick_box()]);
        table.row(cells);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_have_tenths_of_a_millimetre_and_no_negative_zero() {
        assert_eq!(mm(&Vector3::new(-1e-6, 0.123_46, -0.08)), "(0, 123.5, -80)");
    }
}
