//! The server's own thread at 1 kHz with the simulated machine, clients over real sockets and
//! relays that do harm. What must stay flat is looked at between sessions: memory, and open files.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use gantry_tau::faults::relay::{LinkReport, Relay};
use gantry_tau_core::control::endpoint::{CONNECTIONS, Transport};
use gantry_tau_core::control::message::{Capabilities, Cause, Phase};
use gantry_tau_core::control::wire::encode_client;
use gantry_tau_core::units::EpochRange;
use gantry_tau_machine::model::{L2, L2_MOTORS};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::cycle::Cycle;
use gantry_tau_server::server::tick_source::TickSource;
use gantry_tau_server::server::{Controls, Server};
use gantry_tau_server::state::StopLatch;
use gantry_tau_sim::load_generator::load_generator;
use gantry_tau_sim::machine::SimulatedMachine;
use serde::Serialize;

use super::Summary;
use super::audit::{Audit, Seen};
use super::cause_attribution::Evidence;
use super::client::Client;
use super::links::{KINDS, is_slow, plan};
use crate::client::{Noise, hello};
use crate::server_fixture::LOOPBACK;
use crate::{DEADLINE, wait_for};

/// Axes of the machine.
const N: usize = 3;
/// Longest time from a fault of the link until the observer hears of the end.
const SLACK: Duration = Duration::from_millis(150);
/// Ticks in which a server hears everything that was sent to it before.
const TICKS_TO_HEAR: u64 = 20;
/// Growth of the resident memory that does not count as a leak, KiB: allocators and stacks of
/// threads wander by some hundred.
const MEMORY_SLACK_KIB: u64 = 2_048;

/// Resources that the process holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Footprint {
    /// Resident memory, KiB.
    pub memory_kib: u64,
    /// Open files, sockets among them.
    pub files: u64,
}

impl Footprint {
    /// Of this process; `None` where the system does not say it as Linux does.
    #[must_use]
    pub fn now() -> Option<Self> {
        let status = std::fs::read_to_string("/proc/self/status").ok()?;
        let line = status.lines().find(|line| line.starts_with("VmRSS:"))?;
        Some(Self {
            memory_kib: line.split_whitespace().nth(1)?.parse().ok()?,
            files: u64::try_from(std::fs::read_dir("/proc/self/fd").ok()?.count()).ok()?,
        })
    }
}

/// Results of a soak in real time.
#[derive(Clone, Debug, Serialize)]
pub struct Minutes {
    /// Results that both kinds of soak have.
    #[serde(flatten)]
    pub summary: Summary,
    /// Connections of the clients.
    pub connections: u64,
    /// Connections of those that never get a session: wrong Hellos, noise, silence.
    pub others: u64,
    /// Before there was a server.
    pub before: Option<Footprint>,
    /// Most memory, and fewest open files between two sessions, in the second tenth of the time.
    pub early: Option<Footprint>,
    /// The same in the last tenth.
    pub late: Option<Footprint>,
    /// After server, relays and clients have gone.
    pub after: Option<Footprint>,
}

/// Latest observation of the observer.
#[derive(Debug, Default)]
struct Watch {
    ticks: AtomicU64,
    listening: AtomicBool,
}

/// Something the observer has seen.
#[derive(Clone, Copy, Debug)]
struct End {
    cause: Cause,
    at: Instant,
    skipped: bool,
}

/// Soaks for so long. `progress` is given the time that has passed.
#[must_use]
pub fn run(duration: Duration, seed: u64, mut progress: impl FnMut(Duration)) -> Minutes {
    let before = Footprint::now();
    let mut noise = Noise::new(seed.max(1));
    let (server, rows, audit) = server();
    let watch = Arc::new(Watch::default());
    let (ends_to, ends) = channel();
    let observer = observe(rows, audit, &server.controls, &watch, ends_to);
    let relays: Vec<(bool, Relay, Receiver<LinkReport>)> = (0..2 * KINDS)
        .map(|index| {
            let plan = plan(index % KINDS, &mut noise, Transport::Stream);
            let slow = is_slow(&plan);
            let (relay, ended) =
                Relay::spawn(LOOPBACK, server.address, Transport::Stream, plan).unwrap();
            (slow, relay, ended)
        })
        .collect();
    let quit = Arc::new(AtomicBool::new(false));
    let others = others(server.address, &quit);
    let since = Instant::now();
    let mut soak = Soak {
        watch,
        ends,
        noise,
        connections: 0,
        summary: Summary::default(),
    };
    let mut marks = [None; 10];
    while since.elapsed() < duration {
        let (slow, relay, ended) = &relays[soak.noise.below(relays.len())];
        soak.session(relay.address, *slow, ended);
        mark(&mut marks, since.elapsed(), duration);
        progress(since.elapsed());
    }
    quit.store(true, Ordering::Relaxed);
    let others = others.join().unwrap();
    drop(relays);
    assert_eq!(server.quit().unwrap(), 0, "rows lost before the observer");
    let Summary {
        ends,
        faults,
        frames,
        machine_late,
        ..
    } = soak.summary;
    let minutes = Minutes {
        summary: Summary {
            ends,
            faults,
            frames,
            machine_late,
            ..observer.join().unwrap()
        },
        connections: soak.connections,
        others,
        before,
        early: marks[1],
        late: marks[9],
        after: Footprint::now(),
    };
    minutes.check();
    minutes
}

