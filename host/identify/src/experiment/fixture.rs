//! Plans of the tests.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use crate::measurements::plan::{self, Plan};

/// A folder that is removed at the end of its test.
pub(crate) struct Folder(pub(crate) TempDir);

impl Folder {
    pub(crate) fn new(name: &str) -> Self {
        Self(
            tempfile::Builder::new()
                .prefix(&format!("gantry-tau-experiment-{name}-"))
                .tempdir()
                .unwrap(),
        )
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
}

/// Levels of campaign A, N.
pub(crate) const LEVELS: [u32; 11] = [0, 60, 120, 180, 240, 300, 240, 180, 120, 60, 0];

/// Noise of campaign A, and its set-up errors.
pub(crate) const NOISE: &str = "gauge_um = 1.0\nforce_n = 1.0\nmoment_nm = 0.05\n";
pub(crate) const SETUP: &str = "[setup]\ngauge_point_mm = 0.5\ngauge_axis_mrad = 2.0\nsensor_lever_mm = 0.5\n\
    sensor_axes_mrad = 2.0\nsensor_gain = 0.005\n";

/// Campaign A of an L2: at home, three hooks, three directions, six gauges on the platform and
/// three on carts.
pub(crate) fn campaign_a(setup: &str, levels: &[u32]) -> String {
    let mut text = format!(
        "format = \"gantry-tau springs 1\"\nmodel = \"l2\"\nmeasurements = \"springs.csv\"\n[noise]\n{NOISE}{setup}\
         [[pose]]\nname = \"home\"\nT = [0.0, 0.5, 0.65]\n"
    );
    let platform = [
        ("pz1", [0.12, -0.06, 0.10], [0.0, 0.0, 1.0]),
        ("pz2", [-0.12, -0.06, 0.10], [0.0, 0.0, 1.0]),
        ("pz3", [0.0, 0.10, 0.10], [0.0, 0.0, 1.0]),
        ("py1", [0.10, 0.12, 0.05], [0.0, 1.0, 0.0]),
        ("py2", [-0.10, 0.12, 0.05], [0.0, 1.0, 0.0]),
        ("px1", [0.14, 0.0, 0.05], [1.0, 0.0, 0.0]),
    ];
    for (name, point, axis) in platform {
        write!(
            text,
            "[[gauge]]\nname = {name:?}\non = \"platform\"\npoint_m = {point:?}\naxis = {axis:?}\n"
        )
        .unwrap();
    }
    for axis in 1..=3 {
        write!(
            text,
            "[[gauge]]\nname = \"axis{axis}\"\non = \"axis\"\naxis_number = {axis}\n"
        )
        .unwrap();
    }
    for (hook, place) in [[0.0, 0.0, -0.08], [0.15, 0.0, -0.08], [0.0, 0.15, -0.08]]
        .into_iter()
        .enumerate()
    {
        for (name, direction) in [
            ("x", [1.0, 0.0, 0.0]),
            ("y", [0.0, 1.0, 0.0]),
            ("z", [0.0, 0.0, 1.0]),
        ] {
            let hook = hook + 1;
            let series = format!("{name}{hook}");
            write!(
                text,
                "[[series]]\nname = {series:?}\npose = \"home\"\nmounting = \"hook {hook}, {name}\"\n\
                 hook_m = {place:?}\ndirection = {direction:?}\nlevels_n = {levels:?}\n\
                 gauges = [\"pz1\", \"pz2\", \"pz3\", \"py1\", \"py2\", \"px1\", \"axis1\", \"axis2\", \"axis3\"]\n"
            )
            .unwrap();
        }
    }
    text
}

/// The first series of a plan; the second of them at another pose.
pub(crate) fn first_series(plan: &str, count: usize) -> String {
    let mut parts = plan.split("[[series]]");
    let mut text = parts.next().unwrap().to_owned();
    text += "[[pose]]\nname = \"aside\"\nT = [0.02, 0.5, 0.65]\n";
    for (index, series) in parts.take(count).enumerate() {
        let series = if index == 1 {
            series.replace("\"home\"", "\"aside\"")
        } else {
            series.to_owned()
        };
        text += &format!("[[series]]{series}");
    }
    text
}

/// Writes a plan of the L2 and reads it.
pub(crate) fn plan_in(folder: &Folder, text: &str) -> Plan<3> {
    let path = folder.path("plan.toml");
    std::fs::write(&path, text).unwrap();
    read(&path)
}

pub(crate) fn read(path: &Path) -> Plan<3> {
    plan::read(path, "l2", &[1.0; 3]).unwrap()
}
