//! From a load at the tool to bounded offsets, for the client of a server.

use core::ffi::c_void;

use gantry_tau_core::model::compensation::{CompensatorConfig, Correction};
use gantry_tau_core::model::kinematics::{KinematicsError, Pose};
use gantry_tau_core::model::robot::Compliances;
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::model::{f1, l2};
use gantry_tau_core::units::OffsetNm;

use crate::code::gt_code;
use crate::error::gt_error;
use crate::f1::{F1, gt_f1};
use crate::l2::{L2, gt_l2};
use crate::machine::{GT_LINKS, gt_pose, gt_wrench};
use crate::memory::{Object, Reply, numbers, object, place, read, reply, settle, tag};
use crate::server::GT_MAX_AXES;

/// Bytes of a gt_l2_compensator.
pub const GT_L2_COMPENSATOR_SIZE: usize = 4096;
/// Bytes of a gt_f1_compensator.
pub const GT_F1_COMPENSATOR_SIZE: usize = 2560;

/// Compliances of a machine, and the share of its deflection that is corrected. Array entries beyond the machine's axes are not read.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct gt_compensator_config {
    /// Elongation of each link per newton of tension, m/N, link order; positive.
    pub link_m_per_n: [f64; GT_LINKS],
    /// Displacement of each axis per unit of load, q-units (carts: m/N, plates: rad/(N m)); positive.
    pub axis_per_n: [f64; GT_MAX_AXES],
    /// Length of one unit of each q, m: |v_i| for a cart, the screw's law for a plate.
    pub metres_per_q: [f64; GT_MAX_AXES],
    /// Largest magnitude of each axis' offset, nm; 0 means 0.
    pub limits_nm: [i32; GT_MAX_AXES],
    /// Share of the computed displacement that is corrected, 0 to 1. Against a workpiece of stiffness K a measured load fed back is stable
    /// only while the estimated compliance stays below the machine's plus 1/K.
    pub gain: f64,
}

/// Offsets of one cycle.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct gt_correction {
    /// Offset of each axis, nm, within its limit; 0 beyond the machine's axes.
    pub offsets_nm: [i32; GT_MAX_AXES],
    /// 1 for an offset that its limit has cut.
    pub saturated: [u8; GT_MAX_AXES],
}

/// A compensator of a machine with three axes; no call changes it: threads may share it.
pub struct gt_l2_compensator(());

/// A compensator of a machine with six axes; no call changes it: threads may share it.
pub struct gt_f1_compensator(());

struct L2Compensator(l2::Compensator);

impl Object for L2Compensator {
    type Handle = gt_l2_compensator;
    const BYTES: usize = GT_L2_COMPENSATOR_SIZE;
    const TAG: u64 = tag(b"gtcompe", 3);
}

struct F1Compensator(f1::Compensator);

impl Object for F1Compensator {
    type Handle = gt_f1_compensator;
    const BYTES: usize = GT_F1_COMPENSATOR_SIZE;
    const TAG: u64 = tag(b"gtcompe", 6);
}

impl gt_compensator_config {
    fn checked<const N: usize>(&self) -> Reply<(Compliances<N>, CompensatorConfig<N>)> {
        let per_axis =
            |values: &[f64; GT_MAX_AXES]| core::array::from_fn(|index| values.get(index).copied().unwrap_or(f64::NAN));
        let compliances = Compliances::new(self.link_m_per_n, per_axis(&self.axis_per_n))?;
        let config = CompensatorConfig {
            gain: self.gain,
            limits: core::array::from_fn(|index| OffsetNm(self.limits_nm.get(index).copied().unwrap_or(0))),
            metres_per_q: per_axis(&self.metres_per_q),
        };
        Ok((compliances, config))
    }
}

impl<const N: usize> From<Correction<N>> for gt_correction {
    fn from(correction: Correction<N>) -> Self {
        let offset = |index: usize| correction.offsets.get(index).map_or(0, |offset| offset.0);
        let cut = |index: usize| correction.saturated.get(index).is_some_and(|cut| *cut);
        Self { offsets_nm: core::array::from_fn(offset), saturated: core::array::from_fn(|index| cut(index).into()) }
    }
}

/// Makes a compensator of a machine in `memory`. The machine is copied.
///
/// `memory`, `size`: aligned to GT_ALIGN, at least GT_L2_COMPENSATOR_SIZE bytes. `compensator`: receives the handle.
///
/// Errors: GT_CODE_MEMORY_TOO_SMALL, ROBOT_ (a compliance), COMPENSATOR_: the first found.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_l2_compensator_init(
    memory: *mut c_void,
    size: usize,
    machine: *const gt_l2,
    config: *const gt_compensator_config,
    compensator: *mut *mut gt_l2_compensator,
    error: *mut gt_error,
) -> gt_code {
    let init = || {
        // SAFETY: the header's rules for pointers.
        unsafe {
            let (place, config) = (place(compensator)?, read(config)?);
            let machine = object::<L2>(machine)?;
            let make = || {
                let (compliances, config) = config.checked::<{ l2::AXES }>()?;
                let compensator = l2::Compensator::new(&machine.0, &compliances, config)?;
                Ok(L2Compensator(compensator))
            };
            place.put(settle(memory, size, make)?);
        }
        Ok(())
    };
    // SAFETY: as above.
    unsafe { reply(error, init()) }
}

