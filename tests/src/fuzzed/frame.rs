//! Any body in a frame whose length and checksum are right: what random bytes would hardly ever
//! reach (T8).

use arbitrary::{Arbitrary, Unstructured};
use gantry_tau_proofs::properties::wire::sealed_frame_is_judged;

/// A frame without its length and its checksum.
#[derive(Arbitrary, Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sealed<'a> {
    /// Version of the protocol.
    pub version: u8,
    /// Kind of the message.
    pub kind: u8,
    /// Position of the cut.
    pub cut: u16,
    /// Index of the bit that flips at last.
    pub bit: u16,
    /// Body of the frame.
    pub body: &'a [u8],
}

/// A [`Sealed`] frame.
pub fn frame(data: &[u8]) {
    if let Ok(Sealed {
        version,
        kind,
        cut,
        bit,
        body,
    }) = Sealed::arbitrary_take_rest(Unstructured::new(data))
    {
        sealed_frame_is_judged(version, kind, body, cut, bit);
    }
}
