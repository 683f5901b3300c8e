//! Names of curves and bands, in rows above a plot.

use super::look::Look;
use super::{ABOVE, Band, Curve, LABEL, LEFT, RIGHT, WIDTH, width};
use crate::svg::{Colour, Drawing, Point, Shape};

/// Height of a row, px.
const ROW: f64 = 21.0;
/// Length of the piece of a curve that an entry shows, px.
const SAMPLE: f64 = 40.0;
/// Space between a sample and its name, and between entries, px.
const GAPS: [f64; 2] = [6.0, 12.0];

/// The entries in their rows.
pub(super) struct Legend<'a> {
    rows: Vec<Vec<LegendEntry<'a>>>,
}

struct LegendEntry<'a> {
    name: &'a str,
    sample: Swatch,
}

/// Piece of what an entry names.
enum Swatch {
    Curve {
        look: Look,
        has_line: bool,
        has_dots: bool,
    },
    Band(Colour),
}

impl<'a> Legend<'a> {
    /// Returns the legend of curves, if two of them or more have names, and of bands.
    pub(super) fn of(curves: &'a [Curve], bands: &'a [Band]) -> Self {
        let entries = curves.iter().enumerate().map(|(place, curve)| LegendEntry {
            name: &curve.name,
            sample: Swatch::of(curve, place, curves),
        });
        let mut entries: Vec<LegendEntry<'a>> =
            entries.filter(|entry| !entry.name.is_empty()).collect();
        if entries.len() < 2 {
            entries.clear();
        }
        for band in bands {
            if entries.iter().all(|entry| entry.name != band.name) {
                entries.push(LegendEntry {
                    name: band.name,
                    sample: Swatch::Band(band.colour),
                });
            }
        }
        Self {
            rows: rows_of(entries),
        }
    }

    pub(super) fn height(&self) -> f64 {
        match self.rows.len() {
            0 => 0.0,
            rows => rows as f64 * ROW + ABOVE / 2.0,
        }
    }

    /// Draws the legend; `corner` is its upper left one.
    pub(super) fn draw(&self, drawing: &mut Drawing, corner: Point) {
        for (number, row) in self.rows.iter().enumerate() {
            let mut at = corner + Point::new(0.0, ROW * (number as f64 + 0.5));
            for entry in row {
                entry.sample.draw(drawing, at);
                let text = at + Point::new(SAMPLE + GAPS[0], 0.36 * LABEL);
                let name = Shape::text(text, entry.name).fill(Colour::INK);
                drawing.add(name.with("font-size", LABEL));
                at.x += entry.width();
            }
        }
    }
}

/// Fills rows as words fill lines.
fn rows_of(entries: Vec<LegendEntry<'_>>) -> Vec<Vec<LegendEntry<'_>>> {
    let room = WIDTH - 2.0 * LEFT - RIGHT;
    let (mut rows, mut used) = (Vec::<Vec<LegendEntry<'_>>>::new(), 0.0);
    for entry in entries {
        used += entry.width();
        match rows.last_mut() {
            Some(row) if used <= room => row.push(entry),
            _ => {
                used = entry.width();
                rows.push(vec![entry]);
            }
        }
    }
    rows
}

impl LegendEntry<'_> {
    fn width(&self) -> f64 {
        SAMPLE + GAPS[0] + width(self.name.chars().count(), LABEL) + GAPS[1]
    }
}

impl Swatch {
    /// Sample of a curve in its place among the curves, and of those without a name that have its
    /// style: a line and its dots.
    fn of(curve: &Curve, place: usize, curves: &[Curve]) -> Self {
        let alike = curves
            .iter()
            .filter(|other| other.name.is_empty() && curve.has_style_of(other));
        let mut drawn = alike.chain([curve]);
        Self::Curve {
            look: curve.look(place),
            has_line: drawn.clone().any(|curve| curve.has_line),
            has_dots: drawn.any(|curve| curve.has_dots),
        }
    }

    /// Draws the sample to the right of a point.
    fn draw(&self, drawing: &mut Drawing, at: Point) {
        let end = at + Point::new(SAMPLE, 0.0);
        match self {
            Self::Curve {
                look,
                has_line,
                has_dots,
            } => {
                if *has_line {
                    drawing.add(look.line(&[at, end]));
                }
                if *has_dots {
                    drawing.add(look.dot((at + end) / 2.0));
                }
            }
            Self::Band(colour) => {
                let corners = [at + Point::new(8.0, -7.0), end + Point::new(0.0, 7.0)];
                drawing.add(Shape::rectangle(corners).fill(*colour));
            }
        }
    }
}
