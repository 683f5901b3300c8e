//! A server with `N` axes and `TICKS` ticks of black box on either side of an end.

use gantry_tau_core::control::endpoint::{CONNECTIONS, Endpoint, MotorMap, Transport};
use gantry_tau_core::control::session::{BlackBox, Connection, Session};
use gantry_tau_core::units::EpochRange;

use super::config::{gt_server_config, gt_start};
use super::frame::gt_frame;
use super::tick::{gt_tick_input, gt_tick_output};
use super::{
    GT_BLACK_BOX_NONE, GT_BLACK_BOX_TICKS, GT_MAX_MOTORS, GT_SERVER_SIZE_3, GT_SERVER_SIZE_3_BLACK_BOX,
    GT_SERVER_SIZE_6, GT_SERVER_SIZE_6_BLACK_BOX, gt_server,
};
use crate::black_box::{gt_black_box, look, write_part};
use crate::code::gt_code;
use crate::memory::{Object, Reply, tag};

/// Ticks before and after an end that a black box keeps.
#[expect(clippy::as_conversions, reason = "u32 to usize is lossless where this runs; `From` is not const")]
pub(super) const HALF: usize = GT_BLACK_BOX_TICKS as usize;
/// The same without a black box.
#[expect(clippy::as_conversions, reason = "u32 to usize is lossless where this runs; `From` is not const")]
pub(super) const NONE: usize = GT_BLACK_BOX_NONE as usize;

/// Core's endpoint, and its black box.
pub(super) struct Running<const N: usize, const TICKS: usize> {
    endpoint: Endpoint<N, GT_MAX_MOTORS>,
    black_box: BlackBox<N, TICKS>,
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
    /// Checks configuration and start.
    pub(super) fn parts(config: &gt_server_config, start: &gt_start) -> Reply<Parts<N>> {
        let (checked, motor_map) = config.checked()?;
        Ok(Parts {
            session: start.session(checked)?,
            epochs: start.epochs(),
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
        let Parts { session, epochs, motor_map, motors } = parts;
        // SAFETY: the caller's promise; these are all fields.
        unsafe {
            (&raw mut (*place).endpoint).write(Endpoint::new(session, motor_map, epochs));
            (&raw mut (*place).black_box).write(BlackBox::new());
            (&raw mut (*place).motors).write(motors);
        }
    }
}

/// Checked parts of a server.
pub(super) struct Parts<const N: usize> {
    session: Session<N>,
    epochs: EpochRange,
    motor_map: MotorMap<N, GT_MAX_MOTORS>,
    motors: usize,
}

/// Calls of the interface.
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

    pub(super) fn set_epochs(&mut self, epochs: EpochRange) {
        self.endpoint.set_epochs(epochs);
    }

    pub(super) fn tick(&mut self, input: gt_tick_input) -> Reply<gt_tick_output> {
        let input = input.to_core()?;
        let references = self.endpoint.tick_recorded(&input, &mut self.black_box);
        let output = self.endpoint.output().ok_or(gt_code::NoObject)?;
        Ok(gt_tick_output::new(references.as_ref(), output, self.motors))
    }

    pub(super) fn poll_transmit(&mut self) -> Option<gt_frame> {
        let (to, frame) = self.endpoint.poll_transmit()?;
        Some(gt_frame::new(to, frame))
    }

    pub(super) fn poll_close(&mut self) -> Option<u64> {
        Some(self.endpoint.poll_close()?.0)
    }

    pub(super) fn black_box(&self) -> gt_black_box {
        look(&self.black_box)
    }

    pub(super) fn write_black_box(&self, index: usize, room: &mut [u8]) -> Reply<usize> {
        write_part(&self.black_box, index, room)
    }

    pub(super) fn release_black_box(&mut self) {
        self.black_box.release();
    }
}

/// Returns the frame for a peer without room for its connection; it is the same for any number of axes.
pub(super) fn full_refusal() -> gt_frame {
    let refusal = Endpoint::<3, GT_MAX_MOTORS>::full_refusal();
    gt_frame::new(Connection(u64::MAX), &refusal)
}

const _: () = assert!(CONNECTIONS < 255, "a connection is never the number that stands for none");
