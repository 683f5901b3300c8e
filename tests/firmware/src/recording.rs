//! Playing a recording: what arrived and what happened in every tick comes from a file, what became of it goes to another.
//! The same file is compiled into the test, which writes recordings and plays them on the host.
//!
//! All numbers are little-endian. A recording begins with the nominal positions at the start, 6 `i64`, and the number of its ticks
//! `u32`. Then each tick:
//! - how many things happened before it `u16`; each: what `u8` (0 a stream opened, 1 datagrams opened, 2 closed, 3 bytes), connection
//!   `u32`, number of bytes `u16` (at most [`OF_OWNER`]), bytes;
//!   no more of it than [`super::reading`] lets in;
//! - elapsed `u32`, stop `u8`, rearm `u8`, next epoch `u64`, arrival `u16`;
//! - motion `u8` (0 given, 1 L2, 2 F1); if given: nominal positions `i64`, then per axis position `i64`, velocity `i32`, torque `i16`;
//! - pose and load, 12 `f64`.
//!
//! Of every tick is written: the answer of the floats, as bits: `u8` 0 and the error's kind, or 1 (L2) or 2 (F1) and its fields in
//! their order; then each frame sent (`u8` 1, connection `u32`, number of bytes `u16`, bytes); then `u8` 2, each motor's position `i64`,
//! velocity `i32` and torque `i16`, how many connections are to be closed `u8` and each `u32`.

use gantry_tau_core::control::axis::Actual;
use gantry_tau_core::control::endpoint::{Transport, Turn};
use gantry_tau_core::control::session::fsm::Connection;
use gantry_tau_core::model::compensation::Correction;
use gantry_tau_core::model::kinematics::KinematicsError;
use gantry_tau_core::units::{Epoch, PositionNm, TorquePermille, VelocityUmS};

use super::machine::{AXES, Answer, MOTORS, Machine, Meter, Moment, Motion, Part};
use super::reading::{OF_OWNER, Reading};

/// Where a recording comes from.
pub(crate) trait Source {
    /// Fills `bytes`; whether there were that many.
    fn read(&mut self, bytes: &mut [u8]) -> bool;
}

/// Where the output goes.
pub(crate) trait Sink {
    /// Takes all of `bytes`.
    fn write(&mut self, bytes: &[u8]);
}

