//! Axes: ranges, ticks, and the places of values on the paper.

use std::ops::Range;

/// Largest number whose labels have no exponent.
const LARGE: f64 = 1e6;
/// Largest number of decimals of labels without an exponent.
const MAX_DECIMALS: i32 = 5;

/// A number on an axis, in words.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tick {
    pub(super) value: f64,
    pub(super) label: String,
}

/// An axis: values from one end to the other, and places in px.
#[derive(Clone, Debug)]
pub(super) struct Axis {
    values: Range<f64>,
    /// Places of both ends.
    px: [f64; 2],
    /// All values are whole numbers, and so are the ticks.
    is_whole: bool,
}

impl Axis {
    /// Returns the axis around values, of which those that are not finite do not count; `margin` is
    /// the share of the span that is added at both ends.
    pub(super) fn around(values: impl Iterator<Item = f64> + Clone, margin: f64) -> Self {
        let Some([low, high]) = extent(values.clone()) else {
            return Self::of(0.0..1.0);
        };
        let size = low.abs().max(high.abs());
        // One value alone, or one that differs by rounding, stands in the middle.
        let room = if high - low > 1e-12 * size {
            margin * (high - low)
        } else if size > 0.0 {
            size / 2.0
        } else {
            0.5
        };
        let mut finite = values.filter(|value| value.is_finite());
        Self {
            is_whole: finite.all(|value| value.fract().abs() < f64::EPSILON),
            ..Self::of(low - room..high + room)
        }
    }

    /// Returns the axis of a range.
    pub(super) const fn of(values: Range<f64>) -> Self {
        Self {
            values,
            px: [0.0, 1.0],
            is_whole: false,
        }
    }

    /// Sets the places of the ends.
    pub(super) fn spanning(self, from: f64, to: f64) -> Self {
        Self {
            px: [from, to],
            ..self
        }
    }

    pub(super) fn span(&self) -> f64 {
        self.values.end - self.values.start
    }

    /// Px per unit.
    pub(super) fn scale(&self) -> f64 {
        let [from, to] = self.px;
        (to - from).abs() / self.span()
    }

    /// Widens the range around its middle, so that a unit has so many px.
    pub(super) fn scaled(mut self, scale: f64) -> Self {
        let [from, to] = self.px;
        let half = (to - from).abs() / scale / 2.0;
        let middle = f64::midpoint(self.values.start, self.values.end);
        self.values = middle - half..middle + half;
        self
    }

    /// Place of a value, px.
    pub(super) fn at(&self, value: f64) -> f64 {
        let [from, to] = self.px;
        from + (value - self.values.start) / self.span() * (to - from)
    }

    /// Place of a value, or of the nearer end.
    pub(super) fn within(&self, value: f64) -> f64 {
        self.at(value.clamp(self.values.start, self.values.end))
    }

    /// Places of both ends, px.
    pub(super) const fn ends(&self) -> [f64; 2] {
        self.px
    }

    /// Ticks at round numbers, at least about `distance` px apart. Their labels differ from each
    /// other.
    pub(super) fn ticks(&self, distance: f64) -> Vec<Tick> {
        let [from, to] = self.px;
        let count = ((to - from).abs() / distance).max(1.0);
        let least = if self.is_whole { 1.0 } else { 0.0 };
        let step = round_step((self.span() / count).max(least));
        let (first, last) = (
            (self.values.start / step - 1e-9).ceil(),
            (self.values.end / step + 1e-9).floor(),
        );
        let format = Format::of(step, self.values.start.abs().max(self.values.end.abs()));
        // A range that steps do not resolve has no ticks.
        (0..100)
            .map(|number| first + f64::from(number))
            .take_while(|number| *number <= last)
            // Zero without a sign.
            .map(|number| number * step + 0.0)
            .map(|value| Tick {
                value,
                label: format.label(value),
            })
            .collect()
    }
}

/// Returns the smallest and the largest of the finite values.
pub(super) fn extent(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    let finite = values.filter(|value| value.is_finite());
    finite.fold(None, |extent, value| {
        let [low, high] = extent.unwrap_or([value; 2]);
        Some([low.min(value), high.max(value)])
    })
}

/// Returns 1, 2 or 5 times a power of ten that is not less.
fn round_step(least: f64) -> f64 {
    let power = 10_f64.powf(least.log10().floor());
    let factors = [1.0, 2.0, 5.0, 10.0];
    let factor = factors
        .iter()
        .find(|factor| *factor * power >= least * (1.0 - 1e-9));
    factor.copied().unwrap_or(10.0) * power
}

/// Format of numbers that are multiples of a step.
struct Format {
    decimals: usize,
    has_exponent: bool,
}

