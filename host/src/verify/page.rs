//! The pages of `verify`.

use std::collections::BTreeMap;
use std::fmt::Write;

use nalgebra::Vector3;

use super::measured::PairResult;
use super::predict::{PlacePrediction, Prediction, Remainder};
use super::summary::Verification;
use crate::plots::heat::{Cell, HeatMap};
use crate::plots::page::{escape, page};
use crate::plots::{Corner, Curve, Plot};
use crate::workspace::slices;

/// Side of a measured place on its map, m.
const SIDE_M: f64 = 0.05;
/// Planes of the maps of measured places: the world axes that point right and up.
const PLANES: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];
const AXES: [&str; 3] = ["x, m", "y, m", "z, m"];

/// Returns the page of a prediction; `method` names the computation of the corrections.
#[must_use]
pub fn prediction_page(robot: &str, method: &str, prediction: &Prediction, doubts: &[String]) -> String {
    let mut body = format!(
        "<h1>Predicted remainder of {}</h1><p>Corrections: {method}. {}</p>{}<pre>{}</pre>",
        escape(robot),
        loads(prediction),
        doubted(doubts),
        escape(&prediction.summary().to_string())
    );
    body.push_str(&maps(prediction));
    page("gantry-tau verify --predict", &body)
}

/// Returns the page of a verification, with home (world axes, m) as a cross on its maps, and with the maps of a prediction of the same file where there is one.
#[must_use]
pub fn verification_page(
    robot: &str,
    home_m: &Vector3<f64>,
    verification: &Verification,
    prediction: Option<&Prediction>,
    doubts: &[String],
) -> String {
    let mut body = format!(
        "<h1>Verification of {}</h1><p>{}: pairs of windows with compensation off and on, against what the robot file predicts. In each series \
         of the table, rows without a load give the zeros of the gauges. Two rows with the same window and a load are a pair: of one series, \
         or of two, one of which was measured with compensation. The q of the one with compensation contains the offsets.</p>{}<pre>{}</pre>",
        escape(robot),
        escape(&verification.measurements),
        doubted(doubts),
        escape(&verification.to_string())
    );
    let text = "Displacement that remains with compensation, pair by pair in the order of the table. The prediction is that of the robot file at \
                the measured positions of the axes and loads; its interval (95 %) is that of springs, gauges and loads.";
    body.push_str(&format!("<h2>Measured and predicted remainder</h2><p>{text}</p>{}", pairs_plot(verification).svg()));
    body.push_str(&measured_maps(verification, home_m));
    body.push_str(&format!("<h2>Pairs</h2><pre>{}</pre>", escape(&table(&verification.pairs))));
    if let Some(prediction) = prediction {
        body.push_str(&format!("<h2>Prediction over the workspace</h2><p>{}</p>", loads(prediction)));
        body.push_str(&format!("<pre>{}</pre>{}", escape(&prediction.summary().to_string()), maps(prediction)));
    }
    page("gantry-tau verify", &body)
}

fn doubted(doubts: &[String]) -> String {
    if doubts.is_empty() {
        return String::new();
    }
    format!("<p class=\"bad\">Not to be trusted as it is: {}</p>", escape(&doubts.join("; ")))
}

fn loads(prediction: &Prediction) -> String {
    let Prediction { force_n, workpiece_n_per_m, .. } = prediction;
    format!(
        "Loads of {force_n:.0} N at the tool centre point along the axes of the world and the diagonals between them, both ways; platform \
         unturned; workpiece of {workpiece_n_per_m:.1e} N/m."
    )
}

