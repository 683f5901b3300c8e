//! Origin of a recording: program, machine, computer and time of day.

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_system::output::{GrowingFile, printable};
use serde::Serialize;

/// Ending of the companion of a recording that has no place for these facts: `run.csv.json` of
/// `run.csv`.
pub(super) const ENDING: &str = ".json";

/// Origin of a recording.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct About {
    /// Program with its version.
    pub written_by: String,
    /// The robot file, as it was named.
    pub robot: String,
    /// Model of the machine, `l2` or `f1`.
    pub model: String,
    /// Checksum of its kinematics, as Welcome carries it.
    pub kinematics_checksum: String,
    /// Name of the computer that records.
    pub host: String,
    /// Time of the first row by the clock of that computer, RFC 3339, UTC.
    pub started: String,
    /// The same in ns since 1970; the time of tick `t` is later by `t` minus the first tick, in ms,
    /// if the server is not in lock-step.
    pub started_ns: String,
    /// Length of a tick, ms.
    pub tick_ms: String,
}

impl About {
    /// A recording that begins now.
    #[expect(
        clippy::disallowed_methods,
        reason = "metadata: when a recording begins"
    )]
    pub(super) fn now<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>) -> Self {
        let since_1970 = SystemTime::now()
            .duration_since(SystemTime::UNIX_EPOCH)
            .unwrap_or_default();
        Self {
            written_by: concat!("gantry-tau ", env!("CARGO_PKG_VERSION")).to_owned(),
            robot: printable(&robot.name),
            model: K::MODEL.to_owned(),
            kinematics_checksum: format!("0x{:08x}", robot.checksum()),
            host: host(),
            started: rfc_3339(since_1970.as_secs()),
            started_ns: since_1970.as_nanos().to_string(),
            tick_ms: "1".to_owned(),
        }
    }

    /// Writes the companion of a recording. A device or a pipe has none.
    pub(super) fn write_beside(&self, recording: &Path) -> io::Result<()> {
        if !recording.metadata()?.is_file() {
            return Ok(());
        }
        let mut name = recording.as_os_str().to_owned();
        name.push(ENDING);
        let mut file = GrowingFile::fresh(&PathBuf::from(name), None).map_err(io::Error::other)?;
        let text = serde_json::to_string_pretty(self)?;
        file.write_all(format!("{text}\n").as_bytes())
    }

    /// Names and values, for the metadata of MCAP.
    pub(super) fn entries(&self) -> [(&'static str, &str); 8] {
        [
            ("written_by", &self.written_by),
            ("robot", &self.robot),
            ("model", &self.model),
            ("kinematics_checksum", &self.kinematics_checksum),
            ("host", &self.host),
            ("started", &self.started),
            ("started_ns", &self.started_ns),
            ("tick_ms", &self.tick_ms),
        ]
    }
}

/// Name of this computer; empty where the system does not say.
#[cfg(target_os = "linux")]
fn host() -> String {
    printable(&rustix::system::uname().nodename().to_string_lossy())
}

/// Name of this computer; empty where the system does not say.
#[cfg(not(target_os = "linux"))]
fn host() -> String {
    printable(
        &["HOSTNAME", "COMPUTERNAME"]
            .iter()
            .find_map(|name| std::env::var(name).ok())
            .unwrap_or_default(),
    )
}

/// Seconds since 1970 as `2026-01-31T23:59:59Z`.
fn rfc_3339(seconds: u64) -> String {
    let (days, second) = (seconds / 86_400, seconds % 86_400);
    let (year, month, day) = date(days);
    format!(
        "{year:04}-{month:02}-{day:02}T{:02}:{:02}:{:02}Z",
        second / 3_600,
        second / 60 % 60,
        second % 60
    )
}

/// Date of a day since 1970 in the Gregorian calendar (H. Hinnant, "chrono-compatible low-level
/// date algorithms"): years begin with March, so that a leap day is the last of its year.
fn date(days_since_1970: u64) -> (u64, u64, u64) {
    let days = days_since_1970 + 719_468;
    let (era, of_era) = (days / 146_097, days % 146_097);
    let year_of_era = (of_era - of_era / 1_460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let from_march = (5 * of_year + 2) / 153;
    let day = of_year - (153 * from_march + 2) / 5 + 1;
    let month = if from_march < 10 {
        from_march + 3
    } else {
        from_march - 9
    };
    (year_of_era + era * 400 + u64::from(month <= 2), month, day)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_of_day_are_those_of_the_calendar() {
        for (seconds, expected) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_399, "2000-02-28T23:59:59Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (951_868_800, "2000-03-01T00:00:00Z"),
            (1_764_103_837, "2025-11-25T20:50:37Z"),
            (4_107_542_399, "2100-02-28T23:59:59Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
        ] {
            assert_eq!(rfc_3339(seconds), expected);
        }
    }

    #[test]
    fn dates_are_those_of_days_counted_one_by_one() {
        let mut day = 0;
        for year in 1970..=2400 {
            let is_leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
            let lengths = [
                31,
                if is_leap { 29 } else { 28 },
                31,
                30,
                31,
                30,
                31,
                31,
                30,
                31,
                30,
                31,
            ];
            for (month, length) in (1..).zip(lengths) {
                for of_month in 1..=length {
                    assert_eq!(date(day), (year, month, of_month));
                    day += 1;
                }
            }
        }
    }
}
