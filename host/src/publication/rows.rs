//! Rows of the server as samples.

use gantry_tau_core::control::axis::Reference;
use gantry_tau_core::control::message::{self, AxisState, Counters};
use gantry_tau_labcomm::samples::{Axes, Axis, Data, ForceSensor, SessionEvent, State, Tool};
use gantry_tau_labcomm::{Encoder, ErrorKind, Field, Text, Version};

use super::SampleName;
use crate::plant::ToolReading;
use crate::server::cycle::Row;
use crate::server::event_log::{Event, EventKind};

/// Names of a port, with their indices: in order, from the first index of the version.
pub(super) fn indexed(version: Version, names: &[SampleName]) -> impl Iterator<Item = (u32, SampleName)> {
    (version.first_index()..).zip(names.iter().copied())
}

/// Writes version and definitions for a machine with `N` axes.
pub(super) fn define<const N: usize>(
    encoder: &mut Encoder<'_>,
    names: impl Iterator<Item = (u32, SampleName)>,
) -> Result<(), ErrorKind> {
    encoder.version()?;
    for (index, name) in names {
        match name {
            SampleName::Data => encoder.define::<Data>(index),
            SampleName::ForceSensor => encoder.define::<ForceSensor>(index),
            SampleName::State => encoder.define::<State>(index),
            SampleName::Axes => encoder.define::<Axes<N>>(index),
            SampleName::Tool => encoder.define::<Tool>(index),
            SampleName::SessionEvent => encoder.define::<SessionEvent>(index),
        }?;
    }
    Ok(())
}

/// Writes gauges and force sensor, as far as a port carries them.
pub(super) fn write_sensors(
    encoder: &mut Encoder<'_>,
    names: impl Iterator<Item = (u32, SampleName)>,
    tool: &ToolReading,
    gauge_resolution_m: f64,
) -> Result<(), ErrorKind> {
    for (index, name) in names {
        match name {
            SampleName::Data => encoder.data(index, &data(tool, gauge_resolution_m))?,
            SampleName::ForceSensor => encoder.data(index, &force_sensor(tool))?,
            _ => {}
        }
    }
    Ok(())
}

/// Writes one of each sample of a port; sensors and tool if the machine has instruments there, and an event for each that happened.
pub(super) fn write_row<const N: usize>(
    encoder: &mut Encoder<'_>,
    names: impl Iterator<Item = (u32, SampleName)>,
    row: &Row<N>,
    events: &[Event],
    gauge_resolution_m: f64,
) -> Result<(), ErrorKind> {
    for (index, name) in names {
        match (name, &row.tool) {
            (SampleName::State, _) => encoder.data(index, &state(&row.state))?,
            (SampleName::Axes, _) => encoder.data(index, &axes(row))?,
            (SampleName::SessionEvent, _) => write_events(encoder, std::iter::once((index, name)), events)?,
            (SampleName::Data, Some(tool)) => encoder.data(index, &data(tool, gauge_resolution_m))?,
            (SampleName::ForceSensor, Some(tool)) => encoder.data(index, &force_sensor(tool))?,
            (SampleName::Tool, Some(reading)) => encoder.data(index, &tool(row.state.tick.0, reading))?,
            (SampleName::Data | SampleName::ForceSensor | SampleName::Tool, None) => {}
        }
    }
    Ok(())
}

/// Writes these events, if a port carries them.
pub(super) fn write_events<'a>(
    encoder: &mut Encoder<'_>,
    mut names: impl Iterator<Item = (u32, SampleName)>,
    events: impl IntoIterator<Item = &'a Event>,
) -> Result<(), ErrorKind> {
    let Some((index, _)) = names.find(|(_, name)| *name == SampleName::SessionEvent) else { return Ok(()) };
    events.into_iter().try_for_each(|event| encoder.data(index, &session_event(event)))
}

/// `as` would turn NaN into 0 and keep the limits as well, silently.
#[expect(
    clippy::as_conversions,
    clippy::cast_possible_truncation,
    reason = "a length in counts, rounded; it saturates"
)]
fn data(tool: &ToolReading, resolution_m: f64) -> Data {
    Data(tool.gauges_m.map(|length_m| (length_m / resolution_m).round() as i32))
}

#[expect(clippy::as_conversions, clippy::cast_possible_truncation, reason = "the nearest float")]
fn force_sensor(tool: &ToolReading) -> ForceSensor {
    ForceSensor(tool.sensor.map(|component| component as f32))
}

fn state<const N: usize>(state: &message::State<N>) -> State {
    let Counters {
        received,
        missed,
        late,
        duplicate,
        stale,
        malformed,
        out_of_range,
        limited,
        clamped,
        non_owner,
        longest_miss_run,
    } = state.counters;
    let counters = [received, missed, late, duplicate, stale, malformed, out_of_range, limited, clamped, non_owner];
    State {
        tick: long(state.tick.0),
        epoch: long(state.epoch.0),
        sequence: long(state.accepted.0),
        phase: state.phase.code(),
        cause: state.cause.code(),
        on_time: state.on_time_of_100,
        ramp_ticks_left: int(state.ramp_ticks_left),
        counters: counters.map(int),
        longest_miss_run: i16::try_from(longest_miss_run).unwrap_or(i16::MAX),
    }
}

fn axes<const N: usize>(row: &Row<N>) -> Axes<N> {
    let mut axes = row.state.axes.iter().zip(&row.references);
    let mut next = || axes.next().map_or(Axis::ZERO, |(state, reference)| axis(state, reference));
    Axes { tick: long(row.state.tick.0), axis: std::array::from_fn(|_| next()) }
}

fn axis(state: &AxisState, reference: &Reference) -> Axis {
    Axis {
        nominal_nm: state.nominal.0,
        reference_nm: reference.position.0,
        position_offset_nm: state.offsets.position.0,
        velocity_offset_um_s: state.offsets.velocity.0,
        torque_offset_permille: state.offsets.torque.0,
        shadow_nm: state.shadow.position.0,
        actual_nm: state.actual.position.0,
        actual_velocity_um_s: state.actual.velocity.0,
        actual_torque_permille: state.actual.torque.0,
        flags: state.flags.bits(),
    }
}

fn tool(tick: u64, tool: &ToolReading) -> Tool {
    Tool {
        tick: long(tick),
        step: int(tool.step),
        load: tool.load,
        displacement_m: tool.displacement_m,
        turn_rad: tool.turn_rad,
        gauges_m: tool.gauges_m,
    }
}

fn session_event(event: &Event) -> SessionEvent {
    let kind = match event.kind {
        EventKind::Granted => 0,
        EventKind::Refused => 1,
        EventKind::Ended => 2,
        EventKind::Phase => 3,
        EventKind::MachineFailed => 4,
    };
    SessionEvent { tick: long(event.tick), kind, cause: event.code, text: Text::cut(&event.text) }
}

/// A number of the wire as LabComm's signed `long`; it saturates.
fn long(number: u64) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}

/// A number of the wire as LabComm's signed `int`; it saturates.
fn int(number: u32) -> i32 {
    i32::try_from(number).unwrap_or(i32::MAX)
}
