//! Drawing of a scene: parallel projection, placement of the labels, SVG.

use std::fmt::Write;

use nalgebra::{Vector2, Vector3};

use super::scene::{Arm, Scene};

/// A point of the picture, px, y downwards.
type Point = Vector2<f64>;

/// Width of the picture, and its largest height, px.
const SIZE: (f64, f64) = (900.0, 620.0);
/// Space around the machine, px.
const MARGIN: f64 = 64.0;
/// Space for the title, px.
const TITLE: f64 = 44.0;
/// Font size of the labels, px.
const FONT: f64 = 15.0;
/// Width of a character as a share of the font size, in the widest common font.
const CHARACTER: f64 = 0.66;
/// Colours of the arms' clusters.
const COLOURS: [&str; 3] = ["#b3471d", "#1f6f3a", "#1f5fa8"];
const INK: &str = "#333";
/// Costs that differ by less are equal, so that rounding does not choose between them.
const TIE: f64 = 1e-6;
/// Length of the arrows of the world's axes, px.
const TRIAD: f64 = 40.0;

/// Parallel projection: directions of the paper in the world, and a scale.
struct View {
    right: Vector3<f64>,
    down: Vector3<f64>,
    towards: Vector3<f64>,
    scale: f64,
    origin: Point,
    height: f64,
}

impl View {
    /// A view in which the whole scene fits.
    fn of(scene: &Scene, azimuth: f64, elevation: f64) -> Self {
        let (sin_a, cos_a) = azimuth.sin_cos();
        let (sin_e, cos_e) = elevation.sin_cos();
        let mut view = Self {
            right: Vector3::new(-sin_a, cos_a, 0.0),
            down: Vector3::new(sin_e * cos_a, sin_e * sin_a, -cos_e),
            towards: Vector3::new(cos_e * cos_a, cos_e * sin_a, sin_e),
            scale: 1.0,
            origin: Point::zeros(),
            height: SIZE.1,
        };
        let mut points: Vec<Point> = Vec::new();
        for arm in &scene.arms {
            points.extend(arm.rail_m.iter().map(|end| view.point(end)));
            points.extend(corners(arm).iter().map(|corner| view.point(corner)));
        }
        let ends = scene.links.iter().flat_map(|link| &link.ends_m);
        points.extend(ends.map(|end| view.point(end)));
        let low = points.iter().fold(Point::repeat(f64::MAX), |low, p| low.inf(p));
        let high = points.iter().fold(Point::repeat(f64::MIN), |high, p| high.sup(p));
        let room = (SIZE.0 - 2.0 * MARGIN, SIZE.1 - 2.0 * MARGIN - TITLE);
        let span = (high - low).add_scalar(1e-9);
        view.scale = (room.0 / span.x).min(room.1 / span.y);
        view.height = (span.y * view.scale + 2.0 * MARGIN + TITLE).round();
        let middle = Point::new(SIZE.0 / 2.0, (view.height + TITLE) / 2.0);
        view.origin = middle - (low + high) / 2.0 * view.scale;
        view
    }

    fn direction(&self, world: &Vector3<f64>) -> Point {
        Point::new(self.right.dot(world), self.down.dot(world))
    }

    fn point(&self, place_m: &Vector3<f64>) -> Point {
        self.origin + self.direction(place_m) * self.scale
    }

    fn ends(&self, places_m: &[Vector3<f64>; 2]) -> [Point; 2] {
        places_m.each_ref().map(|place| self.point(place))
    }
}

/// A word and its place.
#[derive(Debug)]
pub(super) struct Label {
    text: String,
    colour: &'static str,
    /// The point that it names.
    anchor: Point,
    centre: Point,
}

impl Label {
    fn new(text: impl Into<String>, colour: &'static str, anchor: Point) -> Self {
        let text = text.into();
        let centre = anchor;
        Self { text, colour, anchor, centre }
    }

    /// Half of width and height.
    fn half(&self) -> Point {
        Point::new(self.text.chars().count() as f64 * CHARACTER * FONT / 2.0, 0.6 * FONT)
    }

    /// True if the boxes of two labels have a point in common.
    pub(super) fn overlaps(&self, other: &Self) -> bool {
        let apart = (self.centre - other.centre).abs();
        let reach = self.half() + other.half();
        apart.x < reach.x && apart.y < reach.y
    }

