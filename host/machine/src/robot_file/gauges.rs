//! Gauges on terminals that count their edges: `[[ethercat.gauges]]`, and `[[gauge]]` of the file of a
//! bus of their own.

use serde::Deserialize;

/// Largest number of gauges: a bus has 16 devices, and one of them is no gauge.
pub const MAX_GAUGES: usize = 15;

/// A gauge, and the terminal that counts its edges.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EthercatGauge {
    /// Name, for messages and tables.
    pub name: String,
    /// Alias in the terminal's EEPROM; or `position`.
    pub alias: Option<u16>,
    /// Number of devices before it on the bus; or `alias`.
    pub position: Option<u16>,
    /// Product code in the terminal's EEPROM.
    pub product: u32,
    /// Length of a count, um.
    pub um_per_count: f64,
    /// 1, or -1 for a gauge whose counts grow the other way.
    #[serde(default = "plus")]
    pub sign: i8,
}

const fn plus() -> i8 {
    1
}

impl EthercatGauge {
    /// Returns the length of a number of counts, m.
    #[must_use]
    pub fn length_m(&self, count: i64) -> f64 {
        f64::from(self.sign) * self.um_per_count * 1e-6 * count as f64
    }

    /// Returns its place, as key and value; `None` without one, or with two.
    pub(super) fn place(&self) -> Option<(&'static str, u16)> {
        match (self.alias, self.position) {
            (Some(alias), None) => Some(("alias", alias)),
            (None, Some(position)) => Some(("position", position)),
            _ => None,
        }
    }

    /// Returns what is wrong with it: keys and reasons.
    fn problems(&self) -> impl Iterator<Item = (&'static str, String)> {
        let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
        let name = (self.name.is_empty() || !self.name.chars().all(is_name))
            .then(|| ("name", "expected letters, digits, _ and -".to_owned()));
        let place = match self.place() {
            Some(("alias", 0)) => Some(("alias", "0 is that of devices without one")),
            Some(_) => None,
            None if self.alias.is_some() => {
                Some(("alias", "there is a position already; expected one"))
            }
            None => Some(("position", "missing, and no alias either")),
        };
        let um = self.um_per_count;
        let length = (!(1e-6..=1e3).contains(&um)).then(|| {
            let reason = format!("is {um}; expected from 1e-6 to 1000 um");
            ("um_per_count", reason)
        });
        let sign = (![1, -1].contains(&self.sign))
            .then(|| ("sign", format!("is {}; expected 1 or -1", self.sign)));
        let place = place.map(|(key, reason)| (key, reason.to_owned()));
        [name, place, length, sign].into_iter().flatten()
    }
}

/// Checks the gauges of one bus; returns keys behind that of the table, as `[0].name`, and reasons.
pub fn problems_of_gauges(gauges: &[EthercatGauge]) -> Vec<(String, String)> {
    let mut problems = Vec::new();
    if gauges.len() > MAX_GAUGES {
        let reason = format!(
            "expected at most {MAX_GAUGES} tables, found {}",
            gauges.len()
        );
        problems.push((String::new(), reason));
    }
    for (index, gauge) in gauges.iter().enumerate() {
        let before = gauges.iter().take(index);
        let mut add = |key: &str, reason| problems.push((format!("[{index}].{key}"), reason));
        if before.clone().any(|other| other.name == gauge.name) {
            add("name", format!("{:?} is named twice", gauge.name));
        }
        let place = gauge.place();
        if let Some((key, _)) = place.filter(|_| before.clone().any(|other| other.place() == place))
        {
            add(key, "names the terminal of another gauge too".to_owned());
        }
        for (key, reason) in gauge.problems() {
            add(key, reason);
        }
    }
    problems
}
