//! Padding of results. The bytes of a struct that no field has would otherwise show what was on the library's stack.

use core::mem::{offset_of, size_of};

use crate::black_box::gt_black_box;
use crate::code::gt_code;
use crate::compensation::gt_correction;
use crate::error::{gt_error, gt_parameter};
use crate::machine::{gt_pose, gt_solved, gt_wrench};
use crate::server::{
    gt_actual, gt_axis_config, gt_axis_state, gt_cause, gt_counters, gt_frame, gt_held, gt_limits, gt_offsets,
    gt_phase, gt_reference, gt_server_config, gt_state, gt_tick_output,
};

/// Type of a result. Every one has this, or its functions do not compile.
pub(crate) trait Padded {
    /// Clears every byte that no field has.
    ///
    /// # Safety
    /// `place` points to a value that may be written to.
    unsafe fn clear(place: *mut Self);
}

macro_rules! without_padding {
    ($($type:ty)+) => { $(
        impl Padded for $type {
            unsafe fn clear(_: *mut Self) {}
        }
    )+ };
}

without_padding!(u8 u16 u32 u64 usize i16 i32 i64 f64 gt_code gt_parameter gt_phase gt_cause);

impl<T> Padded for *mut T {
    unsafe fn clear(_: *mut Self) {}
}

impl<T: Padded, const N: usize> Padded for [T; N] {
    #[inline(always)]
    unsafe fn clear(place: *mut Self) {
        for index in 0..N {
            // SAFETY: an element of the array.
            unsafe { T::clear(place.cast::<T>().add(index)) };
        }
    }
}

/// Clears the bytes of a struct from `start` to `end`.
///
/// # Safety
/// They belong to it.
#[inline(always)]
unsafe fn clear_gap(place: *mut u8, start: usize, end: usize) {
    // SAFETY: the caller's promise.
    unsafe { place.add(start).write_bytes(0, end.saturating_sub(start)) };
}

const fn size_behind<T>(_: *const T) -> usize {
    size_of::<T>()
}

/// The fields of structs, in their order.
macro_rules! padded {
    ($($type:ident { $($field:ident)+ })+) => { $(
        impl Padded for $type {
            #[inline(always)]
            unsafe fn clear(place: *mut Self) {
                // Every field has its name here, or this does not compile.
                let _ = |all: Self| {
                    let $type { $($field: _),+ } = all;
                };
                let end = 0;
                $(
                    let start = offset_of!($type, $field);
                    // SAFETY: a field of the caller's struct, and the gap before it.
                    let end = unsafe {
                        let field = &raw mut (*place).$field;
                        clear_gap(place.cast(), end, start);
                        Padded::clear(field);
                        start.saturating_add(size_behind(field))
                    };
                )+
                // SAFETY: the gap behind the last field.
                unsafe { clear_gap(place.cast(), end, size_of::<Self>()) };
            }
        }
    )+ };
}

padded! {
    gt_error { code index parameter iterations value lower upper }
    gt_limits { max step accel ramp }
    gt_axis_config {
        position velocity torque nominal_lower_nm nominal_upper_nm machine_lower_nm machine_upper_nm nominal_step_nm
    }
    gt_server_config {
        axes motors axis_of_motor black_box_ticks cycle_us handshake_ticks kinematics_checksum capabilities echo_window
        budget_window budget_allowed axis
    }
    gt_frame { connection length bytes }
    gt_offsets { position_nm velocity_um_s torque_permille }
    gt_actual { position_nm velocity_um_s torque_permille }
    gt_reference { position_nm velocity_offset_um_s torque_offset_permille }
    gt_counters {
        received missed late duplicate stale malformed out_of_range limited clamped non_owner longest_miss_run
    }
    gt_axis_state { nominal_nm offsets shadow actual flags }
    gt_state {
        tick epoch accepted phase cause ramp_ticks_left arrival_us on_time_of_100 counters axis_count axes
    }
    gt_tick_output { write motor_count motors refused welcomed has_owner owner ended latched state }
    gt_held { write follows motor_count motors }
    gt_black_box { ticks parts frozen }
    gt_pose { position_m rotation }
    gt_wrench { force_n moment_nm }
    gt_solved { iterations residual_m }
    gt_correction { offsets_nm saturated }
}
