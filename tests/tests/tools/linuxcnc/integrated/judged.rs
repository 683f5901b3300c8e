//! Record of both samplers, and its judgement period by period.

use std::path::Path;

use gantry_tau_core::Monitor;
use gantry_tau_core::control::axis::{InForce, Reference};
use gantry_tau_core::control::session::config::AxisConfig;
use gantry_tau_core::units::{PositionNm, TorquePermille, VelocityUmS};

use super::super::record::{FAULT, HANDSHAKE, LISTENING, OBTAIN, SAFE_DISCONNECT, SUBMIT, samples};

/// References printed in millionths, and rounded: nm of a cart, of a plate's screw.
const DIGITS_NM: f64 = 2.0;
/// A half, and what floats add.
const ROUNDING_NM: f64 = 0.51;
/// Share of the distance by which references approach drives that are off, and the largest distance
/// at machine-on, nm: `drives.c`.
const SHARE: f64 = 64.0;
const NEAR_NM: f64 = 10_000.0;
/// Largest change of a reference when the machine is switched on, nm: a ramp's, and an approach's
/// from `NEAR_NM`.
const SWITCHED_ON_NM: f64 = 100.0 + NEAR_NM / SHARE + DIGITS_NM;

/// One period. Positions in nm, unrounded.
#[derive(Clone, Debug)]
pub(super) struct Row<const N: usize> {
    pub(super) nominal: [f64; N],
    pub(super) reference: [f64; N],
    /// Reference minus command, to many digits.
    difference: [f64; N],
    pub(super) position: [f64; N],
    /// In force.
    pub(super) offset: [i64; N],
    feedback: f64,
    pub(super) phase: u8,
    pub(super) cause: u8,
    pub(super) missed: u32,
    pub(super) tick: u32,
    pub(super) is_on: bool,
    pub(super) permit: bool,
}

/// A machine, as the judgement needs it.
pub(super) struct Limits<const N: usize> {
    pub(super) axes: [AxisConfig; N],
    /// Of a millimetre or a degree.
    pub(super) nm: [f64; N],
}

/// Reads both records of a folder. Fails if a period is missing. Lines may be cut at the end.
pub(super) fn read<const N: usize>(folder: &Path, limits: &Limits<N>) -> Vec<Row<N>> {
    let [first, second] = ["record-0.txt", "record-1.txt"].map(|name| lines(&folder.join(name)));
    first
        .iter()
        .zip(&second)
        .map(|(first, second)| row(first, second, limits))
        .collect()
}

fn lines(path: &Path) -> Vec<Vec<f64>> {
    samples(&std::fs::read_to_string(path).unwrap_or_default())
}

#[expect(
    clippy::as_conversions,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "whole numbers, printed"
)]
fn row<const N: usize>(first: &[f64], second: &[f64], limits: &Limits<N>) -> Row<N> {
    let joint =
        |of: &dyn Fn(usize) -> f64| std::array::from_fn(|joint| of(joint) * limits.nm[joint]);
    let [feedback, phase, cause, missed, tick, on, permit, _] = second[2 * N..] else {
        panic!("{second:?}")
    };
    let is_on = on != 0.0;
    let difference = joint(&|joint| first[3 * joint + 2] * 1e-12);
    let offset = std::array::from_fn(|joint| {
        let exact = second[2 * joint + 1] * 1e-6 * limits.nm[joint];
        assert!(
            (exact - exact.round()).abs() < 0.01,
            "{exact} {first:?} {second:?}"
        );
        exact.round() as i64
    });
    Row {
        nominal: joint(&|joint| first[3 * joint]),
        reference: joint(&|joint| first[3 * joint + 1]),
        difference,
        position: joint(&|joint| second[2 * joint]),
        offset,
        feedback: feedback * limits.nm[0],
        phase: phase as u8,
        cause: cause as u8,
        missed: missed as u32,
        tick: tick as u32,
        is_on,
        permit: permit != 0.0,
    }
}