/// Who looks on, tick by tick.
pub(crate) trait Watch: Meter {
    /// Before the tick's input is read: the time of the tick.
    fn wait(&mut self);
    /// After the floats.
    fn answered(&mut self, _: &Answer<'_>) {}
    /// After the tick.
    fn turned(&mut self, turn: &Turn<AXES, MOTORS>);
}

/// Room for what arrives.
pub(crate) type Room = [u8; OF_OWNER];

/// The nominal positions that a recording begins with.
pub(crate) fn start(source: &mut impl Source) -> Option<[PositionNm; AXES]> {
    let mut nominal = [PositionNm(0); AXES];
    for position in &mut nominal {
        *position = PositionNm(i64::from_le_bytes(take(source)?));
    }
    Some(nominal)
}

/// Plays all that follows [`start`]; `None` when the recording ends too early or is none, or has more in a tick than is let in.
pub(crate) fn play(
    machine: &mut Machine,
    room: &mut Room,
    source: &mut impl Source,
    sink: &mut impl Sink,
    watch: &mut impl Watch,
) -> Option<()> {
    for _ in 0..u32::from_le_bytes(take(source)?) {
        watch.wait();
        let mut reading = Reading::default();
        for _ in 0..u16::from_le_bytes(take(source)?) {
            happen(machine, room, &mut reading, source, watch)?;
        }
        let moment = moment(source)?;
        tick(machine, &moment, sink, watch);
    }
    Some(())
}

/// One tick, and what became of it.
pub(crate) fn tick(
    machine: &mut Machine,
    moment: &Moment,
    sink: &mut impl Sink,
    watch: &mut impl Watch,
) {
    compute(machine, moment, sink, watch);
    serve(machine, moment, sink, watch);
}

/// Its first half. Neither half is inlined: together they need as much stack as the larger of them.
#[inline(never)]
fn compute(machine: &mut Machine, moment: &Moment, sink: &mut impl Sink, watch: &mut impl Watch) {
    let answer = machine.compute(moment, watch);
    answered(sink, &answer);
    watch.answered(&answer);
}

/// Its second half.
#[inline(never)]
fn serve(machine: &mut Machine, moment: &Moment, sink: &mut impl Sink, watch: &mut impl Watch) {
    let turn = machine.serve(moment, watch, &mut |to, bytes| sent(sink, to, bytes));
    turned(sink, &turn);
    watch.turned(&turn);
}

/// One of the things that happened before a tick.
fn happen(
    machine: &mut Machine,
    room: &mut Room,
    reading: &mut Reading,
    source: &mut impl Source,
    watch: &mut impl Watch,
) -> Option<()> {
    let [what] = take(source)?;
    let connection = Connection(u64::from(u32::from_le_bytes(take(source)?)));
    let bytes = room.get_mut(..usize::from(u16::from_le_bytes(take(source)?)))?;
    if !source.read(bytes) {
        return None;
    }
    let server = machine.server();
    let owner = server.session().owner();
    let is_let_in = match what {
        0 | 1 => reading.accept(),
        _ => bytes.len() <= reading.left(connection, owner),
    };
    reading.note(connection, owner, bytes.len());
    if !is_let_in {
        return None;
    }
    watch.begin();
    match what {
        0 => _ = server.open(Transport::Stream),
        1 => _ = server.open(Transport::Datagram),
        2 => server.close(connection),
        3 => _ = server.feed(connection, bytes),
        _ => return None,
    }
    watch.end(Part::Feed);
    Some(())
}

/// Not inlined, so that its parts have left the stack when the tick begins.
#[inline(never)]
fn moment(source: &mut impl Source) -> Option<Moment> {
    let elapsed = u32::from_le_bytes(take(source)?);
    let [stop, rearm] = take(source)?;
    let next_epoch = Epoch(u64::from_le_bytes(take(source)?));
    let arrival_us = u16::from_le_bytes(take(source)?);
    let motion = match take(source)? {
        [0] => given(source)?,
        [1] => Motion::L2,
        [2] => Motion::F1,
        _ => return None,
    };
    Some(Moment {
        elapsed,
        stop: stop != 0,
        rearm: rearm != 0,
        next_epoch,
        arrival_us,
        motion,
        pose: six(source)?,
        load: six(source)?,
    })
}

fn given(source: &mut impl Source) -> Option<Motion> {
    let nominal = start(source)?;
    let mut actual = [Actual::default(); AXES];
    for actual in &mut actual {
        *actual = Actual {
            position: PositionNm(i64::from_le_bytes(take(source)?)),
            velocity: VelocityUmS(i32::from_le_bytes(take(source)?)),
            torque: TorquePermille(i16::from_le_bytes(take(source)?)),
        };
    }
    Some(Motion::Given { nominal, actual })
}

fn six(source: &mut impl Source) -> Option<[f64; 6]> {
    let mut numbers = [0.0; 6];
    for number in &mut numbers {
        *number = f64::from_le_bytes(take(source)?);
    }
    Some(numbers)
}

fn take<const K: usize>(source: &mut impl Source) -> Option<[u8; K]> {
    let mut bytes = [0; K];
    source.read(&mut bytes).then_some(bytes)
}

fn sent(sink: &mut impl Sink, to: Connection, bytes: &[u8]) {
    sink.write(&[1]);
    number(sink, to);
    let length = u16::try_from(bytes.len()).unwrap_or(u16::MAX);
    sink.write(&length.to_le_bytes());
    sink.write(bytes);
}

/// A connection; a recording opens fewer than there are numbers.
fn number(sink: &mut impl Sink, connection: Connection) {
    let number = u32::try_from(connection.0).unwrap_or(u32::MAX);
    sink.write(&number.to_le_bytes());
}

fn turned(sink: &mut impl Sink, turn: &Turn<AXES, MOTORS>) {
    sink.write(&[2]);
    for motor in &turn.motors {
        sink.write(&motor.position.0.to_le_bytes());
        sink.write(&motor.velocity_offset.0.to_le_bytes());
        sink.write(&motor.torque_offset.0.to_le_bytes());
    }
    let closed = u8::try_from(turn.close.len()).unwrap_or(u8::MAX);
    sink.write(&[closed]);
    for connection in &turn.close {
        number(sink, *connection);
    }
}

fn answered(sink: &mut impl Sink, answer: &Answer<'_>) {
    match answer {
        Answer::L2(Ok(answer)) => {
            sink.write(&[1]);
            floats(sink, &answer.q);
            corrected(sink, &answer.correction);
        }
        Answer::F1(Ok(answer)) => {
            sink.write(&[2, answer.q.iterations, answer.pose.iterations]);
            let pose = &answer.pose.value;
            floats(sink, &answer.q.value);
            floats(sink, &[answer.q.residual_m, answer.pose.residual_m]);
            floats(sink, pose.position_m.iter());
            floats(sink, pose.rotation.iter());
            floats(sink, answer.jacobian.iter());
            floats(sink, &answer.forces_n);
            floats(sink, &answer.loads);
            corrected(sink, &answer.correction);
        }
        Answer::L2(Err(error)) | Answer::F1(Err(error)) => failed(sink, error),
    }
}

fn failed(sink: &mut impl Sink, error: &KinematicsError) {
    sink.write(&[0]);
    sink.write(error.kind().as_bytes());
}

fn floats<'a>(sink: &mut impl Sink, numbers: impl IntoIterator<Item = &'a f64>) {
    for number in numbers {
        sink.write(&number.to_bits().to_le_bytes());
    }
}

fn corrected<const N: usize>(sink: &mut impl Sink, correction: &Correction<N>) {
    for (offset, saturated) in correction.offsets.iter().zip(correction.saturated) {
        sink.write(&offset.0.to_le_bytes());
        sink.write(&[u8::from(saturated)]);
    }
}
