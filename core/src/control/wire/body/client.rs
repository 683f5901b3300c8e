//! What a client says.

use super::super::cursor::{Short, Writer};
use super::super::frame::{Frame, FrameBytes, Kind, enclose};
use super::{
    Body, ContentError, OFFSETS, axes_byte, check_axes, check_reserved, read_offsets, reader,
    write_offsets,
};
use crate::control::axis::Offsets;
use crate::control::message::{Capabilities, ClientMessage, Command, Hello, Mode};
use crate::units::{Epoch, Sequence, Tick};

/// What a client said.
///
/// # Errors
/// [`ContentError`]: what is wrong with the body.
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

/// The one frame that says this message.
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
        w.u8(mode_code(self.mode))?;
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
        let mode = read_mode(r.u8()?)?;
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

const fn mode_code(mode: Mode) -> u8 {
    match mode {
        Mode::Submit => 1,
        Mode::Obtain => 2,
    }
}

const fn read_mode(code: u8) -> Result<Mode, ContentError> {
    match code {
        1 => Ok(Mode::Submit),
        2 => Ok(Mode::Obtain),
        received => Err(ContentError::Code { received }),
    }
}
