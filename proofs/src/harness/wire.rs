//! T8: every body without a checksum, frames with one, the collector under the deframer by one
//! chunk.

use gantry_tau_core::control::message::{Command, Hello, Refusal, State, Welcome};
use gantry_tau_core::control::wire::{
    Body, Collector, ContentError, Frame, FrameError, HEADER_LEN, Kind, MAX_BODY, PROTOCOL_VERSION,
    Short, TRAILER_LEN, decode_client, decode_server,
};
use gantry_tau_core::units::Epoch;

use super::kani;
use crate::properties::wire::{
    body_is_canonical, body_survives, chunk_is_collected, feed_is_judged, frame_is_canonical,
    frame_is_parsed, frame_survives, notice_is_read,
};
use crate::stand_in;

/// Any bytes of a body's length.
fn canonical<B: Body, const LENGTH: usize>() {
    let bytes: [u8; LENGTH] = kani::any();
    let decoded = body_is_canonical::<B>(&bytes);
    kani::cover!(decoded.is_ok(), "some bytes are one");
}

/// Any bytes behind the good header of a kind.
fn canonical_frame<B: Body, const LENGTH: usize>(kind: Kind) {
    let mut bytes: [u8; LENGTH] = kani::any();
    bytes[0] = b'G';
    bytes[1] = b'T';
    bytes[2] = PROTOCOL_VERSION;
    bytes[3] = kind.code();
    bytes[4] = u8::try_from(LENGTH - HEADER_LEN - TRAILER_LEN).unwrap_or(0);
    bytes[5..HEADER_LEN].fill(0);
    let decoded = frame_is_canonical::<B>(kind, &bytes);
    kani::cover!(decoded, "some bytes are one");
}

/// Any bytes as a body.
struct Bytes<const LENGTH: usize>([u8; LENGTH]);

impl<const LENGTH: usize> Body for Bytes<LENGTH> {
    const LENGTH: usize = LENGTH;

    fn write(&self, body: &mut [u8]) -> Result<(), Short> {
        *body.first_chunk_mut().ok_or(Short)? = self.0;
        Ok(())
    }

    fn read(body: &[u8]) -> Result<Self, ContentError> {
        body.first_chunk()
            .map(|bytes| Self(*bytes))
            .ok_or(ContentError::Reserved)
    }
}

/// Any body of a length, in a frame of any kind.
fn frame_of<const LENGTH: usize>() {
    stand_in::choose_checksum(kani::any(), kani::any());
    frame_survives(kani::any(), &Bytes::<LENGTH>(kani::any()), kani::any());
}

/// Longest frame with a checksum: this family is built without keys.
const LONGEST: usize = framed(MAX_BODY);

/// Length of a whole frame.
const fn framed(body: usize) -> usize {
    HEADER_LEN + body + TRAILER_LEN
}

/// Any length that is at most this.
fn any_length(most: usize) -> usize {
    let length = kani::any();
    assume!(length <= most, length == most, "the longest");
    length
}

/// Any valid collector: up to a whole frame of any length.
fn any_collector() -> Collector {
    let collector = Collector::from_parts(kani::any(), kani::any(), kani::any());
    assume!(collector.is_some(), true, "some collectors are valid");
    let collector = collector.unwrap_or_default();
    kani::cover!(collector.held().len() == LONGEST, "the longest frame");
    collector
}

