//! Three views of places with names, in SVG.

use gantry_tau_report::svg::{Colour, Drawing, Point, Shape, Svg};
use nalgebra::Vector3;

/// A place, with a name where that is not empty, and with an arrow where it has a direction.
pub(super) struct Mark {
    pub(super) name: String,
    pub(super) at_m: Vector3<f64>,
    /// The arrow, m; it ends at the place.
    pub(super) way_m: Vector3<f64>,
    pub(super) is_hook: bool,
}

/// Title, and the world axes to the right and up.
const VIEWS: [(&str, usize, usize); 3] =
    [("from above", 0, 1), ("from -y", 0, 2), ("from +x", 1, 2)];
const AXES: [&str; 3] = ["x", "y", "z"];
/// Size of a view and its margin, px.
const SIZE: f64 = 300.0;
const MARGIN: f64 = 46.0;
/// Heights of a line of text, px.
const LINE: f64 = 12.0;
/// Colours of gauges, and of hooks and places.
const COLOURS: [Colour; 2] = [Colour::of(0x1f_5f_a8), Colour::of(0xb3_47_1d)];
/// Colours of the platform's outline.
const PLATFORM: Colour = Colour::of(0xbb_bb_bb);
const JOINT: Colour = Colour::of(0x99_99_99);

/// Platform joints (none for places in the workspace) and marks from above, from the front and from
/// the right.
pub(super) fn views(title: &str, joints_m: &[Vector3<f64>], marks: &[Mark]) -> Svg {
    let mut drawing = Drawing::new(SIZE * 3.0, SIZE);
    let paper = [Point::zeros(), Point::new(SIZE * 3.0, SIZE)];
    drawing.add(Shape::rectangle(paper).fill(Colour::WHITE));
    if let Some((middle, scale)) = extent(joints_m, marks) {
        for (column, (name, right, up)) in VIEWS.into_iter().enumerate() {
            let view = SheetView {
                left: SIZE * crate::fit::statistics::float(column),
                right,
                up,
                middle,
                scale,
            };
            view.draw(&mut drawing, name, joints_m, marks);
        }
    }
    drawing.finish(title, "from above, from -y, from +x")
}

/// Middle of all that is drawn, and px per m, the same in all views.
fn extent(joints_m: &[Vector3<f64>], marks: &[Mark]) -> Option<(Vector3<f64>, f64)> {
    let ends = marks
        .iter()
        .flat_map(|mark| [mark.at_m, mark.at_m - mark.way_m]);
    let mut all: Vec<Vector3<f64>> = ends.chain(joints_m.iter().copied()).collect();
    // The tool centre point, of which the places of a platform are counted.
    if !joints_m.is_empty() {
        all.push(Vector3::zeros());
    }
    let first = all.first()?;
    let (low, high) = all.iter().fold((*first, *first), |(low, high), point| {
        (low.inf(point), high.sup(point))
    });
    let scale = (SIZE - 2.0 * MARGIN) / (high - low).max().max(1e-6);
    Some(((low + high) / 2.0, scale))
}

/// One of the views: its left end on the paper, and the world axes to the right and up.
struct SheetView {
    left: f64,
    right: usize,
    up: usize,
    middle: Vector3<f64>,
    scale: f64,
}

impl SheetView {
    fn at(&self, place: &Vector3<f64>) -> Point {
        let away = (place - self.middle) * self.scale;
        Point::new(
            self.left + SIZE / 2.0 + away[self.right],
            SIZE / 2.0 - away[self.up],
        )
    }

    fn draw(&self, drawing: &mut Drawing, name: &str, joints_m: &[Vector3<f64>], marks: &[Mark]) {
        let title = format!("{name}: {} right, {} up", AXES[self.right], AXES[self.up]);
        drawing.add(word(
            Point::new(self.left + 8.0, 16.0),
            Colour::of(0x33_33_33),
            &title,
        ));
        let tool = self.at(&Vector3::zeros());
        for joint in joints_m {
            let joint = self.at(joint);
            drawing.add(Shape::line([tool, joint]).stroke(PLATFORM, 1.0));
            drawing.add(
                Shape::circle(joint, 3.5)
                    .fill(Colour::WHITE)
                    .stroke(JOINT, 1.0),
            );
        }
        if !joints_m.is_empty() {
            drawing.add(Shape::circle(tool, 4.0).fill(Colour::ALERT));
        }
        let mut taken: Vec<Point> = Vec::new();
        for mark in marks {
            let [at, from] = [mark.at_m, mark.at_m - mark.way_m].map(|place| self.at(&place));
            let colour = COLOURS[usize::from(mark.is_hook)];
            drawing.add(Shape::line([from, at]).stroke(colour, 2.0));
            drawing.add(Shape::circle(at, 3.0).fill(colour));
            if !mark.name.is_empty() {
                let place = free_place(&taken, at);
                taken.push(place);
                drawing.add(word(place, colour, &mark.name));
            }
        }
    }
}

fn word(at: Point, colour: Colour, text: &str) -> Shape {
    let word = Shape::text(at, text).fill(colour);
    word.with("font-size", LINE)
}

/// Place of a name beside a point, below the names that are there already.
fn free_place(taken: &[Point], at: Point) -> Point {
    let x = at.x + 6.0;
    let mut places = (0..8_u8).flat_map(|step| {
        [1.0, -1.0].map(|side| Point::new(x, at.y - 4.0 + side * LINE * f64::from(step)))
    });
    let free = places.find(|place| {
        let mut apart = taken.iter().map(|other| (other - place).abs());
        apart.all(|apart| apart.x >= 36.0 || apart.y >= LINE)
    });
    free.unwrap_or(Point::new(x, at.y))
}
