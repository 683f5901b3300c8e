//! Bodies of frames: one per message, one encoding per body. No trailer here.

mod client;
#[cfg(feature = "keyed")]
mod keyed;
mod server;

use super::cursor::{Reader, Short, Writer};
use crate::control::axis::Offsets;
use crate::control::message::ContentError;
use crate::units::{Epoch, OffsetNm, TorquePermille, VelocityUmS};

pub use client::{decode_client, encode_client};
#[cfg(feature = "keyed")]
pub(crate) use keyed::{claims_of_command, session_of_welcome};
pub use server::{decode_server, encode_server, encode_state};

/// A part of a message that fills the body of a frame.
pub trait Body: Sized {
    /// Length of the body in bytes.
    const LENGTH: usize;

    /// Writes the body to the front of a slice.
    ///
    /// # Errors
    /// [`Short`], for a slice shorter than the body.
    fn write(&self, body: &mut [u8]) -> Result<(), Short>;

    /// Reads a body.
    ///
    /// # Errors
    /// [`ContentError`], for an invalid body.
    fn read(body: &[u8]) -> Result<Self, ContentError>;
}

/// Unreachable after the length check; reported as `Length` because core must not panic.
impl From<Short> for ContentError {
    fn from(_: Short) -> Self {
        Self::Length {
            expected: 0,
            received: 0,
        }
    }
}

/// Returns a reader of a body with the expected length.
fn reader<B: Body>(body: &[u8]) -> Result<Reader<'_>, ContentError> {
    let (expected, received) = (B::LENGTH, body.len());
    if received == expected {
        Ok(Reader::new(body))
    } else {
        Err(ContentError::Length { expected, received })
    }
}

fn check_axes<const N: usize>(received: u8) -> Result<(), ContentError> {
    if usize::from(received) == N {
        Ok(())
    } else {
        Err(ContentError::Axes {
            expected: N,
            received,
        })
    }
}

const fn check_reserved(value: u16) -> Result<(), ContentError> {
    if value == 0 {
        Ok(())
    } else {
        Err(ContentError::Reserved)
    }
}

/// Returns the byte for the number of axes. Sessions refuse more than `MAX_AXES`.
fn axes_byte<const N: usize>() -> u8 {
    u8::try_from(N).unwrap_or(u8::MAX)
}

/// Goodbye and Stop carry the epoch only.
impl Body for Epoch {
    const LENGTH: usize = 8;

    fn write(&self, body: &mut [u8]) -> Result<(), Short> {
        Writer::new(body).u64(self.0)
    }

    fn read(body: &[u8]) -> Result<Self, ContentError> {
        Ok(Self(reader::<Self>(body)?.u64()?))
    }
}

/// Bytes of an axis' offsets.
const OFFSETS: usize = 4 + 4 + 2;

fn read_offsets(r: &mut Reader<'_>) -> Result<Offsets, Short> {
    Ok(Offsets {
        position: OffsetNm(r.i32()?),
        velocity: VelocityUmS(r.i32()?),
        torque: TorquePermille(r.i16()?),
    })
}

fn write_offsets(w: &mut Writer<'_>, offsets: &Offsets) -> Result<(), Short> {
    w.i32(offsets.position.0)?;
    w.i32(offsets.velocity.0)?;
    w.i16(offsets.torque.0)
}
