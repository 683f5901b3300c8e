//! Picture of a window: offsets, their change since the cause, and events, over ticks relative to
//! the cause.

use gantry_tau_core::control::message::Counters;
use gantry_tau_core::control::session::Entry;
use gantry_tau_core::units::Tick;
use gantry_tau_report::page::Page;
use gantry_tau_report::plots::{Band, Curve, Plot, phases};
use gantry_tau_report::svg::{Colour, Drawing, Point, Shape};
use gantry_tau_server::black_box::Window;

use super::Findings;

/// Height of a title in the SVG, px, and size of its letters.
const LINE: f64 = 34.0;
const LETTERS: u32 = 15;
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

/// Plots of a window.
pub(crate) struct Picture([Plot; 3]);

impl Picture {
    pub(crate) fn of<const N: usize>(window: &Window<N>, findings: &Findings) -> Self {
        let scene = Scene { window, findings };
        Self([
            scene.offsets("Position offsets", "position offset, µm", |_| 0),
            scene.offsets(
                "Change of the offsets since the tick before the cause",
                "change, µm",
                |axis| scene.offset_before_cause(axis),
            ),
            scene.events(),
        ])
    }

    /// The plots as a page with the summary.
    pub(crate) fn page(&self, summary: &str) -> String {
        let mut page = Page::new("gantry-tau replay", "Black box");
        page.preformatted(summary);
        for plot in &self.0 {
            page.section(plot.title());
            page.picture(&plot.svg());
        }
        page.html()
    }

    /// The plots below each other as one drawing.
    pub(crate) fn svg(&self, name: &str) -> String {
        let plots = self.0.each_ref().map(Plot::drawing);
        let height = LINE + plots.iter().map(|plot| LINE + plot.height()).sum::<f64>();
        let width = plots.iter().map(Drawing::width).fold(0.0, f64::max);
        let mut drawing = Drawing::new(width, height);
        let paper = [Point::zeros(), Point::new(width, height)];
        drawing.add(Shape::rectangle(paper).fill(Colour::PAPER));
        drawing.add(heading(LINE, name));
        let mut y = LINE;
        for (plot, shapes) in self.0.iter().zip(&plots) {
            y += LINE;
            drawing.add(heading(y, plot.title()));
            drawing.insert(Point::new(0.0, y), shapes);
            y += shapes.height();
        }
        drawing.finish("Black box", name).as_str().to_owned()
    }
}

/// Title above the height `y`.
fn heading(y: f64, text: &str) -> Shape {
    let heading = Shape::text(Point::new(12.0, y - 12.0), text).fill(Colour::INK);
    heading.with("font-size", LETTERS)
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
        phases::bands(
            self.points()
                .map(|(x, entry)| (x, entry.output.state.phase)),
        )
    }

    /// Position offset of an axis before the cause, nm.
    fn offset_before_cause(&self, axis: usize) -> i32 {
        let index = self.window.end().index.saturating_sub(1);
        let entry = self.window.entries.get(index);
        let offsets = entry.and_then(|entry| Some(entry.output.state.axes.get(axis)?.offsets));
        offsets.unwrap_or_default().position.0
    }

    /// Position offsets minus `origin` (nm), one curve per axis; the cause and the first difference
    /// as vertical lines.
    fn offsets(&self, title: &str, y_axis: &str, origin: impl Fn(usize) -> i32) -> Plot {
        let mut curves: Vec<Curve> = (0..N)
            .map(|axis| self.offset(axis, f64::from(origin(axis))))
            .collect();
        let points = curves.iter().flat_map(Curve::points);
        let ends = points.fold([0.0_f64; 2], |[low, high], point| {
            [low.min(point.1), high.max(point.1)]
        });
        if let Some(cause) = &self.findings.cause {
            curves.push(vertical(cause, 0.0, ends));
        }
        if let Some(difference) = &self.findings.difference {
            let x = self.x(Tick(difference.tick));
            curves.push(vertical("replay differs", x, ends));
        }
        Plot::new(title, self.x_axis(), y_axis, curves).with_bands(self.bands())
    }

    /// Position offset of an axis minus `origin_nm`, µm.
    fn offset(&self, axis: usize, origin_nm: f64) -> Curve {
        let points = self.points().filter_map(|(x, entry)| {
            let offset = entry.output.state.axes.get(axis)?.offsets.position.0;
            Some((x, (f64::from(offset) - origin_nm) / 1e3))
        });
        Curve::line(&format!("axis {}", axis + 1), points.collect())
    }

    /// One dot per event.
    fn events(&self) -> Plot {
        let mut dots = Vec::new();
        // The oldest tick has no predecessor to compare with.
        let mut before = self.window.entries.first();
        for (x, entry) in self.points() {
            let happened = happened(entry, before.unwrap_or(entry));
            let rows = (0..).zip(happened).filter(|(_, happened)| *happened);
            dots.extend(rows.map(|(row, _)| (x, f64::from(row))));
            before = Some(entry);
        }
        let ends = [self.findings.first_tick, self.findings.last_tick];
        let [first, last] = ends.map(|tick| self.x(Tick(tick)));
        let rows = (0..).zip(EVENTS).map(|(row, _)| f64::from(row));
        // The axes reach to all rows and over the whole window.
        let frame = rows.flat_map(|row| [(first, row), (last, row)]);
        let curves = vec![Curve::dots("events", dots), Curve::frame(frame.collect())];
        Plot::new("Events", self.x_axis(), "", curves)
            .with_bands(self.bands())
            .with_names(EVENTS)
    }
}

/// Line across a plot.
fn vertical(name: &str, x: f64, [low, high]: [f64; 2]) -> Curve {
    Curve::line(name, vec![(x, low), (x, high)])
}

/// Says of each event if it happened between two ticks.
fn happened<const N: usize>(entry: &Entry<N>, before: &Entry<N>) -> [bool; 8] {
    let output = &entry.output;
    let [state, last] = [entry, before].map(|entry| &entry.output.state);
    let [now, then] = [state, last].map(|state| state.counters);
    [
        state.accepted > last.accepted,
        now.missed > then.missed,
        bad(now) > bad(then),
        [now.limited, now.clamped] > [then.limited, then.clamped],
        now.non_owner > then.non_owner || !output.refusals.is_empty(),
        entry.input.tick.stop,
        output.welcome.is_some(),
        output.ended.is_some(),
    ]
}

/// Counters of frames that came late or bad.
const fn bad(c: Counters) -> [u32; 5] {
    [c.late, c.duplicate, c.stale, c.malformed, c.out_of_range]
}
