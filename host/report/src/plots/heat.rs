//! Colours over a plane: one value per cell of a regular grid, on a logarithmic scale.

mod scale;

use super::axis::{Axis, extent};
use super::{ABOVE, LABEL, NAME, RIGHT, label, name, name_upwards, width};
use crate::svg::{Colour, Drawing, Point, Shape, Svg};
pub use scale::Scale;

/// Side of the area of the map, px.
const SIDE: f64 = 390.0;
/// Left end of the area of the map, and its space below, px.
const LEFT: f64 = 66.0;
const BELOW: f64 = 48.0;
/// Space between map and scale, px.
const GAP: f64 = 22.0;
/// Smallest distance of ticks of the map, px.
const TICK_DISTANCE: f64 = 65.0;

/// Cell of a map: x and y of its middle, and its value.
pub type Cell = (f64, f64, f64);

/// Values over a plane; places without a cell stay white.
#[derive(Clone, Debug)]
pub struct HeatMap {
    /// Title.
    pub title: String,
    /// Name of the x axis.
    pub x_axis: &'static str,
    /// Name of the y axis.
    pub y_axis: &'static str,
    /// Name of the values.
    pub value: &'static str,
    /// Side of a cell, in the units of both axes.
    pub pitch: f64,
    /// Cells, in any order.
    pub cells: Vec<Cell>,
    /// Place of a cross.
    pub mark: (f64, f64),
    /// Colours of the values.
    pub scale: Scale,
}

impl HeatMap {
    /// Returns the map as a picture.
    #[must_use]
    pub fn svg(&self) -> Svg {
        let labels = self.scale.ticks();
        let longest = labels.iter().map(|tick| tick.label.chars().count()).max();
        let scale = Point::new(LEFT + SIDE + GAP, ABOVE);
        let labels_end = scale.x + scale::WIDTH + 8.0 + width(longest.unwrap_or(0), LABEL);
        let size = Point::new(labels_end + NAME + RIGHT, ABOVE + SIDE + BELOW);
        let mut drawing = Drawing::new(size.x, size.y);
        drawing.add(Shape::rectangle([Point::zeros(), size]).fill(Colour::PAPER));
        // White says that there is no value.
        let area = [
            Point::new(LEFT, ABOVE),
            Point::new(LEFT + SIDE, ABOVE + SIDE),
        ];
        let area = Shape::rectangle(area).fill(Colour::WHITE);
        drawing.add(area.stroke(Colour::FAINT, 1.0));
        let [x, y] = self.axes();
        self.draw_axes(&mut drawing, &x, &y);
        self.draw_cells(&mut drawing, &x, &y);
        self.scale.draw(&mut drawing, scale, SIDE);
        let value = Point::new(labels_end + NAME, ABOVE + SIDE / 2.0);
        drawing.add(name_upwards(value, self.value));
        let description = format!("{} over {} and {}", self.value, self.x_axis, self.y_axis);
        drawing.finish(&self.title, &description)
    }

    /// Both axes with the same length per unit, around the cells and the mark.
    fn axes(&self) -> [Axis; 2] {
        let (right, up) = self.mark;
        let x = extent(self.cells.iter().map(|cell| cell.0).chain([right]));
        let y = extent(self.cells.iter().map(|cell| cell.1).chain([up]));
        let [x, y] = [x, y].map(Option::unwrap_or_default);
        let span = (x[1] - x[0]).max(y[1] - y[0]) + 3.0 * self.pitch;
        let [x, y] = [x, y].map(|[low, high]| f64::midpoint(low, high));
        let [x, y] = [x, y].map(|middle| Axis::of(middle - span / 2.0..middle + span / 2.0));
        [
            x.spanning(LEFT, LEFT + SIDE),
            y.spanning(ABOVE + SIDE, ABOVE),
        ]
    }

    fn draw_axes(&self, drawing: &mut Drawing, x: &Axis, y: &Axis) {
        let bottom = ABOVE + SIDE;
        for tick in x.ticks(TICK_DISTANCE) {
            let at = Point::new(x.at(tick.value), bottom);
            drawing.add(tick_mark(at, Point::new(0.0, 4.0)));
            let text = at + Point::new(0.0, 18.0);
            drawing.add(label(text, &tick.label, "middle"));
        }
        for tick in y.ticks(TICK_DISTANCE) {
            let at = Point::new(LEFT, y.at(tick.value));
            drawing.add(tick_mark(at, Point::new(-4.0, 0.0)));
            let text = at + Point::new(-8.0, 0.36 * LABEL);
            drawing.add(label(text, &tick.label, "end"));
        }
        let middle = Point::new(LEFT + SIDE / 2.0, ABOVE + SIDE / 2.0);
        drawing.add(name(Point::new(middle.x, bottom + 40.0), self.x_axis));
        drawing.add(name_upwards(Point::new(NAME, middle.y), self.y_axis));
    }

    /// Cells, and the cross.
    fn draw_cells(&self, drawing: &mut Drawing, x: &Axis, y: &Axis) {
        // Cells overlap a little, so that rounding leaves no gap between neighbours.
        let half = Point::repeat(0.51 * self.pitch * x.scale());
        for (right, up, value) in &self.cells {
            let middle = Point::new(x.at(*right), y.at(*up));
            let corners = [middle - half, middle + half];
            drawing.add(cell(corners, self.scale.colour(*value)));
        }
        let (right, up) = self.mark;
        let mark = Point::new(x.at(right), y.at(up));
        for arm in [Point::new(6.0, 6.0), Point::new(6.0, -6.0)] {
            drawing.add(Shape::line([mark - arm, mark + arm]).stroke(Colour::ALERT, 2.0));
        }
    }
}

/// Coloured rectangle whose rim is not mixed with what is behind it.
fn cell(corners: [Point; 2], colour: Colour) -> Shape {
    let cell = Shape::rectangle(corners).fill(colour);
    cell.with("shape-rendering", "crispEdges")
}

fn tick_mark(at: Point, way: Point) -> Shape {
    Shape::line([at, at + way]).stroke(Colour::FAINT, 1.0)
}
