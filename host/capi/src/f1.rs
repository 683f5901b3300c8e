//! The machine with six axes (F1): kinematics by Newton's method with checked answers, and statics.

use core::ffi::c_void;

use gantry_tau_core::model::f1;
use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::statics::LineMatrix;

use crate::code::gt_code;
use crate::error::gt_error;
use crate::machine::{GT_ARMS, GT_LINKS, branches, gt_pose, gt_solved, gt_wrench, travel, vectors};
use crate::memory::{Object, Reply, numbers, object, place, read, read_some, reply, settle, tag};

/// Bytes of a gt_f1.
pub const GT_F1_SIZE: usize = 2048;

/// Geometry of a machine with six axes. Joints on the plates: A_ij = C_i + q_i V_i + Q_i P_ij, where plate 2 is turned by
/// Rot(ax, sigma4 q4), plate 3 by Rot(ax, sigma5 q5) Rot(ax6, q6), plate 1 not at all. World axes, m.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct gt_f1_geometry {
    /// C: origins of the carts' plates at q = 0.
    pub carts_m: [[f64; 3]; GT_ARMS],
    /// V: directions of the guideways, m per unit of q.
    pub guideways: [[f64; 3]; GT_ARMS],
    /// P: joints on the plates from the plate's origin, plate axes, link order.
    pub plate_joints_m: [[f64; 3]; GT_LINKS],
    /// b: joints on the platform from the tool centre point, platform axes, link order.
    pub platform_joints_m: [[f64; 3]; GT_LINKS],
    /// L: length of each link, link order.
    pub lengths_m: [f64; GT_LINKS],
    /// Side of each guideway the links point to: 1 or -1.
    pub inverse_branch: [i32; GT_ARMS],
    /// ax: axis about which plates 2 and 3 turn, of any length.
    pub turn_axis: [f64; 3],
    /// ax6: axis about which plate 3 tilts, in axes of the turned plate, of any length.
    pub tilt_axis: [f64; 3],
    /// sigma4, sigma5: directions of plates 2 and 3 for positive q4, q5: 1 or -1.
    pub turn_signs: [i32; 2],
    /// 0: travel of carts is not checked; plates stay within half a turn.
    pub has_travel: u8,
    /// Range of each q, lower and upper end, q-units; rad for the last three.
    pub travel: [[f64; 2]; 6],
}

/// A machine with six axes; its memory is the caller's, and no call changes it: threads may share it.
pub struct gt_f1(());

/// Object behind a handle.
pub(crate) struct F1(pub(crate) f1::Kinematics);

impl Object for F1 {
    type Handle = gt_f1;
    const BYTES: usize = GT_F1_SIZE;
    const TAG: u64 = tag(b"gtmachi", 6);
}

impl F1 {
    fn new(geometry: &gt_f1_geometry) -> Reply<Self> {
        let robot = f1::Robot::new(f1::Geometry {
            carts_m: vectors(geometry.carts_m),
            guideways: vectors(geometry.guideways),
            plate_joints_m: vectors(geometry.plate_joints_m),
            platform_joints_m: vectors(geometry.platform_joints_m),
            lengths_m: geometry.lengths_m,
            configuration: branches(geometry.inverse_branch, 0)?,
            turn_axis: geometry.turn_axis.into(),
            tilt_axis: geometry.tilt_axis.into(),
            turn_signs: branches(geometry.turn_signs, GT_ARMS)?,
            travel: travel(geometry.has_travel, geometry.travel),
        })?;
        Ok(Self(f1::Kinematics::new(&robot)))
    }
}

/// Makes a machine in `memory`: checks every number, once.
///
/// `memory`, `size`: aligned to GT_ALIGN, at least GT_F1_SIZE bytes. `machine`: receives the handle.
///
/// Errors: GT_CODE_MEMORY_TOO_SMALL, GT_CODE_BRANCH (indices 3 and 4: turn_signs), those of ROBOT_: the first found.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_f1_init(
    memory: *mut c_void,
    size: usize,
    geometry: *const gt_f1_geometry,
    machine: *mut *mut gt_f1,
    error: *mut gt_error,
) -> gt_code {
    let init = || {
        // SAFETY: the header's rules for pointers.
        unsafe {
            let (machine, geometry) = (place(machine)?, read(geometry)?);
            machine.put(settle(memory, size, || F1::new(&geometry))?);
        }
        Ok(())
    };
    // SAFETY: as above.
    unsafe { reply(error, init()) }
}

/// Returns the CRC-32 over the kinematic parameters, as gt_l2_checksum.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_f1_checksum(machine: *const gt_f1, checksum: *mut u32) -> gt_code {
    let ask = || {
        // SAFETY: the header's rules for pointers.
        let (place, machine) = unsafe { (place(checksum)?, object::<F1>(machine)?) };
        place.put(machine.0.robot().kinematics_checksum());
        Ok(())
    };
    // SAFETY: null is allowed.
    unsafe { reply(core::ptr::null_mut(), ask()) }
}

