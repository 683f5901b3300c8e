//! Messages as frames of bytes. `wire.md` in the repository specifies the format for writers of
//! other clients.
//!
//! A frame is header, body, trailer; little-endian; every message has exactly one encoding. The trailer
//! is a checksum, or a tag under a key ([`Suite`]).
//! Beside them stands a [`Notice`], which is the same in every version.
//! Parsing has three steps: [`Sealed`] has a valid boundary, version and length; [`Frame`] has a valid
//! trailer as well; [`decode_client`] and [`decode_server`] turn its body into a message or an error.

mod body;
mod collector;
mod cursor;
mod deframer;
pub(crate) mod frame;

pub use super::message::{ContentError, FrameError, MAX_BODY, Notice, PROTOCOL_VERSION};
pub use body::{Body, decode_client, decode_server, encode_client, encode_server, encode_state};
#[cfg(feature = "keyed")]
pub(crate) use body::{claims_of_command, session_of_welcome};
pub use collector::Collector;
pub use cursor::Short;
pub use deframer::{Deframer, Feed, Stage};
pub use frame::{
    Frame, FrameBytes, HEADER_LEN, Kind, MAX_FRAME, Sealed, Suite, TAG_LEN, TRAILER_LEN, enclose,
    encode_notice,
};

#[cfg(test)]
mod tests;
