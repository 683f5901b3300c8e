//! A server with `N` axes and `TICKS` ticks of black box on either side of an end.

use core::ffi::c_void;

use gantry_tau_core::control::endpoint::Endpoint;
use gantry_tau_core::control::session::BlackBox;

use super::config::{gt_server_config, gt_start};
use super::tick::{gt_tick_input, gt_tick_output};
use super::{
    GT_BLACK_BOX_NONE, GT_BLACK_BOX_TICKS, GT_MAX_MOTORS, GT_SERVER_SIZE_3, GT_SERVER_SIZE_3_BLACK_BOX,
    GT_SERVER_SIZE_6, GT_SERVER_SIZE_6_BLACK_BOX, gt_server,
};
use crate::code::gt_code;
use crate::memory::{Object, Reply, settle, size_of, tag};

/// Ticks before and after an end that a black box keeps.
#[expect(clippy::as_conversions, reason = "u32 to usize is lossless where this runs; `From` is not const")]
pub(super) const HALF: usize = GT_BLACK_BOX_TICKS as usize;
/// The same without a black box.
#[expect(clippy::as_conversions, reason = "u32 to usize is lossless where this runs; `From` is not const")]
pub(super) const NONE: usize = GT_BLACK_BOX_NONE as usize;

/// Core's endpoint, and its black box.
pub(super) struct Running<const N: usize, const TICKS: usize> {
    pub(super) endpoint: Endpoint<N, GT_MAX_MOTORS>,
    pub(super) black_box: BlackBox<N, TICKS>,
    motors: usize,
}

impl<const N: usize, const TICKS: usize> Object for Running<N, TICKS> {
    type Handle = gt_server;
    const BYTES: usize = match (N, TICKS) {
        (3, NONE) => GT_SERVER_SIZE_3,
        (3, _) => GT_SERVER_SIZE_3_BLACK_BOX,
        (_, NONE) => GT_SERVER_SIZE_6,
        (_, _) => GT_SERVER_SIZE_6_BLACK_BOX,
    };
    const TAG: u64 = match (N, TICKS) {
        (3, NONE) => tag(b"gtserve", 0x30),
        (3, _) => tag(b"gtserve", 0x31),
        (_, NONE) => tag(b"gtserve", 0x60),
        (_, _) => tag(b"gtserve", 0x61),
    };
}

impl<const N: usize, const TICKS: usize> Running<N, TICKS> {
    /// Checks a configuration, and returns the bytes of its server.
    pub(super) fn check(config: &gt_server_config) -> Reply<usize> {
        config.checked::<N>()?;
        Ok(size_of::<Self>())
    }

    /// Creates a server in memory of the caller, field by field: as one value it would first be on the stack, half a megabyte with its
    /// black box. (The test `capi` runs with a small stack.)
    ///
    /// # Safety
    /// As [`settle`], for the memory.
    #[inline(never)]
    pub(super) unsafe fn begin(
        memory: *mut c_void,
        size: usize,
        config: &gt_server_config,
        start: &gt_start,
    ) -> Reply<*mut gt_server> {
        let checked = || {
            let (checked, motors) = config.checked()?;
            Ok((start.session(checked)?, motors))
        };
        let write = |(session, motors), place: *mut Self| {
            // SAFETY: the place is one for a server; these are all fields.
            unsafe {
                (&raw mut (*place).endpoint).write(Endpoint::new(session, motors, start.epochs()));
                (&raw mut (*place).black_box).write(BlackBox::new());
                (&raw mut (*place).motors).write(usize::try_from(config.motors).unwrap_or(0));
            }
        };
        // SAFETY: the caller's promise; `write` writes a whole server.
        unsafe { settle(memory, size, checked, write) }
    }

    pub(super) fn tick(&mut self, input: gt_tick_input) -> Reply<gt_tick_output> {
        let references = self.endpoint.tick_recorded(&input.to_core()?, &mut self.black_box);
        let output = self.endpoint.output().ok_or(gt_code::NoObject)?;
        Ok(gt_tick_output::new(references.as_ref(), output, self.motors))
    }
}
