//! Pages in few lines: every word, and of each plot its labels and where its marks lie.

use std::collections::BTreeMap;
use std::fmt::Write;

/// Returns the text of a page, a line per cell of its tables; plots by their labels and marks.
pub(super) fn text_of(page: &str) -> String {
    let mut text = String::new();
    let mut rest = page.split_once("</style>").map_or(page, |(_, body)| body);
    while let Some((before, plot)) = rest.split_once("<svg") {
        text += &words(before);
        let (plot, after) = plot.split_once("</svg>").unwrap();
        text += &marks(plot);
        rest = after;
    }
    text + &words(rest)
}

/// Words between tags, those of a class with its name.
fn words(html: &str) -> String {
    let mut text = String::new();
    for element in html.split('<') {
        let (tag, content) = element.split_once('>').unwrap_or(("", element));
        let content = content.trim();
        if content.is_empty() {
            continue;
        }
        match tag.split_once("class=") {
            Some((_, class)) => _ = writeln!(text, "{class} {content}"),
            None => _ = writeln!(text, "{content}"),
        }
    }
    text
}

/// Labels of a plot with their places; marks by kind and colour: their number, and means of what
/// they are drawn by.
fn marks(svg: &str) -> String {
    let mut text = "plot\n".to_owned();
    let mut kinds: BTreeMap<String, Vec<Vec<f64>>> = BTreeMap::new();
    for element in svg.split('<').skip(1) {
        let (tag, content) = element.split_once('>').unwrap_or((element, ""));
        let name = tag.split([' ', '/']).next().unwrap();
        if ["text", "title"].contains(&name) && !content.trim().is_empty() {
            let place =
                ["x", "y"].map(|key| pixels(&attribute(tag, key).unwrap_or("0").parse().unwrap()));
            _ = writeln!(text, "  {} at {} {}", content.trim(), place[0], place[1]);
        }
        let colours = ["fill", "stroke"].map(|key| attribute(tag, key).unwrap_or("-"));
        let drawn: Vec<f64> = [
            "x", "y", "x1", "y1", "x2", "y2", "cx", "cy", "r", "width", "height", "points", "d",
        ]
        .iter()
        .filter_map(|key| attribute(tag, key))
        .flat_map(|value| value.split(|letter: char| !"0123456789.-".contains(letter)))
        .filter_map(|value| value.parse().ok())
        .collect();
        if name != "text" && !drawn.is_empty() {
            kinds
                .entry(format!("{name} {} {}", colours[0], colours[1]))
                .or_default()
                .push(drawn);
        }
    }
    for (kind, marks) in kinds {
        let count = marks.len();
        let all: Vec<f64> = marks.into_iter().flatten().collect();
        // Weights in the order of the marks: which belongs where counts, too.
        let means = [
            mean(&all, |_| 1.0),
            mean(&all, |place| (0.7 * place).sin()),
            mean(&all, |place| (0.011 * place).cos()),
        ];
        _ = writeln!(
            text,
            "  {kind} {count} {:.2} {:.2} {:.2}",
            means[0], means[1], means[2]
        );
    }
    text
}

/// Mean of values by weights of their places.
fn mean(values: &[f64], weight: impl Fn(f64) -> f64) -> f64 {
    let places = (0_u32..).map(f64::from);
    let weighted = values.iter().zip(places);
    let sum: f64 = weighted.map(|(value, place)| value * weight(place)).sum();
    sum / f64::from(u32::try_from(values.len()).unwrap())
}

/// A place to a pixel, as a number that may be one off.
fn pixels(value: &f64) -> String {
    format!("{value:.0}.")
}

fn attribute<'a>(tag: &'a str, key: &str) -> Option<&'a str> {
    tag.split_once(&format!(" {key}=\""))?.1.split('"').next()
}
