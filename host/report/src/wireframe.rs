//! Drawing of a machine: parallel projection, placement of the labels, SVG.

mod label;
mod view;

use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{RobotFile, RobotFileError};
use gantry_tau_machine::scene::Scene;
use nalgebra::Vector3;

use crate::svg::{Colour, Drawing, Point, Shape, Svg};
use label::{Label, labels};
use view::{Outlines, View};

/// Width of the picture, and its largest height, px.
const SIZE: (f64, f64) = (900.0, 620.0);
/// Space around the machine, px.
const MARGIN: f64 = 64.0;
/// Space for the title, px.
const TITLE: f64 = 44.0;
/// Font size of the labels, px.
const FONT: f64 = 15.0;
/// Colours of the arms' clusters.
const COLOURS: [Colour; 3] = [
    Colour::of(0xb3_47_1d),
    Colour::of(0x1f_6f_3a),
    Colour::of(0x1f_5f_a8),
];
const INK: Colour = Colour::of(0x33_33_33);
const PAPER: Colour = Colour::of(0xfb_fb_f9);
const RAIL: Colour = Colour::of(0x9a_9a_94);
/// Lines that explain.
const FAINT: Colour = Colour::of(0x77_77_77);
/// Length of the arrows of the world's axes, px.
const TRIAD: f64 = 40.0;

/// Returns the picture of a machine at home; angles in rad.
///
/// # Errors
/// [`RobotFileError`] if home cannot be reached.
pub fn picture<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    azimuth: f64,
    elevation: f64,
) -> Result<Svg, RobotFileError> {
    Ok(drawing(&Scene::at_home(robot)?, azimuth, elevation))
}

fn colour(arm: usize) -> Colour {
    COLOURS.get(arm).copied().unwrap_or(INK)
}

/// The whole picture.
fn drawing(scene: &Scene, azimuth: f64, elevation: f64) -> Svg {
    let view = View::of(scene, azimuth, elevation);
    let outlines = Outlines::of(scene, &view);
    let mut drawing = Drawing::new(SIZE.0, view.height);
    let paper = [Point::zeros(), Point::new(SIZE.0, view.height)];
    drawing.add(Shape::rectangle(paper).fill(PAPER).with("rx", 10));
    let heading = format!(
        "Gantry-Tau, {} axes: carts on guideways hold the platform by clusters of 1, 2 and 3 links",
        scene.axes
    );
    let heading = Shape::text(Point::new(24.0, 32.0), &heading).fill(INK);
    drawing.add(heading.with("font-size", 17));
    draw_guideways(&mut drawing, scene, &view);
    draw_carts(&mut drawing, scene, &view, &outlines);
    drawing.add(outline(&outlines.platform, INK, 0.14));
    draw_links(&mut drawing, scene, &view);
    draw_triad(&mut drawing, &view);
    for label in labels(scene, &view, &outlines) {
        draw_label(&mut drawing, &label);
    }
    let title = format!("A Gantry-Tau robot with {} axes", scene.axes);
    drawing.finish(&title, "")
}

fn draw_guideways(drawing: &mut Drawing, scene: &Scene, view: &View) {
    for arm in &scene.arms {
        let [from, to] = view.ends(&arm.rail_m);
        let rail = Shape::line([from, to]).stroke(RAIL, 5.0);
        drawing.add(rail.with("stroke-linecap", "round"));
        for ((end, other), goes_on) in [(from, to), (to, from)].into_iter().zip(arm.goes_on) {
            if goes_on {
                let beyond = end + (end - other).normalize() * 26.0;
                let rest = Shape::line([end, beyond]).stroke(RAIL, 5.0);
                drawing.add(rest.with("stroke-dasharray", "4 6"));
            }
        }
    }
}

/// Carts by their outlines and the three edges at the corner that is nearest to the viewer.
fn draw_carts(drawing: &mut Drawing, scene: &Scene, view: &View, outlines: &Outlines) {
    for ((arm, corners), colour) in scene.arms.iter().zip(&outlines.carts).zip(COLOURS) {
        drawing.add(outline(corners, colour, 0.16));
        let seen = arm
            .half_edges_m
            .map(|edge| edge.dot(&view.towards).signum());
        let edges = arm.half_edges_m.iter().zip(seen);
        let nearest: Vector3<f64> =
            arm.centre_m + edges.map(|(edge, sign)| edge * sign).sum::<Vector3<f64>>();
        for (edge, sign) in arm.half_edges_m.iter().zip(seen) {
            let ends = view.ends(&[nearest, nearest - edge * (2.0 * sign)]);
            drawing.add(Shape::line(ends).stroke(colour, 1.0));
        }
    }
}

