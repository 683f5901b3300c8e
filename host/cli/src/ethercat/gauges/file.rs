//! File that names the gauges of a bus.

use std::path::Path;

use gantry_tau_ethercat::gauges::GaugeConfig;
use gantry_tau_ethercat::{DevicePlace, NoReading};
use gantry_tau_identify::measurements::{FileError, setup};
use serde::Deserialize;

/// Largest number of gauges: a bus has 16 devices, and a coupler is one of them.
const MAX_GAUGES: usize = 15;

/// The gauges of a file, in its order.
#[derive(Clone, Debug)]
pub struct GaugesFile {
    /// Path of the file, for errors.
    pub(super) path: String,
    pub(super) gauges: Vec<Gauge>,
}

/// A gauge, and the terminal that counts its edges.
#[derive(Clone, Debug)]
pub(super) struct Gauge {
    pub(super) name: String,
    pub(super) place: DevicePlace,
    pub(super) product: u32,
    /// Length of a count, µm, with the sign of the direction.
    pub(super) um_per_count: f64,
}

impl Gauge {
    /// Length of a number of counts, m.
    fn length_m(&self, count: i64) -> f64 {
        count as f64 * self.um_per_count * 1e-6
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GaugeTables {
    #[serde(default)]
    gauge: Vec<GaugeTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GaugeTable {
    name: String,
    position: Option<u16>,
    alias: Option<u16>,
    product: u32,
    um_per_count: f64,
    #[serde(default = "plus")]
    sign: i64,
}

const fn plus() -> i64 {
    1
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
        let tables: GaugeTables = setup::parse(path, text)?;
        let mut gauges: Vec<Gauge> = Vec::new();
        for (index, table) in tables.gauge.iter().enumerate() {
            let refused = |key: &str, reason: String| {
                FileError::key(path, format!("gauge[{index}].{key}"), reason)
            };
            if gauges.iter().any(|gauge| gauge.name == table.name) {
                return Err(refused("name", format!("{:?} is named twice", table.name)));
            }
            let gauge = table
                .gauge()
                .map_err(|(key, reason)| refused(key, reason))?;
            gauges.push(gauge);
        }
        if !(1..=MAX_GAUGES).contains(&gauges.len()) {
            let reason = format!("expected 1 to {MAX_GAUGES} tables, found {}", gauges.len());
            return Err(FileError::key(path, "gauge", reason));
        }
        let path = path.display().to_string();
        Ok(Self { path, gauges })
    }

    /// Returns the lengths of these counts, m, in the order of the file; not a number for none.
    pub fn lengths_m(
        &self,
        counts: impl Iterator<Item = Result<i64, NoReading>>,
    ) -> impl Iterator<Item = f64> {
        let of_gauges = counts.zip(&self.gauges);
        of_gauges.map(|(count, gauge)| count.map_or(f64::NAN, |count| gauge.length_m(count)))
    }

    /// Expectations of the terminals.
    #[must_use]
    pub fn configs(&self) -> Vec<GaugeConfig> {
        let gauges = self.gauges.iter().map(|gauge| GaugeConfig {
            place: gauge.place,
            vendor: GaugeConfig::BECKHOFF,
            product: gauge.product,
        });
        gauges.collect()
    }
}

impl GaugeTable {
    /// The gauge, or the key that is wrong and the reason.
    fn gauge(&self) -> Result<Gauge, (&'static str, String)> {
        let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
        if self.name.is_empty() || !self.name.chars().all(is_name) {
            let reason = "expected letters, digits, _ and -".to_owned();
            return Err(("name", reason));
        }
        let place = match (self.position, self.alias) {
            (Some(position), None) => DevicePlace::Position(position),
            (None, Some(alias)) if alias != 0 => DevicePlace::Alias(alias),
            (None, Some(_)) => {
                return Err(("alias", "0 is that of devices without one".to_owned()));
            }
            (None, None) => return Err(("position", "missing, and no alias either".to_owned())),
            (Some(_), Some(_)) => {
                return Err((
                    "alias",
                    "there is a position already; expected one".to_owned(),
                ));
            }
        };
        if !(1e-6..=1e3).contains(&self.um_per_count) {
            let reason = format!("is {}; expected from 1e-6 to 1000 um", self.um_per_count);
            return Err(("um_per_count", reason));
        }
        let sign = match self.sign {
            1 => 1.0,
            -1 => -1.0,
            other => return Err(("sign", format!("is {other}; expected 1 or -1"))),
        };
        Ok(Gauge {
            name: self.name.clone(),
            place,
            product: self.product,
            um_per_count: sign * self.um_per_count,
        })
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
        let places: Vec<DevicePlace> = file.configs().iter().map(|config| config.place).collect();
        assert_eq!(places, [DevicePlace::Position(1), DevicePlace::Alias(7)]);
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
        assert_eq!(error, "g.toml: gauge: expected 1 to 15 tables, found 16");
    }
}