impl Minutes {
    /// Neither memory nor open files have grown; at the end every file is closed.
    fn check(&self) {
        if let (Some(early), Some(late)) = (self.early, self.late) {
            // Fewest within a minute: others that are waited for may be among them, never more than
            // there is room for.
            let most = early.files + u64::try_from(CONNECTIONS).unwrap();
            assert!(late.files <= most, "open files leak: {self:?}");
            let most = early.memory_kib + MEMORY_SLACK_KIB;
            // A sanitizer's shadow is memory too, and grows with every page that is touched for the
            // first time.
            let sanitized = std::env::var_os("GANTRY_TAU_SANITIZED").is_some();
            assert!(
                sanitized || late.memory_kib <= most,
                "memory leaks: {self:?}"
            );
        }
        let [before, after] =
            [self.before, self.after].map(|footprint| footprint.map(|footprint| footprint.files));
        assert!(after.is_some() == before.is_some(), "{self:?}");
        assert!(after <= before, "{self:?}");
    }
}

/// The tenth of the time that this is in.
fn mark(marks: &mut [Option<Footprint>; 10], elapsed: Duration, duration: Duration) {
    let Some(now) = Footprint::now() else { return };
    let tenth = (0..9).take_while(|tenth| duration * (tenth + 1) / 10 <= elapsed);
    let mark = &mut marks[tenth.count()];
    *mark = Some(mark.map_or(now, |old: Footprint| Footprint {
        memory_kib: old.memory_kib.max(now.memory_kib),
        files: old.files.min(now.files),
    }));
}

type Rows = rtrb::Consumer<TickRecord<N>>;

fn server() -> (Server<N>, Rows, Audit<N>) {
    let mut robot = RobotFile::<L2, N>::builtin_l2().unwrap();
    // The clients of the soak ask for random targets.
    for axis in &mut robot.limits {
        axis.agitation = None;
    }
    let mut waypoint = robot.home_q().unwrap();
    for (place, scale) in waypoint.iter_mut().zip(robot.metres_per_q) {
        *place = *place * scale + 0.01;
    }
    let motion = Motion::BackAndForth {
        waypoints_m: vec![waypoint],
        speed_m_per_s: 0.02,
        acceleration_m_per_s2: 0.5,
        dwell_cycles: 500,
    };
    let (_, tool) = load_generator();
    let machine = SimulatedMachine::<3, L2_MOTORS>::from_robot(&robot, tool, motion).unwrap();
    let config = robot.session_config(Capabilities::NONE).unwrap();
    let axes = config.parameters().axes;
    let audit = Audit::new(
        axes.map(|axis| axis.limits),
        axes.map(|axis| axis.machine_travel),
    );
    let motors = robot.motor_map().unwrap();
    let cycle: Cycle<N, L2_MOTORS, SimulatedMachine<N, L2_MOTORS>> = Cycle::new(
        config,
        motors,
        machine,
        EpochRange::VOLATILE,
        StopLatch::volatile(),
        LOOPBACK,
    )
    .unwrap();
    let (server, rows) = Server::spawn(cycle, TickSource::RealTime).unwrap();
    (server, rows, audit)
}

/// Audits every row, tells of every end, and re-arms after a stop.
fn observe(
    mut rows: Rows,
    mut audit: Audit<N>,
    controls: &Arc<Controls>,
    watch: &Arc<Watch>,
    ends: Sender<End>,
) -> JoinHandle<Summary> {
    let (controls, watch) = (Arc::clone(controls), Arc::clone(watch));
    std::thread::spawn(move || {
        let mut skipped = false;
        loop {
            let row: TickRecord<N> = match rows.pop() {
                Ok(row) => row,
                Err(_) if rows.is_abandoned() && rows.is_empty() => return audit.summary,
                Err(_) => {
                    std::thread::sleep(Duration::from_millis(1));
                    continue;
                }
            };
            let ended = audit.see(&Seen {
                state: &row.state,
                references: &row.references,
                welcomed: row.welcomed,
                ended: row.ended,
                elapsed: row.elapsed,
            });
            if let Some(cause) = ended {
                let skipped = skipped || row.elapsed > 1;
                let at = Instant::now();
                // At the server's own end the receiver has gone.
                let _ = ends.send(End { cause, at, skipped });
            }
            if row.state.phase == Phase::Fault {
                controls.release_and_rearm();
            }
            let listening = row.state.phase == Phase::Listening;
            watch.listening.store(listening, Ordering::Release);
            watch.ticks.fetch_add(1, Ordering::Release);
            audit.summary.refused += u64::from(row.refused);
            skipped = row.elapsed > 1;
        }
    })
}

