//! Rows of the server as samples.

use gantry_tau_core::control::message::{self, AxisState};
use gantry_tau_labcomm::samples::{Axes, Axis, Data, ForceSensor, SessionEvent, State, Tool};
use gantry_tau_labcomm::{Encoder, ErrorKind, Field, Text, Version};

use super::{DriveStates, MachineIdentity, SampleName};
use crate::plant::{DriveState, ToolReading};
use crate::record::{COUNTERS, Event, TickRecord};

/// Names of a port, with their indices: in order, from the first index of the version.
pub(super) fn indexed(
    version: Version,
    names: &[SampleName],
) -> impl Iterator<Item = (u32, SampleName)> {
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
            SampleName::Drives => encoder.define::<DriveStates<N>>(index),
            SampleName::Machine => encoder.define::<MachineIdentity>(index),
        }?;
    }
    Ok(())
}

/// Writes the machine, if a port carries it.
pub(super) fn write_machine(
    encoder: &mut Encoder<'_>,
    mut names: impl Iterator<Item = (u32, SampleName)>,
    machine: &MachineIdentity,
) -> Result<(), ErrorKind> {
    let Some((index, _)) = names.find(|(_, name)| *name == SampleName::Machine) else {
        return Ok(());
    };
    encoder.data(index, machine)
}

/// Instruments at the tool.
#[derive(Clone, Copy, Debug)]
pub struct Sensors<'a> {
    /// Their readings.
    pub tool: &'a ToolReading,
    /// Resolution of the gauges, m: what one count of `data` means.
    pub gauge_resolution_m: f64,
}

/// Writes counts of gauges, if a port carries them.
pub(super) fn write_data(
    encoder: &mut Encoder<'_>,
    mut names: impl Iterator<Item = (u32, SampleName)>,
    data: Data,
) -> Result<(), ErrorKind> {
    match names.find(|(_, name)| *name == SampleName::Data) {
        Some((index, _)) => encoder.data(index, &data),
        None => Ok(()),
    }
}

/// Writes gauges and force sensor, as far as a port carries them.
pub(super) fn write_sensors(
    encoder: &mut Encoder<'_>,
    mut names: impl Iterator<Item = (u32, SampleName)>,
    sensors: Sensors<'_>,
) -> Result<(), ErrorKind> {
    names.try_for_each(|(index, name)| write_sensor(encoder, index, name, sensors))
}

/// Writes one of them. Counts have no place for gauges that a machine has not got.
fn write_sensor(
    encoder: &mut Encoder<'_>,
    index: u32,
    name: SampleName,
    sensors: Sensors<'_>,
) -> Result<(), ErrorKind> {
    match name {
        SampleName::Data => data(sensors).map_or(Ok(()), |data| encoder.data(index, &data)),
        SampleName::ForceSensor => encoder.data(index, &force_sensor(sensors.tool)),
        _ => Ok(()),
    }
}

/// Samples of one tick of a machine with `N` axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Samples<const N: usize> {
    /// Phase, cause, counters.
    pub state: State,
    /// The axes.
    pub axes: Axes<N>,
    /// The tool, if there are instruments at it.
    pub tool: Option<Tool>,
    /// The drives, if their states are known.
    pub drives: Option<DriveStates<N>>,
}

impl<const N: usize> Samples<N> {
    /// Samples of a State with these references, nm, and of the tool; the states of the drives are
    /// unknown.
    #[must_use]
    pub fn new(of: &message::State<N>, references_nm: &[i64; N], tool: Option<Tool>) -> Self {
        let mut axes = [Axis::ZERO; N];
        let states = of.axes.iter().zip(references_nm);
        for (place, (state, reference)) in axes.iter_mut().zip(states) {
            *place = axis(state, *reference);
        }
        Self {
            state: state(of),
            axes: Axes {
                tick: long(of.tick.0),
                axis: axes,
            },
            tool,
            drives: None,
        }
    }
}

