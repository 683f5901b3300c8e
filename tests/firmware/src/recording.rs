//! Playback of a recording: connections, bytes and cycle inputs come from a file, the outcome of
//! every cycle goes to another. The same file is compiled into the test, which writes recordings
//! and plays them on the host.
//!
//! A recording is a sequence of [`Record`]s, each its length (`u16`, little-endian), its kind (one
//! byte) and its content: the number of a connection (`u64`) and bytes, or the words of a cycle
//! ([`transfer`]). The first is a [`Record::Cycle`] that does not run: it has the nominal positions
//! at the start. The last is [`Record::End`]. The outcome is only compared: raw numbers,
//! little-endian, in the order of this file.
//!
//! Read by hand, not by `serde` and `postcard` as other files are: their decoders took 1.8 KB of an
//! image whose goal is 64 KiB.

use gantry_tau_core::control::axis::InForce;
use gantry_tau_core::control::endpoint::{CONNECTIONS, Transport};
use gantry_tau_core::control::session::{Connection, LastWrite, Output, Reading};
use gantry_tau_core::heapless::Vec;
use gantry_tau_core::model::compensation::Correction;
use gantry_tau_core::units::PositionNm;

use super::ingress_budget::IngressBudget;
use super::machine::{
    AXES, CycleInput, CycleResult, Machine, Meter, Motion, MotorReferences, Part,
};

/// Bytes of the longest record: the kind and the words of a cycle.
pub(crate) const MAX_RECORD: usize = 1 + 8 * 67;

/// One step of a recording.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Record<'a> {
    /// A connection is opened.
    Open(Transport),
    /// A connection is closed.
    Close(Connection),
    /// Bytes of a stream arrive, or one datagram.
    Bytes(Connection, &'a [u8]),
    /// A cycle runs.
    Cycle(&'a CycleInput),
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
    /// Called after the tick, with its output, and the connections that it closes.
    fn ticked(&mut self, output: Option<&Output<AXES>>, closed: &[Connection]);
}

/// Memory of a playback: a record, and the input of the cycle. Static, so that the stack is left to
/// the cycle.
pub(crate) struct Room {
    bytes: [u8; MAX_RECORD],
    input: CycleInput,
}

impl Room {
    /// Empty memory.
    pub(crate) const EMPTY: Self = Self {
        bytes: [0; MAX_RECORD],
        input: CycleInput::on_time(Motion::Given, [0.0; 6]),
    };
}

/// Reads the first record: the nominal positions at the start.
pub(crate) fn start(room: &mut Room, source: &mut impl Source) -> Option<[PositionNm; AXES]> {
    match read(room, source)? {
        Record::Cycle(input) => Some(input.tick.reading?.nominal),
        _ => None,
    }
}

/// Plays the records after [`start`]. `None` for an invalid recording, or if more arrives in a
/// cycle than the budget allows.
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

/// Lets everything arrive until the next cycle, whose input is put into the room. Returns false at
/// the end of the recording. Not inlined, so that its stack is free again when the cycle begins.
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
        let record = read(room, source)?;
        let owner = server.session().owner();
        let is_allowed = match record {
            Record::Open(_) => budget.accept(),
            Record::Bytes(from, bytes) => {
                let left = budget.left(from, owner);
                budget.count(from, owner, bytes.len());
                bytes.len() <= left
            }
            Record::Close(_) => true,
            // It is in the room.
            Record::Cycle(_) => return Some(true),
            Record::End => return Some(false),
        };
        if !is_allowed {
            return None;
        }
        observer.begin();
        match record {
            Record::Open(transport) => _ = server.open(transport),
            Record::Close(connection) => server.close(connection),
            Record::Bytes(from, bytes) => _ = server.feed(from, bytes),
            _ => {}
        }
        observer.end(Part::Feed);
    }
}

/// Runs one cycle, and writes its outcome.
pub(crate) fn cycle(
    machine: &mut Machine,
    input: &CycleInput,
    sink: &mut impl Sink,
    observer: &mut impl Observer,
) {
    compute(machine, input, sink, observer);
    serve(machine, input, sink, observer);
}

/// Float half. Neither half is inlined, so that their stack use does not add up.
#[inline(never)]
fn compute(
    machine: &mut Machine,
    input: &CycleInput,
    sink: &mut impl Sink,
    observer: &mut impl Observer,
) {
    let result = machine.compute(input, observer);
    write_result(sink, &result);
    observer.computed(&result);
}

