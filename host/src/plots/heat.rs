//! Colours over a plane: one value per cell of a regular grid, on a logarithmic scale.

use plotters::prelude::*;

/// Size of a map with its scale, px.
const SIZE: (u32, u32) = (560, 460);
/// Width of the scale, px.
const SCALE: u32 = 90;
/// Colours of the scale from its lower to its upper end (viridis: even in lightness, readable with colour blindness).
const COLOURS: [(f64, f64, f64); 5] =
    [(68.0, 1.0, 84.0), (59.0, 82.0, 139.0), (33.0, 145.0, 140.0), (94.0, 201.0, 98.0), (253.0, 231.0, 37.0)];
/// Number of shades drawn for the scale.
const SHADES: u32 = 64;

/// Cell of a map: x and y of its middle, and its value.
pub(crate) type Cell = (f64, f64, f64);

/// Values over a plane; places without a cell stay white.
pub(crate) struct HeatMap {
    pub(crate) x_axis: &'static str,
    pub(crate) y_axis: &'static str,
    pub(crate) value: &'static str,
    /// Side of a cell, in the units of both axes.
    pub(crate) pitch: f64,
    pub(crate) cells: Vec<Cell>,
    /// Place of a cross.
    pub(crate) mark: (f64, f64),
    /// Ends of the scale, positive; values beyond have the end's colour.
    pub(crate) scale: (f64, f64),
}

impl HeatMap {
    /// The map as an `<svg>` element.
    pub(crate) fn svg(&self) -> String {
        let mut svg = String::new();
        if let Err(error) = self.draw(&mut svg) {
            return format!("<p>This map could not be drawn: {error}</p>");
        }
        svg
    }

    fn draw(&self, svg: &mut String) -> Result<(), Box<dyn std::error::Error>> {
        let root = SVGBackend::with_string(svg, SIZE).into_drawing_area();
        root.fill(&WHITE)?;
        let (map, scale) = root.split_horizontally(SIZE.0.saturating_sub(SCALE));
        // Cells overlap a little, so that no gap shows between neighbours.
        let half = 0.51 * self.pitch;
        let (x, y) = self.ranges();
        let mut chart =
            ChartBuilder::on(&map).margin(10).x_label_area_size(42).y_label_area_size(56).build_cartesian_2d(x, y)?;
        chart
            .configure_mesh()
            .x_desc(self.x_axis)
            .y_desc(self.y_axis)
            .light_line_style(TRANSPARENT)
            .bold_line_style(BLACK.mix(0.12))
            .label_style(("sans-serif", 14))
            .axis_desc_style(("sans-serif", 15))
            .draw()?;
        chart.draw_series(self.cells.iter().map(|(x, y, value)| {
            let corners = [(x - half, y - half), (x + half, y + half)];
            Rectangle::new(corners, self.colour(*value).filled())
        }))?;
        let cross = Cross::new(self.mark, 6, RGBColor(200, 0, 0).stroke_width(2));
        chart.draw_series([cross])?;
        self.draw_scale(&scale)?;
        root.present()?;
        Ok(())
    }

    fn draw_scale<B: DrawingBackend>(
        &self,
        area: &DrawingArea<B, plotters::coord::Shift>,
    ) -> Result<(), DrawingAreaErrorKind<B::ErrorType>> {
        let (low, high) = self.scale;
        let mut chart = ChartBuilder::on(area)
            .margin(10)
            .margin_bottom(52)
            .y_label_area_size(50)
            .build_cartesian_2d(0.0..1.0, low.log10()..high.log10())?;
        let number = |exponent: &f64| {
            let value = 10.0_f64.powf(*exponent);
            let digits = if value < 10.0 { 2 } else { 0 };
            format!("{value:.digits$}")
        };
        chart
            .configure_mesh()
            .disable_mesh()
            .disable_x_axis()
            .y_labels(6)
            .y_label_formatter(&number)
            .y_desc(self.value)
            .label_style(("sans-serif", 13))
            .axis_desc_style(("sans-serif", 14))
            .draw()?;
        let span = high.log10() - low.log10();
        chart.draw_series((0..SHADES).map(|shade| {
            let at = |n: u32| low.log10() + span * f64::from(n) / f64::from(SHADES);
            let middle = 10.0_f64.powf((at(shade) + at(shade + 1)) / 2.0);
            let corners = [(0.0, at(shade)), (1.0, at(shade + 1))];
            Rectangle::new(corners, self.colour(middle).filled())
        }))?;
        Ok(())
    }

    /// Both axes with the same length per unit, around the cells.
    fn ranges(&self) -> (std::ops::Range<f64>, std::ops::Range<f64>) {
        let extent = |of: fn(&Cell) -> f64| {
            let ends = (f64::MAX, f64::MIN);
            let (low, high) = (self.cells.iter().map(of)).fold(ends, |(low, high), x| (low.min(x), high.max(x)));
            if low > high { (0.0, 1.0) } else { (low, high) }
        };
        let (x, y) = (extent(|cell| cell.0), extent(|cell| cell.1));
        let side = (x.1 - x.0).max(y.1 - y.0) + 3.0 * self.pitch;
        let around = |(low, high): (f64, f64)| {
            let middle = (low + high) / 2.0;
            middle - side / 2.0..middle + side / 2.0
        };
        (around(x), around(y))
    }

    #[expect(clippy::indexing_slicing, reason = "`below` is at most the last but one")]
    fn colour(&self, value: f64) -> RGBColor {
        let (low, high) = self.scale;
        let share = (value / low).ln() / (high / low).ln();
        let last = (COLOURS.len() - 1) as f64;
        // NaN becomes the lower end.
        let place = if share > 0.0 { share.min(1.0) * last } else { 0.0 };
        let below = (place as usize).min(COLOURS.len() - 2);
        let part = place - below as f64;
        let (from, to) = (COLOURS[below], COLOURS[below + 1]);
        let mix = |from: f64, to: f64| channel(from + (to - from) * part);
        RGBColor(mix(from.0, to.0), mix(from.1, to.1), mix(from.2, to.2))
    }
}

/// Nearest value of a colour channel.
fn channel(value: f64) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}
