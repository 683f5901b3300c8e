//! File that names the gauges of a bus.

use std::path::Path;

use gantry_tau_ethercat::{GaugeConfig, NoReading};
use gantry_tau_identify::measurements::{FileError, setup};
use gantry_tau_machine::robot_file::{EthercatGauge, MAX_GAUGES, problems_of_gauges};
use serde::Deserialize;

use crate::ethercat::places;

/// The gauges of a file, in its order.
#[derive(Clone, Debug)]
pub struct GaugesFile {
    /// Path of the file, for errors.
    pub(super) path: String,
    pub(super) gauges: Vec<EthercatGauge>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GaugeTables {
    #[serde(default)]
    gauge: Vec<EthercatGauge>,
}

impl GaugesFile {
    /// Reads a file.
    ///
    /// # Errors
    /// [`FileError`], with the key that is wrong.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        Self::parse(path, &setup::text(path)?)
    }

    fn parse(path: &Path, text: &str) -> Result<Self, FileError> {
        let GaugeTables { gauge: gauges } = setup::parse(path, text)?;
        if gauges.is_empty() {
            let reason = format!("expected 1 to {MAX_GAUGES} tables, found none");
            return Err(FileError::key(path, "gauge", reason));
        }
        if let Some((key, reason)) = problems_of_gauges(&gauges).into_iter().next() {
            return Err(FileError::key(path, format!("gauge{key}"), reason));
        }
        let path = path.display().to_string();
        Ok(Self { path, gauges })
    }

    /// Returns the lengths of these counts, m, in the order of the file; not a number for none.
    pub fn lengths_m(
        &self,
        counts: impl Iterator<Item = Result<i64, NoReading>>,
    ) -> impl Iterator<Item = f64> {
        places::lengths_m(&self.gauges, counts)
    }

    /// Expectations of the terminals.
    #[must_use]
    pub fn configs(&self) -> Vec<GaugeConfig> {
        places::gauge_configs(&self.gauges)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GAUGE: &str =
        "[[gauge]]\nname = \"x\"\nposition = 1\nproduct = 0x13ED3052\num_per_count = 0.5\n";

    fn parse(text: &str) -> Result<GaugesFile, String> {
        GaugesFile::parse(Path::new("g.toml"), text).map_err(|error| error.to_string())
    }

    #[test]
    fn a_file_says_where_each_gauge_is_and_what_a_count_means() {
        let second = GAUGE
            .replace("\"x\"", "\"axis-2\"")
            .replace("position = 1", "alias = 7\nsign = -1");
        let file = parse(&format!("{GAUGE}{second}")).unwrap();
        let lengths: Vec<f64> = file.gauges.iter().map(|gauge| gauge.length_m(3)).collect();
        assert_eq!(lengths, [1.5e-6, -1.5e-6]);
        let places: Vec<gantry_tau_ethercat::DevicePlace> =
            file.configs().iter().map(|config| config.place).collect();
        use gantry_tau_ethercat::DevicePlace::{Alias, Position};
        assert_eq!(places, [Position(1), Alias(7)]);
    }

    #[test]
    fn each_mistake_names_its_key() {
        for (from, to, said) in [
            ("\"x\"", "\"\"", "gauge[0].name: expected letters"),
            ("\"x\"", "\"a,b\"", "gauge[0].name: expected letters"),
            ("position = 1", "", "gauge[0].position: missing"),
            ("position = 1", "alias = 0", "gauge[0].alias: 0 is that"),
            (
                "position = 1",
                "position = 1\nalias = 2",
                "gauge[0].alias: there is a position",
            ),
            ("= 0.5", "= 0.0", "gauge[0].um_per_count: is 0; expected"),
            ("= 0.5", "= nan", "gauge[0].um_per_count: is NaN; expected"),
            (
                "= 0.5",
                "= -0.5",
                "gauge[0].um_per_count: is -0.5; expected",
            ),
            ("= 0.5", "= inf", "gauge[0].um_per_count: is inf; expected"),
            (
                "= 0.5",
                "= 0.5\nsign = 0",
                "gauge[0].sign: is 0; expected 1 or -1",
            ),
            ("um_per_count = 0.5", "", "missing field `um_per_count`"),
            ("product = 0x13ED3052", "", "missing field `product`"),
            ("= 0.5", "= 0.5\nzero = 1", "g.toml:6: unknown field `zero`"),
            ("= 1", "= 65536", "g.toml:3: "),
        ] {
            let error = parse(&GAUGE.replace(from, to)).unwrap_err();
            assert!(
                error.starts_with("g.toml:") && error.contains(said),
                "{error}"
            );
        }
        let error = parse(&format!("{GAUGE}{GAUGE}")).unwrap_err();
        assert_eq!(error, "g.toml: gauge[1].name: \"x\" is named twice");
        for text in ["", "[gauge]\n", &GAUGE.repeat(2)[..GAUGE.len() + 3]] {
            assert!(parse(text).is_err(), "{text}");
        }
        let many = (0..16).map(|index| GAUGE.replace("\"x\"", &format!("\"x{index}\"")));
        let error = parse(&many.collect::<String>()).unwrap_err();
        assert_eq!(error, "g.toml: gauge: expected at most 15 tables, found 16");
    }
}
