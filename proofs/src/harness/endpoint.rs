//! Any valid endpoint of one axis: any connections, any events in the inbox. What a stream or a datagram holds, and what a session makes of
//! a tick, are replaced by any outcome.

use gantry_tau_core::control::endpoint::Endpoint;
use gantry_tau_core::control::message::{ClientMessage, ContentError, FrameError};
use gantry_tau_core::control::session::{Connection, Input, Output, Session};
use gantry_tau_core::control::wire::{Deframer, Feed, Frame};

use super::kani;
use crate::endpoint;

/// Any outcome of a feed of at least one byte, and of no byte.
#[cfg_attr(not(kani), allow(dead_code, reason = "Kani puts it in the place of the deframer"))]
fn any_feed<'a>(_: &'a mut Deframer, bytes: &[u8]) -> Feed<'a> {
    match (kani::any::<u8>(), Frame::from_parts(kani::any(), &[])) {
        (0, Some(frame)) => {
            let consumed = kani::any();
            assume!(0 < consumed && consumed <= bytes.len(), consumed == 1, "a frame's end is read");
            Feed::Frame { frame, consumed }
        }
        (1, _) => Feed::Broken(kani::any()),
        _ => Feed::Incomplete,
    }
}

/// Any verdict on a datagram. (The bound makes the lifetime a parameter of the function, as it is of the one that is replaced.)
#[cfg_attr(not(kani), allow(dead_code, reason = "Kani puts it in the place of the parser"))]
fn any_frame<'a>(_: &'a [u8]) -> Result<Frame<'a>, FrameError>
where
    'a: 'a,
{
    Frame::from_parts(kani::any(), &[]).filter(|_| kani::any()).ok_or(kani::any())
}

/// Any message of a frame, or none.
#[cfg_attr(not(kani), allow(dead_code, reason = "Kani puts it in the place of the decoder"))]
fn any_message<const N: usize>(_: &Frame<'_>) -> Result<ClientMessage<N>, ContentError> {
    if kani::any() { Ok(kani::any()) } else { Err(kani::any()) }
}

/// Any session after a tick, and any output.
#[cfg_attr(not(kani), allow(dead_code, reason = "Kani puts it in the place of the tick"))]
fn any_tick<const N: usize>(session: &mut Session<N>, _: &Input<N>) -> Output<N> {
    *session = kani::any();
    kani::any()
}

harnesses! {
    endpoint_has_room [minisat, unwind 18] {
        let endpoint: Endpoint<1, 1> = kani::any();
        kani::cover!(endpoint.session().owner().is_some(), "an owner");
        endpoint::inbox_has_room(&endpoint);
    }
    endpoint_opens [minisat, unwind 18] { endpoint::opens(&mut kani::any::<Endpoint<1, 1>>(), kani::any()); }
    endpoint_closes [minisat, unwind 18] { endpoint::closes(&mut kani::any::<Endpoint<1, 1>>(), kani::any()); }
    endpoint_feeds [
        minisat, unwind 18,
        stub(gantry_tau_core::control::wire::Deframer::feed, any_feed),
        stub(gantry_tau_core::control::wire::Frame::parse, any_frame),
        stub(gantry_tau_core::control::wire::decode_client, any_message)
    ] {
        let mut endpoint: Endpoint<1, 1> = kani::any();
        let connection: Connection = kani::any();
        kani::cover!(endpoint.session().owner() == Some(connection), "the owner");
        endpoint::feeds(&mut endpoint, connection, &[0], kani::any());
    }
    endpoint_ticks [minisat, unwind 18, stub(gantry_tau_core::control::session::Session::tick, any_tick)] {
        endpoint::ticks(&mut kani::any::<Endpoint<1, 1>>(), &kani::any());
    }
}