/// Requires of every period what the interface guarantees.
pub(super) fn judge<const N: usize>(rows: &[Row<N>], limits: &Limits<N>) {
    let mut monitor = Monitor::new(
        limits.axes.map(|axis| axis.limits),
        Some(limits.axes.map(|axis| axis.machine_travel)),
    );
    monitor
        .rebase(&in_force(&rows[0]).map(InForce::at))
        .unwrap();
    for (last, row) in rows.iter().zip(&rows[1..]) {
        let nominal = in_force(row);
        let references = std::array::from_fn(|joint| Reference {
            position: PositionNm(nominal[joint].0 + row.offset[joint]),
            velocity_offset: VelocityUmS(0),
            torque_offset: TorquePermille(0),
        });
        let judged = monitor.check_references(&nominal, &references);
        assert!(judged.is_ok(), "{judged:?}: {last:?} {row:?}");
        for joint in 0..N {
            judge_joint(last, row, joint, limits);
        }
        assert!(
            (row.feedback - seen(last, row)).abs() < DIGITS_NM,
            "LinuxCNC sees no offset: {last:?} {row:?}"
        );
        let is_quiet = [LISTENING, HANDSHAKE, SUBMIT].contains(&row.phase);
        assert!(
            !is_quiet || row.offset == [0; N],
            "without a session, offsets are zero: {row:?}"
        );
    }
}

/// Position of joint 0 that LinuxCNC is to see: that of the drive without the offset, or the
/// nominal position while the drive is off.
#[expect(
    clippy::as_conversions,
    clippy::cast_precision_loss,
    reason = "offsets are small"
)]
fn seen<const N: usize>(last: &Row<N>, row: &Row<N>) -> f64 {
    (if last.is_on {
        row.position[0]
    } else {
        last.reference[0]
    }) - last.offset[0] as f64
}

#[expect(
    clippy::as_conversions,
    clippy::cast_precision_loss,
    reason = "offsets are small"
)]
fn judge_joint<const N: usize>(last: &Row<N>, row: &Row<N>, joint: usize, limits: &Limits<N>) {
    let (offset, before) = (row.offset[joint], last.offset[joint]);
    let position = &limits.axes[joint].limits.position;
    let change = row.reference[joint] - last.reference[joint];
    if row.is_on {
        // Core's reference is in whole nanometres, LinuxCNC's command is not.
        let error = row.difference[joint] - offset as f64;
        assert!(error.abs() < ROUNDING_NM, "{error}: {row:?}");
    } else {
        // The drive is off: its reference approaches it.
        let distance = row.position[joint] - last.reference[joint];
        let bound = distance.abs() / SHARE + (offset - before).abs() as f64 + DIGITS_NM;
        assert!(
            change.abs() <= bound,
            "{change} is beyond {bound}: {last:?} {row:?}"
        );
    }
    if row.is_on && !last.is_on {
        assert!(
            change.abs() <= SWITCHED_ON_NM,
            "a jump at machine-on: {last:?} {row:?}"
        );
        let distance = row.position[joint] - row.reference[joint];
        assert!(
            last.permit && distance.abs() <= NEAR_NM + SWITCHED_ON_NM,
            "switched on beside the drive: {last:?} {row:?}"
        );
    }
    if [SAFE_DISCONNECT, FAULT].contains(&row.phase) && row.tick != last.tick {
        let ramp = i64::from(position.ramp());
        assert_eq!(
            before.abs() - offset.abs(),
            before.abs().min(ramp),
            "the ramp is exact: {last:?} {row:?}"
        );
    }
    if row.tick == last.tick {
        assert_eq!(
            offset, before,
            "without a tick offsets are held: {last:?} {row:?}"
        );
    }
}

/// Nominal positions in force: LinuxCNC's commands while the machine is on.
#[expect(
    clippy::as_conversions,
    clippy::cast_possible_truncation,
    reason = "far below 2^53"
)]
fn in_force<const N: usize>(row: &Row<N>) -> [PositionNm; N] {
    std::array::from_fn(|joint| {
        let nominal = row.nominal[joint].round() as i64;
        PositionNm(if row.is_on {
            nominal
        } else {
            row.reference[joint].round() as i64 - row.offset[joint]
        })
    })
}

/// Ends of sessions: phase and cause in the period after Obtain.
pub(super) fn ends<const N: usize>(rows: &[Row<N>]) -> Vec<[u8; 2]> {
    let ended = rows
        .windows(2)
        .filter(|pair| pair[0].phase == OBTAIN && pair[1].phase != OBTAIN);
    ended.map(|pair| [pair[1].phase, pair[1].cause]).collect()
}
