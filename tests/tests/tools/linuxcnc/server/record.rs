//! Record of the server's sampler, and its judgement period by period.

use gantry_tau_core::control::axis::{InForce, Reference};
use gantry_tau_core::control::message::AxisLimits;
use gantry_tau_core::control::session::config::Travel;
use gantry_tau_core::units::{PositionNm, TorquePermille, VelocityUmS};
use gantry_tau_core::{Monitor, OffsetNm};
use gantry_tau_tests::server_fixture::limits;

use super::super::record::{FAULT, SAFE_DISCONNECT, samples};

/// Axes of the L2.
pub(super) const AXES: usize = 3;
/// Limits of its position offsets in `robots/l2.toml`: the largest change, and that on the way back
/// to zero, nm per period.
const STEP: i32 = 5_000;
const RAMP: i32 = 100;

/// One period. Positions in nm.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub(super) nominal: [i64; AXES],
    pub(super) reference: [i64; AXES],
    /// Reference minus nominal position as HAL subtracts them, times 1e15: zero only if they are
    /// equal bit for bit.
    pub(super) difference: [f64; AXES],
    pub(super) offset: [i32; AXES],
    /// Position of joint 0 as LinuxCNC sees it.
    pub(super) feedback: i64,
    pub(super) phase: u8,
    pub(super) cause: u8,
    pub(super) missed: u32,
    pub(super) tick: u32,
}

/// Numbers of a period, in the order of the sampler's pins.
struct Fields<'a>(&'a [f64]);

#[expect(
    clippy::as_conversions,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "whole numbers, printed"
)]
impl Fields<'_> {
    /// A length in nm; the pin has mm.
    fn long(&self, at: usize) -> i64 {
        (self.0[at] * 1e6).round() as i64
    }

    fn short(&self, at: usize) -> i32 {
        (self.0[at] * 1e6).round() as i32
    }

    fn count(&self, at: usize) -> u32 {
        self.0[at] as u32
    }
}

/// Reads a record. Fails if a period is missing.
pub(super) fn parse(record: &str) -> Vec<Row> {
    let samples = samples(record);
    let rows = samples.iter().map(|numbers| {
        let fields = Fields(numbers);
        Row {
            nominal: [0, 1, 2].map(|at| fields.long(at)),
            reference: [3, 4, 5].map(|at| fields.long(at)),
            difference: [6, 7, 8].map(|at| numbers[at]),
            offset: [9, 10, 11].map(|at| fields.short(at)),
            feedback: fields.long(12),
            phase: u8::try_from(fields.count(13)).unwrap(),
            cause: u8::try_from(fields.count(14)).unwrap(),
            missed: fields.count(15),
            tick: fields.count(16),
        }
    });
    rows.collect()
}

/// Requires of every period what the interface guarantees. Returns the number of periods in which
/// an offset was in force.
pub(super) fn judge(rows: &[Row]) -> usize {
    let mut monitor = monitor(&rows[0]);
    for (last, row) in rows.iter().zip(&rows[1..]) {
        let references = row.reference.map(|nm| Reference {
            position: PositionNm(nm),
            velocity_offset: VelocityUmS(0),
            torque_offset: TorquePermille(0),
        });
        let judged = monitor.check_references(&row.nominal.map(PositionNm), &references);
        assert!(judged.is_ok(), "{judged:?}: {row:?}");
        for axis in 0..AXES {
            let (offset, before) = (row.offset[axis], last.offset[axis]);
            assert_eq!(
                offset == 0,
                row.difference[axis] == 0.0,
                "bit for bit LinuxCNC's, or not: {row:?}"
            );
            assert_eq!(
                row.reference[axis] - row.nominal[axis],
                i64::from(offset),
                "{row:?}"
            );
            assert!((offset - before).abs() <= STEP, "{last:?} {row:?}");
            if [SAFE_DISCONNECT, FAULT].contains(&row.phase) && row.tick != last.tick {
                assert_eq!(
                    before.abs() - offset.abs(),
                    before.abs().min(RAMP),
                    "the ramp is exact: {last:?} {row:?}"
                );
            }
        }
        // The drive has the reference of the period before; rounded twice.
        assert!(
            (row.feedback - last.nominal[0]).abs() <= 1,
            "LinuxCNC sees no offset: {last:?} {row:?}"
        );
    }
    rows.iter().filter(|row| row.offset != [0; AXES]).count()
}

/// A monitor of references that begins where the first period is.
fn monitor(first: &Row) -> Monitor<AXES> {
    let axis = AxisLimits {
        position: limits::<OffsetNm>(2_000_000, STEP, 10_000, RAMP),
        ..AxisLimits::DISABLED
    };
    let mut monitor = Monitor::new(
        [axis; AXES],
        Some([Travel::around_zero(3_000_000_000); AXES]),
    );
    assert_eq!(first.offset, [0; AXES]);
    monitor
        .rebase(&first.nominal.map(|nm| InForce::at(PositionNm(nm))))
        .unwrap();
    monitor
}
