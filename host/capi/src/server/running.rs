//! A server of so many axes and with so much of a black box, and what every one of them can do.

use gantry_tau_core::control::endpoint::{CONNECTIONS, Endpoint, MotorMap, Transport};
use gantry_tau_core::control::session::Session;
use gantry_tau_core::control::session::fsm::Connection;

use super::config::{gt_offsets, gt_server_config, gt_start, in_force};
use super::outbox::{Outbox, gt_frame};
use super::turn::{gt_cycle, gt_turn};
use super::{
    GT_BLACK_BOX_NONE, GT_BLACK_BOX_TICKS, GT_MAX_AXES, GT_MAX_MOTORS, GT_SERVER_SIZE_3,
    GT_SERVER_SIZE_3_BLACK_BOX, GT_SERVER_SIZE_6, GT_SERVER_SIZE_6_BLACK_BOX, gt_server,
};
use crate::black_box::{Line, gt_black_box, look, write_line};
use crate::memory::{Object, Reply, tag};

/// Ticks on either side of an end that a black box keeps, where there is one.
#[expect(
    clippy::as_conversions,
    reason = "u32 to usize is lossless where this runs; `From` is not const"
)]
pub(super) const HALF: usize = GT_BLACK_BOX_TICKS as usize;
/// The same for none.
#[expect(
    clippy::as_conversions,
    reason = "u32 to usize is lossless where this runs; `From` is not const"
)]
pub(super) const NONE: usize = GT_BLACK_BOX_NONE as usize;

/// Core's endpoint with what C fetches from it.
pub(super) struct Running<const N: usize, const TICKS: usize> {
    endpoint: Endpoint<N, GT_MAX_MOTORS, TICKS>,
    outbox: Outbox,
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
    /// What it is made of, checked.
    pub(super) fn parts(config: &gt_server_config, start: &gt_start) -> Reply<Parts<N>> {
        let (checked, motor_map) = config.checked()?;
        Ok(Parts {
            session: start.session(checked)?,
            motor_map,
            motors: usize::try_from(config.motors).unwrap_or(0),
        })
    }

    /// Makes a server of these parts in its place, field by field: as one value it would first be on the stack, half a megabyte
    /// with its black box. (The test `capi` runs with a small stack.)
    ///
    /// # Safety
    /// `place` is one for a server.
    #[inline(always)]
    pub(super) unsafe fn write(parts: Parts<N>, place: *mut Self) {
        let Parts {
            session,
            motor_map,
            motors,
        } = parts;
        // SAFETY: the caller's promise; these are all fields.
        unsafe {
            (&raw mut (*place).endpoint).write(Endpoint::new(session, motor_map));
            (&raw mut (*place).outbox).write(Outbox::new());
            (&raw mut (*place).motors).write(motors);
        }
    }
}

/// What a server is made of, beside what is empty at first.
pub(super) struct Parts<const N: usize> {
    session: Session<N>,
    motor_map: MotorMap<N, GT_MAX_MOTORS>,
    motors: usize,
}

/// What every server can do, however many axes it has.
impl<const N: usize, const TICKS: usize> Running<N, TICKS> {
    pub(super) fn open(&mut self, transport: Transport) -> Reply<u64> {
        Ok(self.endpoint.open(transport)?.0)
    }

    pub(super) fn close(&mut self, connection: u64) {
        self.endpoint.close(Connection(connection));
    }

    pub(super) fn feed(&mut self, connection: u64, bytes: &[u8]) -> u8 {
        self.endpoint.feed(Connection(connection), bytes)
    }

    pub(super) fn owner_has_answered(&self) -> bool {
        self.endpoint.owner_has_answered()
    }

    pub(super) fn tick(&mut self, cycle: gt_cycle) -> gt_turn {
        let Self {
            endpoint,
            outbox,
            motors,
        } = self;
        outbox.clear();
        let turn = endpoint.tick(&cycle.to_core(), &mut |to, bytes| outbox.push(to, bytes));
        gt_turn::new(&turn, *motors, outbox.count())
    }

    pub(super) fn frame(&self, index: usize) -> Option<gt_frame> {
        self.outbox.frame(index)
    }

    pub(super) fn resume(&mut self, offsets: &[gt_offsets; GT_MAX_AXES]) -> Reply {
        Ok(self.endpoint.resume(&in_force(offsets))?)
    }

    pub(super) fn black_box(&self) -> gt_black_box {
        look(self.endpoint.black_box())
    }

    pub(super) fn write_black_box(&self, index: usize, line: &mut Line<'_>) -> Reply {
        write_line(self.endpoint.black_box(), index, line)
    }

    pub(super) fn release_black_box(&mut self) {
        self.endpoint.black_box_mut().release();
    }
}

/// What a peer is told for whom there is no room; it says the same for any number of axes.
pub(super) fn full_refusal() -> gt_frame {
    let refusal = Endpoint::<3, GT_MAX_MOTORS, NONE>::full_refusal();
    gt_frame::new(Connection(u64::MAX), &refusal)
}

const _: () = assert!(
    CONNECTIONS < 255,
    "a connection is never the number that stands for none"
);
