//! Any connection in any valid state. What a stream or a datagram holds is replaced by any outcome.

use gantry_tau_core::control::message::{ClientMessage, ContentError, FrameError};
use gantry_tau_core::control::session::{OWNER_FRAMES, Session};
use gantry_tau_core::control::wire::{Deframer, Feed, Frame};
use gantry_tau_core::verification::control::Slot;

use super::kani;
use crate::properties::endpoint::{self, Told};

/// Any outcome of a feed of at least one byte, and of no byte.
#[cfg_attr(
    not(kani),
    allow(dead_code, reason = "Kani puts it in the place of the deframer")
)]
fn any_feed<'a>(_: &'a mut Deframer, bytes: &[u8]) -> Feed<Frame<'a>> {
    match (kani::any::<u8>(), Frame::from_parts(kani::any(), &[])) {
        (0, Some(frame)) => {
            let consumed = kani::any();
            assume!(
                0 < consumed && consumed <= bytes.len(),
                consumed == 1,
                "a frame's end is read"
            );
            Feed::Frame { frame, consumed }
        }
        (1, _) => Feed::Broken(kani::any()),
        _ => Feed::Incomplete,
    }
}

/// Any verdict on a datagram. (The bound makes the lifetime a parameter of the function, as it is
/// of the one that is replaced.)
#[cfg_attr(
    not(kani),
    allow(dead_code, reason = "Kani puts it in the place of the parser")
)]
fn any_frame<'a>(_: &'a [u8]) -> Result<Frame<'a>, FrameError>
where
    'a: 'a,
{
    Frame::from_parts(kani::any(), &[])
        .filter(|_| kani::any())
        .ok_or(kani::any())
}

/// Any message of a frame, or none.
#[cfg_attr(
    not(kani),
    allow(dead_code, reason = "Kani puts it in the place of the decoder")
)]
fn any_message<const N: usize>(_: &Frame<'_>) -> Result<ClientMessage<N>, ContentError> {
    if kani::any() {
        Ok(kani::any())
    } else {
        Err(kani::any())
    }
}

harnesses! {
    endpoint_events_are_counted [
        minisat,
        stub(gantry_tau_core::control::wire::Deframer::feed, any_feed),
        stub(gantry_tau_core::control::wire::Frame::parse, any_frame),
        stub(gantry_tau_core::control::wire::decode_client, any_message)
    ] {
        let slot: Slot = kani::any();
        assume!(slot.is_valid() && slot.is_read(), slot.frames == OWNER_FRAMES, "no budget is left");
        endpoint::events_are_counted(&slot, &[0]);
    }
    endpoint_fate_is_told [minisat, unwind 5] {
        let session: Session<1> = kani::any();
        let told: Told<1> = kani::any();
        endpoint::fate_is_told(&session, kani::any(), told);
        kani::cover!(told == Told::Nothing, "nothing is said");
        kani::cover!(matches!(told, Told::ReadBack(_)), "values are read back");
    }
}
