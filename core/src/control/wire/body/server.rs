//! Bodies of the server's messages.

use super::super::cursor::{Reader, Short, Writer};
use super::super::frame::{Frame, FrameBytes, Kind, enclose};
use super::{
    Body, ContentError, OFFSETS, axes_byte, check_axes, check_reserved, read_offsets, reader,
    write_offsets,
};
use crate::control::axis::Actual;
use crate::control::channel::{LimitValues, Limits};
use crate::control::message::{
    AxisFlags, AxisLimits, AxisState, Capabilities, Cause, Counters, Phase, Refusal, ServerMessage,
    State, Welcome,
};
use crate::units::{Epoch, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS, WrenchSample};

/// Decodes a message of a server.
///
/// # Errors
/// [`ContentError`], for a body that the frame around it does not fit, or with invalid content.
pub fn decode_server<const N: usize>(frame: &Frame<'_>) -> Result<ServerMessage<N>, ContentError> {
    let (received, body) = (frame.kind_code(), frame.body());
    match Kind::from_code(received) {
        Some(Kind::Welcome) => Welcome::read(body).map(ServerMessage::Welcome),
        Some(Kind::State) => State::read(body).map(ServerMessage::State),
        Some(Kind::Refusal) => Refusal::read(body).map(ServerMessage::Refusal),
        _ => Err(ContentError::Kind { received }),
    }
}

/// Encodes a message of a server; every message has exactly one frame.
#[must_use]
pub fn encode_server<const N: usize>(message: &ServerMessage<N>) -> FrameBytes {
    match message {
        ServerMessage::Welcome(welcome) => enclose(Kind::Welcome, welcome),
        ServerMessage::State(state) => encode_state(state),
        ServerMessage::Refusal(refusal) => enclose(Kind::Refusal, refusal),
    }
}

/// Encodes a State without the detour over [`ServerMessage`]: it is the one message of every tick.
#[must_use]
pub fn encode_state<const N: usize>(state: &State<N>) -> FrameBytes {
    enclose(Kind::State, state)
}

/// Bytes of a channel's limits.
const LIMITS: usize = 4 * 4;

fn read_limits<U>(r: &mut Reader<'_>) -> Result<Limits<U>, ContentError> {
    let values = LimitValues {
        max: r.i32()?,
        step: r.i32()?,
        accel: r.i32()?,
        ramp: r.i32()?,
    };
    Limits::new(values).map_err(|_| ContentError::Limits)
}

fn write_limits<U>(w: &mut Writer<'_>, limits: &Limits<U>) -> Result<(), Short> {
    w.i32(limits.max())?;
    w.i32(limits.step())?;
    w.i32(limits.accel())?;
    w.u32(limits.ramp())
}

impl<const N: usize> Body for Welcome<N> {
    const LENGTH: usize = 28_usize.saturating_add(N.saturating_mul(3 * LIMITS));

    fn write(&self, body: &mut [u8]) -> Result<(), Short> {
        let mut w = Writer::new(body);
        w.u64(self.epoch.0)?;
        w.u64(self.tick.0)?;
        w.u32(self.cycle_us)?;
        w.u8(self.echo_window)?;
        w.u8(axes_byte::<N>())?;
        w.u16(self.capabilities.0)?;
        w.u32(self.kinematics_checksum)?;
        self.limits.iter().try_for_each(|axis| {
            write_limits(&mut w, &axis.position)?;
            write_limits(&mut w, &axis.velocity)?;
            write_limits(&mut w, &axis.torque)
        })
    }

    fn read(body: &[u8]) -> Result<Self, ContentError> {
        let mut r = reader::<Self>(body)?;
        let epoch = Epoch(r.u64()?);
        let tick = Tick(r.u64()?);
        let cycle_us = r.u32()?;
        let echo_window = r.u8()?;
        check_axes::<N>(r.u8()?)?;
        let capabilities = Capabilities(r.u16()?);
        let kinematics_checksum = r.u32()?;
        // Filled below; the loop replaces every element or returns.
        let mut limits = [AxisLimits::DISABLED; N];
        for axis in &mut limits {
            axis.position = read_limits(&mut r)?;
            axis.velocity = read_limits(&mut r)?;
            axis.torque = read_limits(&mut r)?;
        }
        Ok(Self {
            epoch,
            tick,
            cycle_us,
            echo_window,
            capabilities,
            kinematics_checksum,
            limits,
        })
    }
}

