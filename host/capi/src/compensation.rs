//! From a load at the tool to bounded offsets, for the client of a server.

use core::ffi::c_void;

use gantry_tau_core::model::compensation::{CompensatorConfig, Correction};
use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::robot::Compliances;
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::model::{f1, l2};
use gantry_tau_core::units::{OffsetNm, PositionNm};

use crate::code::gt_code;
use crate::error::gt_error;
use crate::f1::{F1, Tracker, gt_f1, gt_f1_tracker};
use crate::l2::{L2, gt_l2};
use crate::machine::{GT_LINKS, Scale, gt_wrench};
use crate::memory::{Object, Reply, answer, create, object, object_mut, read, resized, tag};
use crate::padding::padded;
use crate::server::GT_MAX_AXES;

/// Bytes of a gt_l2_compensator.
pub const GT_L2_COMPENSATOR_SIZE: usize = 4096;
/// Bytes of a gt_f1_compensator.
pub const GT_F1_COMPENSATOR_SIZE: usize = 2560;

/// Compliances of a machine, and the share of its deflection that is corrected. Array entries
/// beyond the machine's axes are not read.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct gt_compensator_config {
    /// Elongation of each link per newton of tension, m/N, link order; positive.
    pub link_m_per_n: [f64; GT_LINKS],
    /// Displacement of each axis per unit of load, q-units (carts: m/N, plates: rad/(N m));
    /// positive.
    pub axis_per_n: [f64; GT_MAX_AXES],
    /// Largest magnitude of each axis' offset, nm; 0 means 0.
    pub limits_nm: [i32; GT_MAX_AXES],
    /// Share of the computed displacement that is corrected, 0 to 1. Against a workpiece of
    /// stiffness K a measured load fed back is stable only while the estimated compliance stays
    /// below the machine's plus 1/K.
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

padded! {
    gt_correction { offsets_nm saturated }
}

/// A compensator of a machine with three axes; no call changes it: threads may share it.
pub struct gt_l2_compensator(());

/// A compensator of a machine with six axes; no call changes it: threads may share it.
pub struct gt_f1_compensator(());

impl Object for l2::Compensator {
    type Handle = gt_l2_compensator;
    const BYTES: usize = GT_L2_COMPENSATOR_SIZE;
    const TAG: u64 = tag(b"gtcompe", 3);
}

impl Object for f1::Compensator {
    type Handle = gt_f1_compensator;
    const BYTES: usize = GT_F1_COMPENSATOR_SIZE;
    const TAG: u64 = tag(b"gtcompe", 6);
}

impl gt_compensator_config {
    fn checked<const N: usize>(
        &self,
        scale: Scale<N>,
    ) -> Reply<(Compliances<N>, CompensatorConfig<N>)> {
        let compliances = Compliances::new(self.link_m_per_n, resized(&self.axis_per_n, f64::NAN))?;
        let limits = resized(&self.limits_nm, 0).map(OffsetNm);
        Ok((
            compliances,
            CompensatorConfig {
                gain: self.gain,
                limits,
                metres_per_q: scale.0,
            },
        ))
    }
}

impl<const N: usize> From<Correction<N>> for gt_correction {
    fn from(correction: Correction<N>) -> Self {
        Self {
            offsets_nm: resized(&correction.offsets.map(|offset| offset.0), 0),
            saturated: resized(&correction.saturated.map(u8::from), 0),
        }
    }
}

/// Makes a compensator of a machine in `memory`. The machine is copied.
///
/// `memory`, `size`: aligned to GT_ALIGN, at least GT_L2_COMPENSATOR_SIZE bytes. `compensator`:
/// receives the handle.
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
    // SAFETY: the header's rules for pointers.
    unsafe {
        create(memory, size, compensator, error, || {
            let machine = object::<L2>(machine)?;
            let (compliances, config) = read(config)?.checked(machine.scale)?;
            Ok(l2::Compensator::new(
                &machine.kinematics,
                &compliances,
                config,
            )?)
        })
    }
}

