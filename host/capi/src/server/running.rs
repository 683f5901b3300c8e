//! A server with `N` axes and `TICKS` ticks of black box on either side of an end.

use core::ffi::c_void;

use gantry_tau_core::control::endpoint::{Budget, Endpoint, MotorMap, Write};
use gantry_tau_core::control::keys::Keyring;
use gantry_tau_core::control::session::{BlackBox, Reading};
use gantry_tau_core::units::PositionNm;

use super::config::{gt_in_force, gt_server_config, gt_start};
use super::tick::{gt_held, gt_tick_input, gt_tick_output, say};
use super::{
    GT_BLACK_BOX_NONE, GT_BLACK_BOX_TICKS, GT_MAX_MOTORS, GT_SERVER_SIZE_3,
    GT_SERVER_SIZE_3_BLACK_BOX, GT_SERVER_SIZE_6, GT_SERVER_SIZE_6_BLACK_BOX, GT_START_WINDOW_NM,
    gt_server,
};
use crate::code::gt_code;
use crate::error::gt_error;
use crate::memory::{Object, Reply, read, resized, settle, size_of, tag};

/// Ticks before and after an end that a black box keeps.
#[expect(
    clippy::as_conversions,
    reason = "u32 to usize is lossless where this runs; `From` is not const"
)]
pub(super) const HALF: usize = GT_BLACK_BOX_TICKS as usize;
/// The same without a black box.
#[expect(
    clippy::as_conversions,
    reason = "u32 to usize is lossless where this runs; `From` is not const"
)]
pub(super) const NONE: usize = GT_BLACK_BOX_NONE as usize;

/// Core's endpoint, and its black box.
pub(super) struct Running<const N: usize, const TICKS: usize> {
    pub(super) endpoint: Endpoint<N>,
    pub(super) black_box: BlackBox<N, TICKS>,
    motor_map: MotorMap<N, GT_MAX_MOTORS>,
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

    /// Creates a server in memory of the caller, field by field: as one value it would first be on
    /// the stack, half a megabyte with its black box. (The test `capi` runs with a small stack.)
    ///
    /// # Safety
    /// As [`settle`], for the memory.
    #[inline(never)]
    pub(super) unsafe fn begin(
        memory: *mut c_void,
        size: usize,
        config: &gt_server_config,
        start: &gt_start,
        keys: Option<(Keyring, Budget)>,
    ) -> Reply<*mut gt_server> {
        let checked = || {
            let (checked, motors) = config.checked()?;
            Ok((start.session(checked)?, motors))
        };
        let write = |(session, motors), place: *mut Self| {
            // SAFETY: the place is one for a server; these are all fields.
            unsafe {
                (&raw mut (*place).endpoint).write(match keys {
                    None => Endpoint::new(session, start.epochs()),
                    Some((keyring, budget)) => {
                        Endpoint::keyed(session, start.epochs(), keyring, budget)
                    }
                });
                (&raw mut (*place).motor_map).write(motors);
                (&raw mut (*place).black_box).write(BlackBox::new());
                (&raw mut (*place).motors).write(usize::try_from(config.motors).unwrap_or(0));
            }
        };
        // SAFETY: the caller's promise; `write` writes a whole server.
        unsafe { settle(memory, size, checked, write) }
    }

    /// References of a cycle in which no tick is run.
    pub(super) fn hold(&self, input: &gt_tick_input) -> gt_held {
        let nominal = resized(&input.nominal_nm, 0).map(PositionNm);
        gt_held::new(
            self.endpoint
                .hold(&nominal, input.elapsed_cycles.max(1))
                .as_ref(),
            &self.motor_map,
            self.motors,
        )
    }

    /// Refuses a first tick whose drives do not stand at what the start said is in force: the first
    /// references would be a step.
    fn agrees_at_the_start(&self, reading: Option<&Reading<N>>) -> Reply {
        let reading = reading.ok_or(gt_code::StartDisagrees)?;
        for (axis, (in_force, actual)) in self
            .endpoint
            .session()
            .demanded()
            .iter()
            .zip(&reading.actual)
            .enumerate()
        {
            let reference = in_force
                .nominal
                .0
                .saturating_add(in_force.offsets.position.0.into());
            let distance_nm = reference.abs_diff(actual.position.0);
            if distance_nm > GT_START_WINDOW_NM {
                let value = f64::from(u32::try_from(distance_nm).unwrap_or(u32::MAX));
                return Err(gt_error::new(gt_code::StartDisagrees).at(axis).value(value));
            }
        }
        Ok(())
    }

    pub(super) fn tick(&mut self, input: gt_tick_input) -> Reply<gt_tick_output> {
        let tick = input.to_core()?;
        if self.endpoint.output().is_none() {
            self.agrees_at_the_start(tick.reading.as_ref())?;
        }
        let write = self.endpoint.tick_recorded(&tick, &mut self.black_box);
        let references = match &write {
            Write::Due(write) => self.motor_map.spread(write.references()),
            Write::Withheld(_) => None,
        };
        // What became of it is told in another call.
        Ok(gt_tick_output::new(
            references.as_ref(),
            write.output(),
            self.motors,
        ))
    }

    /// Takes note of what became of the references of the last tick.
    ///
    /// # Safety
    /// As [`read`], for `in_force`: values of `N` axes.
    pub(super) unsafe fn written(&mut self, fate: u8, in_force: *const gt_in_force) -> Reply {
        let write = self.endpoint.pending().ok_or(gt_code::NotPending)?;
        // SAFETY: the caller's promise.
        say(write, fate, || unsafe {
            read(in_force.cast::<[gt_in_force; N]>())
        })
    }
}
