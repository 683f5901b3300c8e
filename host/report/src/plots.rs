//! Plots: curves and coloured bands over two axes, with a legend outside of them.

mod axis;
pub mod heat;
mod legend;
mod look;
pub mod over_time;
pub mod phases;
#[cfg(test)]
mod tests;
mod thin;

use crate::svg::{Colour, Drawing, Point, Shape, Svg};
use axis::{Axis, Tick};
use legend::Legend;
use look::Look;

/// Width of a plot with its axes, px.
const WIDTH: f64 = 900.0;
/// Height of the area of the data, px, and its largest one where a unit is as long along both axes.
const HEIGHT: f64 = 350.0;
const MAX_HEIGHT: f64 = 600.0;
/// Smallest side of such an area, px.
const MIN_SIDE: f64 = 240.0;
/// Space right of the area of the data, px.
const RIGHT: f64 = 28.0;
/// Space below it, for the x axis, px.
const BELOW: f64 = 50.0;
/// Space left of it, for the name of the y axis and between its labels and the area, px.
const LEFT: f64 = 42.0;
/// Space above it, px.
const ABOVE: f64 = 12.0;
/// Sizes of the letters of labels and of names, px.
const LABEL: f64 = 13.0;
const NAME: f64 = 14.0;
/// Width of a letter as a share of its size, in common fonts.
const LETTER: f64 = 0.6;
/// Smallest distances of ticks along both axes, px.
const TICK_DISTANCES: [f64; 2] = [75.0, 45.0];

/// One curve.
#[derive(Clone, Debug)]
pub struct Curve {
    name: String,
    points: Vec<(f64, f64)>,
    has_line: bool,
    has_dots: bool,
    style: Style,
}

/// Style of a curve.
#[derive(Clone, Copy, Debug)]
enum Style {
    /// By its place among the curves.
    InOrder,
    Numbered(usize),
    Ink,
}

impl Curve {
    /// Creates a line; the legend leaves out an empty name. The line is interrupted where a
    /// coordinate is not finite.
    #[must_use]
    pub fn line(name: &str, points: Vec<(f64, f64)>) -> Self {
        Self {
            name: name.to_owned(),
            points,
            has_line: true,
            has_dots: false,
            style: Style::InOrder,
        }
    }

    /// Creates dots without a line.
    #[must_use]
    pub fn dots(name: &str, points: Vec<(f64, f64)>) -> Self {
        Self {
            has_line: false,
            has_dots: true,
            ..Self::line(name, points)
        }
    }

    /// Creates nothing that is drawn: the axes reach to the points.
    #[must_use]
    pub fn frame(points: Vec<(f64, f64)>) -> Self {
        Self {
            has_line: false,
            ..Self::line("", points)
        }
    }

    /// Draws dots at the points of a line.
    #[must_use]
    pub fn with_dots(self) -> Self {
        Self {
            has_dots: true,
            ..self
        }
    }

    /// Gives the curve the style of a number, which several curves may have; otherwise its place
    /// among the curves is its number.
    #[must_use]
    pub fn styled(self, number: usize) -> Self {
        Self {
            style: Style::Numbered(number),
            ..self
        }
    }

    /// Draws the curve in the colour of text.
    #[must_use]
    pub fn in_ink(self) -> Self {
        Self {
            style: Style::Ink,
            ..self
        }
    }

    /// Points, x and y.
    #[must_use]
    pub fn points(&self) -> &[(f64, f64)] {
        &self.points
    }

    /// True if both have the same number.
    fn has_style_of(&self, other: &Self) -> bool {
        match (self.style, other.style) {
            (Style::Numbered(one), Style::Numbered(other)) => one == other,
            _ => false,
        }
    }

    fn look(&self, place: usize) -> Look {
        match self.style {
            Style::InOrder => Look::new(place),
            Style::Numbered(number) => Look::new(number),
            Style::Ink => Look::INK,
        }
    }
}

/// A coloured stretch of the x axis.
#[derive(Clone, Debug)]
pub struct Band {
    /// Name; bands of a name have one entry of the legend.
    pub name: &'static str,
    /// Lower end.
    pub from: f64,
    /// Upper end.
    pub to: f64,
    /// Colour.
    pub colour: Colour,
}

