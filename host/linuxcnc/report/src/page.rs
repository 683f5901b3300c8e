//! The page of a demonstration in LinuxCNC.

use gantry_tau_core::control::message::Phase;
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_report::page::{Page, Text};
use gantry_tau_report::plots::{Curve, Plot, over_time};
use nalgebra::Vector3;

use crate::results::{LOADED_N, Results, stretches};
use crate::table;
use crate::tool::{Moment, norm};

/// Largest length of a drawn displacement, mm of the path.
const DRAWN_MM: f64 = 50.0;
/// Shortest path that is drawn, periods.
const PATH_PERIODS: usize = 1_000;
/// Periods shown before and after a ramp.
const AROUND: u64 = 500;

/// Returns the page as HTML; `said` is what the demonstration printed.
pub(crate) fn render<const N: usize>(
    results: &Results,
    moments: &[Moment<N>],
    said: &str,
) -> String {
    let mut page = Page::new(
        "gantry-tau in LinuxCNC",
        "A Gantry-Tau under LinuxCNC, held against a force",
    );
    introduce(&mut page, results, said);
    add_paths(&mut page, moments);
    add(
        &mut page,
        "Length of the displacement, with the offsets in the references and without. Where a client has ended, the offsets ramp to zero, \
         and both become one; after the load is released the rest of a ramp is all there is.",
        &displacement(moments),
    );
    add(
        &mut page,
        "In the references of the drives: reference minus LinuxCNC's command.",
        &offsets("Offsets of the axes", moments),
    );
    if let Some(ramp) = ramp(moments) {
        add(
            &mut page,
            "The client is killed in mid-path: every offset goes to zero by 0.1 µm per period, and LinuxCNC's path goes on.",
            &offsets("The ramp", ramp),
        );
    }
    if N > ARMS {
        add(
            &mut page,
            "Angle of the platform's turning, with the offsets and without.",
            &turning(moments),
        );
    }
    add(
        &mut page,
        "As the sensor shows it, world axes.",
        &force(moments),
    );
    add(
        &mut page,
        "As LinuxCNC commands it, from the first session's first period.",
        &position(moments),
    );
    add(
        &mut page,
        "The next client is granted a session after the ramp, not before.",
        &over_time::states("State of the server", moments),
    );
    page.html()
}

fn introduce(page: &mut Page, results: &Results, said: &str) {
    let text = format!(
        "LinuxCNC runs a part program on the kinematics of {}. Between its motion controller and the simulated drives the server adds the \
         offsets of a client on the network. Force and springs are simulated: the tool is computed from the recorded references, period by \
         period, with springs that differ from the client's as in ",
        results.robot
    );
    page.paragraph(Text::from(text).and(Text::code("gantry-tau demo")).and("."));
    if !results.complaints.is_empty() {
        page.warning(format!(
            "Not as it should be: {}",
            results.complaints.join("; ")
        ));
    }
    page.preformatted(table::render(results));
    if !said.is_empty() {
        page.section("What happened");
        page.preformatted(said);
    }
}

/// Adds a section with a plot.
fn add(page: &mut Page, text: &str, plot: &Plot) {
    page.section(plot.title());
    page.paragraph(text);
    page.picture(&plot.svg());
}

/// Adds the path under each load that is long enough.
fn add_paths<const N: usize>(page: &mut Page, moments: &[Moment<N>]) {
    let parts = moments.chunk_by(|last, now| is_loaded(last) == is_loaded(now));
    let parts =
        parts.filter(|part| part.len() > PATH_PERIODS && part.first().is_some_and(is_loaded));
    let titles = [
        (
            "Path of the tool, from above",
            "Lines, arcs, a helix, and corners that LinuxCNC blends. The client is killed in mid-path: the path goes on, the tool gives way.",
        ),
        (
            "Path of the tool with the next client",
            "The same program once more, held to its end.",
        ),
    ];
    for ((title, text), part) in titles.into_iter().zip(parts) {
        let enlarged = enlargement(part);
        add(
            page,
            &format!(
                "As LinuxCNC commands it, and where the springs put the tool under the load: displacements are drawn {enlarged:.0} times as large. {text}"
            ),
            &path(title, part, enlarged),
        );
    }
}

