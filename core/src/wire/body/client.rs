//! What a client says.

use super::super::cursor::{Reader, Short, Writer};
use super::super::frame::{Frame, FrameBytes, Kind, enclose};
use super::{
    ContentError, axes_byte, check_axes, check_length, check_reserved, length, read_offsets,
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
    let received = frame.kind_code();
    let mut r = Reader::new(frame.body());
    match Kind::from_code(received) {
        Some(Kind::Hello) => {
            check_length(frame, length::HELLO)?;
            let axes = r.u8()?;
            check_reserved(u16::from(r.u8()?))?;
            let capabilities = Capabilities(r.u16()?);
            Ok(ClientMessage::Hello(Hello { axes, capabilities }))
        }
        Some(Kind::Command) => read_command(frame).map(ClientMessage::Command),
        Some(Kind::Goodbye) => {
            check_length(frame, length::EPOCH)?;
            Ok(ClientMessage::Goodbye(Epoch(r.u64()?)))
        }
        Some(Kind::Stop) => {
            check_length(frame, length::EPOCH)?;
            Ok(ClientMessage::Stop(Epoch(r.u64()?)))
        }
        _ => Err(ContentError::Kind { received }),
    }
}

/// The one frame that says this message.
#[must_use]
pub fn encode_client<const N: usize>(message: &ClientMessage<N>) -> FrameBytes {
    match message {
        ClientMessage::Hello(hello) => enclose(Kind::Hello, length::HELLO, |body| {
            let mut w = Writer::new(body);
            w.u8(hello.axes)?;
            w.u8(0)?;
            w.u16(hello.capabilities.0)
        }),
        ClientMessage::Command(command) => enclose(Kind::Command, length::command(N), |body| {
            write_command(&mut Writer::new(body), command)
        }),
        ClientMessage::Goodbye(epoch) => enclose(Kind::Goodbye, length::EPOCH, |body| {
            Writer::new(body).u64(epoch.0)
        }),
        ClientMessage::Stop(epoch) => enclose(Kind::Stop, length::EPOCH, |body| {
            Writer::new(body).u64(epoch.0)
        }),
    }
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
