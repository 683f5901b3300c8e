//! The record of LinuxCNC's samplers: one line per servo period in each of two files, numbered by
//! the sampler.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use gantry_tau_core::control::message::{Cause, Phase};

/// Precision of the samplers' files, nm, and of a plate's angle.
const PRINTED_NM: f64 = 1e-4;

/// One servo period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Period<const N: usize> {
    /// Number of the period, from 0.
    pub(crate) number: u64,
    /// Commands of LinuxCNC, whole nm.
    pub(crate) nominal_nm: [i64; N],
    /// References of the drives, nm.
    pub(crate) reference_nm: [i64; N],
    /// Offsets in force, nm.
    pub(crate) offset_nm: [i32; N],
    /// Raw sample of the force sensor, N and N m.
    pub(crate) wrench: [f64; 6],
    /// State of the server.
    pub(crate) phase: Phase,
    /// Cause of the end of the last session.
    pub(crate) cause: Cause,
    /// Missed deadlines of the session.
    pub(crate) missed: u32,
    /// Number of the server's last tick, modulo 2^32: a period of a burst, after a delay, has none,
    /// and its offsets are held.
    pub(crate) tick: u32,
}

/// Reason why a record cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum RecordError {
    /// A file cannot be read.
    #[error("{path}: {reason}")]
    Read {
        /// Its path.
        path: PathBuf,
        /// Error of the system.
        reason: String,
    },
    /// A line is not one of this machine's record.
    #[error("{path}, line {line}: {reason}")]
    Line {
        /// Path of the file.
        path: PathBuf,
        /// Number of the line, from 1.
        line: usize,
        /// Description of the error.
        reason: String,
    },
    /// The record ends before a client had a session.
    #[error("{0}: no session of a client is in the record")]
    NoSession(PathBuf),
}

/// Reads `joints.txt` and `server.txt` of a folder: from the first period of a session on.
///
/// # Errors
/// [`RecordError`]: among others where a sampler has lost a period.
pub(crate) fn read<const N: usize>(folder: &Path) -> Result<Vec<Period<N>>, RecordError> {
    let joints = Table::read(&folder.join("joints.txt"), 3 * N)?;
    let server = Table::read(&folder.join("server.txt"), 10)?;
    let mut periods = Vec::new();
    for (number, (joints_row, server_row)) in joints.rows.iter().zip(&server.rows).enumerate() {
        let period = period(number, joints_row, server_row)
            .map_err(|reason| server.refuse(number, reason))?;
        if !periods.is_empty() || period.phase == Phase::Submit {
            periods.push(period);
        }
    }
    if periods.is_empty() {
        Err(RecordError::NoSession(folder.to_owned()))
    } else {
        Ok(periods)
    }
}

/// The numbers of a file, without those of its lines.
struct Table {
    path: PathBuf,
    rows: Vec<Vec<f64>>,
}

impl Table {
    fn read(path: &Path, columns: usize) -> Result<Self, RecordError> {
        let text = std::fs::read_to_string(path).map_err(|error| RecordError::Read {
            path: path.to_owned(),
            reason: error.to_string(),
        })?;
        let mut table = Self {
            path: path.to_owned(),
            rows: Vec::new(),
        };
        // The last line may have been cut off.
        let whole = text
            .rfind('\n')
            .and_then(|end| text.get(..end))
            .unwrap_or_default();
        for (number, line) in whole.lines().enumerate() {
            let row =
                numbers(line, number, columns).map_err(|reason| table.refuse(number, reason))?;
            table.rows.push(row);
        }
        Ok(table)
    }

    fn refuse(&self, number: usize, reason: String) -> RecordError {
        RecordError::Line {
            path: self.path.clone(),
            line: number + 1,
            reason,
        }
    }
}

/// Numbers of a line after its own, which must be `number`.
fn numbers(line: &str, number: usize, columns: usize) -> Result<Vec<f64>, String> {
    let mut fields = line.split_whitespace();
    if fields.next().and_then(|own| own.parse().ok()) != Some(number) {
        return Err(format!(
            "not sample {number}: the sampler has lost a period"
        ));
    }
    let values: Vec<f64> = fields
        .map(f64::from_str)
        .collect::<Result<_, _>>()
        .map_err(|error| error.to_string())?;
    let found = values.len();
    if found == columns {
        Ok(values)
    } else {
        Err(format!(
            "{found} columns instead of {columns}: another machine?"
        ))
    }
}

