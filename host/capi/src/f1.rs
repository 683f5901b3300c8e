//! The machine with six axes (F1): kinematics by Newton's method with checked answers, tracked from
//! cycle to cycle, and statics.

use core::ffi::c_void;
use core::ptr::null_mut;

use gantry_tau_core::model::f1;
use gantry_tau_core::model::kinematics::{KinematicsError, Pose, Solution};
use gantry_tau_core::model::statics::LineMatrix;

use crate::code::gt_code;
use crate::error::gt_error;
use crate::machine::{
    GT_ARMS, GT_LINKS, Machine, Scale, branches, gt_pose, gt_solved, gt_wrench, statics, travel,
    vectors,
};
use crate::memory::{
    Object, Reply, answer, create, object, object_mut, put_some, read, read_some, reply, tag,
};

/// Bytes of a gt_f1.
pub const GT_F1_SIZE: usize = 2048;
/// Bytes of a gt_f1_tracker.
pub const GT_F1_TRACKER_SIZE: usize = 2048;

/// Geometry of a machine with six axes. Joints on the plates: A_ij = C_i + q_i V_i + Q_i P_ij,
/// where plate 2 is turned by Rot(ax, sigma4 q4), plate 3 by Rot(ax, sigma5 q5) Rot(ax6, q6), plate
/// 1 not at all. World axes, m.
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
    /// Length of one unit of each q by the drives' count, m: |V_i| to a percent for a cart, the
    /// screw's law for a plate.
    pub metres_per_q: [f64; 6],
}

/// A machine with six axes; its memory is the caller's, and no call changes it: threads may share
/// it.
pub struct gt_f1(());

/// Object behind a handle.
pub(crate) type F1 = Machine<f1::Kinematics, { f1::AXES }>;

impl Object for F1 {
    type Handle = gt_f1;
    const BYTES: usize = GT_F1_SIZE;
    const TAG: u64 = tag(b"gtmachi", 6);
}

impl F1 {
    fn checksum(&self) -> u32 {
        self.kinematics.checksum(&self.scale.0)
    }

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
        Ok(Self {
            kinematics: f1::Kinematics::new(&robot),
            scale: Scale::new(geometry.metres_per_q, &geometry.guideways)?,
        })
    }
}

/// Makes a machine in `memory`: checks every number, once.
///
/// `memory`, `size`: aligned to GT_ALIGN, at least GT_F1_SIZE bytes. `machine`: receives the
/// handle.
///
/// Errors: GT_CODE_MEMORY_TOO_SMALL, GT_CODE_BRANCH (indices 3 and 4: turn_signs), those of ROBOT_:
/// the first found.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_f1_init(
    memory: *mut c_void,
    size: usize,
    geometry: *const gt_f1_geometry,
    machine: *mut *mut gt_f1,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe { create(memory, size, machine, error, || F1::new(&read(geometry)?)) }
}

/// Returns the CRC-32 over the kinematic parameters, as gt_l2_checksum.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_f1_checksum(machine: *const gt_f1, checksum: *mut u32) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        answer(checksum, null_mut(), || {
            Ok(object::<F1>(machine)?.checksum())
        })
    }
}

/// Inverse kinematics: positions (nm, rounded) for a pose. `near_nm`: positions from which the
/// search starts, such as those of the last cycle; null: plates at 0. `solved` may be null.
/// Bounded: at most 10 linear solves of each cluster, fewer from near positions.
///
/// Errors: KINEMATICS_: UNREACHABLE, SINGULAR, NOT_CONVERGED, OUT_OF_RANGE, OTHER_BRANCH,
/// NOT_FINITE; CROSSING_OUT_OF_RANGE: a position of 2^53 nm or more. `positions_nm` is then not
/// written.
///
/// cbindgen:ptrs-as-arrays=[[near_nm;6], [positions_nm;6]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_f1_inverse(
    machine: *const gt_f1,
    pose: *const gt_pose,
    near_nm: *const i64,
    positions_nm: *mut i64,
    solved: *mut gt_solved,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        answer(positions_nm.cast(), error, || {
            let machine = object::<F1>(machine)?;
            let near = read_some(near_nm.cast())?.map(|near_nm| {
                let [_, _, _, q4, q5, q6] = machine.scale.q(near_nm);
                [q4, q5, q6]
            });
            let solution = machine.kinematics.inverse(&read(pose)?.into(), near)?;
            let positions_nm = machine.scale.positions_nm(&solution.value)?;
            put_some(solved, (&solution).into());
            Ok(positions_nm)
        })
    }
}

/// The Jacobian: the platform's twist (translation over rotation, world axes) per axis, 36 numbers
/// row by row; m and rad per q-unit. `pose` and positions_nm belong together (gt_f1_inverse,
/// gt_f1_tracker_pose); that is not checked.
///
/// Errors: KINEMATICS_: SINGULAR, NOT_FINITE.
///
/// cbindgen:ptrs-as-arrays=[[positions_nm;6], [jacobian;36]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_f1_jacobian(
    machine: *const gt_f1,
    pose: *const gt_pose,
    positions_nm: *const i64,
    jacobian: *mut f64,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        answer(jacobian.cast::<[[f64; f1::AXES]; 6]>(), error, || {
            // nalgebra counts by columns.
            Ok(lines(machine, pose, positions_nm)?
                .jacobian()?
                .transpose()
                .into())
        })
    }
}

