//! Playback of a recording: connections, bytes and cycle inputs come from a file, the outcome of every cycle goes to another.
//! The same file is compiled into the test, which writes recordings and plays them on the host.
//!
//! A recording is a sequence of [`Record`]s, each its length (`u16`, little-endian) and its `postcard` bytes. The first is a
//! [`Record::Cycle`] that does not run: it has the nominal positions at the start. The last is [`Record::End`]. The outcome is only
//! compared: raw numbers, little-endian, in the order of this file.

use gantry_tau_core::control::endpoint::{CONNECTIONS, Transport};
use gantry_tau_core::control::session::Connection;
use gantry_tau_core::heapless::Vec;
use gantry_tau_core::model::compensation::Correction;
use gantry_tau_core::units::PositionNm;
use serde::{Deserialize, Serialize};

use super::ingress_budget::IngressBudget;
use super::machine::{AXES, CycleInput, CycleResult, Machine, Meter, Motion, MotorReferences, Part};

/// Bytes of the longest record.
pub(crate) const MAX_RECORD: usize = 512;

/// One step of a recording.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[expect(clippy::large_enum_variant, reason = "one at a time, decoded in place; there is no heap to box the large one")]
pub(crate) enum Record<'a> {
    /// A stream is opened.
    OpenStream,
    /// A connection of datagrams is opened.
    OpenDatagram,
    /// A connection is closed.
    Close(Connection),
    /// Bytes of a stream arrive, or one datagram.
    Bytes(Connection, &'a [u8]),
    /// A cycle runs.
    Cycle(CycleInput),
    /// The recording is complete.
    End,
}

/// Bytes of a recording.
pub(crate) trait Source {
    /// Fills `bytes`. False if fewer are left.
    fn read(&mut self, bytes: &mut [u8]) -> bool;
}

/// Destination of the outcome.
pub(crate) trait Sink {
    /// Takes all of `bytes`.
    fn write(&mut self, bytes: &[u8]);
    /// Takes a sent frame.
    fn frame(&mut self, to: Connection, frame: &[u8]) {
        self.write(&to.0.to_le_bytes());
        self.write(frame);
    }
}

