//! The black box as the file that `gantry-tau replay` reads (`host/src/black_box`): one line at a time, into the caller's buffer.

mod fields;
mod text;

use gantry_tau_core::session::BlackBox;

use crate::code::gt_code;
use crate::memory::Reply;
pub(crate) use text::Line;
use text::Text;

/// Longest line of a black box, bytes.
pub const GT_BLACK_BOX_LINE: usize = 16_384;

/// Lines before the first tick: what the file is, the configuration, the session before the oldest tick.
const HEAD: usize = 3;

/// What a black box holds.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct gt_black_box {
    /// Ticks recorded, at most 3 GT_BLACK_BOX_TICKS.
    pub ticks: u32,
    /// Lines of its file; 0 while no tick is recorded.
    pub lines: u32,
    /// Not 0: the end of a session has frozen it, GT_BLACK_BOX_TICKS ticks ago. It records again after gt_server_black_box_release.
    pub frozen: u8,
}

/// What a black box holds.
pub(crate) fn look<const N: usize, const TICKS: usize>(
    black_box: &BlackBox<N, TICKS>,
) -> gt_black_box {
    let ticks = ticks(black_box);
    let lines = if ticks == 0 {
        0
    } else {
        ticks.saturating_add(HEAD)
    };
    let small = |count: usize| u32::try_from(count).unwrap_or(u32::MAX);
    gt_black_box {
        ticks: small(ticks),
        lines: small(lines),
        frozen: black_box.is_frozen().into(),
    }
}

fn ticks<const N: usize, const TICKS: usize>(black_box: &BlackBox<N, TICKS>) -> usize {
    let segments = black_box.segments();
    let used = segments.iter().map(|segment| segment.entries().len());
    used.fold(0, usize::saturating_add)
}

/// Writes one line of the file.
pub(crate) fn write_line<const N: usize, const TICKS: usize>(
    black_box: &BlackBox<N, TICKS>,
    index: usize,
    line: &mut Line<'_>,
) -> Reply {
    let ticks = ticks(black_box);
    let before = black_box.before().filter(|_| ticks > 0);
    let before = before.ok_or(gt_code::Index)?;
    match index {
        0 => {
            line.put("{\"format\":\"gantry-tau black box\",\"version\":1,\"axes\":");
            N.write(line);
            line.put(",\"ticks\":");
            ticks.write(line);
            line.put("}");
        }
        1 => line.object(&[("config", before.config().parameters())]),
        2 => line.object(&[("before", before.parts())]),
        _ => {
            let tick = index.saturating_sub(HEAD);
            let entry = black_box.entries().nth(tick).ok_or(gt_code::Index)?;
            entry.write(line);
        }
    }
    line.put("\n");
    Ok(())
}
