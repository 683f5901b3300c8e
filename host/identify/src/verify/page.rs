//! The pages of `verify`.

use std::collections::BTreeMap;
use std::fmt::Write;

use gantry_tau_report::page::Page;
use gantry_tau_report::plots::heat::{Cell, HeatMap, Scale};
use gantry_tau_report::plots::{Curve, Plot};
use gantry_tau_report::workspace::add_slices;
use nalgebra::Vector3;

use super::measured::PairResult;
use super::predict::{PlacePrediction, Prediction, Remainder};
use super::summary::Verification;

/// Side of a measured place on its map, m.
const SIDE_M: f64 = 0.05;
/// Planes of the maps of measured places: the world axes that point right and up.
const PLANES: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];
const AXES: [&str; 3] = ["x, m", "y, m", "z, m"];

/// Returns the page of a prediction; `method` names the computation of the corrections.
#[must_use]
pub fn prediction_page(
    robot: &str,
    method: &str,
    prediction: &Prediction,
    doubts: &[String],
) -> String {
    let mut page = Page::new(
        "gantry-tau verify --predict",
        format!("Predicted remainder of {robot}"),
    );
    page.paragraph(format!("Corrections: {method}. {}", loads(prediction)));
    add_doubts(&mut page, doubts);
    page.preformatted(prediction.summary().to_string());
    add_maps(&mut page, prediction);
    page.html()
}

/// Returns the page of a verification, with home (world axes, m) as a cross on its maps, and with
/// the maps of a prediction of the same file where there is one.
#[must_use]
pub fn verification_page(
    robot: &str,
    home_m: &Vector3<f64>,
    verification: &Verification,
    prediction: Option<&Prediction>,
    doubts: &[String],
) -> String {
    let mut page = Page::new("gantry-tau verify", format!("Verification of {robot}"));
    page.paragraph(format!(
        "{}: pairs of windows with compensation off and on, against what the robot file predicts. In each series \
         of the table, rows without a load give the zeros of the gauges. Two rows with the same window and a load are a pair: of one series, \
         or of two, one of which was measured with compensation. The q of the one with compensation contains the offsets.",
        verification.measurements
    ));
    add_doubts(&mut page, doubts);
    page.preformatted(verification.to_string());
    page.section("Measured and predicted remainder");
    page.paragraph(
        "Displacement that remains with compensation, pair by pair in the order of the table. The prediction is that of the robot file at \
         the measured positions of the axes and loads; its interval (95 %) is that of springs, gauges and loads.",
    );
    page.picture(&pairs_plot(verification).svg());
    add_measured_maps(&mut page, verification, home_m);
    page.section("Pairs");
    page.preformatted(table(&verification.pairs));
    if let Some(prediction) = prediction {
        page.section("Prediction over the workspace");
        page.paragraph(loads(prediction));
        page.preformatted(prediction.summary().to_string());
        add_maps(&mut page, prediction);
    }
    page.html()
}

fn add_doubts(page: &mut Page, doubts: &[String]) {
    if !doubts.is_empty() {
        page.warning(format!("Not to be trusted as it is: {}", doubts.join("; ")));
    }
}

fn loads(prediction: &Prediction) -> String {
    let Prediction {
        force_n,
        workpiece_n_per_m,
        ..
    } = prediction;
    format!(
        "Loads of {force_n:.0} N at the tool centre point along the axes of the world and the diagonals between them, both ways; platform \
         unturned; workpiece of {workpiece_n_per_m:.1e} N/m."
    )
}

fn add_maps(page: &mut Page, prediction: &Prediction) {
    add_map(
        page,
        prediction,
        "Expected remainder",
        "Largest over the loads that are judged: root mean square over the machines that the file takes for possible.",
        "µm",
        |place| Some(place.worst(Remainder::expected_m)? * 1e6),
    );
    add_map(
        page,
        prediction,
        "Displacement without compensation",
        "Largest over the same loads.",
        "µm",
        |place| Some(place.worst(|load| load.before_m)? * 1e6),
    );
    add_map(
        page,
        prediction,
        "Loads across the jump",
        "Number of loads under which cluster 3 may change sides; its play is not compensated, and these loads are not judged.",
        "loads",
        across_the_jump,
    );
    add_map(
        page,
        prediction,
        "Largest static gain against the workpiece",
        "Largest client.gain that is not statically unstable in contact, in the direction in which it is smallest, with 97.5 % confidence. \
         It is below 1 by what the springs are not known to, and above by what the workpiece gives way.",
        "gain",
        |place| Some(place.largest_gain),
    );
}

