//! `follow.html`.

use super::run::{Measured, Run};
use super::{FORCE_STEP_N, FollowResults, SPEED_M_PER_S};
use crate::plots::page::{self, escape};
use crate::plots::{Corner, Curve, Plot};

/// Milliseconds of the force step that are drawn.
const PUSH_MS: usize = 80;

/// Returns the page as HTML, of the loops in the drive and outside.
pub(super) fn render(
    results: &FollowResults,
    table: &str,
    reference_mm: &[f64],
    [inside, outside]: [&Measured; 2],
) -> String {
    let shown = results.shown;
    let with_torque = outside.torque.as_ref().unwrap_or(&outside.velocity);
    let sections = [
        (
            "Reference",
            format!("Of one cart, from where it starts: up to {SPEED_M_PER_S} m/s, and back to rest."),
            plot("way, mm", Corner::UpperRight, vec![line("reference", reference_mm)]),
        ),
        (
            "Lag without feed-forward",
            "The velocity over the gain: the longer the latency, the smaller the gain.".to_owned(),
            plot(
                "lag, µm",
                Corner::UpperRight,
                vec![lag("in the drive", &inside.plain), lag(&format!("outside, {shown}"), &outside.plain)],
            ),
        ),
        (
            "Lag with feed-forward",
            "The loop outside compares each measurement with the reference that belongs to it. Mind the scale."
                .to_owned(),
            plot(
                "lag, µm",
                // The curves are high at both ends.
                Corner::UpperMiddle,
                vec![
                    lag("in the drive: velocity", &inside.velocity),
                    lag("outside: velocity", &outside.velocity),
                    lag("outside: velocity and torque", with_torque),
                ],
            ),
        ),
        (
            "Torque",
            "Of one motor: acceleration, friction at full speed, deceleration.".to_owned(),
            plot(
                "torque, ‰ of rated",
                Corner::UpperRight,
                vec![
                    line("in the drive", &inside.velocity.permille),
                    line("outside, velocity and torque", &with_torque.permille),
                ],
            ),
        ),
        (
            "The price: a force step",
            format!(
                "{FORCE_STEP_N} N on a motor at rest. The loop outside sees it later and answers with a smaller gain."
            ),
            plot(
                "displacement of the cart, µm",
                Corner::UpperRight,
                vec![line("in the drive", first(&inside.pushed_um)), line("outside", first(&outside.pushed_um))],
            ),
        ),
    ];
    let mut body = format!("<h1>Position loop in the drive and outside of it</h1><pre>{}</pre>", escape(table));
    for (title, text, plot) in sections {
        body.push_str(&format!("<h2>{}</h2><p>{}</p>{}", escape(title), escape(&text), plot.svg()));
    }
    page::page("gantry-tau follow", &body)
}

fn first(values: &[f64]) -> &[f64] {
    values.get(..PUSH_MS).unwrap_or(values)
}

/// One point per cycle of 1 ms.
fn line(name: &str, values: &[f64]) -> Curve {
    Curve::line(name, (1..).zip(values).map(|(ms, value)| (f64::from(ms), *value)).collect())
}

fn lag(name: &str, run: &Run) -> Curve {
    line(name, &run.lag_um)
}

fn plot(y_axis: &'static str, key: Corner, curves: Vec<Curve>) -> Plot {
    Plot { x_axis: "time, ms", y_axis, curves, bands: Vec::new(), y_names: Vec::new(), key }
}
