//! Limits of a recording: its own size, and the free space of its disk.

use std::path::{Path, PathBuf};

/// Rows from one look at the disk to the next.
const ROWS: u32 = 250;
/// Free space that a recording leaves, bytes, for the log, the black boxes and the state of the
/// server ...
const RESERVE: u64 = 64 << 20;
/// ... or, of a small disk, this part of it.
const RESERVED_PART: u64 = 50;

/// Reason why a recording has ended before its rows.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Full {
    /// It has the size that was asked for.
    #[error("it has reached --record-limit, {0} bytes")]
    Limit(u64),
    /// The disk is nearly full.
    #[error("{left} bytes are left on its disk, and {reserve} stay free")]
    Disk {
        /// Free space, bytes.
        left: u64,
        /// Reserve, bytes.
        reserve: u64,
    },
}

/// Watch over the size of a file and the free space of its disk.
#[derive(Debug)]
pub(super) struct FreeSpace {
    path: PathBuf,
    limit: Option<u64>,
    rows: u32,
}

impl FreeSpace {
    pub(super) fn of(path: &Path, limit: Option<u64>) -> Self {
        Self {
            path: path.to_owned(),
            limit,
            rows: 0,
        }
    }

    /// Counts a row. Returns why there is no room for further ones.
    pub(super) fn full(&mut self) -> Option<Full> {
        self.rows = self.rows.wrapping_add(1);
        if self.rows % ROWS != 0 {
            return None;
        }
        let file = self
            .path
            .metadata()
            .ok()
            .filter(std::fs::Metadata::is_file)?;
        let (left, size) = disk(&self.path).unwrap_or((u64::MAX, u64::MAX));
        judge(file.len(), self.limit, left, size)
    }
}

/// Judges a file of `length` bytes on a disk of `size` bytes of which `left` are free.
fn judge(length: u64, limit: Option<u64>, left: u64, size: u64) -> Option<Full> {
    let reserve = RESERVE.min(size / RESERVED_PART);
    match limit {
        Some(limit) if length >= limit => Some(Full::Limit(limit)),
        _ => (left < reserve).then_some(Full::Disk { left, reserve }),
    }
}

/// Free space for this user, and size of the disk of a file, bytes.
#[cfg(target_os = "linux")]
fn disk(path: &Path) -> Option<(u64, u64)> {
    let disk = rustix::fs::statvfs(path).ok()?;
    Some((
        disk.f_bavail.saturating_mul(disk.f_frsize),
        disk.f_blocks.saturating_mul(disk.f_frsize),
    ))
}

/// Free space and size of the disk of a file: not known here.
#[cfg(not(target_os = "linux"))]
fn disk(_: &Path) -> Option<(u64, u64)> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_ends_at_its_limit_and_before_the_disk_is_full() {
        let (large, small) = (1 << 40, 1 << 20);
        assert_eq!(judge(999, Some(1_000), large, large), None);
        assert_eq!(
            judge(1_000, Some(1_000), large, large),
            Some(Full::Limit(1_000))
        );
        assert_eq!(judge(u64::MAX, None, RESERVE, large), None);
        assert_eq!(
            judge(0, None, RESERVE - 1, large),
            Some(Full::Disk {
                left: RESERVE - 1,
                reserve: RESERVE
            })
        );
        // A small disk is not refused as a whole.
        assert_eq!(judge(0, None, small / 2, small), None);
        assert_eq!(
            judge(0, None, small / 51, small),
            Some(Full::Disk {
                left: small / 51,
                reserve: small / 50
            })
        );
    }
}
