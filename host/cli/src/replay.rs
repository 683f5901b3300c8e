//! `replay`: runs a black box through the core again and compares the outputs bit for bit (T11).

pub(crate) mod picture;

use std::error::Error;
use std::fmt;
use std::path::PathBuf;

use gantry_tau_core::control::session::{Entry, Output, replay};
use gantry_tau_record::black_box::{self, loops};
use gantry_tau_server::black_box::Window;
use gantry_tau_server::black_box::loops::LoopsWindow;
use gantry_tau_system::output::{self, Kind};
use serde::Serialize;

use crate::terminal::say;
use picture::Picture;

/// Text in place of a cause.
const NO_END: &str = "the window has no end of a session";

/// Options of a replay.
#[derive(Clone, Debug)]
pub struct ReplayOptions {
    /// Path of the black box.
    pub file: PathBuf,
    /// Its picture, if wanted: an SVG, or a page.
    pub report: Option<output::Output>,
    /// Path of the findings as JSON, if wanted.
    pub json: Option<output::Output>,
}

/// Findings of a replay. The JSON layout is stable: fields are added, never renamed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Findings {
    /// Version of this layout.
    pub layout: u32,
    /// Number of axes.
    pub axes: usize,
    /// Epoch of the session that ended, or of the last one.
    pub epoch: u64,
    /// Number of the oldest tick.
    pub first_tick: u64,
    /// Number of the latest tick.
    pub last_tick: u64,
    /// Number of ticks; an overrun of the server skips tick numbers.
    pub ticks: usize,
    /// Name of the cause of an end of a session, or of a stop. `None` in a window without an end.
    pub cause: Option<&'static str>,
    /// Tick of the cause; the last tick of a window without an end.
    pub cause_tick: u64,
    /// The cause in a sentence.
    pub cause_text: String,
    /// Ticks, from the oldest on, whose outputs agree bit for bit.
    pub agreeing: usize,
    /// The first difference; `None` when all agree.
    pub difference: Option<Difference>,
}

/// First field that differs in the replay.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// Tick, as replayed.
    pub tick: u64,
    /// Field of core's `Output`, for instance `state.axes[1].offsets.position`.
    pub field: String,
    /// Axis of the field, counted from 1, if it belongs to one.
    pub axis: Option<usize>,
    /// Value in the file.
    pub recorded: String,
    /// Value of the replay.
    pub replayed: String,
}

/// Replays a file, prints the findings, writes the files that are wanted. Returns true if all
/// outputs agree.
///
/// # Errors
/// The file is not a black box ([`black_box::FileError`]), or a file cannot be written
/// ([`gantry_tau_system::output::WriteError`]).
pub fn run(options: &ReplayOptions) -> Result<bool, Box<dyn Error>> {
    let name = options.file.display().to_string();
    let bytes = black_box::bytes(&options.file)?;
    if loops::is_of_loops(&bytes) {
        if options.report.is_some() || options.json.is_some() {
            return Err(
                format!("{name}: --report and --json are for black boxes of sessions").into(),
            );
        }
        return match loops::axes(&name, &bytes)? {
            6 => examine_loops::<6>(&name, &bytes),
            _ => examine_loops::<3>(&name, &bytes),
        };
    }
    match black_box::axes(&name, &bytes)? {
        6 => examine::<6>(options, &name, &bytes),
        // Refuses any other number of axes, with its line.
        _ => examine::<3>(options, &name, &bytes),
    }
}

/// Replays a black box of position loops. Returns true if all outputs agree.
fn examine_loops<const N: usize>(name: &str, bytes: &[u8]) -> Result<bool, Box<dyn Error>> {
    let window: LoopsWindow<N> = loops::decode(name, bytes)?;
    let (ticks, (agreeing, differing)) = (window.ticks.len(), window.replay());
    let Some((replayed, tick)) = differing.zip(window.ticks.get(agreeing)) else {
        say(format_args!(
            "{name}\n  {N} axes, position loops\n  replay    all {ticks} ticks agree bit for bit"
        ));
        return Ok(true);
    };
    let recorded = tick.output;
    say(format_args!(
        "{name}\n  {N} axes, position loops\n  replay    {agreeing} of {ticks} ticks agree, then DIFFERS\n  \
                    recorded {recorded:?}\n  replayed {replayed:?}"
    ));
    Ok(false)
}

