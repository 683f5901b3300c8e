//! Three views of places with names, in SVG.

use std::fmt::Write;

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
const VIEWS: [(&str, usize, usize); 3] = [("from above", 0, 1), ("from -y", 0, 2), ("from +x", 1, 2)];
const AXES: [&str; 3] = ["x", "y", "z"];
/// Size of a view and its margin, px.
const SIZE: f64 = 300.0;
const MARGIN: f64 = 46.0;
/// Heights of a line of text, px.
const LINE: f64 = 12.0;
const COLOURS: [&str; 2] = ["#1f5fa8", "#b3471d"];

/// Platform joints (none for places in the workspace) and marks from above, from the front and from the right.
pub(super) fn views(joints_m: &[Vector3<f64>], marks: &[Mark]) -> String {
    let width = SIZE * 3.0;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {SIZE}\" font-family=\"sans-serif\" font-size=\"{LINE}\">"
    );
    for (column, (title, right, up)) in VIEWS.into_iter().enumerate() {
        let left = SIZE * crate::fit::statistics::float(column);
        view(&mut svg, (left, title), (right, up), joints_m, marks);
    }
    svg + "</svg>"
}

fn view(
    svg: &mut String,
    (left, title): (f64, &str),
    (right, up): (usize, usize),
    joints_m: &[Vector3<f64>],
    marks: &[Mark],
) {
    let ends = marks.iter().flat_map(|mark| [mark.at_m, mark.at_m - mark.way_m]);
    let mut all: Vec<Vector3<f64>> = ends.chain(joints_m.iter().copied()).collect();
    // The tool centre point, of which the places of a platform are counted.
    if !joints_m.is_empty() {
        all.push(Vector3::zeros());
    }
    let Some(first) = all.first() else { return };
    let (low, high) = all.iter().fold((*first, *first), |(low, high), point| (low.inf(point), high.sup(point)));
    // All views to one scale.
    let scale = (SIZE - 2.0 * MARGIN) / (high - low).max().max(1e-6);
    let middle = (low + high) / 2.0;
    let at = |place: &Vector3<f64>| {
        let x = left + SIZE / 2.0 + (place[right] - middle[right]) * scale;
        (x, SIZE / 2.0 - (place[up] - middle[up]) * scale)
    };
    let (text_x, axes) = (left + 8.0, format!("{} right, {} up", AXES[right], AXES[up]));
    let _ = write!(svg, "<text x=\"{text_x}\" y=\"16\" fill=\"#333\">{title}: {axes}</text>");
    for joint in joints_m {
        let ((x, y), (tool_x, tool_y)) = (at(joint), at(&Vector3::zeros()));
        let _ = write!(
            svg,
            "<line x1=\"{tool_x:.1}\" y1=\"{tool_y:.1}\" x2=\"{x:.1}\" y2=\"{y:.1}\" stroke=\"#bbb\"/>\
             <circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.5\" fill=\"#fff\" stroke=\"#999\"/>"
        );
    }
    if !joints_m.is_empty() {
        let (x, y) = at(&Vector3::zeros());
        let _ = write!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"#c00\"/>");
    }
    let mut taken: Vec<(f64, f64)> = Vec::new();
    for mark in marks {
        let ((x, y), (from_x, from_y)) = (at(&mark.at_m), at(&(mark.at_m - mark.way_m)));
        let colour = COLOURS[usize::from(mark.is_hook)];
        let _ = write!(
            svg,
            "<line x1=\"{from_x:.1}\" y1=\"{from_y:.1}\" x2=\"{x:.1}\" y2=\"{y:.1}\" stroke=\"{colour}\" stroke-width=\"2\"/>\
             <circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"{colour}\"/>"
        );
        if mark.name.is_empty() {
            continue;
        }
        let (label_x, label_y) = free_place(&taken, (x, y));
        taken.push((label_x, label_y));
        let name = crate::plots::page::escape(&mark.name);
        let _ = write!(svg, "<text x=\"{label_x:.1}\" y=\"{label_y:.1}\" fill=\"{colour}\">{name}</text>");
    }
}

/// Place of a name beside a point, below the names that are there already.
fn free_place(taken: &[(f64, f64)], (x, y): (f64, f64)) -> (f64, f64) {
    let x = x + 6.0;
    let is_taken = |place: f64| taken.iter().any(|other| (other.0 - x).abs() < 36.0 && (other.1 - place).abs() < LINE);
    let places = (0..8_u8).flat_map(|step| [1.0, -1.0].map(|side| y - 4.0 + side * LINE * f64::from(step)));
    places.into_iter().find(|place| !is_taken(*place)).map_or((x, y), |place| (x, place))
}