/// A plot.
#[derive(Clone, Debug)]
pub struct Plot {
    title: String,
    x_axis: String,
    y_axis: String,
    curves: Vec<Curve>,
    bands: Vec<Band>,
    y_names: Vec<&'static str>,
    has_equal_axes: bool,
}

impl Plot {
    /// Creates a plot from its title and the texts of its axes.
    #[must_use]
    pub fn new(
        title: impl Into<String>,
        x_axis: impl Into<String>,
        y_axis: impl Into<String>,
        curves: Vec<Curve>,
    ) -> Self {
        Self {
            title: title.into(),
            x_axis: x_axis.into(),
            y_axis: y_axis.into(),
            curves,
            bands: Vec::new(),
            y_names: Vec::new(),
            has_equal_axes: false,
        }
    }

    /// Draws bands behind the curves.
    #[must_use]
    pub fn with_bands(self, bands: Vec<Band>) -> Self {
        Self { bands, ..self }
    }

    /// Names the whole numbers of the y axis, from 0.
    #[must_use]
    pub fn with_names(self, y_names: impl IntoIterator<Item = &'static str>) -> Self {
        Self {
            y_names: y_names.into_iter().collect(),
            ..self
        }
    }

    /// Draws a unit equally long along both axes: for places and vectors in a plane.
    #[must_use]
    pub fn with_equal_axes(self) -> Self {
        Self {
            has_equal_axes: true,
            ..self
        }
    }

    /// Title.
    #[must_use]
    pub fn title(&self) -> &str {
        &self.title
    }

    /// Returns the plot as a picture.
    #[must_use]
    pub fn svg(&self) -> Svg {
        self.drawing().finish(&self.title, &self.description())
    }

    /// Says what is drawn.
    fn description(&self) -> String {
        let axes = match self.y_axis.as_str() {
            "" => self.x_axis.clone(),
            y_axis => format!("{y_axis} over {}", self.x_axis),
        };
        let named = self.curves.iter().map(|curve| curve.name.as_str());
        let named: Vec<&str> = named.filter(|name| !name.is_empty()).collect();
        match named.as_slice() {
            [] => axes,
            named => format!("{axes}; {}", named.join(", ")),
        }
    }

    /// Returns the plot without a title.
    #[must_use]
    pub fn drawing(&self) -> Drawing {
        let legend = Legend::of(&self.curves, &self.bands);
        let [x, y] = self.axes(ABOVE + legend.height());
        let mut drawing = Drawing::new(WIDTH, y.ends()[0] + BELOW);
        let paper = [Point::zeros(), Point::new(WIDTH, drawing.height())];
        drawing.add(Shape::rectangle(paper).fill(Colour::PAPER));
        legend.draw(&mut drawing, Point::new(x.ends()[0], ABOVE));
        for band in &self.bands {
            drawing.add(stretch(band, &x, &y));
        }
        self.draw_axes(&mut drawing, &x, &y);
        for (place, curve) in self.curves.iter().enumerate() {
            draw_curve(&mut drawing, curve, curve.look(place), [&x, &y]);
        }
        drawing
    }

    /// Both axes in their places below the legend.
    fn axes(&self, top: f64) -> [Axis; 2] {
        let points = self.curves.iter().flat_map(|curve| &curve.points);
        // Dots at the ends would be cut.
        let has_dots = self.curves.iter().any(|curve| curve.has_dots);
        let x_margin = if has_dots { 0.02 } else { 0.0 };
        let x = Axis::around(points.clone().map(|point| point.0), x_margin);
        let y = Axis::around(points.map(|point| point.1), 0.06).spanning(top + HEIGHT, top);
        let labels = self.y_ticks(&y);
        let longest = labels.iter().map(|tick| tick.label.chars().count()).max();
        let left = LEFT + width(longest.unwrap_or(0), LABEL);
        let x = x.spanning(left, WIDTH - RIGHT);
        if !self.has_equal_axes {
            return [x, y];
        }
        let y = y.spanning(top + MAX_HEIGHT, top);
        let scale = x.scale().min(y.scale());
        let [wide, high] = [&x, &y].map(|axis| (axis.span() * scale).max(MIN_SIDE));
        [
            x.spanning(left, left + wide).scaled(scale),
            y.spanning(top + high, top).scaled(scale),
        ]
    }