    /// Number of px of a line that the box hides.
    fn hides(&self, [from, to]: &[Point; 2]) -> f64 {
        const SAMPLES: u32 = 100;
        let half = self.half();
        let inside = |share: &f64| {
            let away = (from + (to - from) * *share - self.centre).abs();
            away.x < half.x && away.y < half.y
        };
        let shares = (0..=SAMPLES).map(|step| f64::from(step) / f64::from(SAMPLES));
        (to - from).norm() * shares.filter(inside).count() as f64 / f64::from(SAMPLES)
    }

    /// Moves to the candidate of least cost: what the label costs there, and a cost of the candidate itself. Of equals the first counts.
    fn settle(&mut self, candidates: impl IntoIterator<Item = (Point, f64)>, cost: impl Fn(&Self) -> f64) {
        let mut best = (f64::MAX, self.anchor);
        for (centre, own) in candidates {
            self.centre = centre;
            let cost = cost(self) + own;
            if cost < best.0 - TIE {
                best = (cost, centre);
            }
        }
        self.centre = best.1;
    }

    /// 1 if the label overlaps another, else 0.
    fn overlap(&self, placed: &[Self]) -> f64 {
        f64::from(u8::from(placed.iter().any(|other| self.overlaps(other))))
    }

    /// Moves along the line that the label names, to the place that hides least of the other lines.
    fn place_on(&mut self, own: &[Point; 2], placed: &[Self], lines: &[[Point; 2]]) {
        let [from, to] = own;
        let candidates = (0..=20_u32).map(|step| {
            let share = 0.3 + 0.02 * f64::from(step);
            (from + (to - from) * share, 10.0 * (share - 0.5).abs())
        });
        self.settle(candidates, |label| {
            let others = lines.iter().filter(|line| *line != own);
            1e4 * label.overlap(placed) + others.map(|line| label.hides(line)).sum::<f64>()
        });
        self.anchor = self.centre;
    }

    /// Moves to the place near the anchor that hides least: far places, lines, other labels and the picture's edge cost.
    fn place(&mut self, placed: &[Self], lines: &[[Point; 2]], height: f64) {
        let (anchor, half) = (self.anchor, self.half());
        let around = |radius: f64| {
            (0..16_u32).map(move |step| {
                let angle = f64::from(step) * std::f64::consts::FRAC_PI_8;
                let direction = Point::new(angle.cos(), angle.sin());
                (anchor + direction * radius + half.component_mul(&direction), radius)
            })
        };
        self.settle([9.0, 16.0, 26.0, 40.0, 58.0].into_iter().flat_map(around), |label| {
            let (top_left, bottom_right) = (label.centre - half, label.centre + half);
            let outside = top_left.min() < 4.0 || bottom_right.x > SIZE.0 - 4.0 || bottom_right.y > height - 4.0;
            let hidden: f64 = lines.iter().map(|line| label.hides(line)).sum();
            1e4 * (f64::from(u8::from(outside)) + label.overlap(placed)) + 3.0 * hidden
        });
    }
}

/// Corners of a cart's box.
fn corners(arm: &Arm) -> Vec<Vector3<f64>> {
    let corner = |number: u32| {
        let signs = [4, 2, 1].map(|bit| if number & bit == 0 { -1.0 } else { 1.0 });
        let away: Vector3<f64> = arm.half_edges_m.iter().zip(signs).map(|(edge, sign)| edge * sign).sum();
        arm.centre_m + away
    };
    (0..8).map(corner).collect()
}

/// The convex hull, in order (Andrew's monotone chain).
fn hull(mut points: Vec<Point>) -> Vec<Point> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let mut hull = chain(points.iter());
    hull.extend(chain(points.iter().rev()));
    hull
}

/// One side of the hull, without its last point.
fn chain<'a>(points: impl Iterator<Item = &'a Point>) -> Vec<Point> {
    let mut side: Vec<Point> = Vec::new();
    for point in points {
        while let [.., before, last] = side.as_slice() {
            if (last - before).perp(&(point - before)) > 0.0 {
                break;
            }
            side.pop();
        }
        side.push(*point);
    }
    side.pop();
    side
}

/// The labels of a scene in their places.
#[cfg(test)]
pub(super) fn labels(scene: &Scene, azimuth: f64, elevation: f64) -> Vec<Label> {
    let view = View::of(scene, azimuth, elevation);
    let shapes = Shapes::of(scene, &view);
    labels_between(scene, &view, &shapes)
}

