//! The machine with three axes (L2) in a constant orientation: kinematics in closed form, and
//! statics.

use core::ffi::c_void;
use core::ptr::null_mut;

use gantry_tau_core::model::l2;

use crate::code::gt_code;
use crate::error::gt_error;
use crate::machine::{
    GT_ARMS, GT_LINKS, Machine, Scale, branches, gt_wrench, matrix, rows, statics, travel, vectors,
};
use crate::memory::{Object, Reply, answer, create, object, read, tag};

/// Bytes of a gt_l2.
pub const GT_L2_SIZE: usize = 2048;

/// Geometry of a machine with three axes: joints on the carts A_ij = A0_ij + q_i v_i, on the
/// platform B_ij = T + R b_ij. World axes, m.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct gt_l2_geometry {
    /// A0: joints on the carts at q = 0, link order.
    pub cart_joints_m: [[f64; 3]; GT_LINKS],
    /// v: directions of the guideways, m per unit of q.
    pub guideways: [[f64; 3]; GT_ARMS],
    /// b: joints on the platform from the tool centre point, platform axes, link order.
    pub platform_joints_m: [[f64; 3]; GT_LINKS],
    /// L: link length of each arm.
    pub lengths_m: [f64; GT_ARMS],
    /// R: world axes from platform axes, row by row; constant.
    pub rotation: [[f64; 3]; 3],
    /// Side of each guideway the links point to, sign(s_i . v_i): 1 or -1.
    pub inverse_branch: [i32; GT_ARMS],
    /// Side of the carts' plane the tool is on, sign(n . (T - P_1)), n = (P_2 - P_1) x (P_3 - P_1):
    /// 1 or -1.
    pub forward_branch: i32,
    /// 0: the travel of q is not checked.
    pub has_travel: u8,
    /// Range of each q, lower and upper end, q-units.
    pub travel: [[f64; 2]; GT_ARMS],
    /// Length of one unit of each q by the drives' count, m: |v_i| to a percent.
    pub metres_per_q: [f64; GT_ARMS],
}

/// A machine with three axes; its memory is the caller's, and no call changes it: threads may share
/// it.
pub struct gt_l2(());

/// Object behind a handle.
pub(crate) type L2 = Machine<l2::Kinematics, { l2::AXES }>;

impl Object for L2 {
    type Handle = gt_l2;
    const BYTES: usize = GT_L2_SIZE;
    const TAG: u64 = tag(b"gtmachi", 3);
}

impl L2 {
    fn checksum(&self) -> u32 {
        self.kinematics.checksum(&self.scale.0)
    }

    fn new(geometry: &gt_l2_geometry) -> Reply<Self> {
        let [forward] = branches([geometry.forward_branch], l2::AXES)?;
        let robot = l2::Robot::new(l2::Geometry {
            cart_joints_m: vectors(geometry.cart_joints_m),
            guideways: vectors(geometry.guideways),
            platform_joints_m: vectors(geometry.platform_joints_m),
            lengths_m: geometry.lengths_m,
            configuration: l2::Configuration {
                inverse: branches(geometry.inverse_branch, 0)?,
                forward,
            },
            travel: travel(geometry.has_travel, geometry.travel),
        })?;
        let kinematics = l2::Kinematics::new(&robot, &matrix(&geometry.rotation))?;
        Ok(Self {
            kinematics,
            scale: Scale::new(geometry.metres_per_q, &geometry.guideways)?,
        })
    }
}

/// Makes a machine in `memory`: checks every number and the Tau property, once.
///
/// `memory`, `size`: aligned to GT_ALIGN, at least GT_L2_SIZE bytes. `machine`: receives the
/// handle.
///
/// Errors: GT_CODE_MEMORY_TOO_SMALL, GT_CODE_BRANCH (index 3: forward_branch), those of ROBOT_ and
/// ORIENTATION_: the first found.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_l2_init(
    memory: *mut c_void,
    size: usize,
    geometry: *const gt_l2_geometry,
    machine: *mut *mut gt_l2,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe { create(memory, size, machine, error, || L2::new(&read(geometry)?)) }
}

