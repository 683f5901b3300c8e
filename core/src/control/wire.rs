//! Messages as frames of bytes. `wire.md` in the repository specifies the format for writers of
//! other clients.
//!
//! A frame is header, body, checksum; little-endian; every message has exactly one encoding.
//! Beside them stands a [`Notice`], which is the same in every version.
//! Parsing has two steps: [`Frame`] is checked once (boundary, version, length, checksum) and its
//! accessors are total; [`decode_client`] and [`decode_server`] turn its body into a message or an
//! error.

mod body;
mod collector;
mod cursor;
mod deframer;
pub(crate) mod frame;

pub use super::message::{ContentError, FrameError, MAX_BODY, Notice, PROTOCOL_VERSION};
pub use body::{Body, decode_client, decode_server, encode_client, encode_server, encode_state};
pub use collector::Collector;
pub use cursor::Short;
pub use deframer::{Deframer, Feed, Stage};
pub use frame::{
    Frame, FrameBytes, HEADER_LEN, Kind, MAX_FRAME, TRAILER_LEN, enclose, encode_notice,
};

#[cfg(test)]
mod tests;