fn labels_between(scene: &Scene, view: &View, shapes: &Shapes) -> Vec<Label> {
    let tool = view.point(&scene.tool_m);
    let mut placed: Vec<Label> = Vec::new();
    for link in &scene.links {
        let own = view.ends(&link.ends_m);
        let mut label = Label::new(link.name, colour(link.arm), own[0]);
        label.place_on(&own, &placed, &shapes.lines);
        placed.push(label);
    }
    let mut labels = Vec::new();
    labels.push(Label::new("tool", INK, tool));
    for (index, arm) in scene.arms.iter().enumerate() {
        let text = format!("cart {}", arm.number);
        labels.push(Label::new(text, colour(index), view.point(&arm.centre_m)));
        // Named at the end that is farther from the tool.
        let [one, other] = view.ends(&arm.rail_m);
        let is_one = (one - tool).norm() > (other - tool).norm();
        let end = if is_one { one } else { other };
        let place = end + (view.point(&arm.centre_m) - end) * 0.15;
        labels.push(Label::new(format!("guideway {}", arm.number), INK, place));
    }
    let middle = shapes.platform.iter().sum::<Point>();
    let farthest = shapes.platform.iter().max_by(|a, b| a.y.total_cmp(&b.y));
    let place = farthest.copied().unwrap_or(middle);
    labels.push(Label::new("platform", INK, place));
    for mut label in labels {
        label.place(&placed, &shapes.lines, view.height);
        placed.push(label);
    }
    placed
}

/// Outlines on the paper.
struct Shapes {
    platform: Vec<Point>,
    carts: Vec<Vec<Point>>,
    /// Every line that a label should not hide.
    lines: Vec<[Point; 2]>,
}

impl Shapes {
    fn of(scene: &Scene, view: &View) -> Self {
        let platform = scene.links.iter().map(|link| link.ends_m[1]);
        let mut joints: Vec<Point> = platform.map(|joint| view.point(&joint)).collect();
        joints.push(view.point(&scene.tool_m));
        let platform = hull(joints);
        let carts: Vec<Vec<Point>> =
            (scene.arms.iter()).map(|arm| hull(corners(arm).iter().map(|c| view.point(c)).collect())).collect();
        let links = scene.links.iter().map(|link| link.ends_m);
        let lines = links.chain(scene.arms.iter().map(|arm| arm.rail_m));
        let mut lines: Vec<[Point; 2]> = lines.map(|ends| view.ends(&ends)).collect();
        for outline in carts.iter().chain([&platform]) {
            let next = outline.iter().cycle().skip(1);
            lines.extend(outline.iter().zip(next).map(|(from, to)| [*from, *to]));
            // The inside of an outline: lines to its middle.
            let middle = outline.iter().sum::<Point>() / outline.len() as f64;
            lines.extend(outline.iter().map(|corner| [*corner, middle]));
        }
        Self { platform, carts, lines }
    }
}

fn colour(arm: usize) -> &'static str {
    COLOURS.get(arm).copied().unwrap_or(INK)
}