/// Inverse kinematics: positions q (q-units; rad for the last three) for a pose.
/// `seed`: q4, q5, q6 to start from, those of the last cycle; null: 0. `solved` may be null.
/// Bounded: at most GT_COLD_SOLVES linear solves of each cluster, fewer from a near seed.
///
/// Errors: KINEMATICS_: UNREACHABLE, SINGULAR, NOT_CONVERGED, OUT_OF_RANGE, OTHER_BRANCH, NOT_FINITE. `q` is then not written.
///
/// cbindgen:ptrs-as-arrays=[[q;6], [seed;3]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_f1_inverse(
    machine: *const gt_f1,
    pose: *const gt_pose,
    seed: *const f64,
    q: *mut f64,
    solved: *mut gt_solved,
    error: *mut gt_error,
) -> gt_code {
    let solve = || {
        // SAFETY: the header's rules for pointers.
        let (q, pose, seed, machine) = unsafe {
            (
                place(q.cast::<[f64; f1::AXES]>())?,
                read(pose)?,
                read_some(seed.cast::<[f64; 3]>())?,
                object::<F1>(machine)?,
            )
        };
        let solution = machine.0.inverse(&pose.into(), seed)?;
        q.put(solution.value);
        // SAFETY: as above; null is allowed.
        if let Ok(place) = unsafe { place(solved) } {
            place.put((&solution).into());
        }
        Ok(())
    };
    // SAFETY: as above.
    unsafe { reply(error, solve()) }
}

/// Forward kinematics: the pose for positions q (q-units).
/// `seed`: a pose nearby, that of the last cycle, from which at most `most_solves` linear solves are made (GT_WARM_SOLVES,
/// GT_COLD_SOLVES); null: start from the synchronised form, with GT_COLD_SOLVES. `solved` may be null; `pose` may be `seed`.
///
/// Errors: KINEMATICS_: SEED_REQUIRED, NO_ASSEMBLY, NOT_CONVERGED, SINGULAR, OUT_OF_RANGE, OTHER_BRANCH, NOT_FINITE.
///
/// cbindgen:ptrs-as-arrays=[[q;6]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_f1_forward(
    machine: *const gt_f1,
    q: *const f64,
    seed: *const gt_pose,
    most_solves: u8,
    pose: *mut gt_pose,
    solved: *mut gt_solved,
    error: *mut gt_error,
) -> gt_code {
    let solve = || {
        // SAFETY: the header's rules for pointers.
        let (pose, q, seed, machine) = unsafe { (place(pose)?, numbers(q)?, read_some(seed)?, object::<F1>(machine)?) };
        let solution = match seed {
            Some(seed) => machine.0.forward_from(&q, &seed.into(), most_solves)?,
            None => machine.0.forward(&q)?,
        };
        pose.put(solution.value.into());
        // SAFETY: as above; null is allowed.
        if let Ok(place) = unsafe { place(solved) } {
            place.put((&solution).into());
        }
        Ok(())
    };
    // SAFETY: as above.
    unsafe { reply(error, solve()) }
}

/// The Jacobian: the platform's twist (translation over rotation, world axes) per axis, 36 numbers row by row; m and rad per q-unit.
/// `pose` and `q` belong together (gt_f1_inverse, gt_f1_forward); that is not checked.
///
/// Errors: KINEMATICS_: SINGULAR, NOT_FINITE.
///
/// cbindgen:ptrs-as-arrays=[[q;6], [jacobian;36]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_f1_jacobian(
    machine: *const gt_f1,
    pose: *const gt_pose,
    q: *const f64,
    jacobian: *mut f64,
    error: *mut gt_error,
) -> gt_code {
    let solve = || {
        // SAFETY: the header's rules for pointers.
        let (place, lines) = unsafe { (place(jacobian.cast::<[[f64; f1::AXES]; 6]>())?, lines(machine, pose, q)?) };
        // nalgebra counts by columns.
        place.put(lines.jacobian()?.transpose().into());
        Ok(())
    };
    // SAFETY: as above.
    unsafe { reply(error, solve()) }
}

/// Statics: tensions of the links (N, link order) and loads on the axes (N times m per q-unit, N m for plates; positive along +q).
/// `pose` and `q` belong together; that is not checked.
///
/// Errors: KINEMATICS_: SINGULAR, NOT_FINITE.
///
/// cbindgen:ptrs-as-arrays=[[q;6], [link_forces_n;6], [axis_loads;6]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_f1_statics(
    machine: *const gt_f1,
    pose: *const gt_pose,
    q: *const f64,
    load: *const gt_wrench,
    link_forces_n: *mut f64,
    axis_loads: *mut f64,
    error: *mut gt_error,
) -> gt_code {
    let solve = || {
        // SAFETY: the header's rules for pointers.
        let (forces, loads) =
            unsafe { (place(link_forces_n.cast::<[f64; GT_LINKS]>())?, place(axis_loads.cast::<[f64; f1::AXES]>())?) };
        // SAFETY: as above.
        let (load, lines) = unsafe { (read(load)?, lines(machine, pose, q)?) };
        let tensions = lines.link_forces_n(&load.into())?;
        forces.put(tensions);
        loads.put(lines.cart_loads(&tensions));
        Ok(())
    };
    // SAFETY: as above.
    unsafe { reply(error, solve()) }
}

/// The lines of a pose.
///
/// # Safety
/// The header's rules for pointers.
unsafe fn lines(machine: *const gt_f1, pose: *const gt_pose, q: *const f64) -> Reply<LineMatrix<{ f1::AXES }>> {
    // SAFETY: the caller's promise.
    let (pose, q, machine) = unsafe { (read(pose)?, numbers(q)?, object::<F1>(machine)?) };
    Ok(machine.0.line_matrix(&Pose::from(pose), &q)?)
}