impl Body for Refusal {
    const LENGTH: usize = 8;

    fn write(&self, body: &mut [u8]) -> Result<(), Short> {
        let mut w = Writer::new(body);
        let (code, detail, bits, ticks_left) = refusal_fields(*self);
        w.u8(code)?;
        w.u8(detail)?;
        w.u16(bits)?;
        w.u32(ticks_left)
    }

    fn read(body: &[u8]) -> Result<Self, ContentError> {
        let mut r = reader::<Self>(body)?;
        let code = r.u8()?;
        let detail = r.u8()?;
        let bits = r.u16()?;
        let ticks_left = r.u32()?;
        let refusal = match code {
            1 => Self::Busy,
            2 => Self::Ramping { ticks_left },
            3 => Self::Faulted { ticks_left },
            5 => Self::Axes { expected: detail },
            6 => Self::Capability {
                needed: Capabilities(bits),
            },
            7 => Self::Unavailable,
            9 => Self::Role,
            received => return Err(ContentError::Code { received }),
        };
        // One encoding per message: what this reason does not use must be zero.
        if refusal_fields(refusal) == (code, detail, bits, ticks_left) {
            Ok(refusal)
        } else {
            Err(ContentError::Reserved)
        }
    }
}

/// Returns code, detail, bits and ticks of a refusal, in the order of the wire.
const fn refusal_fields(refusal: Refusal) -> (u8, u8, u16, u32) {
    let (detail, bits, ticks_left) = match refusal {
        Refusal::Busy | Refusal::Unavailable | Refusal::Role => (0, 0, 0),
        Refusal::Ramping { ticks_left } | Refusal::Faulted { ticks_left } => (0, 0, ticks_left),
        Refusal::Axes { expected } => (expected, 0, 0),
        Refusal::Capability { needed } => (0, needed.0, 0),
    };
    (refusal.code(), detail, bits, ticks_left)
}

/// Reads one byte as a code.
fn read_code<T>(
    r: &mut Reader<'_>,
    from_code: impl FnOnce(u8) -> Option<T>,
) -> Result<T, ContentError> {
    let received = r.u8()?;
    from_code(received).ok_or(ContentError::Code { received })
}

fn read_counters(r: &mut Reader<'_>) -> Result<Counters, Short> {
    Ok(Counters {
        received: r.u32()?,
        missed: r.u32()?,
        late: r.u32()?,
        duplicate: r.u32()?,
        stale: r.u32()?,
        malformed: r.u32()?,
        out_of_range: r.u32()?,
        limited: r.u32()?,
        clamped: r.u32()?,
        non_owner: r.u32()?,
        longest_miss_run: r.u16()?,
    })
}

#[inline]
fn write_counters(w: &mut Writer<'_>, counters: &Counters) -> Result<(), Short> {
    w.u32(counters.received)?;
    w.u32(counters.missed)?;
    w.u32(counters.late)?;
    w.u32(counters.duplicate)?;
    w.u32(counters.stale)?;
    w.u32(counters.malformed)?;
    w.u32(counters.out_of_range)?;
    w.u32(counters.limited)?;
    w.u32(counters.clamped)?;
    w.u32(counters.non_owner)?;
    w.u16(counters.longest_miss_run)
}

/// Byte of a sensor with a sample; without one it is zero.
const HAS_SAMPLE: u8 = 1;
/// Byte of a sensor with a sample of which a component was cut.
const HAS_CUT_SAMPLE: u8 = 3;

/// Reads 26 bytes; without a sample all of them are zero.
fn read_sensor(r: &mut Reader<'_>) -> Result<Option<WrenchSample>, ContentError> {
    let bits = r.u8()?;
    let age = r.u8()?;
    let mut counts = [0; 6];
    for count in &mut counts {
        *count = r.i32()?;
    }
    match bits {
        0 if age == 0 && counts == [0; 6] => Ok(None),
        HAS_SAMPLE | HAS_CUT_SAMPLE => Ok(Some(WrenchSample {
            is_cut: bits == HAS_CUT_SAMPLE,
            ..WrenchSample::of_counts(age, counts)
        })),
        _ => Err(ContentError::Reserved),
    }
}

