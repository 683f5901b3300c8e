//! Logarithmic scale of colours: robust ends, and how it is drawn.

use super::super::axis::{Axis, Tick, logarithmic};
use super::super::{LABEL, label};
use super::tick_mark;
use crate::svg::{Colour, Drawing, Point, Shape};

/// Width of the scale, px.
pub(super) const WIDTH: f64 = 18.0;
/// Height of the point of an end beyond which there are values, px.
const POINT: f64 = 14.0;
/// Largest number of ticks.
const MAX_TICKS: usize = 9;
/// Colours from the lower to the upper end (viridis: even in lightness, readable with colour
/// blindness).
const COLOURS: [(f64, f64, f64); 5] = [
    (68.0, 1.0, 84.0),
    (59.0, 82.0, 139.0),
    (33.0, 145.0, 140.0),
    (94.0, 201.0, 98.0),
    (253.0, 231.0, 37.0),
];
/// Number of shades drawn.
const SHADES: u32 = 64;
/// Distance from a quartile at which a value is an outlier, in distances between the quartiles
/// (Tukey's fence).
const FENCE: f64 = 1.5;
/// Reach of a scale with outliers beyond the quartile, in the same unit: that of values that are
/// spread evenly.
const REACH: f64 = 0.5;
/// Share of the scale around the label of an end that has no other label.
const ROOM: f64 = 0.06;

/// Ends of a logarithmic scale of colours, which show that values lie beyond them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    low: f64,
    high: f64,
    /// Smallest and largest value.
    extremes: [f64; 2],
}

impl Scale {
    /// Returns the scale of positive values. Near a singularity values are unbounded: some of them
    /// do not use up the colours of the others.
    #[must_use]
    pub fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let values = values.into_iter().filter(|value| *value > 0.0);
        let mut logs: Vec<f64> = values
            .filter(|value| value.is_finite())
            .map(f64::ln)
            .collect();
        logs.sort_by(f64::total_cmp);
        let last = logs.len().max(1) - 1;
        let [Some(least), Some(lower), Some(upper), Some(largest)] =
            [0, 1, 3, 4].map(|quarter| logs.get(last * quarter / 4))
        else {
            return Self::between(1.0, 1.0);
        };
        let spread = upper - lower;
        let low = lower - reach(lower - least, spread);
        let high = upper + reach(largest - upper, spread);
        Self {
            extremes: [least.exp(), largest.exp()],
            ..Self::between(low.exp(), high.exp())
        }
    }

    /// Ends that are apart.
    fn between(low: f64, high: f64) -> Self {
        Self {
            low,
            high: high.max(1.01 * low),
            extremes: [low, high],
        }
    }

    /// True if there are values below the scale, and above it.
    fn is_exceeded(&self) -> [bool; 2] {
        let [least, largest] = self.extremes;
        [
            least < self.low * (1.0 - 1e-9),
            largest > self.high * (1.0 + 1e-9),
        ]
    }

    /// Share of the scale that lies below a value.
    fn share(&self, value: f64) -> f64 {
        (value / self.low).ln() / (self.high / self.low).ln()
    }

    /// Colour of a value; beyond an end, that of the end.
    #[expect(
        clippy::indexing_slicing,
        reason = "`below` is at most the last but one"
    )]
    pub(in super::super) fn colour(&self, value: f64) -> Colour {
        let share = self.share(value);
        // NaN becomes the lower end.
        let share = if share > 0.0 { share.min(1.0) } else { 0.0 };
        let place = share * (COLOURS.len() - 1) as f64;
        let below = (place as usize).min(COLOURS.len() - 2);
        let part = place - below as f64;
        let [(r0, g0, b0), (r1, g1, b1)] = [below, below + 1].map(|index| COLOURS[index]);
        let [red, green, blue] = [(r0, r1), (g0, g1), (b0, b1)]
            .map(|(from, to)| (from + (to - from) * part).round().clamp(0.0, 255.0) as u8);
        Colour::rgb(red, green, blue)
    }

    /// Ticks; those of ends beyond which there are values say so.
    pub(super) fn ticks(&self) -> Vec<Tick> {
        let mut ticks = logarithmic(self.low, self.high, MAX_TICKS);
        let [is_below, is_above] = self.is_exceeded();
        for (value, sign, is_exceeded) in [(self.low, "≤", is_below), (self.high, "≥", is_above)]
        {
            if is_exceeded {
                let share = self.share(value);
                ticks.retain(|tick| (self.share(tick.value) - share).abs() > ROOM);
                ticks.push(Tick {
                    value,
                    label: format!("{sign} {}", three_digits(value)),
                });
            }
        }
        ticks
    }

    /// Draws the scale at its upper left corner, `height` px high. An end with values beyond it has
    /// a point.
    pub(super) fn draw(&self, drawing: &mut Drawing, corner: Point, height: f64) {
        let axis = self.axis(corner.y, height);
        let [low, high] = [self.low, self.high].map(f64::ln);
        for shade in 0..SHADES {
            let ends = [shade, shade + 1]
                .map(|number| low + (high - low) * f64::from(number) / f64::from(SHADES));
            let [bottom, top] = ends.map(|end| axis.at(end));
            let corners = [
                Point::new(corner.x, bottom),
                Point::new(corner.x + WIDTH, top),
            ];
            let value = f64::midpoint(ends[0], ends[1]).exp();
            drawing.add(super::cell(corners, self.colour(value)));
        }
        let [is_below, is_above] = self.is_exceeded();
        for (value, is_exceeded, way) in
            [(self.low, is_below, POINT), (self.high, is_above, -POINT)]
        {
            if is_exceeded {
                let base = axis.at(value.ln());
                let corners = [
                    Point::new(corner.x, base),
                    Point::new(corner.x + WIDTH, base),
                    Point::new(corner.x + WIDTH / 2.0, base + way),
                ];
                drawing.add(Shape::polygon(&corners).fill(self.colour(value)));
            }
        }
        for tick in self.ticks() {
            let at = Point::new(corner.x + WIDTH, axis.at(tick.value.ln()));
            drawing.add(tick_mark(at, Point::new(4.0, 0.0)));
            let text = at + Point::new(8.0, 0.36 * LABEL);
            drawing.add(label(text, &tick.label, "start"));
        }
    }

    /// Logarithms from bottom to top, with space for the points.
    fn axis(&self, top: f64, height: f64) -> Axis {
        let [below, above] = self
            .is_exceeded()
            .map(|is_exceeded| if is_exceeded { POINT } else { 0.0 });
        Axis::of(self.low.ln()..self.high.ln()).spanning(top + height - below, top + above)
    }
}

/// Reach of a scale beyond a quartile, from where the values reach `tail` farther.
fn reach(tail: f64, spread: f64) -> f64 {
    if spread > 0.0 && tail > FENCE * spread {
        REACH * spread
    } else {
        tail
    }
}

/// Returns a number to three digits, or to all before the point.
fn three_digits(value: f64) -> String {
    let place = value.abs().log10().floor() as i32;
    if !(-4..6).contains(&place) {
        return format!("{value:.2e}");
    }
    let decimals = usize::try_from(2 - place).unwrap_or(0);
    format!("{value:.decimals$}")
}