fn maps(prediction: &Prediction) -> String {
    let map = |title: &str, text: &str, value: &'static str, of: &dyn Fn(&PlacePrediction) -> Option<f64>| {
        let values = prediction.places.iter().filter_map(|place| Some((Vector3::from(place.tool_m), of(place)?)));
        slices(&prediction.grid, title, text, value, &values.collect::<Vec<_>>())
    };
    let um = |of: fn(&Remainder) -> f64| move |place: &PlacePrediction| Some(place.worst(of)? * 1e6);
    let jump = |place: &PlacePrediction| {
        let across = place.loads.iter().filter(|load| load.changes_sides).count();
        let across = u32::try_from(across).ok().filter(|count| *count > 0)?;
        Some(f64::from(across))
    };
    [
        map(
            "Expected remainder",
            "Largest over the loads that are judged: root mean square over the machines that the file takes for possible.",
            "µm",
            &um(Remainder::expected_m),
        ),
        map("Displacement without compensation", "Largest over the same loads.", "µm", &um(|load| load.before_m)),
        map(
            "Loads across the jump",
            "Number of loads under which cluster 3 may change sides; its play is not compensated, and these loads are not judged.",
            "loads",
            &jump,
        ),
        map(
            "Largest gain against the workpiece",
            "Largest client.gain that is stable in contact, in the direction in which it is smallest, with 97.5 % confidence. \
             It is below 1 by what the springs are not known to, and above by what the workpiece gives way.",
            "gain",
            &|place| Some(place.largest_gain),
        ),
    ]
    .concat()
}

fn pairs_plot(verification: &Verification) -> Plot {
    let judged = |apart: bool| {
        let numbered = (1..).zip(&verification.pairs);
        numbered.filter(move |(_, pair)| pair.is_judged() != apart).map(|(number, pair)| (f64::from(number), pair))
    };
    let dots = |name: &str, apart: bool, value: fn(&PairResult) -> f64| {
        Curve::dots(name, judged(apart).map(|(number, pair)| (number, value(pair) * 1e6)).collect())
    };
    let upper = |pair: &PairResult| {
        let [_, upper] = pair.interval95_m;
        upper
    };
    let mut curves = vec![
        dots("measured", false, |pair| pair.after_m),
        dots("predicted", false, |pair| pair.predicted_m),
        Curve::line(
            "upper end of the interval",
            judged(false).map(|(number, pair)| (number, upper(pair) * 1e6)).collect(),
        ),
    ];
    if judged(true).next().is_some() {
        curves.push(dots("measured, not judged", true, |pair| pair.after_m));
    }
    Plot {
        x_axis: "pair",
        y_axis: "remainder, µm",
        curves,
        bands: Vec::new(),
        y_names: Vec::new(),
        key: Corner::UpperLeft,
    }
}

/// Maps of the measured places, seen along the axes of the world; one cell per pose with its largest remainder.
fn measured_maps(verification: &Verification, home_m: &Vector3<f64>) -> String {
    let mut places: BTreeMap<[i64; 3], ([f64; 3], f64)> = BTreeMap::new();
    for pair in verification.pairs.iter().filter(|pair| pair.is_judged()) {
        let key = pair.tool_m.map(|metres| (metres * 1e3).round() as i64);
        let (_, largest) = places.entry(key).or_insert((pair.tool_m, 0.0));
        *largest = largest.max(pair.after_m * 1e6);
    }
    let mut places: Vec<([f64; 3], f64)> = places.into_values().collect();
    // The largest is drawn last, and covers those behind it.
    places.sort_by(|(_, one), (_, other)| one.total_cmp(other));
    let (Some((_, low)), Some((_, high))) = (places.first(), places.last()) else { return String::new() };
    let low = low.max(1e-3);
    let text = "Largest measured remainder of each pose, seen along the axes of the world; of poses behind each other the largest shows. The \
                cross is home.";
    let mut section = format!("<h2>Where it was measured</h2><p>{text}</p><div class=\"row\">");
    for (right, up) in PLANES {
        let map = HeatMap {
            x_axis: AXES[right],
            y_axis: AXES[up],
            value: "µm",
            pitch: SIDE_M,
            cells: places.iter().map(|(place, value)| -> Cell { (place[right], place[up], *value) }).collect(),
            mark: (home_m[right], home_m[up]),
            scale: (low, high.max(1.01 * low)),
        };
        section.push_str(&format!("<div>{}</div>", map.svg()));
    }
    section + "</div>"
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
                PairResult { changes_sides: true, .. } => "  across the jump",
                PairResult { saturated: true, .. } => "  at an offset limit",
                _ => "",
            }
        );
    }
    text
}
