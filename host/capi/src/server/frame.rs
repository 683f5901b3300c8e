//! Frames for C.

use gantry_tau_core::control::session::Connection;
use gantry_tau_core::control::wire::MAX_FRAME;

use crate::padding::padded;

/// Longest frame, bytes.
pub const GT_MAX_FRAME: usize = 408;
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
