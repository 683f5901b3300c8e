//! The table of a comparison, as text.

use super::{ACCELERATION_M_PER_S2, FORCE_STEP_N, FollowResults, LoopNumbers, SPEED_M_PER_S};

/// Returns the table, and what it says.
pub(super) fn render(results: &FollowResults) -> String {
    let [tool, of_velocity] = match results.inside().and_then(|row| row.tool_um) {
        Some(_) => ["       tool,", " velocity ff"],
        None => [""; 2],
    };
    let mut text = format!(
        "{}: largest lag of a cart on the way to {SPEED_M_PER_S} m/s at {ACCELERATION_M_PER_S2} m/s^2, um, and {FORCE_STEP_N} N on a motor\n\n\
         {:<15} {:>7} {:>9} {:>12} {:>12} {:>9} {:>12} {:>10} {:>8}{tool}\n\
         {:<15} {:>7} {:>9} {:>12} {:>12} {:>9} {:>12} {:>10} {:>8}{of_velocity}\n",
        results.machine,
        "position loop",
        "gain",
        "no feed-",
        "velocity ff",
        "velocity ff",
        "+ torque",
        "mass 20 %",
        "300 N:",
        "< 1 um",
        "",
        "1/s",
        "forward",
        "not aligned",
        "aligned",
        "ff",
        "wrong",
        "peak, um",
        "after ms",
    );
    for row in &results.loops {
        text.push_str(&line(row));
    }
    text.push_str(&conclusion(results));
    text
}

fn line(row: &LoopNumbers) -> String {
    let name = row.latency.map_or_else(
        || "in the drive".to_owned(),
        |latency| format!("outside, {latency}"),
    );
    let tool = row.tool_um.map(|tool_um| format!(" {:>11}", um(tool_um)));
    let tool = tool.unwrap_or_default();
    format!(
        "{name:<15} {:>7.1} {:>9} {:>12} {:>12} {:>9} {:>12} {:>10} {:>8}{tool}\n",
        row.gain_per_s,
        um(row.plain_um),
        um_or_dash(row.misaligned_um),
        um(row.velocity_um),
        um_or_dash(row.torque_um),
        um_or_dash(row.wrong_mass_um),
        um(row.pushed_um),
        row.settled_ms,
    )
}

/// Micrometres with four digits at most.
fn um(value: f64) -> String {
    if value < 100.0 {
        format!("{value:.1}")
    } else {
        format!("{value:.0}")
    }
}

fn um_or_dash(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), um)
}

/// Conclusion from the numbers, for those who have to choose.
fn conclusion(results: &FollowResults) -> String {
    let (Some(inside), Some(outside)) = (results.inside(), results.outside()) else {
        return String::new();
    };
    format!(
        "\nOutside with {} cycles of latency (command + measurement) aligned velocity feed-forward takes the lag\n\
         from {:.0} to {:.1} um. The price is stiffness: a force step moves a cart {:.2} times as far as with the\n\
         loop in the drive, for {:.1} times as long. Move the loop out for following; leave it in for compensating,\n\
         unless the drive has no other way.\n",
        results.shown,
        outside.plain_um,
        outside.velocity_um,
        outside.pushed_um / inside.pushed_um,
        f64::from(outside.settled_ms) / f64::from(inside.settled_ms.max(1)),
    )
}
