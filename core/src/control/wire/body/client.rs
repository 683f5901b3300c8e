//! Bodies of the client's messages.

use super::super::cursor::{Short, Writer};
use super::super::frame::{Frame, FrameBytes, Kind, enclose};
use super::{
    Body, ContentError, OFFSETS, axes_byte, check_axes, check_reserved, read_offsets, reader,
    write_offsets,
};
use crate::control::axis::Offsets;
use crate::control::message::{Capabilities, ClientMessage, Command, Hello, Mode};
use crate::units::{Epoch, Sequence, Tick};

/// Decodes a message of a client.
///
/// # Errors
/// [`ContentError`], for a body that the frame around it does not fit, or with invalid content.
pub fn decode_client<const N: usize>(frame: &Frame<'_>) -> Result<ClientMessage<N>, ContentError> {
    let (received, body) = (frame.kind_code(), frame.body());
    match Kind::from_code(received) {
        Some(Kind::Hello) => Hello::read(body).map(ClientMessage::Hello),
        Some(Kind::Command) => Command::read(body).map(ClientMessage::Command),
        Some(Kind::Goodbye) => Epoch::read(body).map(ClientMessage::Goodbye),
        Some(Kind::Stop) => Epoch::read(body).map(ClientMessage::Stop),
        _ => Err(ContentError::Kind { received }),
    }
}

/// Encodes a message of a client; every message has exactly one frame.
#[must_use]
pub fn encode_client<const N: usize>(message: &ClientMessage<N>) -> FrameBytes {
    match message {
        ClientMessage::Hello(hello) => enclose(Kind::Hello, hello),
        ClientMessage::Command(command) => enclose(Kind::Command, command),
        ClientMessage::Goodbye(epoch) => enclose(Kind::Goodbye, epoch),
        ClientMessage::Stop(epoch) => enclose(Kind::Stop, epoch),
    }
}

impl Body for Hello {
    const LENGTH: usize = 4;

    fn write(&self, body: &mut [u8]) -> Result<(), Short> {
        let mut w = Writer::new(body);
        w.u8(self.axes)?;
        w.u8(0)?;
        w.u16(self.capabilities.0)
    }

    fn read(body: &[u8]) -> Result<Self, ContentError> {
        let mut r = reader::<Self>(body)?;
        let axes = r.u8()?;
        check_reserved(u16::from(r.u8()?))?;
        let capabilities = Capabilities(r.u16()?);
        Ok(Self { axes, capabilities })
    }
}

impl<const N: usize> Body for Command<N> {
    const LENGTH: usize = 28_usize.saturating_add(N.saturating_mul(OFFSETS));

    fn write(&self, body: &mut [u8]) -> Result<(), Short> {
        let mut w = Writer::new(body);
        w.u64(self.epoch.0)?;
        w.u64(self.sequence.0)?;
        w.u64(self.echo.0)?;
        w.u8(self.mode.code())?;
        w.u8(axes_byte::<N>())?;
        w.u16(0)?;
        self.targets
            .iter()
            .try_for_each(|target| write_offsets(&mut w, target))
    }

    fn read(body: &[u8]) -> Result<Self, ContentError> {
        let mut r = reader::<Self>(body)?;
        let epoch = Epoch(r.u64()?);
        let sequence = Sequence(r.u64()?);
        let echo = Tick(r.u64()?);
        let received = r.u8()?;
        let mode = Mode::from_code(received).ok_or(ContentError::Code { received })?;
        check_axes::<N>(r.u8()?)?;
        check_reserved(r.u16()?)?;
        let mut targets = [Offsets::default(); N];
        for target in &mut targets {
            *target = read_offsets(&mut r)?;
        }
        Ok(Self {
            epoch,
            sequence,
            echo,
            mode,
            targets,
        })
    }
}