fn examine<const N: usize>(
    options: &ReplayOptions,
    name: &str,
    bytes: &[u8],
) -> Result<bool, Box<dyn Error>> {
    let window: Window<N> = black_box::decode(name, bytes)?;
    let findings = Findings::of(&window);
    let summary = format!("{name}\n{findings}");
    say(&summary);
    if let Some(report) = &options.report {
        let picture = Picture::of(&window, &findings);
        let is_page = report.kind() == Kind::Page;
        report.write(&if is_page {
            picture.page(&summary)
        } else {
            picture.svg(name)
        })?;
    }
    if let Some(answer) = &options.json {
        let json = serde_json::to_string_pretty(&findings);
        let json = json.unwrap_or_else(|error| error.to_string());
        answer.write(&json)?;
    }
    Ok(findings.difference.is_none())
}

fn number_of<const N: usize>(entry: &Entry<N>) -> u64 {
    entry.output.state.tick.0
}

impl Findings {
    /// Replays a window.
    #[must_use]
    pub fn of<const N: usize>(window: &Window<N>) -> Self {
        let end = window.end();
        let replayed = replay(&window.before, &window.entries);
        let recorded = window.entries.get(replayed.agreeing);
        let difference = recorded.zip(replayed.differing.as_ref());
        Self {
            layout: 1,
            axes: N,
            epoch: end.epoch.0,
            first_tick: window.entries.first().map_or(0, number_of),
            last_tick: window.entries.last().map_or(0, number_of),
            ticks: window.entries.len(),
            cause: end.cause.map(|cause| cause.name()),
            cause_tick: end.tick.0,
            cause_text: end
                .cause
                .map_or_else(|| NO_END.to_owned(), |cause| cause.to_string()),
            agreeing: replayed.agreeing,
            difference: difference
                .map(|(recorded, replayed)| Difference::of(&recorded.output, replayed)),
        }
    }
}

impl Difference {
    fn of<const N: usize>(recorded: &Output<N>, replayed: &Output<N>) -> Self {
        let tick = replayed.state.tick.0;
        let difference = black_box::first_difference(recorded, replayed);
        let (field, recorded, replayed) = difference.unwrap_or_default();
        let axis = ["references[", "state.axes["]
            .iter()
            .find_map(|list| field.strip_prefix(list)?.split(']').next()?.parse().ok())
            .map(|index: usize| index + 1);
        Self {
            tick,
            field,
            axis,
            recorded,
            replayed,
        }
    }
}

impl fmt::Display for Findings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (ticks, first, last) = (self.ticks, self.first_tick, self.last_tick);
        writeln!(f, "  {} axes, epoch {}", self.axes, self.epoch)?;
        writeln!(f, "  window    {ticks} ticks, {first} to {last}")?;
        let name = self.cause.unwrap_or("none");
        let tick = self.cause_tick;
        writeln!(f, "  cause     {name} in tick {tick}: {}", self.cause_text)?;
        write!(f, "  replay    ")?;
        match &self.difference {
            None => write!(f, "all {ticks} ticks agree bit for bit"),
            Some(difference) => {
                let agreeing = self.agreeing;
                write!(
                    f,
                    "{agreeing} of {ticks} ticks agree, then DIFFERS\n{difference}"
                )
            }
        }
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let axis = (self.axis).map_or_else(String::new, |axis| format!(" (axis {axis})"));
        write!(f, "            tick {}, {}{axis}: ", self.tick, self.field)?;
        write!(f, "recorded {}, replayed {}", self.recorded, self.replayed)
    }
}

#[cfg(test)]
mod tests {
    use gantry_tau_record::black_box::{decode, encode};
    use gantry_tau_test_support::black_boxes::window;

    use super::*;

    proptest::proptest! {
        /// A file with other digits is replayed and drawn for any of its numbers, or refused.
        #[test]
        fn any_digits_are_replayed_and_drawn(seed in 0..8_u64, places: Vec<(usize, u8)>) {
            let mut bytes = encode(&window::<3>(seed)).into_bytes();
            let head = bytes.iter().position(|byte| *byte == b'\n').unwrap();
            let digits: Vec<usize> = (head..bytes.len()).filter(|at| bytes[*at].is_ascii_digit()).collect();
            for (place, digit) in places.iter().take(8) {
                bytes[digits[place % digits.len()]] = b'1' + digit % 9;
            }
            if let Ok(window) = decode::<3>("x", &bytes) {
                let findings = Findings::of(&window);
                proptest::prop_assert!(Picture::of(&window, &findings).svg("x").ends_with("</svg>\n"));
            }
        }
    }
}
