//! A MainDevice of ethercrab with the pump that carries its frames.

use std::time::Duration;

use ethercrab::{MainDevice, MainDeviceConfig, PduStorage, RetryBehaviour, Timeouts};

use crate::pump::Pump;
use crate::wire::Wire;

/// Frames that can be under way; one is.
const FRAMES: usize = 16;
/// Longest frame's data: more than the longest process image with the states of all SubDevices.
const FRAME_DATA: usize = PduStorage::element_size(1_100);
/// Resends of a lost frame during a bring-up. In a cycle nothing is sent twice: its time is over
/// before.
const RESENDS: usize = 10;

/// Creates a MainDevice on a wire; a frame without an answer is given up after `answer_us`. Memory
/// of about 20 KiB is kept to the end of the process.
pub(crate) fn main_device<W: Wire>(
    wire: W,
    answer_us: u32,
) -> Option<(Pump<W>, &'static MainDevice<'static>)> {
    let storage: &'static PduStorage<FRAMES, FRAME_DATA> = Box::leak(Box::new(PduStorage::new()));
    let (tx, rx, pdu_loop) = storage.try_split().ok()?;
    let timeouts = Timeouts {
        state_transition: Duration::from_secs(3),
        pdu: Duration::from_micros(answer_us.into()),
        wait_loop_delay: Duration::from_micros(100),
        ..Timeouts::default()
    };
    let config = MainDeviceConfig {
        // The clocks of a machine are brought up elsewhere.
        dc_static_sync_iterations: 0,
        retry_behaviour: RetryBehaviour::Count(RESENDS),
    };
    let main = Box::leak(Box::new(MainDevice::new(pdu_loop, timeouts, config)));
    Some((Pump::new(wire, tx, rx), main))
}
