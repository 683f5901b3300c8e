//! `report.html`: one self-contained page.

use gantry_tau_core::control::message::Phase;
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_report::page::Page;
use gantry_tau_report::plots::{Curve, Plot, over_time};

use super::motion::InMotion;
use super::results::{ForceStep, Results};
use super::sampler::TickSample;
use super::scenario::Recording;
use super::{DemoOptions, table};

/// Ticks shown before the disconnect and after its end.
const AROUND_TICKS: u64 = 500;

/// Returns the page as HTML.
pub(super) fn render<K, const N: usize>(
    options: &DemoOptions<K, N>,
    results: &Results,
    recording: &Recording<N>,
    in_motion: Option<&InMotion>,
) -> String {
    let mut page = Page::new(
        "gantry-tau demo",
        "A Gantry-Tau held still over the network",
    );
    introduce(&mut page, options, results);
    let samples = &recording.samples;
    add(
        &mut page,
        "Length of the mean displacement over the settled half of each step; the dots show length gauges at the tool.",
        &against_force(options, results),
    );
    let steps = options.robot.limits.map(|axis| axis.limits.position.step());
    let step_um = f64::from(steps.into_iter().max().unwrap_or(0)) / 1e3;
    add(
        &mut page,
        &format!(
            "The same steps over time, then the ramp after the pulled cable, under the last force. \
             In Obtain each step shows as a short spike: the sensor is filtered, and offsets move by at most {step_um:.0} µm per tick."
        ),
        &displacement(samples),
    );
    if N > ARMS {
        add(
            &mut page,
            "Rotation vector of the platform relative to its nominal orientation. The same compensation holds all six degrees of freedom.",
            &turning(samples),
        );
    }
    add(
        &mut page,
        "The cable is pulled at full offset. One deadline is tolerated, the second begins the ramp of 0.1 µm per ms.",
        &offsets(recording),
    );
    add(
        &mut page,
        "The short session of the newcomer is at the end.",
        &over_time::states("State of the server over time", samples),
    );
    if let Some(in_motion) = in_motion {
        add_motion(&mut page, in_motion);
    }
    page.html()
}

/// Adds what a tap and a path do to a machine with masses.
fn add_motion(page: &mut Page, in_motion: &InMotion) {
    add(
        page,
        "A push of 100 N for 20 ms, with the filter of the file, and with one of first order at 20 Hz: the force sensor reads the inertia of \
         its own tool, so that the compensation is a loop in free air.",
        &in_motion.tap_plot(),
    );
    if let Some(plot) = in_motion.path_plot() {
        add(
            page,
            "The inertia of the platform, the links and the carts bends the machine, which no sensor at the tool sees. With feed-forward \
             (client.feed_forward) the client computes it from the nominal path.",
            &plot,
        );
    }
}

fn introduce<K, const N: usize>(page: &mut Page, options: &DemoOptions<K, N>, results: &Results) {
    let pace = match results.pace {
        "real" => "in real time at 1 kHz",
        _ => "in lock-step (the server waits for its client; link times mean nothing)",
    };
    let springs = 100.0 * options.robot.simulation.spring_deviation;
    page.paragraph(format!(
        "{}, simulated, {pace}. The true springs of the simulation differ from the client's by up to ±{springs:.0} % each (seed {}), \
         the force sensor is noisy, the equilibrium is nonlinear.",
        results.robot, options.robot.simulation.seed,
    ));
    if !results.complaints.is_empty() {
        page.warning(format!(
            "Not as it should be: {}",
            results.complaints.join("; ")
        ));
    }
    page.preformatted(table::render(results));
}

/// Adds a section with a plot.
fn add(page: &mut Page, text: &str, plot: &Plot) {
    page.section(plot.title());
    page.paragraph(text);
    page.picture(&plot.svg());
}

fn against_force<K, const N: usize>(options: &DemoOptions<K, N>, results: &Results) -> Plot {
    let mut curves = vec![
        Curve::line(
            "uncompensated",
            from_zero(results, |step| step.uncompensated_norm_um),
        ),
        Curve::line(
            "compensated",
            from_zero(results, |step| step.compensated_norm_um),
        ),
        Curve::dots(
            "gauges, uncompensated",
            by_force(results, |step| step.gauges_um[0]),
        ),
        Curve::dots(
            "gauges, compensated",
            by_force(results, |step| step.gauges_um[1]),
        ),
    ];
    if results.steps.iter().any(|step| step.beyond_jump) {
        let jump = options.robot.simulation.jump_force_n;
        let top = results
            .steps
            .iter()
            .map(|step| step.uncompensated_norm_um)
            .fold(0.0, f64::max);
        let name = format!("the platform leaves cart 3 at {jump:.0} N");
        curves.push(Curve::line(&name, vec![(jump, 0.0), (jump, top)]));
    }
    Plot::new(
        "Displacement of the tool against force",
        "force in x, N",
        "displacement, µm",
        curves,
    )
}

fn by_force(results: &Results, value: fn(&ForceStep) -> f64) -> Vec<(f64, f64)> {
    let steps = results.steps.iter();
    steps.map(|step| (step.force_n, value(step))).collect()
}

fn from_zero(results: &Results, value: fn(&ForceStep) -> f64) -> Vec<(f64, f64)> {
    let mut points = by_force(results, value);
    points.insert(0, (0.0, 0.0));
    points
}

fn displacement<const N: usize>(samples: &[TickSample<N>]) -> Plot {
    let names = ["x", "y", "z"].map(str::to_owned);
    over_time::plot(
        "Displacement of the tool over time",
        "displacement, µm",
        over_time::curves(names, samples, |s| s.displacement_um),
        samples,
    )
}

fn turning<const N: usize>(samples: &[TickSample<N>]) -> Plot {
    let names = ["about x", "about y", "about z"].map(str::to_owned);
    over_time::plot(
        "Turning of the platform over time",
        "turning, µrad",
        over_time::curves(names, samples, |s| s.turn_urad),
        samples,
    )
}

fn offsets<const N: usize>(recording: &Recording<N>) -> Plot {
    let ended = recording.ended.tick;
    let mut samples = recording.samples.iter();
    let listening = samples
        .find(|s| s.tick > ended && s.phase == Phase::Listening)
        .map_or(ended, |sample| sample.tick);
    let window = ended.saturating_sub(AROUND_TICKS)..listening + AROUND_TICKS;
    let samples = recording.samples.iter().copied();
    let samples: Vec<TickSample<N>> = samples.filter(|s| window.contains(&s.tick)).collect();
    let curves = over_time::curves(over_time::axis_names(), &samples, |s| {
        s.offset_nm.map(|nm| f64::from(nm) / 1e3)
    });
    over_time::plot(
        "Offsets through the disconnect",
        "position offset, µm",
        curves,
        &samples,
    )
}
