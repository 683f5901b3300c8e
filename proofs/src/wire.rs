//! The decoder: T8. Bodies without a checksum, frames with one, and the stream by induction on one chunk.

use gantry_tau_core::wire::{
    Body, Collector, ContentError, Deframer, Feed, Frame, FrameError, MAX_BODY, Stage,
    decode_client, decode_server, encode_client, encode_server,
};

/// From bytes to a message and back: the same bytes, or an error. Says which.
///
/// # Errors
/// When the bytes are no message; what is wrong with them.
///
/// # Panics
/// When the message has another encoding.
pub fn body_is_canonical<M: Body>(frame: &Frame<'_>) -> Result<(), ContentError> {
    let message = M::read(frame)?;
    let (kind, length) = message.shape();
    assert!(kind.code() == frame.kind_code(), "T8: the same kind");
    assert!(length == frame.body().len(), "T8: the same length");
    let mut buffer = [0; MAX_BODY];
    let body = &mut buffer[..frame.body().len()];
    assert!(message.write(body).is_ok(), "T8: a body fits its length");
    assert!(body == frame.body(), "T8: decode(b) = m => encode(m) = b");
    Ok(())
}

/// From a message to bytes and back: the same message.
///
/// # Panics
/// When it is not.
pub fn message_survives<M: Body + PartialEq>(message: &M) {
    let (kind, length) = message.shape();
    assert!(length <= MAX_BODY, "T8: every body fits a frame");
    let mut buffer = [0; MAX_BODY];
    let body = &mut buffer[..length];
    assert!(message.write(body).is_ok(), "T8: a body fits its length");
    let read = Frame::from_parts(kind.code(), body).map(|frame| M::read(&frame));
    assert!(
        read.is_some_and(|read| read.as_ref() == Ok(message)),
        "T8: decode(encode(m)) = m"
    );
}
