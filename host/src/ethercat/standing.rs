//! Motors that stand: where their axes are, and what they have in force.

use gantry_tau_core::control::axis::{InForce, Offsets};
use gantry_tau_core::units::{OffsetNm, PositionNm, TorquePermille, VelocityUmS};
use gantry_tau_ethercat::{Initial, Offset, Target};

use super::plant::Motor;

/// Largest distance between the motors of one axis, nm: more is a wrong zero or a wrong scale.
pub(super) const APART_NM: i64 = 500_000;

/// Returns the position of an axis, the mean of its motors', and the largest distance between two of them, nm. `None` for an axis without
/// motors, or beyond the range.
pub(super) fn axis_position<const M: usize>(
    axis: usize,
    motors: &[Motor; M],
    counts: impl Fn(usize) -> i32,
) -> Option<(PositionNm, i64)> {
    let (mut sum, mut count, mut least, mut most) = (0_i64, 0_i64, i64::MAX, i64::MIN);
    for (index, motor) in motors.iter().enumerate().filter(|(_, motor)| motor.axis == axis) {
        let nm = motor.scale.position(counts(index).into())?.0;
        (sum, count) = (sum.checked_add(nm)?, count + 1);
        (least, most) = (least.min(nm), most.max(nm));
    }
    Some((PositionNm(sum.checked_div(count)?), most - least))
}

/// Returns the offsets in force of a drive, in the units of the reference path.
pub(super) fn offsets_of(motor: &Motor, initial: &Initial) -> Option<Offsets> {
    let Offset { position, velocity, torque } = initial.offset;
    Some(Offsets {
        position: OffsetNm(i32::try_from(motor.scale.nanometres(position.into())?).ok()?),
        velocity: VelocityUmS(i32::try_from(motor.velocity_um_s(velocity)?).ok()?),
        torque: TorquePermille(motor.turned(torque)),
    })
}

/// Returns the references of every motor for what is in force; `None` beyond the range of a drive.
pub(super) fn targets<const N: usize, const M: usize>(
    motors: &[Motor; M],
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