/// Observer of a playback.
pub(crate) trait Observer: Meter {
    /// Called before a cycle: returns when the cycle is due.
    fn wait(&mut self) {}
    /// Called after the float part.
    fn computed(&mut self, _: &CycleResult<'_>) {}
    /// Called after the tick, with the connections that it closes.
    fn ticked(&mut self, machine: &Machine, closed: &[Connection]);
}

/// Memory of a playback: a record, and the input of the cycle. Static, so that the stack is left to the cycle.
pub(crate) struct Room {
    bytes: [u8; MAX_RECORD],
    input: CycleInput,
}

impl Room {
    /// Empty memory.
    pub(crate) const EMPTY: Self = Self { bytes: [0; MAX_RECORD], input: CycleInput::on_time(Motion::Given, [0.0; 6]) };
}

/// Reads the first record: the nominal positions at the start.
pub(crate) fn start(room: &mut Room, source: &mut impl Source) -> Option<[PositionNm; AXES]> {
    match read(&mut room.bytes, source)? {
        Record::Cycle(input) => Some(input.tick.nominal),
        _ => None,
    }
}

/// Plays the records after [`start`]. `None` for an invalid recording, or if more arrives in a cycle than the budget allows.
pub(crate) fn play(
    machine: &mut Machine,
    room: &mut Room,
    source: &mut impl Source,
    sink: &mut impl Sink,
    observer: &mut impl Observer,
) -> Option<()> {
    let mut budget = IngressBudget::default();
    while arrive(machine, room, &mut budget, source, observer)? {
        observer.wait();
        cycle(machine, &room.input, sink, observer);
        budget = IngressBudget::default();
    }
    Some(())
}

/// Lets everything arrive until the next cycle, whose input is put into the room. Returns false at the end of the recording.
/// Not inlined, so that its stack is free again when the cycle begins.
#[inline(never)]
fn arrive(
    machine: &mut Machine,
    room: &mut Room,
    budget: &mut IngressBudget,
    source: &mut impl Source,
    observer: &mut impl Observer,
) -> Option<bool> {
    let server = machine.server();
    loop {
        let record = read(&mut room.bytes, source)?;
        let owner = server.session().owner();
        let is_allowed = match record {
            Record::OpenStream | Record::OpenDatagram => budget.accept(),
            Record::Bytes(from, bytes) => {
                let left = budget.left(from, owner);
                budget.count(from, owner, bytes.len());
                bytes.len() <= left
            }
            Record::Close(_) => true,
            Record::Cycle(input) => {
                room.input = input;
                return Some(true);
            }
            Record::End => return Some(false),
        };
        if !is_allowed {
            return None;
        }
        observer.begin();
        match record {
            Record::OpenStream => _ = server.open(Transport::Stream),
            Record::OpenDatagram => _ = server.open(Transport::Datagram),
            Record::Close(connection) => server.close(connection),
            Record::Bytes(from, bytes) => _ = server.feed(from, bytes),
            _ => {}
        }
        observer.end(Part::Feed);
    }
}

/// Runs one cycle, and writes its outcome.
pub(crate) fn cycle(machine: &mut Machine, input: &CycleInput, sink: &mut impl Sink, observer: &mut impl Observer) {
    compute(machine, input, sink, observer);
    serve(machine, sink, observer);
}

/// Float half. Neither half is inlined, so that their stack use does not add up.
#[inline(never)]
fn compute(machine: &mut Machine, input: &CycleInput, sink: &mut impl Sink, observer: &mut impl Observer) {
    let result = machine.compute(input, observer);
    write_result(sink, &result);
    observer.computed(&result);
}

/// Integer half.
#[inline(never)]
fn serve(machine: &mut Machine, sink: &mut impl Sink, observer: &mut impl Observer) {
    let references = machine.serve(observer, &mut |to, frame| sink.frame(to, frame));
    write_references(sink, &references);
    let mut closed = Vec::<Connection, CONNECTIONS>::new();
    while let Some(connection) = machine.server().poll_close() {
        sink.write(&connection.0.to_le_bytes());
        // There is room for all that can be open.
        closed.push(connection).unwrap_or(());
    }
    observer.ticked(machine, &closed);
}

/// Reads a record.
fn read<'a>(room: &'a mut [u8; MAX_RECORD], source: &mut impl Source) -> Option<Record<'a>> {
    let mut length = [0; 2];
    if !source.read(&mut length) {
        return None;
    }
    let bytes = room.get_mut(..u16::from_le_bytes(length).into())?;
    if !source.read(bytes) {
        return None;
    }
    postcard::from_bytes(bytes).ok()
}

fn write_references(sink: &mut impl Sink, references: &MotorReferences) {
    sink.write(&[u8::from(references.is_some())]);
    for motor in references.iter().flatten() {
        sink.write(&motor.position.0.to_le_bytes());
        sink.write(&motor.velocity_offset.0.to_le_bytes());
        sink.write(&motor.torque_offset.0.to_le_bytes());
    }
}

fn write_result(sink: &mut impl Sink, result: &CycleResult<'_>) {
    match result {
        CycleResult::L2(Ok(result)) => {
            write_floats(sink, &result.q);
            write_correction(sink, &result.correction);
        }
        CycleResult::F1(Ok(result)) => {
            let pose = &result.pose.value;
            sink.write(&[result.q.iterations, result.pose.iterations]);
            write_floats(sink, &result.q.value);
            write_floats(sink, &[result.q.residual_m, result.pose.residual_m]);
            write_floats(sink, pose.position_m.iter());
            write_floats(sink, pose.rotation.iter());
            write_floats(sink, result.jacobian.iter());
            write_floats(sink, &result.forces_n);
            write_floats(sink, &result.loads);
            write_correction(sink, &result.correction);
        }
        CycleResult::L2(Err(error)) | CycleResult::F1(Err(error)) => {
            sink.write(error.kind().as_bytes());
        }
    }
}

fn write_floats<'a>(sink: &mut impl Sink, numbers: impl IntoIterator<Item = &'a f64>) {
    for number in numbers {
        sink.write(&number.to_bits().to_le_bytes());
    }
}

fn write_correction<const N: usize>(sink: &mut impl Sink, correction: &Correction<N>) {
    for (offset, saturated) in correction.offsets.iter().zip(correction.saturated) {
        sink.write(&offset.0.to_le_bytes());
        sink.write(&[u8::from(saturated)]);
    }
}