/// One cycle: offsets that hold the tool where the nominal positions put it, under `load`; to first
/// order, at constant cost. For any load the result is within the limits, or an error.
///
/// Errors: KINEMATICS_: as gt_l2_forward and gt_l2_inverse.
///
/// cbindgen:ptrs-as-arrays=[[nominal_nm;3]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_l2_correction(
    compensator: *const gt_l2_compensator,
    nominal_nm: *const i64,
    load: *const gt_wrench,
    correction: *mut gt_correction,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        answer(correction, error, || {
            let nominal = read(nominal_nm.cast::<[i64; l2::AXES]>())?.map(PositionNm);
            Ok(object::<l2::Compensator>(compensator)?
                .correct(&nominal, &read(load)?.into())?
                .into())
        })
    }
}

/// As gt_l2_correction, by the exact map, for large deflections with rotation of the platform. At
/// most 10 rounds, each with two solves of six equations.
///
/// Errors: KINEMATICS_: as gt_l2_forward; SINGULAR, NOT_CONVERGED, NOT_FINITE.
///
/// cbindgen:ptrs-as-arrays=[[nominal_nm;3]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_l2_exact_correction(
    compensator: *const gt_l2_compensator,
    nominal_nm: *const i64,
    load: *const gt_wrench,
    correction: *mut gt_correction,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        answer(correction, error, || {
            let compensator = object::<l2::Compensator>(compensator)?;
            let q = Scale(compensator.config().metres_per_q).q(read(nominal_nm.cast())?);
            let kinematics = compensator.machine().kinematics();
            let pose = kinematics.pose(kinematics.forward(&q)?);
            Ok(compensator
                .correct_exact_at(&pose, &q, &read(load)?.into())?
                .into())
        })
    }
}

/// Makes a compensator of a machine in `memory`. The machine is copied.
///
/// `memory`, `size`: aligned to GT_ALIGN, at least GT_F1_COMPENSATOR_SIZE bytes. `compensator`:
/// receives the handle.
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
    // SAFETY: the header's rules for pointers.
    unsafe {
        create(memory, size, compensator, error, || {
            let machine = object::<F1>(machine)?;
            let (compliances, config) = read(config)?.checked(machine.scale)?;
            Ok(f1::Compensator::new(
                &machine.kinematics,
                &compliances,
                config,
            )?)
        })
    }
}

/// One cycle: offsets that hold the pose of the nominal positions under `load`; to first order. The
/// pose is found by `tracker`, which is one of the same machine. For any load the result is within
/// the limits, or an error.
///
/// Errors: KINEMATICS_: as gt_f1_tracker_pose and gt_f1_inverse. After an error of the correction
/// itself the tracker has the pose found; after one of the tracking it is as after
/// gt_f1_tracker_pose.
///
/// cbindgen:ptrs-as-arrays=[[nominal_nm;6]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_f1_correction(
    compensator: *const gt_f1_compensator,
    tracker: *mut gt_f1_tracker,
    nominal_nm: *const i64,
    load: *const gt_wrench,
    correction: *mut gt_correction,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        answer(correction, error, || {
            let (compensator, pose, q, load) = cycle(compensator, tracker, nominal_nm, load)?;
            Ok(compensator.correct_at(&pose, &q, &load)?.into())
        })
    }
}

/// As gt_f1_correction, by the exact map: at most 10 inverses.
///
/// Errors: as gt_f1_correction.
///
/// cbindgen:ptrs-as-arrays=[[nominal_nm;6]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_f1_exact_correction(
    compensator: *const gt_f1_compensator,
    tracker: *mut gt_f1_tracker,
    nominal_nm: *const i64,
    load: *const gt_wrench,
    correction: *mut gt_correction,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        answer(correction, error, || {
            let (compensator, pose, q, load) = cycle(compensator, tracker, nominal_nm, load)?;
            Ok(compensator.correct_exact_at(&pose, &q, &load)?.into())
        })
    }
}

/// Compensator, pose, positions in q-units, and load of a cycle.
///
/// # Safety
/// The header's rules for pointers.
#[inline(always)]
unsafe fn cycle<'a>(
    compensator: *const gt_f1_compensator,
    tracker: *mut gt_f1_tracker,
    nominal_nm: *const i64,
    load: *const gt_wrench,
) -> Reply<(&'a f1::Compensator, Pose, [f64; f1::AXES], Wrench)> {
    // SAFETY: the caller's promise.
    unsafe {
        let (load, compensator) = (read(load)?.into(), object::<f1::Compensator>(compensator)?);
        let tracker = object_mut::<Tracker>(tracker)?;
        let q = tracker.q(nominal_nm)?;
        Ok((compensator, tracker.kinematics.track(&q)?.value, q, load))
    }
}
