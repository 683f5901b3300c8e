//! Initial state of motors: where their axes stand, and what they have in force.

use gantry_tau_core::control::axis::{InForce, Offsets};
use gantry_tau_core::units::{OffsetNm, PositionNm, TorquePermille, VelocityUmS};
use gantry_tau_ethercat::{Initial, Offset, Target};

use super::plant::DriveMotor;

/// Largest distance between the motors of one axis, nm: more is a wrong zero or a wrong scale.
pub(super) const APART_NM: i64 = 500_000;

/// Returns the position of an axis, the mean of its motors', and the largest distance between two
/// of them, nm, by the positions of all drives. `None` for an axis without motors, or beyond the
/// range.
pub(super) fn axis_position<const M: usize>(
    axis: usize,
    motors: &[DriveMotor; M],
    counts: &[i32; M],
) -> Option<(PositionNm, i64)> {
    let mut sum = 0_i64;
    let mut count = 0_i64;
    let mut min = i64::MAX;
    let mut max = i64::MIN;
    let own = motors.iter().zip(counts);
    for (motor, &counts) in own.filter(|(motor, _)| motor.axis == axis) {
        let nm = motor.scale.position(counts.into())?.0;
        sum = sum.checked_add(nm)?;
        count += 1;
        min = min.min(nm);
        max = max.max(nm);
    }
    Some((PositionNm(sum.checked_div(count)?), max - min))
}

/// Returns the offsets in force of a drive, in the units of the reference path.
pub(super) fn offsets_of(motor: &DriveMotor, initial: &Initial) -> Option<Offsets> {
    let Offset {
        position,
        velocity,
        torque,
    } = initial.offset;
    Some(Offsets {
        position: OffsetNm(i32::try_from(motor.scale.nanometres(position.into())?).ok()?),
        velocity: VelocityUmS(i32::try_from(motor.velocity_um_s(velocity)?).ok()?),
        torque: TorquePermille(motor.turned(torque)),
    })
}

/// Returns the references of every motor for what is in force; `None` beyond the range of a drive.
pub(super) fn targets<const N: usize, const M: usize>(
    motors: &[DriveMotor; M],
    in_force: &[InForce; N],
) -> Option<[Target; M]> {
    let mut targets = [Target::default(); M];
    for (target, motor) in targets.iter_mut().zip(motors) {
        let InForce { nominal, offsets } = in_force.get(motor.axis)?;
        let sum = PositionNm(nominal.0.checked_add(offsets.position.0.into())?);
        *target = motor.target(sum, offsets)?;
    }
    Some(targets)
}