/// The whole picture.
pub(super) fn picture(scene: &Scene, azimuth: f64, elevation: f64) -> String {
    let view = View::of(scene, azimuth, elevation);
    let shapes = Shapes::of(scene, &view);
    let (width, height) = (SIZE.0, view.height);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"{FONT}\">\n\
         <title>A Gantry-Tau robot with {} axes</title>\n\
         <rect width=\"{width}\" height=\"{height}\" rx=\"10\" fill=\"#fbfbf9\"/>\n\
         <text x=\"24\" y=\"32\" font-size=\"17\" fill=\"{INK}\">Gantry-Tau, {} axes: carts on guideways hold the platform by \
         clusters of 1, 2 and 3 links</text>\n",
        scene.axes, scene.axes
    );
    for arm in &scene.arms {
        let [from, to] = view.ends(&arm.rail_m);
        let style = "stroke-width=\"5\" stroke-linecap=\"round\"";
        line(&mut svg, [from, to], "#9a9a94", style);
        for ((end, other), goes_on) in [(from, to), (to, from)].into_iter().zip(arm.goes_on) {
            if goes_on {
                let beyond = end + (end - other).normalize() * 26.0;
                let style = "stroke-width=\"5\" stroke-dasharray=\"4 6\"";
                line(&mut svg, [end, beyond], "#9a9a94", style);
            }
        }
    }
    for ((arm, outline), colour) in scene.arms.iter().zip(&shapes.carts).zip(COLOURS) {
        polygon(&mut svg, outline, colour, 0.16);
        let seen = arm.half_edges_m.map(|edge| edge.dot(&view.towards).signum());
        let edges = arm.half_edges_m.iter().zip(seen);
        let nearest: Vector3<f64> = arm.centre_m + edges.map(|(edge, sign)| edge * sign).sum::<Vector3<f64>>();
        for (edge, sign) in arm.half_edges_m.iter().zip(seen) {
            let ends = view.ends(&[nearest, nearest - edge * (2.0 * sign)]);
            line(&mut svg, ends, colour, "stroke-width=\"1\"");
        }
    }
    polygon(&mut svg, &shapes.platform, INK, 0.14);
    let tool = view.point(&scene.tool_m);
    for link in &scene.links {
        let [cart, platform] = view.ends(&link.ends_m);
        let colour = colour(link.arm);
        line(&mut svg, [platform, tool], "#777", "stroke-width=\"0.8\"");
        line(&mut svg, [cart, platform], colour, "stroke-width=\"2.5\"");
        for joint in [cart, platform] {
            circle(&mut svg, joint, 4.0, colour, "#fff");
        }
    }
    circle(&mut svg, tool, 6.0, "#c00", "#fff");
    circle(&mut svg, tool, 2.0, "#c00", "#c00");
    triad(&mut svg, &view);
    for label in labels_between(scene, &view, &shapes) {
        if (label.centre - label.anchor).norm() > 34.0 + label.half().x {
            let ends = [label.anchor, label.centre];
            line(&mut svg, ends, "#999", "stroke-width=\"0.8\"");
        }
        text(&mut svg, label.centre, label.colour, &label.text);
    }
    svg + "</svg>\n"
}

/// The directions of the world's axes, in the lower left corner.
fn triad(svg: &mut String, view: &View) {
    let origin = Point::new(66.0, view.height - 62.0);
    let axes = [(Vector3::x(), "x"), (Vector3::y(), "y"), (Vector3::z(), "z")];
    for (axis, name) in axes {
        let way = view.direction(&axis);
        // An axis that points at the viewer has no length to be named at.
        if way.norm() > 0.15 {
            line(svg, [origin, origin + way * TRIAD], INK, "stroke-width=\"1.5\"");
            text(svg, origin + way * TRIAD + way.normalize() * 11.0, INK, name);
        }
    }
}

/// A coordinate, to a tenth of a px, without a sign on zero.
fn px(value: f64) -> f64 {
    (value * 10.0).round() / 10.0 + 0.0
}

fn line(svg: &mut String, [from, to]: [Point; 2], colour: &str, style: &str) {
    let [x1, y1, x2, y2] = [from.x, from.y, to.x, to.y].map(px);
    // Writing to a `String` does not fail.
    let _ = writeln!(svg, "<line x1=\"{x1}\" y1=\"{y1}\" x2=\"{x2}\" y2=\"{y2}\" stroke=\"{colour}\" {style}/>");
}

fn polygon(svg: &mut String, corners: &[Point], colour: &str, opacity: f64) {
    let corner = |point: &Point| format!("{},{}", px(point.x), px(point.y));
    let points: Vec<String> = corners.iter().map(corner).collect();
    let _ = writeln!(
        svg,
        "<polygon points=\"{}\" fill=\"{colour}\" fill-opacity=\"{opacity}\" stroke=\"{colour}\" stroke-width=\"1.2\" stroke-linejoin=\"round\"/>",
        points.join(" ")
    );
}

fn circle(svg: &mut String, at: Point, radius: f64, colour: &str, fill: &str) {
    let (x, y) = (px(at.x), px(at.y));
    let _ = writeln!(
        svg,
        "<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\" fill=\"{fill}\" stroke=\"{colour}\" stroke-width=\"1.8\"/>"
    );
}

/// Text around a point, with a rim that keeps it readable on lines.
fn text(svg: &mut String, at: Point, colour: &str, text: &str) {
    let (x, y) = (px(at.x), px(at.y + 0.36 * FONT));
    let _ = writeln!(
        svg,
        "<text x=\"{x}\" y=\"{y}\" text-anchor=\"middle\" fill=\"{colour}\" stroke=\"#fbfbf9\" stroke-width=\"6\" \
         stroke-linejoin=\"round\" paint-order=\"stroke\">{text}</text>"
    );
}
