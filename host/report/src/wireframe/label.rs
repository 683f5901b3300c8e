//! Labels of a wireframe, and where they hide least.

use gantry_tau_machine::scene::Scene;

use super::view::{Outlines, View};
use super::{FONT, INK, SIZE, colour};
use crate::svg::{Colour, Point};

/// Width of a character as a share of the font size, in the widest common font.
const CHARACTER: f64 = 0.66;
/// Costs that differ by less are equal, so that rounding does not choose between them.
const TIE: f64 = 1e-6;

/// A word and its place.
#[derive(Debug)]
pub(super) struct Label {
    pub(super) text: String,
    pub(super) colour: Colour,
    /// The point that it names.
    pub(super) anchor: Point,
    pub(super) centre: Point,
}

impl Label {
    fn new(text: impl Into<String>, colour: Colour, anchor: Point) -> Self {
        let text = text.into();
        let centre = anchor;
        Self {
            text,
            colour,
            anchor,
            centre,
        }
    }

    /// Half of width and height.
    pub(super) fn half(&self) -> Point {
        Point::new(
            self.text.chars().count() as f64 * CHARACTER * FONT / 2.0,
            0.6 * FONT,
        )
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
        let hidden = (0..=SAMPLES).filter(|step| {
            let share = f64::from(*step) / f64::from(SAMPLES);
            let away = (from + (to - from) * share - self.centre).abs();
            away.x < half.x && away.y < half.y
        });
        (to - from).norm() * hidden.count() as f64 / f64::from(SAMPLES)
    }

    /// Moves to the candidate of least cost: what the label costs there, and a cost of the
    /// candidate itself. Of equals the first counts.
    fn settle(
        &mut self,
        candidates: impl IntoIterator<Item = (Point, f64)>,
        cost: impl Fn(&Self) -> f64,
    ) {
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

    /// Moves to the place near the anchor that hides least: far places, lines, other labels and the
    /// picture's edge cost.
    fn place(&mut self, placed: &[Self], lines: &[[Point; 2]], height: f64) {
        let half = self.half();
        self.settle(around(self.anchor, half), |label| {
            let (top_left, bottom_right) = (label.centre - half, label.centre + half);
            let outside = top_left.min() < 4.0
                || bottom_right.x > SIZE.0 - 4.0
                || bottom_right.y > height - 4.0;
            let hidden: f64 = lines.iter().map(|line| label.hides(line)).sum();
            1e4 * (f64::from(u8::from(outside)) + label.overlap(placed)) + 3.0 * hidden
        });
    }
}

/// Places around a point, for a label of half a width and height, with their distances.
fn around(anchor: Point, half: Point) -> impl Iterator<Item = (Point, f64)> {
    [9.0, 16.0, 26.0, 40.0, 58.0]
        .into_iter()
        .flat_map(move |radius: f64| {
            (0..16_u32).map(move |step| {
                let angle = f64::from(step) * std::f64::consts::FRAC_PI_8;
                let direction = Point::new(angle.cos(), angle.sin());
                let away = direction * radius + half.component_mul(&direction);
                (anchor + away, radius)
            })
        })
}

/// Labels of everything, in their places.
pub(super) fn labels(scene: &Scene, view: &View, shapes: &Outlines) -> Vec<Label> {
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