struct Soak {
    watch: Arc<Watch>,
    ends: Receiver<End>,
    noise: Noise,
    connections: u64,
    summary: Summary,
}

impl Soak {
    /// One client from its Hello to the server's listening again; its end must have a reason.
    fn session(&mut self, address: SocketAddr, slow: bool, ended: &Receiver<LinkReport>) {
        let began = Instant::now();
        let mut client = Client::new(Transport::Stream, &mut self.noise);
        // A relay whose server has no room closes at once.
        let peer = live(address, &mut client, began, &mut self.noise);
        self.connections += 1;
        let link = ended
            .recv_timeout(DEADLINE)
            .expect("a link that does not end");
        assert_eq!(link.peer, peer);
        self.summary.link(&link.up);
        self.summary.link(&link.down);
        // The server may only now see its Hello, and its close.
        let heard = self.watch.ticks.load(Ordering::Acquire) + TICKS_TO_HEAR;
        wait_for("Listening", || {
            let listening = self.watch.listening.load(Ordering::Acquire);
            listening && self.watch.ticks.load(Ordering::Acquire) >= heard
        });
        for end in self.ends.try_iter() {
            let evidence = Evidence {
                at: (end.at - began).saturating_sub(SLACK),
                up: &link.up,
                down: &link.down,
                deed: client.deed_done,
                closed: client.gone,
                slow,
                skipped: end.skipped,
                stopped: false,
                jumped: false,
            };
            self.summary.end(end.cause);
            if evidence.explains(end.cause) {
                continue;
            }
            // Two cores shared with everything else: what is late without a fault is so by itself,
            // and counted.
            let late = [
                Cause::ClientLate,
                Cause::NetworkLate,
                Cause::ServerLate,
                Cause::Flood,
            ];
            assert!(
                late.contains(&end.cause),
                "{:?} without a reason: {evidence:?}",
                end.cause
            );
            self.summary.machine_late += 1;
        }
    }
}

/// Connects, says Hello, and lives until it has left or was left. Returns its own address.
fn live(
    address: SocketAddr,
    client: &mut Client<N>,
    began: Instant,
    noise: &mut Noise,
) -> SocketAddr {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_nodelay(true).unwrap();
    stream
        .set_read_timeout(Some(Duration::from_millis(5)))
        .unwrap();
    stream
        .set_write_timeout(Some(Duration::from_millis(200)))
        .unwrap();
    let own = stream.local_addr().unwrap();
    let mut buffer = [0; 4_096];
    let mut alive = stream.write_all(&client.hello()).is_ok();
    while alive && !client.gone {
        let heard = match stream.read(&mut buffer) {
            Ok(0) => break,
            Ok(count) => vec![buffer[..count].to_vec()],
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) =>
            {
                Vec::new()
            }
            Err(_) => break,
        };
        let said = client.live(began.elapsed(), &heard, noise);
        alive = said.iter().all(|bytes| stream.write_all(bytes).is_ok());
    }
    // A write that fails or takes too long is a reason to leave.
    client.gone |= !alive;
    own
}

/// Connections that never get a session: Hellos of another machine, noise, silence; some leave at
/// once.
fn others(address: SocketAddr, quit: &Arc<AtomicBool>) -> JoinHandle<u64> {
    let quit = Arc::clone(quit);
    std::thread::spawn(move || {
        let mut noise = Noise::new(77);
        let mut count = 0;
        while !quit.load(Ordering::Relaxed) {
            let Ok(mut stream) = TcpStream::connect_timeout(&address, DEADLINE) else {
                continue;
            };
            count += 1;
            // The server may have closed already.
            let _ = match noise.below(3) {
                0 => stream.write_all(&encode_client(&hello::<5>())),
                1 => stream.write_all(&noise.bytes(100)),
                _ => Ok(()),
            };
            std::thread::sleep(Duration::from_millis(
                u64::try_from(noise.below(60)).unwrap(),
            ));
        }
        count
    })
}