/// Integer half.
#[inline(never)]
fn serve(
    machine: &mut Machine,
    input: &CycleInput,
    sink: &mut impl Sink,
    observer: &mut impl Observer,
) {
    let references = machine.serve(input, observer, &mut |to, frame| sink.frame(to, frame));
    write_references(sink, &references);
    let mut closed = Vec::<Connection, CONNECTIONS>::new();
    while let Some(connection) = machine.server().poll_close() {
        sink.write(&connection.0.to_le_bytes());
        // There is room for all that can be open.
        closed.push(connection).unwrap_or(());
    }
    observer.ticked(machine.output(), &closed);
}

/// Reads a record; the input of a cycle into the room.
#[inline(never)]
fn read<'a>(room: &'a mut Room, source: &mut impl Source) -> Option<Record<'a>> {
    let mut length = [0; 2];
    if !source.read(&mut length) {
        return None;
    }
    let bytes = room.bytes.get_mut(..u16::from_le_bytes(length).into())?;
    if !source.read(bytes) {
        return None;
    }
    let (kind, mut bytes) = bytes.split_first()?;
    Some(match kind {
        0 => Record::Open(Transport::Stream),
        1 => Record::Open(Transport::Datagram),
        2 => Record::Close(Connection(u64::from_le_bytes(consume(&mut bytes)?))),
        3 => Record::Bytes(Connection(u64::from_le_bytes(consume(&mut bytes)?)), bytes),
        4 => {
            transfer(&mut room.input, &mut |_| consume(&mut bytes))?;
            Record::Cycle(&room.input)
        }
        5 => Record::End,
        _ => return None,
    })
}

/// Consumes eight bytes.
fn consume(bytes: &mut &[u8]) -> Option<[u8; 8]> {
    let (first, rest) = bytes.split_first_chunk()?;
    *bytes = rest;
    Some(*first)
}

/// Passage of the eight bytes of a number: to a recording, which returns them, or from one, which
/// returns others.
type Word<'a> = &'a mut dyn FnMut([u8; 8]) -> Option<[u8; 8]>;

/// Passes the numbers of a cycle, one by one, to or from a recording. `None` if one does not fit
/// its place.
pub(crate) fn transfer(input: &mut CycleInput, word: Word<'_>) -> Option<()> {
    let CycleInput {
        tick,
        fate,
        arrival_us,
        motion,
        pose,
        load,
    } = input;
    whole(&mut tick.elapsed_cycles, word)?;
    whole(arrival_us, word)?;
    truth(&mut tick.stop, word)?;
    truth(&mut tick.rearm, word)?;
    let mut kind = match motion {
        Motion::Given => 0_u8,
        Motion::L2 => 1,
        Motion::F1 => 2,
    };
    whole(&mut kind, word)?;
    *motion = match kind {
        0 => Motion::Given,
        1 => Motion::L2,
        2 => Motion::F1,
        _ => return None,
    };
    let mut is_read = tick.reading.is_some();
    let mut reading = (tick.reading).unwrap_or(Reading::unmeasured([PositionNm(0); AXES]));
    truth(&mut is_read, word)?;
    for nominal in &mut reading.nominal {
        whole(&mut nominal.0, word)?;
    }
    for actual in &mut reading.actual {
        whole(&mut actual.position.0, word)?;
        whole(&mut actual.velocity.0, word)?;
        whole(&mut actual.torque.0, word)?;
    }
    tick.reading = is_read.then_some(reading);
    let mut in_force = [InForce::at(PositionNm(0)); AXES];
    let mut kind = match fate {
        LastWrite::Accepted => 0_u8,
        LastWrite::Unknown => 1,
        LastWrite::Refused { in_force: found } => {
            in_force = *found;
            2
        }
    };
    whole(&mut kind, word)?;
    for one in &mut in_force {
        whole(&mut one.nominal.0, word)?;
        whole(&mut one.offsets.position.0, word)?;
        whole(&mut one.offsets.velocity.0, word)?;
        whole(&mut one.offsets.torque.0, word)?;
    }
    *fate = match kind {
        0 => LastWrite::Accepted,
        1 => LastWrite::Unknown,
        2 => LastWrite::Refused { in_force },
        _ => return None,
    };
    for number in pose.iter_mut().chain(load) {
        *number = f64::from_le_bytes(word(number.to_le_bytes())?);
    }
    Some(())
}

/// Passes a flag.
fn truth(flag: &mut bool, word: Word<'_>) -> Option<()> {
    let mut number = u8::from(*flag);
    whole(&mut number, word)?;
    *flag = match number {
        0 => false,
        1 => true,
        _ => return None,
    };
    Some(())
}

/// Passes an integer.
fn whole<T: Copy + Into<i64> + TryFrom<i64>>(number: &mut T, word: Word<'_>) -> Option<()> {
    let passed = word(Into::<i64>::into(*number).to_le_bytes())?;
    *number = i64::from_le_bytes(passed).try_into().ok()?;
    Some(())
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
