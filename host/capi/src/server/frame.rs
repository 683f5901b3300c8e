//! Frames for C: copied, and a Hello recognised.

use core::ptr::null_mut;

use gantry_tau_core::control::message::ClientMessage;
use gantry_tau_core::control::session::Connection;
use gantry_tau_core::control::wire::{Frame, MAX_FRAME, decode_client};

use super::GT_MAX_AXES;
use crate::code::gt_code;
use crate::memory::{answer, bytes};
use crate::padding::padded;

/// Longest frame, bytes.
pub const GT_MAX_FRAME: usize = 396;
const _: () = assert!(GT_MAX_FRAME == MAX_FRAME, "a frame fits");

/// A frame to be sent on a connection.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct gt_frame {
    /// Recipient.
    pub connection: u64,
    /// Number of bytes.
    pub length: u32,
    /// The bytes; 0 from `length` on.
    pub bytes: [u8; GT_MAX_FRAME],
}

padded! {
    gt_frame { connection length bytes }
}

impl gt_frame {
    pub(super) fn new(connection: Connection, frame: &[u8]) -> Self {
        let mut bytes = [0; GT_MAX_FRAME];
        for (to, from) in bytes.iter_mut().zip(frame) {
            *to = *from;
        }
        Self {
            connection: connection.0,
            length: u32::try_from(frame.len()).unwrap_or(0),
            bytes,
        }
    }
}

/// `hello` receives 1 if a datagram asks for a session, else 0. Only such a datagram makes its
/// sender a connection (gt_server_open): anything else from an address without one is dropped, and
/// not answered.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_datagram_is_hello(
    datagram: *const u8,
    length: usize,
    hello: *mut u8,
) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        answer(hello, null_mut(), || {
            bytes(datagram, length).map(|datagram| is_hello(datagram).into())
        })
    }
}

fn is_hello(datagram: &[u8]) -> bool {
    // A Hello is the same for any number of axes.
    Frame::parse(datagram).is_ok_and(|frame| {
        matches!(
            decode_client::<GT_MAX_AXES>(&frame),
            Ok(ClientMessage::Hello(_))
        )
    })
}
