//! Between link and target: forwards every byte, hears every State before its client does, and is the force sensor.
//!
//! The sample of a tick leaves before the State of that tick, as in a real cell where one cycle does both; so what the client computes
//! depends on ticks only.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::thread::JoinHandle;
use std::time::Instant;

use gantry_tau::sensor_link::{Sample, SensorPublisher};
use gantry_tau_core::control::message::{Phase, ServerMessage};
use gantry_tau_core::control::wire::{Deframer, Feed, decode_server};

use super::{LOOK, PATIENCE, State};

/// What the sensor shows unloaded, N and N m, sensor axes; the client tares it.
const BIAS: [f64; 6] = [1.5, -0.8, -18.0, 0.05, -0.1, 0.02];
/// Ticks in Obtain before somebody pulls at the tool.
const PULL_AFTER: u32 = 100;

/// Everything that was heard.
#[derive(Default)]
struct Accepted {
    states: Mutex<Vec<State>>,
    more: Condvar,
    quit: AtomicBool,
    /// Both ends of every connection, to be shut at the end.
    open: Mutex<Vec<TcpStream>>,
    sensor: Mutex<Option<Sensor>>,
}

/// The sensor, and how long its tool has been ready to be pulled at.
struct Sensor {
    publisher: SensorPublisher,
    /// Force along x of the world, N: against y of the sensor.
    pull_n: f64,
    obtained: u32,
}

/// The tap; closes everything when dropped.
pub(super) struct Tap {
    /// Where the way to the target begins.
    pub(super) address: SocketAddr,
    /// Where force samples come from.
    pub(super) sensor: SocketAddr,
    heard: Arc<Accepted>,
    thread: Option<JoinHandle<()>>,
}

impl Tap {
    /// Stands before `target`; pulls with `pull_n` soon after Obtain.
    pub(super) fn before(target: SocketAddr, pull_n: f64) -> Self {
        let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let publisher = SensorPublisher::bind(any).unwrap();
        let sensor = publisher.address().unwrap();
        let listener = TcpListener::bind(any).unwrap();
        listener.set_nonblocking(true).unwrap();
        let address = listener.local_addr().unwrap();
        let heard = Arc::new(Accepted::default());
        *heard.sensor.lock().unwrap() = Some(Sensor {
            publisher,
            pull_n,
            obtained: 0,
        });
        let shared = Arc::clone(&heard);
        let thread = std::thread::spawn(move || accept(&listener, target, &shared));
        Self {
            address,
            sensor,
            heard,
            thread: Some(thread),
        }
    }

    /// Waits for a State like this one, and returns it.
    pub(super) fn await_state(&self, what: &str, is_it: impl Fn(&State) -> bool) -> State {
        let since = Instant::now();
        let mut states = self.heard.states.lock().unwrap();
        let mut looked = 0;
        loop {
            if let Some(found) = states[looked..].iter().find(|state| is_it(state)) {
                return *found;
            }
            looked = states.len();
            let left = PATIENCE.checked_sub(since.elapsed());
            let left = left.unwrap_or_else(|| panic!("no State of {what}: {:?}", states.last()));
            states = self.heard.more.wait_timeout(states, left).unwrap().0;
        }
    }

    /// Every State so far.
    pub(super) fn states(&self) -> Vec<State> {
        self.heard.states.lock().unwrap().clone()
    }
}

impl Drop for Tap {
    fn drop(&mut self) {
        self.heard.quit.store(true, Ordering::Relaxed);
        for stream in self.heard.open.lock().unwrap().iter() {
            let _ = stream.shutdown(Shutdown::Both);
        }
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn accept(listener: &TcpListener, target: SocketAddr, heard: &Arc<Accepted>) {
    while !heard.quit.load(Ordering::Relaxed) {
        let Ok((client, _)) = listener.accept() else {
            std::thread::sleep(LOOK);
            continue;
        };
        client.set_nonblocking(false).unwrap();
        let target = TcpStream::connect_timeout(&target, PATIENCE).unwrap();
        for stream in [&client, &target] {
            stream.set_nodelay(true).unwrap();
            heard.open.lock().unwrap().push(stream.try_clone().unwrap());
        }
        let (from, to) = (client.try_clone().unwrap(), target.try_clone().unwrap());
        std::thread::spawn(move || forward(from, to, |_| {}));
        let heard = Arc::clone(heard);
        let mut deframer = Deframer::new();
        std::thread::spawn(move || {
            forward(target, client, |bytes| heard.listen(&mut deframer, bytes));
        });
    }
}

/// One direction, until its sender has closed.
fn forward(mut from: TcpStream, mut to: TcpStream, mut first: impl FnMut(&[u8])) {
    let mut buffer = [0; 4_096];
    while let Ok(count @ 1..) = from.read(&mut buffer) {
        first(&buffer[..count]);
        if to.write_all(&buffer[..count]).is_err() {
            break;
        }
    }
    let _ = to.shutdown(Shutdown::Write);
}

impl Accepted {
    fn listen(&self, deframer: &mut Deframer, mut bytes: &[u8]) {
        loop {
            match deframer.feed(bytes) {
                Feed::Incomplete => return,
                Feed::Frame { frame, consumed } => {
                    if let ServerMessage::State(state) = decode_server(&frame).unwrap() {
                        self.measure(&state);
                        self.states.lock().unwrap().push(state);
                        self.more.notify_all();
                    }
                    bytes = &bytes[consumed..];
                }
                Feed::Broken(error) => panic!("the target sent no frame: {error}"),
            }
        }
    }

    /// The sensor's part of the tick.
    fn measure(&self, state: &State) {
        let mut sensor = self.sensor.lock().unwrap();
        let sensor = sensor.as_mut().unwrap();
        sensor.obtained = match state.phase {
            Phase::Obtain => sensor.obtained + 1,
            _ => 0,
        };
        let mut wrench = BIAS;
        if sensor.obtained > PULL_AFTER {
            wrench[1] -= sensor.pull_n;
        }
        sensor.publisher.publish(&Sample {
            tick: state.tick.0,
            wrench,
        });
    }
}
