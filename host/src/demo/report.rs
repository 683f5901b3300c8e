//! `report.html`: one self-contained page.

use gantry_tau_core::control::message::Phase;
use gantry_tau_core::model::robot::ARMS;

use super::results::Results;
use super::sampler::Sample;
use super::scenario::Recording;
use super::{DemoOptions, table};
use crate::plots::page::{self, escape};
use crate::plots::{Corner, Curve, Plot, over_time};

/// Ticks shown before the disconnect and after its end.
const AROUND_TICKS: u64 = 500;

/// Returns the page as HTML.
pub(super) fn render<K, const N: usize>(
    options: &DemoOptions<K, N>,
    results: &Results,
    recording: &Recording<N>,
) -> String {
    let verdict = if results.complaints.is_empty() {
        String::new()
    } else {
        let text = results.complaints.join("; ");
        format!("<p class=\"bad\">Not as it should be: {}</p>", escape(&text))
    };
    let pace = match results.pace {
        "real" => "in real time at 1 kHz",
        _ => "in lock-step (the server waits for its client; link times mean nothing)",
    };
    let springs = 100.0 * options.robot.simulation.spring_deviation;
    let steps = options.robot.limits.map(|axis| axis.limits.position.step());
    let step_um = f64::from(steps.into_iter().max().unwrap_or(0)) / 1e3;
    let mut sections = vec![
        (
            "Displacement of the tool against force",
            "Length of the mean displacement over the settled half of each step; the dots show length gauges at the tool.".to_owned(),
            against_force(options, results).svg(),
        ),
        (
            "Displacement of the tool over time",
            format!(
                "The same steps over time, then the ramp after the pulled cable, under the last force. \
                 In Obtain each step shows as a short spike: the sensor is filtered, and offsets move by at most {step_um:.0} µm per tick."
            ),
            displacement(&recording.samples).svg(),
        ),
        (
            "Offsets through the disconnect",
            "The cable is pulled at full offset. One deadline is tolerated, the second begins the ramp of 0.1 µm per ms.".to_owned(),
            offsets(recording).svg(),
        ),
        (
            "State of the server over time",
            "The short session of the newcomer is at the end.".to_owned(),
            over_time::states(&recording.samples).svg(),
        ),
    ];
    if N > ARMS {
        let text = "Rotation vector of the platform relative to its nominal orientation. The same compensation holds all six degrees of freedom.";
        let turning = ("Turning of the platform over time", text.to_owned(), turning(&recording.samples).svg());
        sections.insert(2, turning);
    }
    let mut body = format!(
        "<h1>A Gantry-Tau held still over the network</h1>\
         <p>{}, simulated, {pace}. The true springs of the simulation differ from the client's by up to ±{springs:.0} % each (seed {}), \
         the force sensor is noisy, the equilibrium is nonlinear.</p>{verdict}<pre>{}</pre>",
        escape(&results.robot),
        options.robot.simulation.seed,
        escape(&table::render(results)),
    );
    for (title, text, svg) in sections {
        let key = if title.contains("force") { String::new() } else { page::key() };
        body.push_str(&format!("<h2>{title}</h2><p>{text}</p>{key}{svg}"));
    }
    page::page("gantry-tau demo", &body)
}

fn against_force<K, const N: usize>(options: &DemoOptions<K, N>, results: &Results) -> Plot {
    let points = |value: fn(&super::Step) -> f64| results.steps.iter().map(move |step| (step.force_n, value(step)));
    let line = |name: &str, value| Curve::line(name, std::iter::once((0.0, 0.0)).chain(points(value)).collect());
    let dots = |name: &str, value| Curve::dots(name, points(value).collect());
    let mut curves = vec![
        line("uncompensated", |step| step.uncompensated_norm_um),
        line("compensated", |step| step.compensated_norm_um),
        dots("gauges, uncompensated", |step| step.gauges_um[0]),
        dots("gauges, compensated", |step| step.gauges_um[1]),
    ];
    if results.steps.iter().any(|step| step.beyond_jump) {
        let jump = options.robot.simulation.jump_force_n;
        let top = results.steps.iter().map(|step| step.uncompensated_norm_um).fold(0.0, f64::max);
        let name = format!("the platform leaves cart 3 at {jump:.0} N");
        curves.push(Curve::line(&name, vec![(jump, 0.0), (jump, top)]));
    }
    Plot {
        x_axis: "force in x, N",
        y_axis: "displacement, µm",
        curves,
        bands: Vec::new(),
        y_names: Vec::new(),
        key: Corner::UpperLeft,
    }
}

fn displacement<const N: usize>(samples: &[Sample<N>]) -> Plot {
    let names = ["x", "y", "z"].map(str::to_owned);
    over_time::plot("displacement, µm", over_time::curves(names, samples, |s| s.displacement_um), samples)
}

fn turning<const N: usize>(samples: &[Sample<N>]) -> Plot {
    let names = ["about x", "about y", "about z"].map(str::to_owned);
    over_time::plot("turning, µrad", over_time::curves(names, samples, |s| s.turn_urad), samples)
}

fn offsets<const N: usize>(recording: &Recording<N>) -> Plot {
    let ended = recording.ended.tick;
    let mut samples = recording.samples.iter();
    let listening = samples.find(|s| s.tick > ended && s.phase == Phase::Listening).map_or(ended, |sample| sample.tick);
    let window = ended.saturating_sub(AROUND_TICKS)..listening + AROUND_TICKS;
    let samples = recording.samples.iter().copied();
    let samples: Vec<Sample<N>> = samples.filter(|s| window.contains(&s.tick)).collect();
    let micrometres = |s: &Sample<N>| s.offset_nm.map(|nm| f64::from(nm) / 1e3);
    let curves = over_time::curves(over_time::axis_names(), &samples, micrometres);
    Plot { key: Corner::LowerRight, ..over_time::plot("position offset, µm", curves, &samples) }
}
