//! `workspace.html`: slices of the map through home.
#![expect(
    clippy::indexing_slicing,
    reason = "axes of the world: 0, 1 or 2 of a vector with three entries"
)]

use gantry_tau_core::model::robot::ARMS;
use gantry_tau_machine::workspace::map::{Grid, Reached};
use gantry_tau_machine::workspace::{Summary, Survey};
use nalgebra::Vector3;

use crate::page::Page;
use crate::plots::heat::{Cell, HeatMap, Scale};

/// Number and name of an axis of the world.
type Axis = (usize, &'static str);

const X: Axis = (0, "x, m");
const Y: Axis = (1, "y, m");
const Z: Axis = (2, "z, m");
/// Planes through home: their names, and the axes that point right and up.
const PLANES: [(&str, Axis, Axis); 3] = [("z", X, Y), ("y", X, Z), ("x", Y, Z)];

/// Returns the page of a survey.
#[must_use]
pub fn page<const N: usize>(survey: &Survey<N>, summary: &Summary) -> String {
    let mut page = Page::new(
        "gantry-tau workspace",
        format!("Workspace of {}", survey.name),
    );
    page.preformatted(summary.to_string());
    page.paragraph(
        "Slices through home (the cross), with the platform unturned. White is out of reach, \
         or beyond the nominal travel.",
    );
    let turned = if N > ARMS {
        format!(
            " A radian of the platform counts as {:.3} m, the mean distance of its joints from the tool; a plate's axis as its screw's way.",
            survey.radian_m
        )
    } else {
        String::new()
    };
    add_slices(
        &mut page,
        &survey.grid,
        "Condition number of the Jacobian",
        &format!(
            "Largest over smallest speed of the tool for the same speed of the axes: 1 is even, large is near a singularity.{turned}"
        ),
        "condition number",
        &values(survey, |reached| Some(reached.condition)),
    );
    if summary.compliance_um_per_n.is_some() {
        add_slices(
            &mut page,
            &survey.grid,
            "Compliance at the tool",
            "Displacement per force at the tool centre point, in the direction in which it is largest.",
            "µm/N",
            &values(survey, |reached| {
                reached.compliance_m_per_n.map(|c| c * 1e6)
            }),
        );
    }
    page.html()
}

/// Returns a value of every place that is reached.
fn values<const N: usize>(
    survey: &Survey<N>,
    of: impl Fn(&Reached<N>) -> Option<f64>,
) -> Vec<(Vector3<f64>, f64)> {
    let values = survey
        .places
        .iter()
        .filter_map(|place| Some((place.tool_m, of(place.reached.as_ref().ok()?)?)));
    values.collect()
}

/// Adds a section with three maps of values at places of a grid: the planes through home.
pub fn add_slices(
    page: &mut Page,
    grid: &Grid,
    title: &str,
    text: &str,
    value: &'static str,
    values: &[(Vector3<f64>, f64)],
) {
    page.section(title);
    page.paragraph(text);
    let scale = Scale::of(values.iter().map(|(_, value)| *value));
    page.named_pictures(PLANES.map(|(normal, (right, x_axis), (up, y_axis))| {
        let plane = format!("{normal} = home");
        let map = HeatMap {
            title: format!("{title}, {plane}"),
            x_axis,
            y_axis,
            value,
            pitch: grid.pitch_m,
            cells: cells(grid, right, up, values),
            mark: (grid.home_m[right], grid.home_m[up]),
            scale,
        };
        (plane, map.svg())
    }));
}

/// Returns the places of the plane through home.
fn cells(grid: &Grid, right: usize, up: usize, values: &[(Vector3<f64>, f64)]) -> Vec<Cell> {
    let in_plane = values.iter().filter(|(place_m, _)| {
        let away = place_m - grid.home_m;
        let mut across = (0..3).filter(|axis| *axis != right && *axis != up);
        across.all(|axis| away[axis].abs() < grid.pitch_m / 2.0)
    });
    in_plane
        .map(|(place_m, value)| (place_m[right], place_m[up], *value))
        .collect()
}
