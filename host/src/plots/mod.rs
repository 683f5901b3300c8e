//! Plots as SVG, and pages around them. The browser draws the text; fonts are not needed.

pub(crate) mod heat;
pub(crate) mod over_time;
pub(crate) mod page;
pub(crate) mod phases;

pub use plotters::chart::SeriesLabelPosition as Corner;
use plotters::prelude::*;

/// Size of a plot, px.
pub(crate) const SIZE: (u32, u32) = (900, 420);
const COLOURS: [RGBColor; 8] = [
    RGBColor(31, 119, 180),
    RGBColor(214, 90, 30),
    RGBColor(44, 140, 70),
    RGBColor(120, 80, 170),
    RGBColor(130, 130, 130),
    RGBColor(140, 86, 75),
    RGBColor(200, 70, 140),
    RGBColor(0, 0, 0),
];
/// One curve.
pub struct Curve {
    /// Name in the key; empty: none.
    pub name: String,
    /// Points, x and y.
    pub points: Vec<(f64, f64)>,
    /// Draws dots at the points.
    pub dots: bool,
    /// Draws no line between the points.
    pub no_line: bool,
    /// Number of its colour; without one, its place among the curves.
    pub colour: Option<usize>,
}

impl Curve {
    /// Creates a line.
    pub fn line(name: &str, points: Vec<(f64, f64)>) -> Self {
        Self { name: name.to_owned(), points, dots: false, no_line: false, colour: None }
    }

    /// Creates dots without a line.
    pub fn dots(name: &str, points: Vec<(f64, f64)>) -> Self {
        Self { dots: true, no_line: true, ..Self::line(name, points) }
    }
}

/// A coloured stretch of the x axis.
pub struct Band {
    /// Lower end.
    pub from: f64,
    /// Upper end.
    pub to: f64,
    /// Colour.
    pub colour: RGBColor,
}

/// Axes, curves and bands of a plot.
pub struct Plot {
    /// Text of the x axis.
    pub x_axis: &'static str,
    /// Text of the y axis.
    pub y_axis: &'static str,
    /// Curves.
    pub curves: Vec<Curve>,
    /// Bands behind them.
    pub bands: Vec<Band>,
    /// Names for integer values of y; empty for numbers.
    pub y_names: Vec<&'static str>,
    /// Corner for the names of the curves.
    pub key: Corner,
}

impl Plot {
    /// Returns the plot as an `<svg>` element.
    pub fn svg(&self) -> String {
        let mut svg = String::new();
        if let Err(error) = self.draw(&mut svg) {
            return format!("<p>This plot could not be drawn: {error}</p>");
        }
        svg
    }

    fn draw(&self, svg: &mut String) -> Result<(), Box<dyn std::error::Error>> {
        let (x, y) = (self.range(|point| point.0, 0.0), self.range(|point| point.1, 0.06));
        let root = SVGBackend::with_string(svg, SIZE).into_drawing_area();
        root.fill(&WHITE)?;
        let names = &self.y_names;
        let label_width = if names.is_empty() { 70 } else { 130 };
        let mut chart = ChartBuilder::on(&root)
            .margin(12)
            .margin_right(32)
            .x_label_area_size(44)
            .y_label_area_size(label_width)
            .build_cartesian_2d(x.clone(), y.clone())?;
        chart.draw_series(self.bands.iter().map(|band| {
            let from = band.from.clamp(x.start, x.end);
            let to = band.to.clamp(x.start, x.end);
            Rectangle::new([(from, y.start), (to, y.end)], band.colour.filled())
        }))?;
        let name = |value: &f64| self.name_of(*value);
        let (x_number, y_number) = (number(&x), number(&y));
        let mut mesh = chart.configure_mesh();
        mesh.x_desc(self.x_axis)
            .x_label_formatter(&x_number)
            .y_label_formatter(&y_number)
            .y_desc(self.y_axis)
            .light_line_style(TRANSPARENT)
            .bold_line_style(BLACK.mix(0.12))
            .label_style(("sans-serif", 14))
            .axis_desc_style(("sans-serif", 15));
        if !names.is_empty() {
            mesh.y_labels(names.len() + 1).y_label_formatter(&name);
        }
        mesh.draw()?;
        for (place, curve) in self.curves.iter().enumerate() {
            let mut colours = COLOURS.iter().cycle().skip(curve.colour.unwrap_or(place));
            let Some(colour) = colours.next() else { continue };
            let style = colour.stroke_width(2);
            let is_named = !curve.name.is_empty();
            if !curve.no_line {
                let line = chart.draw_series(LineSeries::new(curve.points.iter().copied(), style))?;
                if is_named {
                    line.label(&curve.name).legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
                }
            }
            if curve.dots {
                let dot = |point: &(f64, f64)| Circle::new(*point, 4, colour.filled());
                let dots = chart.draw_series(curve.points.iter().map(dot))?;
                if is_named && curve.no_line {
                    let colour = *colour;
                    dots.label(&curve.name).legend(move |(x, y)| Circle::new((x + 9, y), 4, colour.filled()));
                }
            }
        }
        let named = self.curves.iter().filter(|curve| !curve.name.is_empty());
        if named.count() > 1 {
            chart
                .configure_series_labels()
                .position(self.key.clone())
                .background_style(WHITE.mix(0.85))
                .border_style(BLACK.mix(0.3))
                .label_font(("sans-serif", 14))
                .draw()?;
        }
        root.present()?;
        Ok(())
    }

    fn name_of(&self, value: f64) -> String {
        (self.y_names.iter())
            .zip(0..)
            .find(|(_, number)| (value - f64::from(*number)).abs() < 1e-6)
            .map_or_else(String::new, |(name, _)| (*name).to_owned())
    }

    /// Range of a coordinate, extended by `margin` of its span at both ends.
    fn range(&self, coordinate: impl Fn(&(f64, f64)) -> f64, margin: f64) -> std::ops::Range<f64> {
        let values = self.curves.iter().flat_map(|curve| &curve.points).map(coordinate);
        let (low, high) = values
            .filter(|value| value.is_finite())
            .fold((f64::MAX, f64::MIN), |(low, high), value| (low.min(value), high.max(value)));
        if low > high {
            return 0.0..1.0;
        }
        let span = if high > low { high - low } else { 1.0 };
        low - margin * span..high + margin * span
    }
}

/// Formatter of axis labels, with digits according to the span.
fn number(range: &std::ops::Range<f64>) -> impl Fn(&f64) -> String {
    let digits = usize::from(range.end - range.start < 10.0);
    move |value| format!("{value:.digits$}")
}
