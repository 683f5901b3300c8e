//! Page of a calibration.

use std::fmt::Write as _;

use nalgebra::Vector3;

use super::expected::Expected;
use crate::fit::answer::{Parameter, Unobservable};
use crate::fit::statistics::{float, median};
use crate::geometry::f1::Diagnostic;
use crate::plots::page::{escape, page};
use crate::plots::{Corner, Curve, Plot};
use crate::robot_file::Calibrated;
use crate::workspace::slices;

/// Length that the median rest is drawn with, m.
const DRAWN_M: f64 = 0.04;
/// Views: name, and the axes that point right and up.
const VIEWS: [(&str, usize, usize); 3] = [("from above", 0, 1), ("from the side", 0, 2), ("along the guideways", 1, 2)];
const AXES: [&str; 3] = ["x, m", "y, m", "z, m"];

/// Content of the page.
pub(super) struct Page<'a> {
    pub(super) robot: &'a str,
    pub(super) measurements: &'a Calibrated,
    pub(super) summary: &'a str,
    pub(super) doubts: &'a [String],
    pub(super) remarks: &'a [String],
    pub(super) parameters: &'a [Parameter],
    /// All combinations of parameters, the worst seen first.
    pub(super) directions: &'a [Unobservable],
    pub(super) diagnostics: &'a [Diagnostic],
    /// Place and rest, m.
    pub(super) residuals: &'a [[Vector3<f64>; 2]],
    pub(super) expected: &'a Expected,
}

impl Page<'_> {
    pub(super) fn html(&self) -> String {
        let Calibrated { measurements, crc, poses, .. } = self.measurements;
        let mut body = format!(
            "<h1>Geometry of {}</h1><p>{poses} poses of {} (CRC-32 {crc:08x}). {}</p>",
            escape(self.robot),
            escape(measurements),
            escape(self.summary)
        );
        for doubt in self.doubts {
            _ = write!(body, "<p class=\"bad\">{}</p>", escape(doubt));
        }
        for remark in self.remarks {
            _ = write!(body, "<p>{}</p>", escape(remark));
        }
        body += &self.rests();
        body += &slices(
            &self.expected.grid,
            "Expected error",
            "Of a place, root mean square, by the covariance of the parameters. Slices through home (the cross); measure where you work.",
            "µm",
            &self.expected.places_um,
        );
        body += "<h2>Parameters</h2><p>In the frame of the device.</p><table><tr><th>parameter<th>status<th>value<th>95 % interval<th>sd</tr>";
        for parameter in self.parameters {
            let Parameter { name, value, unit, sd, status, .. } = parameter;
            let interval =
                parameter.interval().map_or_else(|| "-".to_owned(), |[low, high]| format!("{low:.6} to {high:.6}"));
            _ = write!(body, "<tr><td>{name}<td>{}<td>{value:.6} {unit}<td>{interval}<td>{sd:.1e}</tr>", status.name());
        }
        body += "</table><h2>What can be seen</h2><p>Combinations of parameters by falling standard deviation, in centimetres and in centiradians; \
                 above 1 nothing is seen.</p><table><tr><th>sd<th>combination</tr>";
        for direction in self.directions {
            _ = write!(body, "<tr><td>{:.2e}<td>{direction}</tr>", direction.relative_sd);
        }
        body += "</table>";
        body += &self.departures();
        page("gantry-tau calibrate", &body)
    }

    /// Effects that the model leaves out, and how much of them the poses show.
    fn departures(&self) -> String {
        if self.diagnostics.is_empty() {
            return String::new();
        }
        let mut table = "<h2>What the model leaves out</h2><p>Fitted along with the parameters, one at a time, and judged by an F-test. The robot file has no \
                         place for it: nothing of it is written.</p><table><tr><th>departure<th>size<th>p</tr>"
            .to_owned();
        for found in self.diagnostics {
            _ = write!(table, "<tr><td>{}<td>{}<td>{:.2e}</tr>", found.departure, found.magnitude(), found.p);
        }
        table + "</table>"
    }

    /// Places, and what the machine leaves there, magnified.
    fn rests(&self) -> String {
        let lengths: Vec<f64> = self.residuals.iter().map(|[_, rest]| rest.norm()).collect();
        let rms = (lengths.iter().map(|length| length * length).sum::<f64>() / float(lengths.len())).sqrt();
        let factor = (DRAWN_M / median(lengths)).min(1e9);
        let mut body = format!(
            "<h2>What is left</h2><p>Measured less predicted place, {:.1} µm rms, drawn {factor:.0} times as long, in the frame of the device. \
             A pattern says that the model lacks something.</p>",
            rms * 1e6
        );
        for (name, right, up) in VIEWS {
            let mut curves = vec![Curve {
                colour: Some(0),
                ..Curve::dots("", self.residuals.iter().map(|[place, _]| (place[right], place[up])).collect())
            }];
            for [place, rest] in self.residuals {
                let end = place + rest * factor;
                let line = vec![(place[right], place[up]), (end[right], end[up])];
                curves.push(Curve { colour: Some(1), ..Curve::line("", line) });
            }
            let plot = Plot {
                x_axis: AXES[right],
                y_axis: AXES[up],
                curves,
                bands: Vec::new(),
                y_names: Vec::new(),
                key: Corner::UpperLeft,
            };
            _ = write!(body, "<h3>{name}</h3>{}", plot.svg());
        }
        body
    }
}