/// Returns the CRC-32 over the kinematic parameters, metres_per_q included (wire.md), for
/// kinematics_checksum of a server; the client compares it with its own.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_l2_checksum(machine: *const gt_l2, checksum: *mut u32) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        answer(checksum, null_mut(), || {
            Ok(object::<L2>(machine)?.checksum())
        })
    }
}

/// Inverse kinematics: positions (nm, rounded) that put the tool centre point at tcp_m (world axes,
/// m), for a tool on the machine's side of the carts' plane. Closed form, constant cost.
///
/// Errors: KINEMATICS_: UNREACHABLE, SINGULAR, OUT_OF_RANGE, OTHER_BRANCH, NOT_FINITE;
/// CROSSING_OUT_OF_RANGE: a position of 2^53 nm or more. `positions_nm` is then not written.
///
/// cbindgen:ptrs-as-arrays=[[tcp_m;3], [positions_nm;3]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_l2_inverse(
    machine: *const gt_l2,
    tcp_m: *const f64,
    positions_nm: *mut i64,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        answer(positions_nm.cast(), error, || {
            let machine = object::<L2>(machine)?;
            let tcp_m: [f64; 3] = read(tcp_m.cast())?;
            machine
                .scale
                .positions_nm(&machine.kinematics.inverse_in_assembly(&tcp_m.into())?)
        })
    }
}

/// Forward kinematics: position of the tool centre point (world axes, m) for positions in nm.
/// Closed form, constant cost.
///
/// Errors: KINEMATICS_: NO_ASSEMBLY, SINGULAR, OUT_OF_RANGE, OTHER_BRANCH.
///
/// cbindgen:ptrs-as-arrays=[[positions_nm;3], [tcp_m;3]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_l2_forward(
    machine: *const gt_l2,
    positions_nm: *const i64,
    tcp_m: *mut f64,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        answer(tcp_m.cast::<[f64; 3]>(), error, || {
            let machine = object::<L2>(machine)?;
            Ok(machine
                .kinematics
                .forward(&machine.q(positions_nm)?)?
                .into())
        })
    }
}

/// The Jacobian dT/dq at tcp_m, 9 numbers row by row: m per q-unit, world axes.
///
/// Errors: as gt_l2_inverse.
///
/// cbindgen:ptrs-as-arrays=[[tcp_m;3], [jacobian;9]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_l2_jacobian(
    machine: *const gt_l2,
    tcp_m: *const f64,
    jacobian: *mut f64,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        answer(jacobian.cast(), error, || {
            let tcp_m: [f64; 3] = read(tcp_m.cast())?;
            Ok(rows(
                &object::<L2>(machine)?.kinematics.jacobian(&tcp_m.into())?,
            ))
        })
    }
}

/// Statics: tensions of the links (N, link order) and loads on the carts (N times m per q-unit,
/// positive along +q), under a load. tcp_m and positions_nm belong together (gt_l2_inverse,
/// gt_l2_forward); that is not checked.
///
/// Errors: KINEMATICS_: SINGULAR, NOT_FINITE.
///
/// cbindgen:ptrs-as-arrays=[[tcp_m;3], [positions_nm;3], [link_forces_n;6], [cart_loads;3]]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_l2_statics(
    machine: *const gt_l2,
    tcp_m: *const f64,
    positions_nm: *const i64,
    load: *const gt_wrench,
    link_forces_n: *mut f64,
    cart_loads: *mut f64,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        statics(link_forces_n, cart_loads.cast(), load, error, || {
            let machine = object::<L2>(machine)?;
            let tcp_m: [f64; 3] = read(tcp_m.cast())?;
            let pose = machine.kinematics.pose(tcp_m.into());
            Ok(machine
                .kinematics
                .line_matrix(&pose, &machine.q(positions_nm)?)?)
        })
    }
}
