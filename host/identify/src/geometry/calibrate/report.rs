//! Page of a calibration.

use gantry_tau_machine::robot_file::Calibrated;
use gantry_tau_report::page::{Page, Table};
use gantry_tau_report::plots::{Curve, Plot};
use gantry_tau_report::workspace::add_slices;
use nalgebra::Vector3;

use super::expected::Expected;
use crate::fit::answer::{Parameter, Unobservable};
use crate::fit::statistics::{float, median};
use crate::geometry::f1::Diagnostic;

/// Length that the median rest is drawn with, m.
const DRAWN_M: f64 = 0.04;
/// Views: name, and the axes that point right and up.
const VIEWS: [(&str, usize, usize); 3] = [
    ("from above", 0, 1),
    ("from the side", 0, 2),
    ("along the guideways", 1, 2),
];
const AXES: [&str; 3] = ["x, m", "y, m", "z, m"];

/// Content of the page.
pub(super) struct CalibrationPage<'a> {
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

impl CalibrationPage<'_> {
    pub(super) fn html(&self) -> String {
        let Calibrated {
            measurements,
            crc,
            poses,
            ..
        } = self.measurements;
        let mut page = Page::new(
            "gantry-tau calibrate",
            format!("Geometry of {}", self.robot),
        );
        page.paragraph(format!(
            "{poses} poses of {measurements} (CRC-32 {crc:08x}). {}",
            self.summary
        ));
        for doubt in self.doubts {
            page.warning(doubt);
        }
        for remark in self.remarks {
            page.paragraph(remark);
        }
        self.add_rests(&mut page);
        add_slices(
            &mut page,
            &self.expected.grid,
            "Expected error",
            "Of a place, root mean square, by the covariance of the parameters. Slices through home (the cross); measure where you work.",
            "µm",
            &self.expected.places_um,
        );
        self.add_parameters(&mut page);
        self.add_directions(&mut page);
        self.add_departures(&mut page);
        page.html()
    }

    fn add_parameters(&self, page: &mut Page) {
        page.section("Parameters");
        page.paragraph("In the frame of the device.");
        let mut table = Table::new(["parameter", "status", "value", "95 % interval", "sd"]);
        for parameter in self.parameters {
            let Parameter {
                name,
                value,
                unit,
                sd,
                status,
                ..
            } = parameter;
            let interval = parameter.interval().map_or_else(
                || "-".to_owned(),
                |[low, high]| format!("{low:.6} to {high:.6}"),
            );
            table.row([
                name.to_string(),
                status.name().to_owned(),
                format!("{value:.6} {unit}"),
                interval,
                format!("{sd:.1e}"),
            ]);
        }
        page.table(table);
    }

    fn add_directions(&self, page: &mut Page) {
        page.section("What can be seen");
        page.paragraph(
            "Combinations of parameters by falling standard deviation, in centimetres and in centiradians; \
             above 1 nothing is seen.",
        );
        let mut table = Table::new(["sd", "combination"]);
        for direction in self.directions {
            table.row([
                format!("{:.2e}", direction.relative_sd),
                direction.to_string(),
            ]);
        }
        page.table(table);
    }

    /// Effects that the model leaves out, and how much of them the poses show.
    fn add_departures(&self, page: &mut Page) {
        if self.diagnostics.is_empty() {
            return;
        }
        page.section("What the model leaves out");
        page.paragraph(
            "Fitted along with the parameters, one at a time, and judged by an F-test. The robot file has no \
             place for it: nothing of it is written.",
        );
        let mut table = Table::new(["departure", "size", "p"]);
        for found in self.diagnostics {
            table.row([
                found.departure.to_string(),
                found.magnitude().to_string(),
                format!("{:.2e}", found.p),
            ]);
        }
        page.table(table);
    }

    /// Places, and what the machine leaves there, magnified.
    fn add_rests(&self, page: &mut Page) {
        let lengths: Vec<f64> = self.residuals.iter().map(|[_, rest]| rest.norm()).collect();
        let rms = (lengths.iter().map(|length| length * length).sum::<f64>()
            / float(lengths.len()))
        .sqrt();
        let factor = (DRAWN_M / median(lengths)).min(1e9);
        page.section("What is left");
        page.paragraph(format!(
            "Measured less predicted place, {:.1} µm rms, drawn {factor:.0} times as long, in the frame of the device. \
             A pattern says that the model lacks something.",
            rms * 1e6
        ));
        for (name, right, up) in VIEWS {
            page.subsection(name);
            page.picture(&self.rests(name, right, up, factor).svg());
        }
    }

    /// A view of the places with their rests, drawn `factor` times as long.
    fn rests(&self, name: &str, right: usize, up: usize, factor: f64) -> Plot {
        let places = self.residuals.iter();
        let places = places.map(|[place, _]| (place[right], place[up]));
        let mut curves = vec![Curve::dots("", places.collect()).styled(0)];
        for [place, rest] in self.residuals {
            let end = place + rest * factor;
            let line = vec![(place[right], place[up]), (end[right], end[up])];
            curves.push(Curve::line("", line).in_ink());
        }
        let title = format!("What is left, {name}");
        Plot::new(title, AXES[right], AXES[up], curves).with_equal_axes()
    }
}
