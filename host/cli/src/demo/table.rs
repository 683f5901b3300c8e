//! The table at the end of the demo.

use std::fmt::Write;

use gantry_tau_core::model::robot::ARMS;

use super::motion::MotionNumbers;
use super::results::Results;

/// Plain text, at most 110 columns.
pub(super) fn render(results: &Results) -> String {
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _ = write_all(&mut text, results);
    text
}

fn write_all(text: &mut String, results: &Results) -> std::fmt::Result {
    let pace = match results.pace {
        "real" => "real time, 1 kHz",
        _ => "lock-step: the server waits for its client, link times mean nothing",
    };
    writeln!(text, "{}, {pace}\n", results.robot)?;
    write_steps(text, results)?;
    if results.steps.iter().any(|step| step.beyond_jump) {
        writeln!(
            text,
            "  * in or beyond the jump, which is not compensated (see the thesis, 5.2.2 and 6.1)"
        )?;
    }
    if let Some(corrections) = &results.corrections {
        let ([first, exact], [first_known, exact_known]) =
            (corrections.file_springs_um, corrections.true_springs_um);
        let force_n = corrections.force_n;
        writeln!(
            text,
            "\n  remaining at {force_n:.0} N, computed without noise     first order      exact"
        )?;
        writeln!(
            text,
            "    with the springs of the file            {first:9.2} um {exact:7.2} um"
        )?;
        writeln!(
            text,
            "    with the true springs                   {first_known:9.2} um {exact_known:7.2} um"
        )?;
    }
    if let Some(in_motion) = &results.in_motion {
        write_motion(text, in_motion)?;
    }
    let ramp = &results.ramp;
    let offsets: Vec<String> = (ramp.start_offset_nm.iter())
        .map(|nm| format!("{:.1}", f64::from(*nm) / 1e3))
        .collect();
    let offsets = offsets.join(", ");
    writeln!(text, "\n  ramp after the pulled cable ({})", ramp.cause)?;
    writeln!(text, "    start offsets               {offsets} um")?;
    writeln!(
        text,
        "    ticks to zero               {} (expected {})",
        ramp.ticks, ramp.expected_ticks
    )?;
    writeln!(
        text,
        "    largest change per tick     {} nm",
        ramp.largest_change_nm
    )?;
    writeln!(text, "    a newcomer meanwhile        {}", ramp.refusal)?;
    let link = &results.link;
    let [p50, p99, max] = link.round_trip_us;
    writeln!(text, "\n  link until then")?;
    writeln!(
        text,
        "    commands on time            {:.5} ({} of {} missed, longest run {})",
        link.on_time_share, link.missed, link.deadlines, link.longest_miss_run
    )?;
    writeln!(
        text,
        "    round trip                  p50 {p50} us, p99 {p99} us, max {max} us"
    )?;
    writeln!(
        text,
        "\n  largest change of any drive reference in a tick: {} nm (limit {} nm)",
        results.largest_reference_change_nm, results.allowed_reference_change_nm
    )?;
    if results.complaints.is_empty() {
        writeln!(text, "\nAll as it should be.")?;
    }
    for complaint in &results.complaints {
        writeln!(text, "\nNOT AS IT SHOULD BE: {complaint}")?;
    }
    Ok(())
}

fn write_motion(text: &mut String, in_motion: &MotionNumbers) -> std::fmt::Result {
    let MotionNumbers {
        settles_s,
        margin_any_phase,
        tap_left_um: [of_file, first_order],
        path_largest_um,
    } = in_motion;
    let settles_ms = settles_s * 1e3;
    writeln!(text, "\n  in motion, by the masses of the file")?;
    writeln!(
        text,
        "    settles to 5 %              {settles_ms:.0} ms, margin {margin_any_phase:.1} against any phase (2 is required)"
    )?;
    writeln!(
        text,
        "    a second after a tap        {of_file:.2} um (filter of first order, 20 Hz: {first_order:.2} um)"
    )?;
    if let Some([without, with]) = path_largest_um {
        writeln!(
            text,
            "    path at 5 m/s^2             {without:.1} um at most (with feed-forward {with:.1} um)"
        )?;
    }
    Ok(())
}

/// Writes one line per step; with turning where the axes can compensate it.
fn write_steps(text: &mut String, results: &Results) -> std::fmt::Result {
    let six = results.axes > ARMS;
    let [heads, units] = if six {
        [
            "    turning of the platform, urad    remaining",
            "    uncompensated   compensated          share",
        ]
    } else {
        ["", ""]
    };
    writeln!(
        text,
        "  force x    displacement of the tool, um    remaining{heads}"
    )?;
    writeln!(
        text,
        "        N    uncompensated   compensated         share{units}"
    )?;
    for step in &results.steps {
        write!(
            text,
            "  {:7.0}    {:13.2}   {:11.2}      {:6.2} %",
            step.force_n,
            step.uncompensated_norm_um,
            step.compensated_norm_um,
            100.0 * step.remaining_share,
        )?;
        if six {
            let [before, after] = step.turn_urad;
            let share = 100.0 * step.remaining_turn_share;
            write!(text, "    {before:13.2}   {after:11.2}       {share:6.2} %")?;
        }
        writeln!(text, "{}", if step.beyond_jump { "  *" } else { "" })?;
    }
    Ok(())
}