harnesses! {
    wire_hello_is_canonical [minisat] { canonical::<Hello, { Hello::LENGTH }>(); }
    wire_hello_survives [minisat] { body_survives::<Hello>(&kani::any()); }
    wire_epoch_is_canonical [minisat] { canonical::<Epoch, { Epoch::LENGTH }>(); }
    wire_epoch_survives [minisat] { body_survives::<Epoch>(&kani::any()); }
    wire_refusal_is_canonical [minisat] { canonical::<Refusal, { Refusal::LENGTH }>(); }
    wire_refusal_survives [minisat] { body_survives::<Refusal>(&kani::any()); }
    wire_command_1_is_canonical [minisat] { canonical::<Command<1>, { Command::<1>::LENGTH }>(); }
    wire_command_1_survives [minisat] { body_survives::<Command<1>>(&kani::any()); }
    wire_command_6_is_canonical [minisat] { canonical::<Command<6>, { Command::<6>::LENGTH }>(); }
    wire_command_6_survives [minisat] { body_survives::<Command<6>>(&kani::any()); }
    wire_welcome_1_is_canonical [minisat] { canonical::<Welcome<1>, { Welcome::<1>::LENGTH }>(); }
    wire_welcome_1_survives [minisat] { body_survives::<Welcome<1>>(&kani::any()); }
    wire_welcome_6_is_canonical [minisat] { canonical::<Welcome<6>, { Welcome::<6>::LENGTH }>(); }
    wire_welcome_6_survives [minisat] { body_survives::<Welcome<6>>(&kani::any()); }
    wire_state_1_is_canonical [minisat] { canonical::<State<1>, { State::<1>::LENGTH }>(); }
    wire_state_1_survives [minisat] { body_survives::<State<1>>(&kani::any()); }
    wire_state_6_is_canonical [minisat] { canonical::<State<6>, { State::<6>::LENGTH }>(); }
    wire_state_6_survives [minisat] { body_survives::<State<6>>(&kani::any()); }
    wire_decode_is_total [minisat] {
        let bytes: [u8; MAX_BODY] = kani::any();
        let frame = Frame::from_parts(kani::any(), &bytes[..any_length(MAX_BODY)]);
        let decoded = frame
            .is_some_and(|frame| decode_client::<1>(&frame).is_ok() || decode_server::<1>(&frame).is_ok());
        kani::cover!(decoded, "some frames are messages");
    }
    wire_write_is_total [minisat] {
        // The longest of the three, and more.
        let mut room = [0; State::<1>::LENGTH + 1];
        let length = any_length(room.len());
        kani::cover!(length == 0, "no room at all");
        let written = kani::any::<Command<1>>().write(&mut room[..length]);
        assert!(written.is_ok() == (length >= Command::<1>::LENGTH));
        let written = kani::any::<Welcome<1>>().write(&mut room[..length]);
        assert!(written.is_ok() == (length >= Welcome::<1>::LENGTH));
        let written = kani::any::<State<1>>().write(&mut room[..length]);
        assert!(written.is_ok() == (length >= State::<1>::LENGTH));
        kani::cover!(written.is_err(), "some rooms are too small");
        kani::cover!(written.is_ok(), "some rooms hold a State");
    }
    wire_frame_of_hello_is_canonical [minisat] { canonical_frame::<Hello, { framed(Hello::LENGTH) }>(Kind::Hello); }
    wire_frame_of_goodbye_is_canonical [minisat] { canonical_frame::<Epoch, { framed(Epoch::LENGTH) }>(Kind::Goodbye); }
    wire_frame_of_refusal_is_canonical [minisat] { canonical_frame::<Refusal, { framed(Refusal::LENGTH) }>(Kind::Refusal); }
    wire_frame_of_command_1_is_canonical [minisat] { canonical_frame::<Command<1>, { framed(Command::<1>::LENGTH) }>(Kind::Command); }
    wire_any_frame_is_parsed [minisat, stub(gantry_tau_core::verification::control::checksum, crate::stand_in::checksum)] {
        stand_in::choose_checksum(kani::any(), kani::any());
        let bytes: [u8; LONGEST + 1] = kani::any();
        let length = any_length(bytes.len());
        let parsed = frame_is_parsed(&bytes[..length], kani::any());
        kani::cover!(parsed.is_ok() && length == LONGEST, "the longest frame");
        kani::cover!(parsed == Err(FrameError::Checksum), "a wrong checksum");
        kani::cover!(parsed == Err(FrameError::Suite { received: 1 }), "another suite");
        kani::cover!(matches!(parsed, Err(FrameError::Notice(_))), "a notice");
    }
    wire_notice_is_read [minisat, stub(gantry_tau_core::verification::control::checksum, crate::stand_in::checksum)] {
        stand_in::choose_checksum(kani::any(), kani::any());
        notice_is_read(kani::any());
    }
    wire_frame_of_hello_survives [minisat, stub(gantry_tau_core::verification::control::checksum, crate::stand_in::checksum)] { frame_of::<{ Hello::LENGTH }>(); }
    wire_frame_of_epoch_survives [minisat, stub(gantry_tau_core::verification::control::checksum, crate::stand_in::checksum)] { frame_of::<{ Epoch::LENGTH }>(); }
    wire_frame_of_refusal_survives [minisat, stub(gantry_tau_core::verification::control::checksum, crate::stand_in::checksum)] { frame_of::<{ Refusal::LENGTH }>(); }
    wire_frame_of_command_1_survives [minisat, stub(gantry_tau_core::verification::control::checksum, crate::stand_in::checksum)] { frame_of::<{ Command::<1>::LENGTH }>(); }
    wire_frame_of_command_3_survives [minisat, stub(gantry_tau_core::verification::control::checksum, crate::stand_in::checksum)] { frame_of::<{ Command::<3>::LENGTH }>(); }
    wire_frame_of_command_6_survives [minisat, stub(gantry_tau_core::verification::control::checksum, crate::stand_in::checksum)] { frame_of::<{ Command::<6>::LENGTH }>(); }
    wire_frame_of_welcome_1_survives [minisat, stub(gantry_tau_core::verification::control::checksum, crate::stand_in::checksum)] { frame_of::<{ Welcome::<1>::LENGTH }>(); }
    wire_frame_of_welcome_3_survives [minisat, stub(gantry_tau_core::verification::control::checksum, crate::stand_in::checksum)] { frame_of::<{ Welcome::<3>::LENGTH }>(); }
    wire_frame_of_welcome_6_survives [minisat, stub(gantry_tau_core::verification::control::checksum, crate::stand_in::checksum)] { frame_of::<{ Welcome::<6>::LENGTH }>(); }
    wire_frame_of_state_1_survives [minisat, stub(gantry_tau_core::verification::control::checksum, crate::stand_in::checksum)] { frame_of::<{ State::<1>::LENGTH }>(); }
    wire_frame_of_state_3_survives [minisat, stub(gantry_tau_core::verification::control::checksum, crate::stand_in::checksum)] { frame_of::<{ State::<3>::LENGTH }>(); }
    wire_frame_of_state_6_survives [minisat, stub(gantry_tau_core::verification::control::checksum, crate::stand_in::checksum)] { frame_of::<{ State::<6>::LENGTH }>(); }
    wire_feed_is_judged [minisat, unwind 9, stub(gantry_tau_core::verification::control::checksum, crate::stand_in::checksum)] {
        stand_in::choose_checksum(kani::any(), kani::any());
        let chunk: [u8; 8] = kani::any();
        let chunk = &chunk[..any_length(8)];
        let returned = feed_is_judged(&any_collector(), kani::any(), chunk);
        kani::cover!(returned, "a frame is returned");
    }
    wire_chunk_is_collected [minisat, unwind 9] {
        let chunk: [u8; 8] = kani::any();
        let chunk = &chunk[..any_length(8)];
        let outcome = chunk_is_collected(&any_collector(), chunk, kani::any());
        kani::cover!(outcome == Ok(true), "a frame can be complete");
    }
}
