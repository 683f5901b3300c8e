//! Plots, read back from the SVG.

use std::collections::BTreeSet;

use super::heat::{HeatMap, Scale};
use super::*;

/// An element of a picture.
struct Element<'a> {
    name: &'a str,
    tag: &'a str,
    content: &'a str,
}

impl Element<'_> {
    fn get(&self, key: &str) -> Option<&str> {
        let (_, rest) = self.tag.split_once(&format!(" {key}=\""))?;
        rest.split('"').next()
    }

    fn number(&self, key: &str) -> f64 {
        self.get(key).unwrap().parse().unwrap()
    }

    fn points(&self) -> Vec<[f64; 2]> {
        let points = self.get("points").unwrap().split(' ').map(|point| {
            let (x, y) = point.split_once(',').unwrap();
            [x.parse().unwrap(), y.parse().unwrap()]
        });
        points.collect()
    }
}

fn elements(svg: &Svg) -> Vec<Element<'_>> {
    let parts = svg.as_str().split('<').skip(1);
    parts
        .map(|part| {
            let (tag, content) = part.split_once('>').unwrap();
            let name = tag.split([' ', '/']).next().unwrap();
            Element { name, tag, content }
        })
        .collect()
}

fn lines(svg: &Svg) -> Vec<Vec<[f64; 2]>> {
    let elements = elements(svg);
    let drawn = elements.iter().filter(|element| element.name == "polyline");
    drawn.map(Element::points).collect()
}

/// Ticks of an axis: value and place. Labels of the y axis end at it, those of the x axis are
/// around it.
fn ticks(svg: &Svg, anchor: &str, key: &str) -> Vec<(f64, f64)> {
    let elements = elements(svg);
    let labels = elements.iter().filter(|element| {
        element.get("text-anchor") == Some(anchor) && element.get("font-size") == Some("13")
    });
    labels
        .map(|label| (label.content.parse().unwrap(), label.number(key)))
        .collect()
}

/// Values of places, by the ticks of an axis.
struct Reading {
    low: f64,
    from: f64,
    px_per_unit: f64,
}

impl Reading {
    fn of(ticks: &[(f64, f64)]) -> Self {
        let [(low, from), .., (high, to)] = *ticks else {
            panic!("{ticks:?}")
        };
        let px_per_unit = (to - from) / (high - low);
        Self {
            low,
            from,
            px_per_unit,
        }
    }

    fn value(&self, place: f64) -> f64 {
        self.low + (place - self.from) / self.px_per_unit
    }
}

/// Waves, a spike of 40 um that is 7 ticks wide, and one of a tick downwards.
fn spiked(tick: u32) -> f64 {
    match tick {
        17_003..=17_009 => 40.0,
        23_456 => -31.0,
        _ => 10.0 * (f64::from(tick) * 0.003).sin(),
    }
}

/// Found from outside: 30 000 ticks, of which every tenth was drawn, and the spike with any height
/// up to its own.
#[test]
fn the_highest_and_the_lowest_point_drawn_are_those_of_the_data() {
    let points: Vec<(f64, f64)> = (0..30_000)
        .map(|tick| (f64::from(tick) / 1e3, spiked(tick)))
        .collect();
    let svg = Plot::new("Spike", "time, s", "um", vec![Curve::line("", points)]).svg();
    let drawn = lines(&svg);
    let [line] = drawn.as_slice() else {
        panic!("{} lines", drawn.len())
    };
    assert!(line.len() < 4 * 900, "{} points", line.len());
    let [low, high] = axis::extent(line.iter().map(|point| point[1])).unwrap();
    let y = Reading::of(&ticks(&svg, "end", "y"));
    // Labels stand lower than their ticks.
    let drop = 0.36 * LABEL;
    let [top, bottom] = [low, high].map(|place| y.value(place + drop));
    let tolerance = 0.3 / y.px_per_unit.abs();
    assert!((top - 40.0).abs() < tolerance, "{top}");
    assert!((bottom + 31.0).abs() < tolerance, "{bottom}");
}

#[test]
fn a_line_is_interrupted_where_there_is_no_value() {
    let values = [1.0, 2.0, f64::NAN, 3.0, f64::INFINITY, 2.0, 1.0];
    let points = (0..).map(f64::from).zip(values).collect();
    let svg = Plot::new("Gaps", "x", "y", vec![Curve::line("", points)]).svg();
    let lengths: Vec<usize> = lines(&svg).iter().map(Vec::len).collect();
    assert_eq!(lengths, [2, 2]);
    let dots = elements(&svg).iter().filter(|e| e.name == "circle").count();
    assert_eq!(dots, 1, "the value between two gaps");
    assert!(!svg.as_str().contains("NaN") && !svg.as_str().contains("inf"));
}

fn band(name: &'static str, from: f64) -> Band {
    Band {
        name,
        from,
        to: from + 0.1,
        colour: Colour::of(0xcd_eb_cd),
    }
}