fn is_loaded<const N: usize>(moment: &Moment<N>) -> bool {
    norm(moment.force_n) > LOADED_N
}

/// Returns the power of ten by which the largest displacement is drawn at most [`DRAWN_MM`] long.
fn enlargement<const N: usize>(moments: &[Moment<N>]) -> f64 {
    let norms = moments
        .iter()
        .flat_map(|moment| moment.displacement_um.norms());
    let largest_mm = norms.fold(f64::MIN_POSITIVE, f64::max) / 1e3;
    10_f64.powf((DRAWN_MM / largest_mm).log10().floor())
}

/// From above: x and y.
fn path<const N: usize>(title: &str, moments: &[Moment<N>], enlarged: f64) -> Plot {
    let programmed = displaced(moments, enlarged, |_| [0.0; 3]);
    let without = displaced(moments, enlarged, |moment| moment.displacement_um.without);
    let with = displaced(moments, enlarged, |moment| moment.displacement_um.with);
    let curves = vec![
        Curve::line("programmed", programmed).in_ink(),
        Curve::line("without offsets", without).styled(1),
        Curve::line("with the offsets", with).styled(0),
    ];
    Plot::new(title, "x, mm", "y, mm", curves).with_equal_axes()
}

/// Path of the tool with enlarged displacements (µm), mm.
fn displaced<const N: usize>(
    moments: &[Moment<N>],
    enlarged: f64,
    displacement_um: impl Fn(&Moment<N>) -> [f64; 3],
) -> Vec<(f64, f64)> {
    let points = moments.iter().map(|moment| {
        let ([x, y, _], [dx, dy, _]) = (moment.path_mm, displacement_um(moment));
        (x + dx * enlarged / 1e3, y + dy * enlarged / 1e3)
    });
    points.collect()
}

fn displacement<const N: usize>(moments: &[Moment<N>]) -> Plot {
    let names = ["with the offsets", "without"].map(str::to_owned);
    over_time::plot(
        "Displacement of the tool by the load",
        "displacement, µm",
        over_time::curves(names, moments, |m| m.displacement_um.norms()),
        moments,
    )
}

fn turning<const N: usize>(moments: &[Moment<N>]) -> Plot {
    let names = ["with the offsets", "without"].map(str::to_owned);
    over_time::plot(
        "Turning of the platform by the load",
        "turning, µrad",
        over_time::curves(names, moments, |m| m.turn_urad.norms()),
        moments,
    )
}

fn offsets<const N: usize>(title: &str, moments: &[Moment<N>]) -> Plot {
    let curves = over_time::curves(over_time::axis_names(), moments, |moment| {
        moment.period.offset_nm.map(|nm| f64::from(nm) / 1e3)
    });
    over_time::plot(title, "position offset, µm", curves, moments)
}

fn force<const N: usize>(moments: &[Moment<N>]) -> Plot {
    let names = ["x", "y", "z"].map(str::to_owned);
    over_time::plot(
        "Force on the tool",
        "force, N",
        over_time::curves(names, moments, |m| m.force_n),
        moments,
    )
}

fn position<const N: usize>(moments: &[Moment<N>]) -> Plot {
    let names = ["x", "y", "z"].map(str::to_owned);
    let start = Vector3::from(moments.first().map_or([0.0; 3], |moment| moment.path_mm));
    let curves = over_time::curves(names, moments, |moment| {
        (Vector3::from(moment.path_mm) - start).into()
    });
    over_time::plot("Position of the tool", "position, mm", curves, moments)
}

/// Moments around the first ramp.
fn ramp<const N: usize>(moments: &[Moment<N>]) -> Option<&[Moment<N>]> {
    let (first, last) = stretches(moments, &[Phase::SafeDisconnect])
        .find_map(|part| Some((part.first()?, part.last()?)))?;
    let window = first.period.number.saturating_sub(AROUND)..last.period.number + AROUND;
    let from = moments
        .iter()
        .position(|moment| window.contains(&moment.period.number))?;
    let count = moments
        .iter()
        .filter(|moment| window.contains(&moment.period.number))
        .count();
    moments.get(from..from + count)
}
