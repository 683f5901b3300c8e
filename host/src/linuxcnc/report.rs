//! The page of a demonstration in LinuxCNC.

use gantry_tau_core::control::message::Phase;
use gantry_tau_core::model::robot::ARMS;
use nalgebra::Vector3;

use super::results::{LOADED_N, Results, stretches};
use super::table;
use super::tool::{Moment, norm};
use crate::plots::page::{self, escape};
use crate::plots::{Corner, Curve, Plot, over_time};

/// Largest length of a drawn displacement, mm of the path.
const DRAWN_MM: f64 = 50.0;
/// Shortest path that is drawn, periods.
const PATH_PERIODS: usize = 1_000;
/// Points of a drawn path, and periods shown before and after a ramp.
const PATH_POINTS: usize = 3_000;
const AROUND: u64 = 500;

/// Returns the page as HTML; `said` is what the demonstration printed.
pub(super) fn render<const N: usize>(results: &Results, moments: &[Moment<N>], said: &str) -> String {
    let verdict = if results.complaints.is_empty() {
        String::new()
    } else {
        format!("<p class=\"bad\">Not as it should be: {}</p>", escape(&results.complaints.join("; ")))
    };
    let mut sections = paths(moments);
    sections.extend([
        (
            "Displacement of the tool by the load",
            "Length of the displacement, with the offsets in the references and without. Where a client has ended, the offsets ramp to zero, \
             and both become one; after the load is released the rest of a ramp is all there is."
                .to_owned(),
            displacement(moments),
        ),
        ("Offsets of the axes", "In the references of the drives: reference minus LinuxCNC's command.".to_owned(), offsets(moments)),
    ]);
    if let Some(plot) = ramp(moments) {
        let text = "The client is killed in mid-path: every offset goes to zero by 0.1 µm per period, and LinuxCNC's path goes on.";
        sections.push(("The ramp", text.to_owned(), plot));
    }
    if N > ARMS {
        let text = "Angle of the platform's turning, with the offsets and without.";
        sections.push(("Turning of the platform by the load", text.to_owned(), turning(moments)));
    }
    sections.push(("Force on the tool", "As the sensor shows it, world axes.".to_owned(), force(moments)));
    sections.push((
        "Position of the tool",
        "As LinuxCNC commands it, from the first session's first period.".to_owned(),
        position(moments),
    ));
    sections.push((
        "State of the server",
        "The next client is granted a session after the ramp, not before.".to_owned(),
        over_time::states(moments),
    ));

    let mut body = format!(
        "<h1>A Gantry-Tau under LinuxCNC, held against a force</h1>\
         <p>LinuxCNC runs a part program on the kinematics of {}. Between its motion controller and the simulated drives the server adds the \
         offsets of a client on the network. Force and springs are simulated: the tool is computed from the recorded references, period by \
         period, with springs that differ from the client's as in <code>gantry-tau demo</code>.</p>{verdict}<pre>{}</pre>",
        escape(&results.robot),
        escape(&table::render(results)),
    );
    if !said.is_empty() {
        body.push_str(&format!("<h2>What happened</h2><pre>{}</pre>", escape(said)));
    }
    for (title, text, plot) in sections {
        let key = if plot.bands.is_empty() { String::new() } else { page::key() };
        body.push_str(&format!("<h2>{title}</h2><p>{text}</p>{key}{}", plot.svg()));
    }
    page::page("gantry-tau in LinuxCNC", &body)
}

/// The path under each load that is long enough.
fn paths<const N: usize>(moments: &[Moment<N>]) -> Vec<(&'static str, String, Plot)> {
    let is_loaded = |moment: &Moment<N>| norm(moment.force_n) > LOADED_N;
    let parts = moments.chunk_by(|last, now| is_loaded(last) == is_loaded(now));
    let parts = parts.filter(|part| part.len() > PATH_PERIODS && part.first().is_some_and(is_loaded));
    let titles = ["Path of the tool, from above", "Path of the tool with the next client"];
    let texts = [
        "Lines, arcs, a helix, and corners that LinuxCNC blends. The client is killed in mid-path: the path goes on, the tool gives way.",
        "The same program once more, held to its end.",
    ];
    let drawn = titles.into_iter().zip(texts).zip(parts).map(|((title, text), part)| {
        let enlarged = enlargement(part);
        let text = format!(
            "As LinuxCNC commands it, and where the springs put the tool under the load: displacements are drawn {enlarged:.0} times as large. {text}"
        );
        (title, text, path(part, enlarged))
    });
    drawn.collect()
}