/// Right and upper end of the area of the data, by the lines of the axes.
fn corner(elements: &[Element<'_>]) -> [f64; 2] {
    let axes = elements
        .iter()
        .filter(|e| e.name == "line" && e.get("stroke") == Some("#777777"));
    let ends = axes.map(|axis| [axis.number("x2"), axis.number("y2")]);
    ends.reduce(|[right, top], [x, y]| [right.max(x), top.min(y)])
        .unwrap()
}

/// Found from outside: the worst pair lay under the legend.
#[test]
fn legends_stand_outside_of_the_data_and_name_every_curve_and_band() {
    for count in [2, 9, 40] {
        let curves = (0..count)
            .map(|number| Curve::line(&format!("series s{number}"), vec![(0.0, 0.0), (1.0, 1.0)]));
        let plot = Plot::new("Legend", "x", "y", curves.collect());
        let bands = [("Obtain", 0.0), ("Fault", 0.2), ("Obtain", 0.4)];
        let bands = bands.map(|(name, from)| band(name, from));
        let svg = plot.with_bands(bands.into()).svg();
        let elements = elements(&svg);
        let [right, top] = corner(&elements);
        let names = elements
            .iter()
            .filter(|e| e.name == "text" && e.get("text-anchor").is_none());
        let names: Vec<&Element<'_>> = names.collect();
        assert_eq!(names.len(), count + 2);
        for (number, name) in names.iter().enumerate() {
            assert!(name.number("y") + 0.3 * LABEL < top, "{}", name.content);
            let end = name.number("x") + width(name.content.chars().count(), LABEL);
            assert!(end <= right, "{} ends at {end}", name.content);
            let next = names
                .get(number + 1)
                .filter(|next| next.get("y") == name.get("y"));
            assert!(next.is_none_or(|next| next.number("x") > end));
        }
        assert_eq!(svg.as_str().matches(">Obtain<").count(), 1);
    }
}

/// Found from outside: arrows whose axes were 2.8 to 3.9 : 1.
#[test]
fn equal_axes_draw_a_unit_equally_long_both_ways() {
    for (wide, high) in [(3.0, 0.7), (0.2, 5.0)] {
        let places = vec![(-wide, 0.0), (wide, high)];
        let plot = Plot::new("Places", "x, m", "y, m", vec![Curve::dots("", places)]);
        let svg = plot.with_equal_axes().svg();
        let x = Reading::of(&ticks(&svg, "middle", "x")).px_per_unit;
        let y = Reading::of(&ticks(&svg, "end", "y")).px_per_unit;
        assert!((x / y + 1.0).abs() < 2e-3, "{x} and {y} px");
    }
}

/// Found from outside: 8 colours for 9 series.
#[test]
fn every_curve_has_a_look_of_its_own_with_and_without_colour() {
    let flat = (0..look::COUNT)
        .map(|number| Curve::line(&format!("{number}"), vec![(0.0, 0.0), (1.0, 0.0)]));
    let svg = Plot::new("Looks", "x", "y", flat.collect()).svg();
    let elements = elements(&svg);
    let drawn = elements.iter().filter(|e| e.name == "polyline");
    let looks: BTreeSet<_> = drawn
        .map(|line| (line.get("stroke"), line.get("stroke-dasharray")))
        .collect();
    assert_eq!(looks.len(), look::COUNT);
    for count in [2, 5, 10] {
        let dots = (0..count).map(|number| Curve::dots(&format!("{number}"), vec![(0.0, 0.0)]));
        let svg = Plot::new("Looks", "x", "y", dots.collect()).svg();
        let elements = self::elements(&svg);
        let dots = elements
            .iter()
            .filter(|e| ["circle", "polygon"].contains(&e.name));
        let colours: BTreeSet<_> = dots.map(|dot| dot.get("fill")).collect();
        assert_eq!(colours.len(), count);
    }
}

#[test]
fn a_plot_says_what_it_is_to_those_who_do_not_see_it() {
    let curves = ["a < b", "c"].map(|name| Curve::line(name, vec![(0.0, 0.0)]));
    let svg = Plot::new("Title & more", "time, s", "way, µm", curves.into()).svg();
    let elements = elements(&svg);
    assert_eq!(elements[0].get("role"), Some("img"));
    let label = "Title &amp; more: way, µm over time, s; a &lt; b, c";
    assert_eq!(elements[0].get("aria-label"), Some(label));
    assert_eq!(
        (elements[1].name, elements[1].content),
        ("title", "Title &amp; more")
    );
}

/// Found from outside: at singular edges values are a million times as large, and used up the
/// colours of all others.
#[test]
fn a_scale_of_colours_is_not_used_up_by_singular_edges_and_shows_them() {
    let values: Vec<f64> = (0..600)
        .map(|index| match index % 5 {
            0 => 1e6,
            _ => 1.0 + f64::from(index % 50) / 50.0,
        })
        .collect();
    let cells = (0..).map(f64::from).zip(&values);
    let map = HeatMap {
        title: "Edges".to_owned(),
        x_axis: "x, m",
        y_axis: "y, m",
        value: "condition number",
        pitch: 1.0,
        cells: cells
            .map(|(place, value)| (place % 30.0, (place / 30.0).floor(), *value))
            .collect(),
        mark: (1.0, 1.0),
        scale: Scale::of(values),
    };
    let svg = map.svg();
    let elements = elements(&svg);
    let labels = elements
        .iter()
        .filter(|e| e.get("text-anchor") == Some("start"));
    let labels: Vec<&str> = labels.map(|label| label.content).collect();
    let [others @ .., end] = labels.as_slice() else {
        panic!("{labels:?}")
    };
    let end: f64 = end.strip_prefix("≥ ").unwrap().parse().unwrap();
    assert!((2.0..3.0).contains(&end), "{labels:?}");
    let others = others.iter().map(|label| label.parse::<f64>().unwrap());
    assert!(others.fold(0.0, f64::max) < end, "{labels:?}");
    let points = elements.iter().filter(|element| element.name == "polygon");
    assert_eq!(points.count(), 1, "the upper end has a point");
}

#[test]
fn a_scale_of_colours_without_outliers_has_all_values() {
    let low = Scale::of((1..=9).map(f64::from)).colour(1.0);
    assert_ne!(low, Scale::of((1..=9).map(f64::from)).colour(1.2));
    // All alike.
    let scale = Scale::of([2.0; 5]);
    assert_ne!(scale.colour(2.0), scale.colour(2.02));
}
