//! Looks of curves: each differs from the others in its colour, and in its dashes or dots, so that
//! it is known without its colour as well.

use crate::svg::{Colour, Point, Shape};

/// Width of a line, px.
const WIDTH: f64 = 2.0;
/// Radius of a round dot, px.
const RADIUS: f64 = 4.0;
/// Colours that stand out from light and from dark paper.
const COLOURS: [u32; 10] = [
    0x2b_7b_ba, 0xd6_65_1e, 0x2f_8f_4e, 0x8a_63_c4, 0xa0_67_4b, 0xd1_4d_94, 0x82_82_82, 0x13_95_a0,
    0x8c_8a_1e, 0xd6_3a_3a,
];
/// Dashes and gaps, px. Gaps are hardly longer than the line is wide: an extremum does not vanish
/// in one.
const DASHES: [&str; 5] = ["", "10 3", "3 3", "12 3 3 3", "20 3 3 3 3 3"];
/// Corners of the dots, in multiples of the radius; none of a circle.
const CORNERS: [&[[f64; 2]]; 5] = [
    &[],
    &[[-0.9, -0.9], [0.9, -0.9], [0.9, 0.9], [-0.9, 0.9]],
    &[[0.0, -1.2], [1.1, 0.8], [-1.1, 0.8]],
    &[[0.0, -1.3], [1.3, 0.0], [0.0, 1.3], [-1.3, 0.0]],
    &[[0.0, 1.2], [1.1, -0.8], [-1.1, -0.8]],
];
/// Number of looks that differ.
#[cfg(test)]
pub(super) const COUNT: usize = COLOURS.len() * DASHES.len();

/// Look of a curve.
#[derive(Clone, Copy, Debug)]
pub(super) struct Look {
    colour: Colour,
    /// Number of dashes and of dots, below 5.
    pattern: usize,
}

impl Look {
    /// Solid, in the colour of text.
    pub(super) const INK: Self = Self {
        colour: Colour::INK,
        pattern: 0,
    };

    /// Returns a look; the first fifty differ from each other, the first ten in colour.
    pub(super) fn new(number: usize) -> Self {
        let colour = COLOURS.iter().cycle().nth(number % COLOURS.len());
        Self {
            colour: colour.map_or(Colour::INK, |rgb| Colour::of(*rgb)),
            pattern: (number + number / COLOURS.len()) % DASHES.len(),
        }
    }

    /// Line through points.
    pub(super) fn line(self, points: &[Point]) -> Shape {
        let line = Shape::polyline(points)
            .stroke(self.colour, WIDTH)
            .with("stroke-linejoin", "round");
        match DASHES.get(self.pattern) {
            None | Some(&"") => line,
            Some(dashes) => line.with("stroke-dasharray", dashes),
        }
    }

    /// Dot at a point.
    pub(super) fn dot(self, at: Point) -> Shape {
        let shape = match CORNERS.get(self.pattern) {
            None | Some([]) => Shape::circle(at, RADIUS),
            Some(corners) => {
                let corners = corners
                    .iter()
                    .map(|[x, y]| at + Point::new(*x, *y) * RADIUS);
                Shape::polygon(&corners.collect::<Vec<_>>())
            }
        };
        shape.fill(self.colour)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative luminance (WCAG).
    fn luminance(rgb: u32) -> f64 {
        let [_, red, green, blue] = rgb.to_be_bytes().map(linear);
        0.2126 * red + 0.7152 * green + 0.0722 * blue
    }

    fn linear(byte: u8) -> f64 {
        let share = f64::from(byte) / 255.0;
        if share <= 0.040_45 {
            share / 12.92
        } else {
            ((share + 0.055) / 1.055).powf(2.4)
        }
    }

    #[test]
    fn colours_stand_out_from_light_and_from_dark_paper() {
        for colour in COLOURS {
            for paper in [0xff_ff_ff, 0x17_18_1a] {
                let (one, other) = (luminance(colour), luminance(paper));
                let contrast = (one.max(other) + 0.05) / (one.min(other) + 0.05);
                assert!(contrast > 3.0, "{colour:06x} on {paper:06x}: {contrast}");
            }
        }
    }
}