    fn y_ticks(&self, y: &Axis) -> Vec<Tick> {
        if self.y_names.is_empty() {
            return y.ticks(TICK_DISTANCES[1]);
        }
        let numbered = (0_u32..).map(f64::from).zip(&self.y_names);
        let ticks = numbered.map(|(value, name)| Tick {
            value,
            label: (*name).to_owned(),
        });
        ticks.collect()
    }

    /// Ticks, their lines, and the names of the axes.
    fn draw_axes(&self, drawing: &mut Drawing, x: &Axis, y: &Axis) {
        let ([left, right], [bottom, top]) = (x.ends(), y.ends());
        for tick in x.ticks(TICK_DISTANCES[0]) {
            let at = x.at(tick.value);
            drawing.add(grid_line([Point::new(at, top), Point::new(at, bottom)]));
            drawing.add(label(Point::new(at, bottom + 18.0), &tick.label, "middle"));
        }
        for tick in self.y_ticks(y) {
            let at = y.at(tick.value);
            drawing.add(grid_line([Point::new(left, at), Point::new(right, at)]));
            drawing.add(label(
                Point::new(left - 8.0, at + 0.36 * LABEL),
                &tick.label,
                "end",
            ));
        }
        for end in [Point::new(right, bottom), Point::new(left, top)] {
            let axis = [Point::new(left, bottom), end];
            drawing.add(Shape::line(axis).stroke(Colour::FAINT, 1.0));
        }
        let middle = Point::new(f64::midpoint(left, right), f64::midpoint(bottom, top));
        drawing.add(name(Point::new(middle.x, bottom + 40.0), &self.x_axis));
        if !self.y_axis.is_empty() {
            drawing.add(name_upwards(Point::new(NAME, middle.y), &self.y_axis));
        }
    }
}

fn is_drawn(place: &Point) -> bool {
    place.x.is_finite() && place.y.is_finite()
}

/// Returns the rectangle of a band, at least one px wide.
fn stretch(band: &Band, x: &Axis, y: &Axis) -> Shape {
    let ([from, to], [bottom, top]) = ([band.from, band.to].map(|end| x.within(end)), y.ends());
    let corners = [
        Point::new(from, top),
        Point::new(to.max(from + 1.0), bottom),
    ];
    Shape::rectangle(corners).fill(band.colour)
}

fn draw_curve(drawing: &mut Drawing, curve: &Curve, look: Look, [x, y]: [&Axis; 2]) {
    let places = curve
        .points
        .iter()
        .map(|(right, up)| Point::new(x.at(*right), y.at(*up)));
    let places: Vec<Point> = places.collect();
    if curve.has_line {
        for stretch in places.split(|place| !is_drawn(place)) {
            match stretch {
                [] => {}
                [alone] => drawing.add(look.dot(*alone)),
                stretch => drawing.add(look.line(&thin::thinned(stretch))),
            }
        }
    }
    if curve.has_dots {
        for place in places.iter().filter(|place| is_drawn(place)) {
            drawing.add(look.dot(*place));
        }
    }
}

fn grid_line(ends: [Point; 2]) -> Shape {
    Shape::line(ends)
        .stroke(Colour::GRID, 1.0)
        .with("stroke-opacity", 0.7)
}

/// Label of a tick.
fn label(at: Point, text: &str, anchor: &str) -> Shape {
    let label = Shape::text(at, text).fill(Colour::INK);
    label.with("font-size", LABEL).with("text-anchor", anchor)
}

/// Name of an axis around a point.
fn name(at: Point, text: &str) -> Shape {
    let name = Shape::text(at, text).fill(Colour::INK);
    name.with("font-size", NAME).with("text-anchor", "middle")
}

/// Name of an axis around a point, read from below.
fn name_upwards(at: Point, text: &str) -> Shape {
    let turn = format!("rotate(-90 {:.1} {:.1})", at.x, at.y);
    name(at, text).with("transform", turn)
}

/// Width of a text, px.
fn width(letters: usize, size: f64) -> f64 {
    letters as f64 * LETTER * size
}
