//! Numbers of the reference path as reals of the SI, and back. Every whole number comes back as it was.

use gantry_tau_core::model::compensation::Correction;
use gantry_tau_core::units::{Metres, OffsetNm, PositionNm, TorquePermille, VelocityUmS};
use gantry_tau_machine::model::{MachineKind, on_path};
use gantry_tau_machine::robot_file::RobotFile;

/// Largest position from outside, m.
pub(crate) const MAX_POSITION_M: f64 = 1e3;
/// Largest offset, m: that of core's unit.
pub(crate) const MAX_OFFSET_M: f64 = 2.0;
/// Largest velocity offset, m/s.
pub(crate) const MAX_VELOCITY_M_PER_S: f64 = 2e3;
/// Largest torque offset, as a share of the rated torque.
pub(crate) const MAX_TORQUE: f64 = 30.0;
/// Largest force from outside, N: that of core's force sensor.
pub(crate) const MAX_FORCE_N: f64 = 1e6;
/// Largest moment from outside, N m: that of a State.
pub(crate) const MAX_MOMENT_NM: f64 = 2e3;

const PERMILLE: f64 = 1e3;
const UM_PER_M: f64 = 1e6;

/// Returns positions in nm; `m` has been checked.
pub(crate) fn positions<const N: usize>(m: [f64; N]) -> [PositionNm; N] {
    m.map(|m| PositionNm::from_metres(Metres(m)).unwrap_or_default())
}

/// Returns positions in m.
pub(crate) fn metres<const N: usize>(nm: [PositionNm; N]) -> [f64; N] {
    nm.map(|position| position.to_metres().0)
}

/// Returns an offset in nm; `m` has been checked.
pub(crate) fn offset(m: f64) -> OffsetNm {
    let nm = PositionNm::from_metres(Metres(m)).unwrap_or_default().0;
    OffsetNm(i32::try_from(nm).unwrap_or_default())
}

/// Returns offsets in m.
pub(crate) fn offsets_m<const N: usize>(nm: [OffsetNm; N]) -> [f64; N] {
    metres(nm.map(|offset| PositionNm(offset.0.into())))
}

/// Returns a velocity in µm/s.
pub(crate) fn velocity(m_per_s: f64) -> VelocityUmS {
    VelocityUmS((m_per_s * UM_PER_M).round() as i32)
}

/// Returns a velocity in m/s.
pub(crate) fn metres_per_s(velocity: VelocityUmS) -> f64 {
    f64::from(velocity.0) / UM_PER_M
}

/// Returns a torque in per mille.
pub(crate) fn torque(share: f64) -> TorquePermille {
    TorquePermille((share * PERMILLE).round() as i16)
}

/// Returns a torque as a share of the rated one.
pub(crate) fn share(torque: TorquePermille) -> f64 {
    f64::from(torque.0) / PERMILLE
}

/// Returns the offsets of a correction in m, and 1 for each axis where it is cut.
pub(crate) fn corrected<const N: usize>(correction: &Correction<N>) -> ([f64; N], [f64; N]) {
    let cut = correction.saturated.map(|cut| f64::from(u8::from(cut)));
    (offsets_m(correction.offsets), cut)
}

/// Returns home on the reference path, m.
///
/// # Errors
/// A sentence: the machine cannot take it.
pub(crate) fn home_m<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
) -> Result<[f64; N], String> {
    let home_q = robot.home_q().map_err(|error| error.to_string())?;
    let home = on_path(&home_q, &robot.metres_per_q)
        .map_err(|error| robot.refuse("simulation.home_m", error).to_string())?;
    Ok(metres(home))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_come_back() {
        for nm in (-2_000_000_000..2_000_000_000).step_by(999_983) {
            assert_eq!(offset(offsets_m([OffsetNm(nm)])[0]), OffsetNm(nm));
            let far = PositionNm(i64::from(nm) * 497);
            assert_eq!(positions(metres([far])), [far]);
            assert_eq!(velocity(metres_per_s(VelocityUmS(nm))), VelocityUmS(nm));
        }
        for permille in i16::MIN..=i16::MAX {
            let torque_permille = TorquePermille(permille);
            assert_eq!(torque(share(torque_permille)), torque_permille);
        }
    }
}
