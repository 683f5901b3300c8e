//! Readers of a port: what they have got is compared with the rows of the server.

use std::io::Read;
use std::net::{SocketAddr, TcpStream};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use gantry_tau_core::model::robot::ARMS;
use gantry_tau_labcomm::samples::{Axes, Data, ForceSensor, State, Tool};
use gantry_tau_labcomm::{Decoded, Decoder, Event};
use gantry_tau_server::record::TickRecord;
use gantry_tau_tests::wait_for;
use socket2::{Domain, Socket, Type};

/// Length of a count of the gauges, m.
pub(super) const RESOLUTION_M: f64 = 0.5e-6;

/// A reader that takes everything, in a thread that ends with the connection.
pub(super) struct Reader {
    pub(super) stream: TcpStream,
    bytes: Arc<Mutex<Vec<u8>>>,
}

impl Reader {
    pub(super) fn of(address: SocketAddr) -> Self {
        let stream = TcpStream::connect(address).unwrap();
        let bytes = Arc::new(Mutex::new(Vec::new()));
        let (mut reading, taken) = (stream.try_clone().unwrap(), Arc::clone(&bytes));
        std::thread::spawn(move || {
            let mut chunk = [0; 65_536];
            while let Ok(count @ 1..) = reading.read(&mut chunk) {
                taken.lock().unwrap().extend(&chunk[..count]);
            }
        });
        Self { stream, bytes }
    }

    /// Waits until the sample of every row is there, the first of which is `rows[0]`, and compares
    /// them.
    pub(super) fn assert_every_sample(&self, rows: &[TickRecord<ARMS>]) {
        let mut seen = Seen::default();
        wait_for("the last sample", || {
            seen = Seen::of(&self.bytes.lock().unwrap());
            seen.ticks() >= rows.len()
        });
        seen.assert_is(rows);
    }

    /// Compares what has come with the last rows; at least `least` of them.
    pub(super) fn assert_last_samples(&self, rows: &[TickRecord<ARMS>], least: usize) {
        let mut seen = Seen::default();
        let last = floats(rows.last().unwrap());
        wait_for("the last samples", || {
            seen = Seen::of(&self.bytes.lock().unwrap());
            seen.ticks() >= least && seen.force.last() == Some(&last)
        });
        seen.assert_is(&rows[rows.len() - seen.ticks()..]);
    }

    /// True if nothing has come.
    pub(super) fn has_nothing(&self) -> bool {
        self.bytes.lock().unwrap().is_empty()
    }
}

/// Samples of a stream, in order.
#[derive(Default)]
struct Seen {
    counts: Vec<[i32; 3]>,
    force: Vec<[f32; 6]>,
    states: Vec<State>,
    axes: Vec<Axes<ARMS>>,
    tools: Vec<Tool>,
}

impl Seen {
    fn of(bytes: &[u8]) -> Self {
        let (mut decoder, mut rest, mut seen) =
            (Decoder::<8, 4_096>::new(4_096), bytes, Self::default());
        while let Decoded::Event { event, used } = decoder.decode(rest).unwrap() {
            rest = &rest[used..];
            let Event::Data { definition, value } = event else {
                continue;
            };
            match definition.name {
                b"data" => seen.counts.push(value.read::<Data>().unwrap().0),
                b"forcesensor" => seen.force.push(value.read::<ForceSensor>().unwrap().0),
                b"state" => seen.states.push(value.read().unwrap()),
                b"axes" => seen.axes.push(value.read().unwrap()),
                b"tool" => seen.tools.push(value.read().unwrap()),
                other => assert_eq!(other, b"session_event"),
            }
        }
        seen
    }

    /// Whole ticks: every port of these tests carries the force, before all others.
    fn ticks(&self) -> usize {
        self.force.len()
    }

    /// Each sample of the stream is there once per row, with the row's numbers.
    fn assert_is(&self, rows: &[TickRecord<ARMS>]) {
        let tools = rows.iter().map(|row| row.tool.unwrap());
        let force: Vec<_> = rows.iter().map(floats).collect();
        assert!(
            self.force == force,
            "{} samples for {} rows",
            self.force.len(),
            force.len()
        );
        if !self.counts.is_empty() {
            assert!(
                self.counts
                    .iter()
                    .copied()
                    .eq(tools.clone().map(|tool| tool.gauges_m.map(counts)))
            );
        }
        if !self.states.is_empty() {
            assert_eq!(self.states.len(), rows.len());
            for ((state, axes), row) in self.states.iter().zip(&self.axes).zip(rows) {
                let tick = i64::try_from(row.state.tick.0).unwrap();
                assert_eq!(
                    (state.tick, axes.tick, state.phase),
                    (tick, tick, row.state.phase.code())
                );
                let references = row.references.map(|reference| reference.position.0);
                assert_eq!(axes.axis.map(|axis| axis.reference_nm), references);
            }
            assert!(
                self.tools
                    .iter()
                    .map(|tool| tool.load)
                    .eq(tools.map(|tool| tool.load))
            );
        }
    }
}

/// The raw force of a row, as a stream carries it.
#[expect(clippy::as_conversions, reason = "the nearest float")]
pub(super) fn floats(row: &TickRecord<ARMS>) -> [f32; 6] {
    row.tool.unwrap().sensor.map(|component| component as f32)
}

/// The nearest count of a gauge.
#[expect(clippy::as_conversions, reason = "some hundred counts")]
fn counts(gauge_m: f64) -> i32 {
    (gauge_m / RESOLUTION_M).round() as i32
}

/// A connection with the smallest receive buffer there is, from an address of this computer.
pub(super) fn narrow(from: [u8; 4], to: SocketAddr) -> TcpStream {
    let socket = Socket::new(Domain::IPV4, Type::STREAM, None).unwrap();
    socket.set_recv_buffer_size(1).unwrap();
    socket.bind(&SocketAddr::from((from, 0)).into()).unwrap();
    socket.connect(&to.into()).unwrap();
    socket.into()
}

/// Resets a connection.
pub(super) fn reset(stream: TcpStream) {
    Socket::from(stream)
        .set_linger(Some(Duration::ZERO))
        .unwrap();
}