impl<const N: usize> From<&TickRecord<N>> for Samples<N> {
    fn from(row: &TickRecord<N>) -> Self {
        let references = row.references.map(|reference| reference.position.0);
        let tick = row.state.tick.0;
        let samples = Self::new(
            &row.state,
            &references,
            row.tool.as_ref().map(|reading| tool(tick, reading)),
        );
        let drives = row.drives.map(|drives| DriveStates {
            tick: long(tick),
            state: drives.map(DriveState::code),
        });
        Self { drives, ..samples }
    }
}

/// Writes one of each sample; sensors and tool if the machine has instruments there, drives if it
/// tells their states, and an event for each that happened.
pub(super) fn write_tick<const N: usize>(
    encoder: &mut Encoder<'_>,
    names: impl Iterator<Item = (u32, SampleName)>,
    samples: &Samples<N>,
    events: &[Event],
    sensors: Option<Sensors<'_>>,
) -> Result<(), ErrorKind> {
    for (index, name) in names {
        match (name, sensors) {
            (SampleName::State, _) => encoder.data(index, &samples.state)?,
            (SampleName::Axes, _) => encoder.data(index, &samples.axes)?,
            (SampleName::Tool, _) => {
                if let Some(tool) = &samples.tool {
                    encoder.data(index, tool)?;
                }
            }
            (SampleName::Drives, _) => {
                if let Some(drives) = &samples.drives {
                    encoder.data(index, drives)?;
                }
            }
            (SampleName::SessionEvent, _) => {
                write_events(encoder, std::iter::once((index, name)), events)?
            }
            (SampleName::Data | SampleName::ForceSensor, Some(sensors)) => {
                write_sensor(encoder, index, name, sensors)?
            }
            (SampleName::Data | SampleName::ForceSensor, None) | (SampleName::Machine, _) => {}
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
    let Some((index, _)) = names.find(|(_, name)| *name == SampleName::SessionEvent) else {
        return Ok(());
    };
    events
        .into_iter()
        .try_for_each(|event| encoder.data(index, &session_event(event)))
}

/// Counts of the gauges; `None` of a machine without: `as` would turn what is not a number into 0.
#[expect(
    clippy::as_conversions,
    clippy::cast_possible_truncation,
    reason = "a length in counts, rounded; it saturates"
)]
fn data(
    Sensors {
        tool,
        gauge_resolution_m,
    }: Sensors<'_>,
) -> Option<Data> {
    let counts = tool
        .gauges_m
        .map(|length_m| (length_m / gauge_resolution_m).round());
    let is_known = counts.iter().all(|count| !count.is_nan());
    is_known.then(|| Data(counts.map(|count| count as i32)))
}

#[expect(
    clippy::as_conversions,
    clippy::cast_possible_truncation,
    reason = "the nearest float"
)]
fn force_sensor(tool: &ToolReading) -> ForceSensor {
    ForceSensor(tool.sensor.map(|component| component as f32))
}

fn state<const N: usize>(state: &message::State<N>) -> State {
    let [counters @ .., (_, longest_miss_run)] = COUNTERS;
    State {
        tick: long(state.tick.0),
        epoch: long(state.epoch.0),
        sequence: long(state.accepted.0),
        phase: state.phase.code(),
        cause: state.cause.code(),
        on_time: state.on_time_of_100,
        ramp_ticks_left: int(state.ramp_ticks_left),
        counters: counters.map(|(_, value)| int(value(&state.counters))),
        longest_miss_run: i16::try_from(longest_miss_run(&state.counters)).unwrap_or(i16::MAX),
    }
}

fn axis(state: &AxisState, reference_nm: i64) -> Axis {
    Axis {
        nominal_nm: state.nominal.0,
        reference_nm,
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
    let kind = event.kind.code();
    SessionEvent {
        tick: long(event.tick),
        kind,
        cause: event.code,
        text: Text::cut(&event.text),
    }
}

/// A number of the wire as LabComm's signed `long`; it saturates.
fn long(number: u64) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}

/// A number of the wire as LabComm's signed `int`; it saturates.
fn int(number: u32) -> i32 {
    i32::try_from(number).unwrap_or(i32::MAX)
}