/// Statics: tensions of the links (N, link order) and loads on the axes (N times m per q-unit, N m
/// for plates; positive along +q). `pose` and positions_nm belong together; that is not checked.
///
/// Errors: KINEMATICS_: SINGULAR, NOT_FINITE.
///
/// cbindgen:ptrs-as-arrays=[[positions_nm;6], [link_forces_n;6], [axis_loads;6]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_f1_statics(
    machine: *const gt_f1,
    pose: *const gt_pose,
    positions_nm: *const i64,
    load: *const gt_wrench,
    link_forces_n: *mut f64,
    axis_loads: *mut f64,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        statics(link_forces_n, axis_loads.cast(), load, error, || {
            lines(machine, pose, positions_nm)
        })
    }
}

/// The lines of a pose.
///
/// # Safety
/// The header's rules for pointers.
unsafe fn lines(
    machine: *const gt_f1,
    pose: *const gt_pose,
    positions_nm: *const i64,
) -> Reply<LineMatrix<{ f1::AXES }>> {
    // SAFETY: the caller's promise.
    unsafe {
        let machine = object::<F1>(machine)?;
        Ok(machine
            .kinematics
            .line_matrix(&read(pose)?.into(), &machine.q(positions_nm)?)?)
    }
}

/// Forward kinematics of a machine with six axes, cycle by cycle: each pose is found from the last
/// one, which is kept inside.
pub struct gt_f1_tracker(());

/// Kinematics with the last pose.
pub(crate) struct Tracked {
    pub(crate) machine: f1::Kinematics,
    pub(crate) poses: f1::PoseTracker,
}

impl Tracked {
    pub(crate) fn track(&mut self, q: &[f64; f1::AXES]) -> Result<Solution<Pose>, KinematicsError> {
        self.poses.track(&self.machine, q)
    }
}

/// Object behind a handle.
pub(crate) type Tracker = Machine<Tracked, { f1::AXES }>;

impl Object for Tracker {
    type Handle = gt_f1_tracker;
    const BYTES: usize = GT_F1_TRACKER_SIZE;
    const TAG: u64 = tag(b"gttrack", 6);
}

/// Makes a tracker of a machine in `memory`, without a last pose. The machine is copied.
///
/// `memory`, `size`: aligned to GT_ALIGN, at least GT_F1_TRACKER_SIZE bytes. `tracker`: receives
/// the handle.
///
/// Errors: GT_CODE_MEMORY_TOO_SMALL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_f1_tracker_init(
    memory: *mut c_void,
    size: usize,
    machine: *const gt_f1,
    tracker: *mut *mut gt_f1_tracker,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        create(memory, size, tracker, error, || {
            let machine = object::<F1>(machine)?;
            let kinematics = Tracked {
                machine: machine.kinematics,
                poses: f1::PoseTracker::default(),
            };
            Ok(Tracker {
                kinematics,
                scale: machine.scale,
            })
        })
    }
}

/// Forward kinematics: the pose for positions in nm, found from the tracker's last pose by at most
/// 2 linear solves, enough at 1 m/s and 1 kHz. One attempt per call: after an error, where the last
/// pose stays, the next call makes up to 10 solves from it, the one after that up to 10 from the
/// synchronised form, and so in turn until one succeeds. `solved` may be null.
///
/// Errors: KINEMATICS_: NO_ASSEMBLY, NOT_CONVERGED, SINGULAR, OUT_OF_RANGE, OTHER_BRANCH,
/// NOT_FINITE; SEED_REQUIRED: the machine has no synchronised form, so gt_f1_tracker_start_from
/// must be called first.
///
/// cbindgen:ptrs-as-arrays=[[positions_nm;6]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_f1_tracker_pose(
    tracker: *mut gt_f1_tracker,
    positions_nm: *const i64,
    pose: *mut gt_pose,
    solved: *mut gt_solved,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        answer(pose, error, || {
            let tracker = object_mut::<Tracker>(tracker)?;
            let q = tracker.q(positions_nm)?;
            let solution = tracker.kinematics.track(&q)?;
            put_some(solved, (&solution).into());
            Ok(solution.value.into())
        })
    }
}

/// Takes a pose as the last one; null: forgets the last one, and the next pose is found from the
/// synchronised form. The pose is not checked: from one that is not finite or far away the next
/// calls are errors.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_f1_tracker_start_from(
    tracker: *mut gt_f1_tracker,
    pose: *const gt_pose,
) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        reply(null_mut(), || {
            let pose = read_some(pose)?;
            let tracker = object_mut::<Tracker>(tracker)?;
            tracker.kinematics.poses = f1::PoseTracker::default();
            tracker.kinematics.poses.last = pose.map(Into::into);
            Ok(())
        })
    }
}