fn period<const N: usize>(
    number: usize,
    joints: &[f64],
    server: &[f64],
) -> Result<Period<N>, String> {
    let columns: Vec<_> = joints
        .chunks_exact(N)
        .map(|columns| <[f64; N]>::try_from(columns).ok())
        .collect();
    let (
        [Some(command), Some(reference), Some(offset)],
        &[w0, w1, w2, w3, w4, w5, phase, cause, missed, tick],
    ) = (columns.as_slice(), server)
    else {
        return Err("columns are missing".to_owned());
    };
    let mut period = Period {
        number: number as u64,
        nominal_nm: [0; N],
        reference_nm: whole(reference)?,
        // Core has no such offset: the reference will not be command plus offset.
        offset_nm: whole(offset)?.map(|nm| i32::try_from(nm).unwrap_or(i32::MAX)),
        wrench: [w0, w1, w2, w3, w4, w5],
        phase: Phase::from_code(phase as u8).ok_or_else(|| format!("{phase} is not a phase"))?,
        cause: Cause::from_code(cause as u8).ok_or_else(|| format!("{cause} is not a cause"))?,
        missed: missed as u32,
        tick: tick as u32,
    };
    let axes = period
        .nominal_nm
        .iter_mut()
        .zip(period.reference_nm)
        .zip(period.offset_nm)
        .zip(command);
    for (((nominal_nm, reference_nm), offset_nm), command) in axes {
        *nominal_nm = nearest(*command, reference_nm - i64::from(offset_nm));
    }
    Ok(period)
}

/// Whole nanometres, as the component counts them; of a plate they have been in degrees.
fn whole<const N: usize>(values: &[f64; N]) -> Result<[i64; N], String> {
    match values.iter().find(|value| !is_whole(**value)) {
        Some(value) => Err(format!("{value} nm is not a whole number")),
        None => Ok(values.map(|value| value.round() as i64)),
    }
}

/// True if a number is whole; NaN is near nothing.
fn is_whole(value: f64) -> bool {
    (value - value.round()).abs() < PRINTED_NM
}

/// A command in whole nanometres: `counted` if that is one nearest to it. Commands are
/// interpolated, and many lie halfway between two.
fn nearest(command: f64, counted: i64) -> i64 {
    if (command - counted as f64).abs() < 0.5 + PRINTED_NM {
        counted
    } else {
        command.round() as i64
    }
}

#[cfg(test)]
mod tests {
    use tempfile::TempDir;

    use super::*;

    /// A folder with these two files.
    fn folder(joints: &str, server: &str) -> TempDir {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("joints.txt"), joints).unwrap();
        std::fs::write(folder.path().join("server.txt"), server).unwrap();
        folder
    }

    const JOINTS: &str =
        "0 1.4 2 3 1 2 3 0 0 0\n1 1.5 2.5 3 101 3 -97 100 0 -100\n2 1.6 2 3 2 7 3 0 0 0\n3 1.6 2";
    const SERVER: &str = "0 0 0 0 0 0 0 0 0 0 5\n1 1.5 0 0 0 0 -2 2 0 7 6\n2 0 0 0 0 0 0 4 5 0 7\n";

    #[test]
    fn a_record_begins_with_its_first_session_and_a_cut_line_is_dropped() {
        let periods = read::<3>(folder(JOINTS, SERVER).path()).unwrap();
        let [first, second] = periods.as_slice() else {
            panic!("{periods:?}")
        };
        // Halfway between two is the one that the component took.
        assert_eq!((first.number, first.nominal_nm), (1, [1, 3, 3]));
        assert_eq!(
            (first.reference_nm, first.offset_nm),
            ([101, 3, -97], [100, 0, -100])
        );
        assert_eq!(
            (first.wrench, first.phase),
            ([1.5, 0.0, 0.0, 0.0, 0.0, -2.0], Phase::Submit)
        );
        assert_eq!((first.missed, first.tick), (7, 6));
        assert_eq!(
            (second.nominal_nm, second.reference_nm),
            ([2, 2, 3], [2, 7, 3])
        );
        assert_eq!(
            (second.phase, second.cause),
            (Phase::SafeDisconnect, Cause::Closed)
        );
    }

    /// Error of a record, without the path of its folder.
    fn said(joints: &str, server: &str) -> String {
        let error = read::<3>(folder(joints, server).path()).unwrap_err();
        error.to_string().rsplit('/').next().unwrap().to_owned()
    }

    #[test]
    fn what_is_wrong_is_named_with_its_file_and_line() {
        let lost = JOINTS.replace("\n1 ", "\n2 ");
        let expected = "joints.txt, line 2: not sample 1: the sampler has lost a period";
        assert_eq!(said(&lost, SERVER), expected);
        let other = "server.txt, line 1: 1 columns instead of 10: another machine?";
        assert_eq!(said(JOINTS, "0 1\n"), other);
        assert_eq!(
            said(JOINTS, "0 0 0 0 0 0 0 9 0 0 0\n"),
            "server.txt, line 1: 9 is not a phase"
        );
        let fraction = JOINTS.replace(" 101 ", " 101.4 ");
        assert_eq!(
            said(&fraction, SERVER),
            "server.txt, line 2: 101.4 nm is not a whole number"
        );
        assert!(
            said("0 1 2 3 1 2 3 0 0 0\n", SERVER)
                .ends_with("no session of a client is in the record")
        );
        assert!(said("overrun\n", SERVER).contains("line 1"));
    }
}