fn add_map(
    page: &mut Page,
    prediction: &Prediction,
    title: &str,
    text: &str,
    value: &'static str,
    of: impl Fn(&PlacePrediction) -> Option<f64>,
) {
    let values = prediction
        .places
        .iter()
        .filter_map(|place| Some((Vector3::from(place.tool_m), of(place)?)));
    let values: Vec<(Vector3<f64>, f64)> = values.collect();
    add_slices(page, &prediction.grid, title, text, value, &values);
}

fn across_the_jump(place: &PlacePrediction) -> Option<f64> {
    let across = place.loads.iter().filter(|load| load.changes_sides).count();
    let across = u32::try_from(across).ok().filter(|count| *count > 0)?;
    Some(f64::from(across))
}

fn pairs_plot(verification: &Verification) -> Plot {
    let (judged, apart): (Vec<_>, Vec<_>) = (1..)
        .map(f64::from)
        .zip(&verification.pairs)
        .partition(|(_, pair)| pair.is_judged());
    let mut curves = vec![
        Curve::dots("measured", by_number(&judged, |pair| pair.after_m)),
        Curve::dots("predicted", by_number(&judged, |pair| pair.predicted_m)),
        Curve::line(
            "upper end of the interval",
            by_number(&judged, |pair| {
                let [_, upper] = pair.interval95_m;
                upper
            }),
        ),
    ];
    if !apart.is_empty() {
        let measured = by_number(&apart, |pair| pair.after_m);
        curves.push(Curve::dots("measured, not judged", measured));
    }
    Plot::new(
        "Measured and predicted remainder",
        "pair",
        "remainder, µm",
        curves,
    )
}

/// Values of numbered pairs, µm.
fn by_number(pairs: &[(f64, &PairResult)], value: fn(&PairResult) -> f64) -> Vec<(f64, f64)> {
    let pairs = pairs.iter();
    pairs
        .map(|(number, pair)| (*number, value(pair) * 1e6))
        .collect()
}

/// Adds maps of the measured places, seen along the axes of the world; one cell per pose with its
/// largest remainder.
fn add_measured_maps(page: &mut Page, verification: &Verification, home_m: &Vector3<f64>) {
    let mut places: BTreeMap<[i64; 3], ([f64; 3], f64)> = BTreeMap::new();
    for pair in verification.pairs.iter().filter(|pair| pair.is_judged()) {
        let key = pair.tool_m.map(|metres| (metres * 1e3).round() as i64);
        let (_, largest) = places.entry(key).or_insert((pair.tool_m, 0.0));
        *largest = largest.max(pair.after_m * 1e6);
    }
    let mut places: Vec<([f64; 3], f64)> = places.into_values().collect();
    // The largest is drawn last, and covers those behind it.
    places.sort_by(|(_, one), (_, other)| one.total_cmp(other));
    if places.is_empty() {
        return;
    }
    page.section("Where it was measured");
    page.paragraph(
        "Largest measured remainder of each pose, seen along the axes of the world; of poses behind each other the largest shows. The \
         cross is home.",
    );
    let scale = Scale::of(places.iter().map(|(_, value)| value.max(1e-3)));
    page.pictures(PLANES.map(|(right, up)| {
        let map = HeatMap {
            title: format!("Where it was measured, {} over {}", AXES[up], AXES[right]),
            x_axis: AXES[right],
            y_axis: AXES[up],
            value: "µm",
            pitch: SIDE_M,
            cells: places
                .iter()
                .map(|(place, value)| -> Cell { (place[right], place[up], *value) })
                .collect(),
            mark: (home_m[right], home_m[up]),
            scale,
        };
        map.svg()
    }));
}

fn table(pairs: &[PairResult]) -> String {
    let mut text = String::from(
        "series, window                 force, N           uncompensated   compensated   predicted (95 %), um      z\n",
    );
    for pair in pairs {
        let [x, y, z, ..] = pair.load;
        let [low, high] = pair.interval95_m.map(|metres| metres * 1e6);
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "{:<22} {x:8.1} {y:8.1} {z:8.1}   {:13.2}   {:11.2}   {:6.2} ({low:.2} to {high:.2})   {:6.2}{}",
            format!("{}, {}", pair.series, pair.window),
            pair.before_m * 1e6,
            pair.after_m * 1e6,
            pair.predicted_m * 1e6,
            pair.z,
            match pair {
                PairResult {
                    changes_sides: true,
                    ..
                } => "  across the jump",
                PairResult {
                    saturated: true, ..
                } => "  at an offset limit",
                _ => "",
            }
        );
    }
    text
}
