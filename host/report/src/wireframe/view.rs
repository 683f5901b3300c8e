//! Parallel projection of a scene, and the outlines that it has on the paper.

use gantry_tau_machine::scene::{Scene, SceneArm};
use nalgebra::Vector3;

use super::{MARGIN, SIZE, TITLE};
use crate::svg::Point;

/// Parallel projection: directions of the paper in the world, and a scale.
pub(super) struct View {
    right: Vector3<f64>,
    down: Vector3<f64>,
    /// Direction to the viewer.
    pub(super) towards: Vector3<f64>,
    scale: f64,
    origin: Point,
    /// Height of the picture, px.
    pub(super) height: f64,
}

impl View {
    /// A view in which the whole scene fits.
    pub(super) fn of(scene: &Scene, azimuth: f64, elevation: f64) -> Self {
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
        let low = points
            .iter()
            .fold(Point::repeat(f64::MAX), |low, p| low.inf(p));
        let high = points
            .iter()
            .fold(Point::repeat(f64::MIN), |high, p| high.sup(p));
        let room = (SIZE.0 - 2.0 * MARGIN, SIZE.1 - 2.0 * MARGIN - TITLE);
        let span = (high - low).add_scalar(1e-9);
        view.scale = (room.0 / span.x).min(room.1 / span.y);
        view.height = (span.y * view.scale + 2.0 * MARGIN + TITLE).round();
        let middle = Point::new(SIZE.0 / 2.0, (view.height + TITLE) / 2.0);
        view.origin = middle - (low + high) / 2.0 * view.scale;
        view
    }

    pub(super) fn direction(&self, world: &Vector3<f64>) -> Point {
        Point::new(self.right.dot(world), self.down.dot(world))
    }

    pub(super) fn point(&self, place_m: &Vector3<f64>) -> Point {
        self.origin + self.direction(place_m) * self.scale
    }

    pub(super) fn ends(&self, places_m: &[Vector3<f64>; 2]) -> [Point; 2] {
        places_m.each_ref().map(|place| self.point(place))
    }
}

/// Outlines on the paper.
pub(super) struct Outlines {
    pub(super) platform: Vec<Point>,
    pub(super) carts: Vec<Vec<Point>>,
    /// Every line that a label should not hide.
    pub(super) lines: Vec<[Point; 2]>,
}

impl Outlines {
    pub(super) fn of(scene: &Scene, view: &View) -> Self {
        let platform = scene.links.iter().map(|link| link.ends_m[1]);
        let mut joints: Vec<Point> = platform.map(|joint| view.point(&joint)).collect();
        joints.push(view.point(&scene.tool_m));
        let platform = hull(joints);
        let carts: Vec<Vec<Point>> = (scene.arms.iter())
            .map(|arm| hull(corners(arm).iter().map(|c| view.point(c)).collect()))
            .collect();
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
        Self {
            platform,
            carts,
            lines,
        }
    }
}

/// Corners of a cart's box.
fn corners(arm: &SceneArm) -> Vec<Vector3<f64>> {
    let corners = (0..8_u32).map(|number| {
        let signs = [4, 2, 1].map(|bit| if number & bit == 0 { -1.0 } else { 1.0 });
        let away: Vector3<f64> = arm
            .half_edges_m
            .iter()
            .zip(signs)
            .map(|(edge, sign)| edge * sign)
            .sum();
        arm.centre_m + away
    });
    corners.collect()
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