fn write_sensor(w: &mut Writer<'_>, sensor: Option<&WrenchSample>) -> Result<(), Short> {
    const NONE: WrenchSample = WrenchSample::of_counts(0, [0; 6]);
    let (bits, sample) = match sensor {
        None => (0, &NONE),
        Some(sample) if sample.is_cut => (HAS_CUT_SAMPLE, sample),
        Some(sample) => (HAS_SAMPLE, sample),
    };
    w.u8(bits)?;
    w.u8(sample.age)?;
    let counts = sample.counts();
    counts.iter().try_for_each(|count| w.i32(*count))
}

/// Bytes of an axis.
const AXIS: usize = 8 + 2 * OFFSETS + 14 + 2;

fn read_axis(r: &mut Reader<'_>) -> Result<AxisState, ContentError> {
    let nominal = PositionNm(r.i64()?);
    let offsets = read_offsets(r)?;
    let shadow = read_offsets(r)?;
    let actual = Actual {
        position: PositionNm(r.i64()?),
        velocity: VelocityUmS(r.i32()?),
        torque: TorquePermille(r.i16()?),
    };
    let flags = AxisFlags::from_bits(r.u8()?).ok_or(ContentError::Reserved)?;
    check_reserved(u16::from(r.u8()?))?;
    Ok(AxisState {
        nominal,
        offsets,
        shadow,
        actual,
        flags,
    })
}

// Out of line, this and `write_counters` are a fourteenth of a tick of the server.
#[inline]
fn write_axis(w: &mut Writer<'_>, axis: &AxisState) -> Result<(), Short> {
    w.i64(axis.nominal.0)?;
    write_offsets(w, &axis.offsets)?;
    write_offsets(w, &axis.shadow)?;
    w.i64(axis.actual.position.0)?;
    w.i32(axis.actual.velocity.0)?;
    w.i16(axis.actual.torque.0)?;
    w.u8(axis.flags.bits())?;
    w.u8(0)
}

impl<const N: usize> Body for State<N> {
    const LENGTH: usize = 102_usize.saturating_add(N.saturating_mul(AXIS));

    fn write(&self, body: &mut [u8]) -> Result<(), Short> {
        let mut w = Writer::new(body);
        w.u64(self.tick.0)?;
        w.u64(self.epoch.0)?;
        w.u64(self.accepted.0)?;
        w.u8(self.phase.code())?;
        w.u8(self.cause.code())?;
        w.u8(axes_byte::<N>())?;
        w.u8(self.on_time_of_100)?;
        w.u32(self.ramp_ticks_left)?;
        w.u16(self.arrival_us)?;
        write_counters(&mut w, &self.counters)?;
        write_sensor(&mut w, self.sensor.as_ref())?;
        self.axes
            .iter()
            .try_for_each(|axis| write_axis(&mut w, axis))
    }

    fn read(body: &[u8]) -> Result<Self, ContentError> {
        let mut r = reader::<Self>(body)?;
        let tick = Tick(r.u64()?);
        let epoch = Epoch(r.u64()?);
        let accepted = Sequence(r.u64()?);
        let phase = read_code(&mut r, Phase::from_code)?;
        let cause = read_code(&mut r, Cause::from_code)?;
        check_axes::<N>(r.u8()?)?;
        let on_time_of_100 = r.u8()?;
        let ramp_ticks_left = r.u32()?;
        let arrival_us = r.u16()?;
        let counters = read_counters(&mut r)?;
        let sensor = read_sensor(&mut r)?;
        let mut axes = [AxisState::default(); N];
        for axis in &mut axes {
            *axis = read_axis(&mut r)?;
        }
        Ok(Self {
            tick,
            epoch,
            accepted,
            phase,
            cause,
            on_time_of_100,
            arrival_us,
            ramp_ticks_left,
            counters,
            sensor,
            axes,
        })
    }
}