impl Format {
    /// As many digits as tell one step from the next, for numbers up to `largest`.
    fn of(step: f64, largest: f64) -> Self {
        let place = (step.log10() + 1e-9).floor() as i32;
        let has_exponent = largest >= LARGE || -place > MAX_DECIMALS;
        let highest = if has_exponent {
            largest.log10().floor() as i32
        } else {
            0
        };
        Self {
            decimals: usize::try_from(highest - place).unwrap_or(0),
            has_exponent,
        }
    }

    fn label(&self, value: f64) -> String {
        let decimals = self.decimals;
        if self.has_exponent && value.abs() > 0.0 {
            format!("{value:.decimals$e}")
        } else if self.has_exponent {
            "0".to_owned()
        } else {
            format!("{value:.decimals$}")
        }
    }
}

/// Returns at most `max_count` ticks of a logarithmic axis between two positive numbers: at 1, 2, 5
/// and powers of ten; at equal distances where the range has too few of them.
pub(super) fn logarithmic(low: f64, high: f64, max_count: usize) -> Vec<Tick> {
    let decades = low.log10().floor() as i32..=high.log10().floor() as i32;
    let fine = decades
        .clone()
        .flat_map(|decade| [1.0, 2.0, 5.0].map(|factor| in_decade(factor, decade)));
    let within = low * (1.0 - 1e-9)..=high * (1.0 + 1e-9);
    let fine: Vec<Tick> = fine.filter(|tick| within.contains(&tick.value)).collect();
    if fine.len() < 3 {
        let axis = Axis::of(low..high).spanning(0.0, max_count as f64);
        return axis.ticks(1.5);
    }
    if fine.len() <= max_count {
        return fine;
    }
    let every = decades.clone().count().div_ceil(max_count);
    let powers = decades.step_by(every).map(|decade| in_decade(1.0, decade));
    powers.filter(|tick| within.contains(&tick.value)).collect()
}

fn in_decade(factor: f64, decade: i32) -> Tick {
    let power = 10_f64.powi(decade);
    let value = factor * power;
    Tick {
        value,
        label: Format::of(power, value).label(value),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    fn labels(axis: Axis) -> Vec<String> {
        axis.spanning(0.0, 400.0)
            .ticks(50.0)
            .into_iter()
            .map(|tick| tick.label)
            .collect()
    }

    /// Found from outside: "0.1, 0.0, 0.0, -0.0".
    #[test]
    fn ticks_are_round_numbers_and_zero_has_no_sign() {
        let expected = ["-0.04", "-0.02", "0.00", "0.02", "0.04", "0.06", "0.08"];
        assert_eq!(labels(Axis::of(-0.04..0.08)), expected);
        assert_eq!(
            labels(Axis::of(0.0..1e7)),
            ["0", "2.0e6", "4.0e6", "6.0e6", "8.0e6", "1.0e7"]
        );
        assert_eq!(
            labels(Axis::of(-2e-7..0.0)),
            ["-2.0e-7", "-1.5e-7", "-1.0e-7", "-5.0e-8", "0"]
        );
    }

    #[test]
    fn counted_things_have_whole_ticks() {
        let axis = Axis::around([1.0, 4.0].into_iter(), 0.03);
        assert_eq!(labels(axis), ["1", "2", "3", "4"]);
    }

    proptest! {
        #[test]
        fn labels_are_distinct_and_say_where_their_ticks_stand(
            start in -1e9..1e9_f64, decade in -9..9_i32, span in 1.0..10.0_f64
        ) {
            // Steps below the last place of a double are not resolved.
            let span = span * 10_f64.powi(decade).max(1e-9 * start.abs());
            let axis = Axis::of(start..start + span).spanning(0.0, 400.0);
            let ticks = axis.ticks(50.0);
            prop_assert!((3..=9).contains(&ticks.len()), "{ticks:?}");
            let distinct: BTreeSet<&str> = ticks.iter().map(|tick| tick.label.as_str()).collect();
            prop_assert_eq!(distinct.len(), ticks.len());
            for Tick { value, label } in &ticks {
                prop_assert!(!label.starts_with("-0.0") || label.contains(['1', '2', '5']));
                let named: f64 = label.parse().unwrap();
                prop_assert!((named - value).abs() < 1e-6 * span, "{label} at {value}");
            }
        }

        #[test]
        fn logarithmic_labels_are_distinct(low in 1e-6..1e6_f64, factor in 1.01..1e6_f64) {
            let ticks = logarithmic(low, low * factor, 9);
            prop_assert!((2..=10).contains(&ticks.len()), "{ticks:?}");
            let distinct: BTreeSet<&str> = ticks.iter().map(|tick| tick.label.as_str()).collect();
            prop_assert_eq!(distinct.len(), ticks.len(), "{:?}", ticks);
        }
    }
}
