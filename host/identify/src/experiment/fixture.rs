//! Plans of the tests.

use std::path::{Path, PathBuf};

use gantry_tau_test_support::campaigns;
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

/// Campaign A of an L2, with this set-up and these levels.
pub(crate) fn campaign_a(setup: &str, levels: &[u32]) -> String {
    campaigns::campaign_a(&format!("{NOISE}{setup}"), levels)
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
