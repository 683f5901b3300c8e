//! What a client says.

use super::super::cursor::{Reader, Short, Writer};
use super::super::frame::{Frame, FrameBytes, Kind, enclose};
use super::{
    Body, ContentError, axes_byte, check_axes, check_length, check_reserved, length, read_offsets,
    write_offsets,
};
use crate::axis::Offsets;
use crate::message::{Capabilities, ClientMessage, Command, Hello, Mode};
use crate::units::{Epoch, Sequence, Tick};

/// What a client said.
///
/// # Errors
/// [`ContentError`]: what is wrong with the body.
pub fn decode_client<const N: usize>(frame: &Frame<'_>) -> Result<ClientMessage<N>, ContentError> {
    ClientMessage::read(frame)
}

/// The one frame that says this message.
#[must_use]
pub fn encode_client<const N: usize>(message: &ClientMessage<N>) -> FrameBytes {
    let (kind, length) = message.shape();
    enclose(kind, length, |body| message.write(body))
}

impl<const N: usize> Body for ClientMessage<N> {
    fn shape(&self) -> (Kind, usize) {
        match self {
            Self::Hello(_) => (Kind::Hello, length::HELLO),
            Self::Command(_) => (Kind::Command, length::command(N)),
            Self::Goodbye(_) => (Kind::Goodbye, length::EPOCH),
            Self::Stop(_) => (Kind::Stop, length::EPOCH),
        }
    }

    #[inline]
    fn write(&self, body: &mut [u8]) -> Result<(), Short> {
        let mut w = Writer::new(body);
        match self {
            Self::Hello(hello) => write_hello(&mut w, hello),
            Self::Command(command) => write_command(&mut w, command),
            Self::Goodbye(epoch) | Self::Stop(epoch) => w.u64(epoch.0),
        }
    }

    #[inline]
    fn read(frame: &Frame<'_>) -> Result<Self, ContentError> {
        let received = frame.kind_code();
        match Kind::from_code(received) {
            Some(Kind::Hello) => read_hello(frame).map(Self::Hello),
            Some(Kind::Command) => read_command(frame).map(Self::Command),
            Some(Kind::Goodbye) => read_epoch(frame).map(Self::Goodbye),
            Some(Kind::Stop) => read_epoch(frame).map(Self::Stop),
            _ => Err(ContentError::Kind { received }),
        }
    }
}

fn read_hello(frame: &Frame<'_>) -> Result<Hello, ContentError> {
    check_length(frame, length::HELLO)?;
    let mut r = Reader::new(frame.body());
    let axes = r.u8()?;
    check_reserved(u16::from(r.u8()?))?;
    let capabilities = Capabilities(r.u16()?);
    Ok(Hello { axes, capabilities })
}

fn write_hello(w: &mut Writer<'_>, hello: &Hello) -> Result<(), Short> {
    w.u8(hello.axes)?;
    w.u8(0)?;
    w.u16(hello.capabilities.0)
}

fn read_epoch(frame: &Frame<'_>) -> Result<Epoch, ContentError> {
    check_length(frame, length::EPOCH)?;
    Ok(Epoch(Reader::new(frame.body()).u64()?))
}

fn read_command<const N: usize>(frame: &Frame<'_>) -> Result<Command<N>, ContentError> {
    check_length(frame, length::command(N))?;
    let mut r = Reader::new(frame.body());
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
    Ok(Command {
        epoch,
        sequence,
        echo,
        mode,
        targets,
    })
}

fn write_command<const N: usize>(w: &mut Writer<'_>, command: &Command<N>) -> Result<(), Short> {
    w.u64(command.epoch.0)?;
    w.u64(command.sequence.0)?;
    w.u64(command.echo.0)?;
    w.u8(mode_code(command.mode))?;
    w.u8(axes_byte::<N>())?;
    w.u16(0)?;
    command
        .targets
        .iter()
        .try_for_each(|target| write_offsets(w, target))
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
