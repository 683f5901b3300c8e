//! Picture of a window: offsets, their change since the cause, and events, over ticks relative to the cause.

use gantry_tau_core::control::session::Entry;
use gantry_tau_core::units::Tick;

use super::Findings;
use crate::black_box::Window;
use crate::plots::page::{self, escape};
use crate::plots::{Band, Corner, Curve, Plot, SIZE, phases};

/// Height of a title, and of the key to the colours, in the SVG, px.
const LINE: u32 = 34;
/// Rows of the event plot, from below.
const EVENTS: [&str; 8] = [
    "answer accepted",
    "deadline missed",
    "late or bad frame",
    "limited, clamped",
    "other peer, refusal",
    "stop held",
    "session granted",
    "session ended",
];

/// Titles and plots.
pub(crate) struct Picture(Vec<(&'static str, Plot)>);

impl Picture {
    pub(crate) fn of<const N: usize>(window: &Window<N>, findings: &Findings) -> Self {
        let scene = Scene { window, findings };
        Self(vec![
            ("Position offsets", scene.offsets("position offset, µm", |_| 0)),
            (
                "Change of the offsets since the tick before the cause",
                scene.offsets("change, µm", |axis| scene.offset_before_cause(axis)),
            ),
            ("Events", scene.events()),
        ])
    }

    /// The plots as a page with the summary.
    pub(crate) fn page(&self, summary: &str) -> String {
        let summary = escape(summary);
        let mut body = format!("<h1>Black box</h1><pre>{summary}</pre>{}", page::key());
        for (title, plot) in &self.0 {
            body.push_str(&format!("<h2>{title}</h2>{}", plot.svg()));
        }
        page::page("gantry-tau replay", &body)
    }

    /// The plots below each other as one drawing.
    pub(crate) fn svg(&self, name: &str) -> String {
        let (width, height) = SIZE;
        let mut y = LINE;
        let mut body = text(12, y - 12, name);
        for (x, (name, colour)) in (0..).map(|place| 12 + 145 * place).zip(phases::key()) {
            let label = text(x + 6, y + 14, name);
            let y = y - 2;
            body.push_str(&format!(
                "<rect x=\"{x}\" y=\"{y}\" width=\"135\" height=\"22\" rx=\"3\" fill=\"{colour}\"/>{label}"
            ));
        }
        y += LINE;
        for (title, plot) in &self.0 {
            body.push_str(&text(12, y + 18, title));
            y += LINE;
            body.push_str(&format!("<g transform=\"translate(0,{y})\">{}</g>", plot.svg()));
            y += height;
        }
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{y}\" viewBox=\"0 0 {width} {y}\">\
             <rect width=\"{width}\" height=\"{y}\" fill=\"white\"/>{body}</svg>\n"
        )
    }
}

fn text(x: u32, y: u32, text: &str) -> String {
    let text = escape(text);
    format!("<text x=\"{x}\" y=\"{y}\" font-family=\"sans-serif\" font-size=\"15\" fill=\"#222\">{text}</text>")
}

/// Data of the plots.
struct Scene<'a, const N: usize> {
    window: &'a Window<N>,
    findings: &'a Findings,
}

impl<const N: usize> Scene<'_, N> {
    /// Position of a tick on the x axis.
    fn x(&self, tick: Tick) -> f64 {
        let ticks = i128::from(tick.0) - i128::from(self.findings.cause_tick);
        i32::try_from(ticks).map_or(f64::NAN, f64::from)
    }

    const fn x_axis(&self) -> &'static str {
        match self.findings.cause {
            Some(_) => "ticks after the cause",
            None => "ticks after the last",
        }
    }

    fn points(&self) -> impl Iterator<Item = (f64, &Entry<N>)> {
        let entries = self.window.entries.iter();
        entries.map(|entry| (self.x(entry.output.state.tick), entry))
    }

    fn bands(&self) -> Vec<Band> {
        phases::bands(self.points().map(|(x, entry)| (x, entry.output.state.phase)))
    }

    /// Position offset of an axis before the cause, nm.
    fn offset_before_cause(&self, axis: usize) -> i32 {
        let index = self.window.end().index.saturating_sub(1);
        let entry = self.window.entries.get(index);
        let offsets = entry.and_then(|entry| Some(entry.output.state.axes.get(axis)?.offsets));
        offsets.unwrap_or_default().position.0
    }

    /// Position offsets minus `origin` (nm), one curve per axis; the cause and the first difference as vertical lines.
    fn offsets(&self, y_axis: &'static str, origin: impl Fn(usize) -> i32) -> Plot {
        let curve = |axis: usize| {
            let origin = f64::from(origin(axis));
            let points = self.points().filter_map(|(x, entry)| {
                let offset = entry.output.state.axes.get(axis)?.offsets.position.0;
                Some((x, (f64::from(offset) - origin) / 1e3))
            });
            Curve::line(&format!("axis {}", axis + 1), points.collect())
        };
        let mut curves: Vec<Curve> = (0..N).map(curve).collect();
        let values = || curves.iter().flat_map(|curve| &curve.points).map(|point| point.1);
        let (low, high) = (values().fold(0.0, f64::min), values().fold(0.0, f64::max));
        let vertical = |name: &str, x: f64| Curve::line(name, vec![(x, low), (x, high)]);
        let mut marks = Vec::new();
        if let Some(cause) = &self.findings.cause {
            marks.push(vertical(cause, 0.0));
        }
        if let Some(difference) = &self.findings.difference {
            marks.push(vertical("replay differs", self.x(Tick(difference.tick))));
        }
        curves.extend(marks);
        Plot { x_axis: self.x_axis(), y_axis, curves, bands: self.bands(), y_names: Vec::new(), key: Corner::UpperLeft }
    }

    /// One dot per event.
    fn events(&self) -> Plot {
        let mut dots = Vec::new();
        // The oldest tick has no predecessor to compare with.
        let oldest = self.window.entries.first();
        let (mut accepted, mut counters) =
            oldest.map_or_else(Default::default, |entry| (entry.output.state.accepted, entry.output.state.counters));
        for (x, entry) in self.points() {
            let (output, state) = (&entry.output, &entry.output.state);
            let now = state.counters;
            let bad = |c: gantry_tau_core::control::message::Counters| {
                [c.late, c.duplicate, c.stale, c.malformed, c.out_of_range]
            };
            let happened = [
                state.accepted > accepted,
                now.missed > counters.missed,
                bad(now) > bad(counters),
                [now.limited, now.clamped] > [counters.limited, counters.clamped],
                now.non_owner > counters.non_owner || !output.refusals.is_empty(),
                entry.input.tick.stop,
                output.welcome.is_some(),
                output.ended.is_some(),
            ];
            let rows = (0..).zip(happened).filter(|(_, happened)| *happened);
            dots.extend(rows.map(|(row, _)| (x, f64::from(row))));
            (accepted, counters) = (state.accepted, now);
        }
        let (first, last) = (self.x(Tick(self.findings.first_tick)), self.x(Tick(self.findings.last_tick)));
        let rows = (0..).zip(EVENTS).map(|(row, _)| f64::from(row));
        // Extends the axes to all rows and the whole window.
        let frame = rows.flat_map(|row| [(first, row), (last, row)]);
        Plot {
            x_axis: self.x_axis(),
            y_axis: "",
            curves: vec![Curve::dots("events", dots), Curve { dots: false, ..Curve::dots("", frame.collect()) }],
            bands: self.bands(),
            y_names: EVENTS.into(),
            key: Corner::UpperLeft,
        }
    }
}