/// Links with their joints, and the tool centre point.
fn draw_links(drawing: &mut Drawing, scene: &Scene, view: &View) {
    let tool = view.point(&scene.tool_m);
    for link in &scene.links {
        let [cart, platform] = view.ends(&link.ends_m);
        let colour = colour(link.arm);
        drawing.add(Shape::line([platform, tool]).stroke(FAINT, 0.8));
        drawing.add(Shape::line([cart, platform]).stroke(colour, 2.5));
        for joint in [cart, platform] {
            drawing.add(ring(joint, 4.0, colour));
        }
    }
    drawing.add(ring(tool, 6.0, Colour::ALERT));
    drawing.add(Shape::circle(tool, 2.0).fill(Colour::ALERT));
}

/// The directions of the world's axes, in the lower left corner.
fn draw_triad(drawing: &mut Drawing, view: &View) {
    let origin = Point::new(66.0, view.height - 62.0);
    let axes = [
        (Vector3::x(), "x"),
        (Vector3::y(), "y"),
        (Vector3::z(), "z"),
    ];
    for (axis, name) in axes {
        let way = view.direction(&axis);
        // An axis that points at the viewer has no length to be named at.
        if way.norm() > 0.15 {
            let end = origin + way * TRIAD;
            drawing.add(Shape::line([origin, end]).stroke(INK, 1.5));
            drawing.add(word(end + way.normalize() * 11.0, INK, name));
        }
    }
}

/// A label, with a line to what it names if that is far away.
fn draw_label(drawing: &mut Drawing, label: &Label) {
    if (label.centre - label.anchor).norm() > 34.0 + label.half().x {
        let ends = [label.anchor, label.centre];
        drawing.add(Shape::line(ends).stroke(Colour::of(0x99_99_99), 0.8));
    }
    drawing.add(word(label.centre, label.colour, &label.text));
}

fn outline(corners: &[Point], colour: Colour, opacity: f64) -> Shape {
    Shape::polygon(corners)
        .fill(colour)
        .with("fill-opacity", opacity)
        .stroke(colour, 1.2)
        .with("stroke-linejoin", "round")
}

fn ring(at: Point, radius: f64, colour: Colour) -> Shape {
    Shape::circle(at, radius)
        .fill(Colour::WHITE)
        .stroke(colour, 1.8)
}

/// Text around a point, with a rim that keeps it readable on lines.
fn word(at: Point, colour: Colour, text: &str) -> Shape {
    Shape::text(at + Point::new(0.0, 0.36 * FONT), text)
        .with("font-size", FONT)
        .with("text-anchor", "middle")
        .fill(colour)
        .stroke(PAPER, 6.0)
        .with("stroke-linejoin", "round")
        .with("paint-order", "stroke")
}

#[cfg(test)]
mod tests {
    use super::*;
    use gantry_tau_machine::robot_file::AnyRobotFile;
    use gantry_tau_machine::robot_file::AnyRobotFile::{F1, L2};

    /// The link vectors of the scene have the lengths of the robot file, and every label is apart
    /// from every other.
    #[test]
    fn links_have_their_lengths_and_labels_stand_apart() {
        for name in ["l2", "f1"] {
            let (scene, geometry) = match AnyRobotFile::named(name).unwrap() {
                L2(robot) => (Scene::at_home(&robot), robot.model.geometry()),
                F1(robot) => (Scene::at_home(&robot), robot.model.geometry()),
            };
            let scene = scene.unwrap();
            assert_eq!(scene.links.len(), 6);
            for (link, length) in scene.links.iter().zip(geometry.lengths_m) {
                let [cart, platform] = link.ends_m;
                let error = (cart - platform).norm() - length;
                assert!(error.abs() < 1e-9, "{name} {}", link.name);
            }
            for azimuth in [20.0_f64, 60.0, 110.0] {
                let view = View::of(&scene, azimuth.to_radians(), 0.4);
                let labels = labels(&scene, &view, &Outlines::of(&scene, &view));
                // 3 guideways, 3 carts, 6 links, platform, tool.
                assert_eq!(labels.len(), 14);
                for (index, label) in labels.iter().enumerate() {
                    for other in labels.iter().skip(index + 1) {
                        assert!(!label.overlaps(other), "{name}: {label:?} {other:?}");
                    }
                }
            }
        }
    }
}
