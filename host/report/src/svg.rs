//! Drawings in SVG: shapes with colours, and the finished picture.
//!
//! Every shape carries its colour for a light background. Colours with a role (ink, paper, phases)
//! are classes as well: the stylesheet of a page has others for readers who prefer a dark one.

mod colour;

use std::fmt::{Display, Write as _};

use nalgebra::Vector2;

use crate::text::Text;
pub use colour::Colour;

/// A point of a drawing, px, y downwards.
pub type Point = Vector2<f64>;

/// A finished picture: an `<svg>` element with a title.
#[derive(Clone, Debug)]
pub struct Svg(String);

impl Svg {
    /// Returns the element as the text of a file.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

/// Shapes on a sheet, the later ones above the earlier ones.
#[derive(Clone, Debug)]
pub struct Drawing {
    size: Point,
    shapes: String,
}

impl Drawing {
    /// Creates an empty sheet of a width and a height, px.
    #[must_use]
    pub const fn new(width: f64, height: f64) -> Self {
        Self {
            size: Point::new(width, height),
            shapes: String::new(),
        }
    }

    /// Width, px.
    #[must_use]
    pub fn width(&self) -> f64 {
        self.size.x
    }

    /// Height, px.
    #[must_use]
    pub fn height(&self) -> f64 {
        self.size.y
    }

    /// Adds a shape.
    pub fn add(&mut self, shape: Shape) {
        self.shapes += &shape.element();
    }

    /// Adds another drawing, with its upper left corner at a point.
    pub fn insert(&mut self, at: Point, drawing: &Self) {
        let (x, y) = (px(at.x), px(at.y));
        self.shapes += &format!(
            "<g transform=\"translate({x},{y})\">\n{}</g>\n",
            drawing.shapes
        );
    }

    /// Finishes the picture. `title` names it; `description` adds what it shows, for those who do not
    /// see it.
    #[must_use]
    pub fn finish(self, title: &str, description: &str) -> Svg {
        let [width, height] = [self.size.x, self.size.y].map(px);
        let [title, description] = [title, description].map(|text| Text::from(text).into_html());
        let label = match description.as_str() {
            "" => title.clone(),
            description => format!("{title}: {description}"),
        };
        Svg(format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{label}\" \
             font-family=\"sans-serif\">\n<title>{title}</title>\n{}</svg>\n",
            self.shapes
        ))
    }
}

/// Element of a drawing.
#[derive(Clone, Debug)]
#[must_use]
pub struct Shape {
    name: &'static str,
    attributes: String,
    classes: Vec<String>,
    content: Option<String>,
}

impl Shape {
    const fn new(name: &'static str) -> Self {
        Self {
            name,
            attributes: String::new(),
            classes: Vec::new(),
            content: None,
        }
    }

    /// Straight line.
    pub fn line([from, to]: [Point; 2]) -> Self {
        Self::new("line")
            .with("x1", px(from.x))
            .with("y1", px(from.y))
            .with("x2", px(to.x))
            .with("y2", px(to.y))
    }

    /// Line through points.
    pub fn polyline(points: &[Point]) -> Self {
        Self::new("polyline")
            .with("points", joined(points))
            .with("fill", "none")
    }

    /// Closed outline.
    pub fn polygon(corners: &[Point]) -> Self {
        Self::new("polygon").with("points", joined(corners))
    }

    /// Circle around a point.
    pub fn circle(at: Point, radius: f64) -> Self {
        Self::new("circle")
            .with("cx", px(at.x))
            .with("cy", px(at.y))
            .with("r", radius)
    }

    /// Rectangle between two opposite corners.
    pub fn rectangle([one, other]: [Point; 2]) -> Self {
        let corner = one.inf(&other);
        let size = (one - other).abs();
        Self::new("rect")
            .with("x", px(corner.x))
            .with("y", px(corner.y))
            .with("width", px(size.x))
            .with("height", px(size.y))
    }

    /// Text that begins at a point of its base line.
    pub fn text(at: Point, text: &str) -> Self {
        Self {
            content: Some(Text::from(text).into_html()),
            ..Self::new("text").with("x", px(at.x)).with("y", px(at.y))
        }
    }

    /// Fills the shape.
    pub fn fill(self, colour: Colour) -> Self {
        self.coloured("fill", colour)
    }

    /// Draws its outline, of a width in px.
    pub fn stroke(self, colour: Colour, width: f64) -> Self {
        self.coloured("stroke", colour).with("stroke-width", width)
    }

    fn coloured(mut self, property: &'static str, colour: Colour) -> Self {
        if let Some(role) = colour.role() {
            self.classes.push(format!("{property}-{role}"));
        }
        self.with(property, colour)
    }

    /// Adds an attribute; its value is a number, or words of this program.
    pub fn with(mut self, attribute: &'static str, value: impl Display) -> Self {
        // Writing to a `String` does not fail.
        let _ = write!(self.attributes, " {attribute}=\"{value}\"");
        self
    }

    fn element(&self) -> String {
        let Self {
            name, attributes, ..
        } = self;
        let class = match self.classes.as_slice() {
            [] => String::new(),
            classes => format!(" class=\"{}\"", classes.join(" ")),
        };
        self.content.as_ref().map_or_else(
            || format!("<{name}{attributes}{class}/>\n"),
            |content| format!("<{name}{attributes}{class}>{content}</{name}>\n"),
        )
    }
}

/// Coordinates for an attribute.
fn joined(points: &[Point]) -> String {
    let points = points
        .iter()
        .map(|point| format!("{},{}", px(point.x), px(point.y)));
    points.collect::<Vec<_>>().join(" ")
}

/// Returns a coordinate to a tenth of a px, without a sign on zero.
fn px(value: f64) -> f64 {
    (value * 10.0).round() / 10.0 + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_has_a_role_a_title_and_a_label_and_escapes_its_words() {
        let mut drawing = Drawing::new(40.0, 20.0);
        drawing.add(Shape::text(Point::new(1.0, -0.01), "a < \"b\""));
        drawing.add(Shape::circle(Point::new(2.04, 3.0), 1.5).fill(Colour::INK));
        let svg = drawing.finish("A & B", "x over \"y\"");
        assert_eq!(
            svg.as_str(),
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"40\" height=\"20\" viewBox=\"0 0 40 20\" \
             role=\"img\" aria-label=\"A &amp; B: x over &quot;y&quot;\" font-family=\"sans-serif\">\n\
             <title>A &amp; B</title>\n\
             <text x=\"1\" y=\"0\">a &lt; &quot;b&quot;</text>\n\
             <circle cx=\"2\" cy=\"3\" r=\"1.5\" fill=\"#222222\" class=\"fill-ink\"/>\n</svg>\n"
        );
    }
}
