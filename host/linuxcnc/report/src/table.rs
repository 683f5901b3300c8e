//! The table of a demonstration in LinuxCNC.

use std::fmt::Write;

use crate::results::{LoadedSession, Ramp, Results};

/// Plain text, at most 110 columns.
pub(crate) fn render(results: &Results) -> String {
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _ = write_all(&mut text, results);
    text
}

fn write_all(text: &mut String, results: &Results) -> std::fmt::Result {
    writeln!(
        text,
        "{} in LinuxCNC, {} servo periods\n",
        results.robot, results.periods
    )?;
    writeln!(
        text,
        "  client   force      under load   path moves   displacement of the tool, um   remaining   missed"
    )?;
    writeln!(
        text,
        "               N               s    of all     uncompensated     compensated"
    )?;
    for (number, session) in (1..).zip(&results.sessions) {
        let LoadedSession {
            seconds: [from, to],
            periods,
            moving,
            force_n,
            ..
        } = session;
        let moves = 100.0 * *moving as f64 / *periods as f64;
        writeln!(
            text,
            "  {number:6}   {force_n:5.0}   {from:5.1} to {to:4.1}   {moves:8.0} %     {:13.2}   {:13.2}    {:6.2} %   {:6}",
            session.uncompensated_um,
            session.compensated_um,
            100.0 * session.remaining_share,
            session.missed,
        )?;
    }
    for Ramp {
        seconds,
        cause,
        start_offset_nm,
        ticks,
        expected_ticks,
        moving,
        ..
    } in &results.ramps
    {
        let offsets: Vec<String> = start_offset_nm
            .iter()
            .map(|nm| format!("{:.1}", f64::from(*nm) / 1e3))
            .collect();
        writeln!(text, "\n  ramp at {seconds:.1} s ({cause})")?;
        writeln!(
            text,
            "    start offsets               {} um",
            offsets.join(", ")
        )?;
        writeln!(
            text,
            "    ticks to zero               {ticks} (expected {expected_ticks})"
        )?;
        writeln!(text, "    periods with a moving path  {moving}")?;
    }
    let (largest, allowed) = (results.largest_change_nm, results.allowed_change_nm);
    writeln!(
        text,
        "\n  largest change of any offset in a period: {largest} nm (limit {allowed} nm)"
    )?;
    if results.complaints.is_empty() {
        writeln!(text, "\nAll as it should be.")?;
    }
    for complaint in &results.complaints {
        writeln!(text, "\nNOT AS IT SHOULD BE: {complaint}")?;
    }
    Ok(())
}