/// One cycle: offsets that hold the tool where the nominal positions q (q-units) put it, under `load`; to first order, at constant cost.
/// For any load the result is within the limits, or an error.
///
/// Errors: KINEMATICS_: as gt_l2_forward and gt_l2_inverse.
///
/// cbindgen:ptrs-as-arrays=[[q;3]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_l2_correction(
    compensator: *const gt_l2_compensator,
    q: *const f64,
    load: *const gt_wrench,
    correction: *mut gt_correction,
    error: *mut gt_error,
) -> gt_code {
    let solve = || {
        // SAFETY: the header's rules for pointers.
        let (place, q, load) = unsafe { (place(correction)?, numbers(q)?, read(load)?) };
        // SAFETY: as above.
        let compensator = unsafe { object::<L2Compensator>(compensator) }?;
        place.put(compensator.0.correct_q(&q, &load.into())?.into());
        Ok(())
    };
    // SAFETY: as above.
    unsafe { reply(error, solve()) }
}

/// As gt_l2_correction, by the exact map, for large deflections with rotation of the platform. At most 10 rounds, each with
/// two solves of six equations.
///
/// Errors: KINEMATICS_: as gt_l2_forward; SINGULAR, NOT_CONVERGED, NOT_FINITE.
///
/// cbindgen:ptrs-as-arrays=[[q;3]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_l2_exact_correction(
    compensator: *const gt_l2_compensator,
    q: *const f64,
    load: *const gt_wrench,
    correction: *mut gt_correction,
    error: *mut gt_error,
) -> gt_code {
    let solve = || {
        // SAFETY: the header's rules for pointers.
        let (place, q, load) = unsafe { (place(correction)?, numbers(q)?, read(load)?) };
        // SAFETY: as above.
        let compensator = unsafe { object::<L2Compensator>(compensator) }?;
        let kinematics = compensator.0.machine().kinematics();
        let pose = kinematics.pose(kinematics.forward(&q)?);
        let exact = compensator.0.correct_exact_at(&pose, &q, &load.into())?;
        place.put(exact.into());
        Ok(())
    };
    // SAFETY: as above.
    unsafe { reply(error, solve()) }
}

/// Makes a compensator of a machine in `memory`. The machine is copied.
///
/// `memory`, `size`: aligned to GT_ALIGN, at least GT_F1_COMPENSATOR_SIZE bytes. `compensator`: receives the handle.
///
/// Errors: GT_CODE_MEMORY_TOO_SMALL, ROBOT_ (a compliance), COMPENSATOR_: the first found.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_f1_compensator_init(
    memory: *mut c_void,
    size: usize,
    machine: *const gt_f1,
    config: *const gt_compensator_config,
    compensator: *mut *mut gt_f1_compensator,
    error: *mut gt_error,
) -> gt_code {
    let init = || {
        // SAFETY: the header's rules for pointers.
        unsafe {
            let (place, config) = (place(compensator)?, read(config)?);
            let machine = object::<F1>(machine)?;
            let make = || {
                let (compliances, config) = config.checked::<{ f1::AXES }>()?;
                let compensator = f1::Compensator::new(&machine.0, &compliances, config)?;
                Ok(F1Compensator(compensator))
            };
            place.put(settle(memory, size, make)?);
        }
        Ok(())
    };
    // SAFETY: as above.
    unsafe { reply(error, init()) }
}

/// One cycle: offsets that hold `pose`, which belongs to the nominal positions q (q-units), under `load`; to first order. The pose comes
/// from gt_f1_forward, seeded by that of the last cycle. For any load the result is within the limits, or an error.
///
/// Errors: KINEMATICS_: as gt_f1_inverse.
///
/// cbindgen:ptrs-as-arrays=[[q;6]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_f1_correction(
    compensator: *const gt_f1_compensator,
    pose: *const gt_pose,
    q: *const f64,
    load: *const gt_wrench,
    correction: *mut gt_correction,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        let solve = six(compensator, pose, q, load, correction, f1::Compensator::correct_at);
        reply(error, solve)
    }
}

/// As gt_f1_correction, by the exact map: at most 10 inverses.
///
/// Errors: KINEMATICS_: as gt_f1_inverse.
///
/// cbindgen:ptrs-as-arrays=[[q;6]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_f1_exact_correction(
    compensator: *const gt_f1_compensator,
    pose: *const gt_pose,
    q: *const f64,
    load: *const gt_wrench,
    correction: *mut gt_correction,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        let exact = f1::Compensator::correct_exact_at;
        let solve = six(compensator, pose, q, load, correction, exact);
        reply(error, solve)
    }
}

/// One of the maps of a machine with six axes.
type SixMap =
    fn(&f1::Compensator, &Pose, &[f64; f1::AXES], &Wrench) -> Result<Correction<{ f1::AXES }>, KinematicsError>;

/// A correction by one of the maps.
///
/// # Safety
/// The header's rules for pointers.
#[inline(always)]
unsafe fn six(
    compensator: *const gt_f1_compensator,
    pose: *const gt_pose,
    q: *const f64,
    load: *const gt_wrench,
    correction: *mut gt_correction,
    map: SixMap,
) -> Reply {
    // SAFETY: the caller's promise.
    let (place, pose, q, load) = unsafe { (place(correction)?, read(pose)?, numbers(q)?, read(load)?) };
    // SAFETY: as above.
    let compensator = unsafe { object::<F1Compensator>(compensator) }?;
    place.put(map(&compensator.0, &pose.into(), &q, &load.into())?.into());
    Ok(())
}
