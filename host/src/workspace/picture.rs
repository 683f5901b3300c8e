//! `workspace.html`: slices of the map through home.

use gantry_tau_core::model::robot::ARMS;
use nalgebra::Vector3;

use super::map::{Grid, Reached};
use super::{Summary, Survey};
use crate::plots::heat::{Cell, HeatMap};
use crate::plots::page::{self, escape};

/// A plane through home: its name, and the world axes that point right and up.
const PLANES: [(&str, usize, usize); 3] = [("z", 0, 1), ("y", 0, 2), ("x", 1, 2)];
const AXES: [&str; 3] = ["x, m", "y, m", "z, m"];

pub(super) fn page<const N: usize>(survey: &Survey<N>, summary: &Summary) -> String {
    let mut body = format!(
        "<h1>Workspace of {}</h1><pre>{}</pre><p>Slices through home (the cross), with the platform unturned. White is out of reach, \
         or beyond the nominal travel.</p>",
        escape(&survey.name),
        escape(&summary.to_string()),
    );
    let turned = if N > ARMS {
        format!(
            " A radian of the platform counts as {:.3} m, the mean distance of its joints from the tool; a plate's axis as its screw's way.",
            survey.radian_m
        )
    } else {
        String::new()
    };
    body.push_str(&section(
        survey,
        "Condition number of the Jacobian",
        &format!("Largest over smallest speed of the tool for the same speed of the axes: 1 is even, large is near a singularity.{turned}"),
        "condition number",
        |reached| Some(reached.condition),
    ));
    if summary.compliance_um_per_n.is_some() {
        body.push_str(&section(
            survey,
            "Compliance at the tool",
            "Displacement per force at the tool centre point, in the direction in which it is largest.",
            "µm/N",
            |reached| reached.compliance_m_per_n.map(|c| c * 1e6),
        ));
    }
    page::page("gantry-tau workspace", &body)
}

fn section<const N: usize>(
    survey: &Survey<N>,
    title: &str,
    text: &str,
    value: &'static str,
    of: impl Fn(&Reached<N>) -> Option<f64>,
) -> String {
    let reached = survey.places.iter().filter_map(|place| Some((place.tool_m, of(place.reached.as_ref().ok()?)?)));
    slices(&survey.grid, title, text, value, &reached.collect::<Vec<_>>())
}

/// Returns a section of a page with three maps of values at places of a grid: the planes through home.
pub(crate) fn slices(
    grid: &Grid,
    title: &str,
    text: &str,
    value: &'static str,
    values: &[(Vector3<f64>, f64)],
) -> String {
    let scale = scale(values);
    let mut section = format!("<h2>{title}</h2><p>{text}</p><div class=\"row\">");
    for (normal, right, up) in PLANES {
        let map = HeatMap {
            x_axis: axis(right),
            y_axis: axis(up),
            value,
            pitch: grid.pitch_m,
            cells: cells(grid, right, up, values),
            mark: (component(grid, right), component(grid, up)),
            scale,
        };
        section.push_str(&format!("<div><h3>{normal} = home</h3>{}</div>", map.svg()));
    }
    section + "</div>"
}

/// Returns the smallest value and one that 95 % stay below: near a singularity values are unbounded.
fn scale(values: &[(Vector3<f64>, f64)]) -> (f64, f64) {
    let mut values: Vec<f64> = values.iter().map(|(_, value)| *value).collect();
    values.sort_by(f64::total_cmp);
    let low = values.first().copied().unwrap_or(1.0);
    let high = values.get(values.len() * 19 / 20).copied().unwrap_or(low);
    (low, high.max(1.01 * low))
}

/// Returns the places of the plane through home.
fn cells(grid: &Grid, right: usize, up: usize, values: &[(Vector3<f64>, f64)]) -> Vec<Cell> {
    let in_plane = |place_m: &Vector3<f64>| {
        let away = place_m - grid.home_m;
        let across = (0..3).filter(|axis| *axis != right && *axis != up);
        across.filter_map(|axis| away.get(axis)).all(|away| away.abs() < grid.pitch_m / 2.0)
    };
    let in_plane = values.iter().filter(|(place_m, _)| in_plane(place_m));
    in_plane.filter_map(|(place_m, value)| Some((*place_m.get(right)?, *place_m.get(up)?, *value))).collect()
}

fn axis(index: usize) -> &'static str {
    AXES.get(index).copied().unwrap_or_default()
}

fn component(grid: &Grid, axis: usize) -> f64 {
    grid.home_m.get(axis).copied().unwrap_or(0.0)
}