/// Returns the power of ten by which the largest displacement is drawn at most [`DRAWN_MM`] long.
fn enlargement<const N: usize>(moments: &[Moment<N>]) -> f64 {
    let norms = moments.iter().flat_map(|moment| moment.displacement_um.norms());
    let largest_mm = norms.fold(f64::MIN_POSITIVE, f64::max) / 1e3;
    10_f64.powf((DRAWN_MM / largest_mm).log10().floor())
}

/// From above: x and y.
fn path<const N: usize>(moments: &[Moment<N>], enlarged: f64) -> Plot {
    let every = moments.len().div_ceil(PATH_POINTS).max(1);
    let curve = |name: &str, of: &dyn Fn(&Moment<N>) -> [f64; 3]| {
        let point = |moment: &Moment<N>| {
            let ([x, y, _], [dx, dy, _]) = (moment.path_mm, of(moment));
            (x + dx * enlarged / 1e3, y + dy * enlarged / 1e3)
        };
        Curve::line(name, moments.iter().step_by(every).map(point).collect())
    };
    Plot {
        x_axis: "x, mm",
        y_axis: "y, mm",
        curves: vec![
            Curve { colour: Some(7), ..curve("programmed", &|_| [0.0; 3]) },
            Curve { colour: Some(1), ..curve("without offsets", &|moment| moment.displacement_um.without) },
            Curve { colour: Some(0), ..curve("with the offsets", &|moment| moment.displacement_um.with) },
        ],
        bands: Vec::new(),
        y_names: Vec::new(),
        key: Corner::UpperLeft,
    }
}

fn displacement<const N: usize>(moments: &[Moment<N>]) -> Plot {
    let names = ["with the offsets", "without"].map(str::to_owned);
    over_time::plot("displacement, µm", over_time::curves(names, moments, |m| m.displacement_um.norms()), moments)
}

fn turning<const N: usize>(moments: &[Moment<N>]) -> Plot {
    let names = ["with the offsets", "without"].map(str::to_owned);
    over_time::plot("turning, µrad", over_time::curves(names, moments, |m| m.turn_urad.norms()), moments)
}

fn offsets<const N: usize>(moments: &[Moment<N>]) -> Plot {
    let micrometres = |moment: &Moment<N>| moment.period.offset_nm.map(|nm| f64::from(nm) / 1e3);
    over_time::plot("position offset, µm", over_time::curves(over_time::axis_names(), moments, micrometres), moments)
}

fn force<const N: usize>(moments: &[Moment<N>]) -> Plot {
    let names = ["x", "y", "z"].map(str::to_owned);
    over_time::plot("force, N", over_time::curves(names, moments, |m| m.force_n), moments)
}

fn position<const N: usize>(moments: &[Moment<N>]) -> Plot {
    let names = ["x", "y", "z"].map(str::to_owned);
    let start = Vector3::from(moments.first().map_or([0.0; 3], |moment| moment.path_mm));
    let since = |moment: &Moment<N>| (Vector3::from(moment.path_mm) - start).into();
    over_time::plot("position, mm", over_time::curves(names, moments, since), moments)
}

/// Offsets around the first ramp.
fn ramp<const N: usize>(moments: &[Moment<N>]) -> Option<Plot> {
    let (first, last) =
        stretches(moments, &[Phase::SafeDisconnect]).find_map(|part| Some((part.first()?, part.last()?)))?;
    let window = first.period.number.saturating_sub(AROUND)..last.period.number + AROUND;
    let from = moments.iter().position(|moment| window.contains(&moment.period.number))?;
    let count = moments.iter().filter(|moment| window.contains(&moment.period.number)).count();
    moments.get(from..from + count).map(offsets)
}
