//! `follow.html`.

use gantry_tau_report::page::Page;
use gantry_tau_report::plots::{Curve, Plot};

use super::run::{Measured, Run};
use super::{FORCE_STEP_N, FollowResults, SPEED_M_PER_S};

/// Milliseconds of the force step that are drawn, and those of a machine with masses, which rings.
const PUSH_MS: usize = 80;
const RING_MS: usize = 500;

/// Returns the page as HTML, of the loops in the drive and outside.
pub(super) fn render(
    results: &FollowResults,
    table: &str,
    reference_mm: &[f64],
    [inside, outside]: [&Measured; 2],
) -> String {
    let shown = results.shown;
    let has_masses = !inside.velocity.tool_um.is_empty();
    let push_ms = if has_masses { RING_MS } else { PUSH_MS };
    let with_torque = outside.torque.as_ref().unwrap_or(&outside.velocity);
    let mut page = Page::new(
        "gantry-tau follow",
        "Position loop in the drive and outside of it",
    );
    page.preformatted(table);
    add(
        &mut page,
        "Reference",
        &format!("Of one cart, from where it starts: up to {SPEED_M_PER_S} m/s, and back to rest."),
        "way, mm",
        vec![line("reference", reference_mm)],
    );
    add(
        &mut page,
        "Lag without feed-forward",
        "The velocity over the gain: the longer the latency, the smaller the gain.",
        "lag, µm",
        vec![
            lag("in the drive", &inside.plain),
            lag(&format!("outside, {shown}"), &outside.plain),
        ],
    );
    add(
        &mut page,
        "Lag with feed-forward",
        "The loop outside compares each measurement with the reference that belongs to it. Mind the scale.",
        "lag, µm",
        vec![
            lag("in the drive: velocity", &inside.velocity),
            lag("outside: velocity", &outside.velocity),
            lag("outside: velocity and torque", with_torque),
        ],
    );
    if has_masses {
        add(
            &mut page,
            "Lag of the tool",
            "Distance from its place on the rigid machine, with velocity feed-forward: what accelerates behind the springs bends them.",
            "distance, µm",
            vec![
                line("in the drive", &inside.velocity.tool_um),
                line(&format!("outside, {shown}"), &outside.velocity.tool_um),
            ],
        );
    }
    add(
        &mut page,
        "Torque",
        "Of one motor: acceleration, friction at full speed, deceleration.",
        "torque, ‰ of rated",
        vec![
            line("in the drive", &inside.velocity.permille),
            line("outside, velocity and torque", &with_torque.permille),
        ],
    );
    add(
        &mut page,
        "The price: a force step",
        &format!(
            "{FORCE_STEP_N} N on a motor at rest. The loop outside sees it later and answers with a smaller gain."
        ),
        "displacement of the cart, µm",
        vec![
            line("in the drive", first(&inside.pushed_um, push_ms)),
            line("outside", first(&outside.pushed_um, push_ms)),
        ],
    );
    page.html()
}

/// Adds a section with a plot over time.
fn add(page: &mut Page, title: &str, text: &str, y_axis: &str, curves: Vec<Curve>) {
    page.section(title);
    page.paragraph(text);
    page.picture(&Plot::new(title, "time, ms", y_axis, curves).svg());
}

fn first(values: &[f64], count: usize) -> &[f64] {
    values.get(..count).unwrap_or(values)
}

/// One point per cycle of 1 ms.
fn line(name: &str, values: &[f64]) -> Curve {
    Curve::line(
        name,
        (1..)
            .zip(values)
            .map(|(ms, value)| (f64::from(ms), *value))
            .collect(),
    )
}

fn lag(name: &str, run: &Run) -> Curve {
    line(name, &run.lag_um)
}
