//! A server in this process, ticks that are simulated milliseconds, clients over mangled links; the
//! same on every machine. Three axes or six, in the thesis profile or with a budget of misses.
//!
//! What the server is fed is counted beside it; its `received` must say the same.

use std::collections::VecDeque;
use std::time::Duration;

use gantry_tau::faults::Direction;
use gantry_tau::faults::injector::FaultInjector;
use gantry_tau::faults::plan::FaultPlan;
use gantry_tau_core::control::endpoint::{Endpoint, Transport};
use gantry_tau_core::control::message::{Cause, ClientMessage, Phase, State};
use gantry_tau_core::control::session::config::{Config, MissBudget, Parameters};
use gantry_tau_core::control::session::{Connection, OWNER_FRAMES, Session, Start, TickInput};
use gantry_tau_core::control::wire::{Deframer, Feed, Frame, decode_client};
use gantry_tau_core::units::{Epoch, EpochRange, PositionNm};

use super::Summary;
use super::audit::{Audit, Seen};
use super::cause_attribution::Evidence;
use super::client::Client;
use super::links::{KINDS, is_slow, plan};
use crate::client::Noise;
use crate::server_fixture::{NOMINAL_STEP_NM, on_time, parameters, taken};

const MS: Duration = Duration::from_millis(1);
/// Clients at once, one more than there is room for.
const CLIENTS: usize = 7;

/// Runs a server of `N` axes for so many ticks, with or without a budget of misses. `progress` is
/// given each of them.
#[must_use]
pub fn run<const N: usize>(
    budget: Option<MissBudget>,
    ticks: u64,
    seed: u64,
    mut progress: impl FnMut(u64),
) -> Summary {
    let mut world = World::<N>::new(budget, seed);
    for tick in 1..=ticks {
        world.tick(tick);
        progress(tick);
    }
    let World {
        mut audit, links, ..
    } = world;
    for link in &links {
        link.add_to(&mut audit.summary);
    }
    audit.summary
}

struct World<const N: usize> {
    noise: Noise,
    endpoint: Endpoint<N>,
    audit: Audit<N>,
    links: Vec<Link<N>>,
    opened: u64,
    nominal: [PositionNm; N],
    skipped_before: bool,
}

impl<const N: usize> World<N> {
    fn new(budget: Option<MissBudget>, seed: u64) -> Self {
        let parameters = Parameters {
            budget,
            ..parameters::<N>()
        };
        let nominal = [PositionNm(0); N];
        let config = Config::new(parameters).unwrap();
        let session = Session::new(config, &Start::at_rest(nominal)).unwrap();
        Self {
            noise: Noise::new(seed.max(1)),
            endpoint: Endpoint::new(session, EpochRange::VOLATILE),
            audit: Audit::new(
                parameters.axes.map(|axis| axis.limits),
                parameters.axes.map(|axis| axis.machine_travel),
            ),
            links: Vec::new(),
            opened: 0,
            nominal,
            skipped_before: false,
        }
    }

    fn tick(&mut self, tick: u64) {
        let now = MS * u32::try_from(tick).unwrap();
        self.arrive(now);
        self.deliver(now);
        self.step(now);
        assert!(self.endpoint.is_valid(), "tick {tick}");
        for link in &mut self.links {
            link.live(now + MS / 2, &mut self.noise);
        }
    }

    fn one_in(&mut self, n: usize) -> bool {
        self.noise.below(n) == 0
    }

    /// Lets clients arrive, more of them while there are few.
    fn arrive(&mut self, now: Duration) {
        let rare = if self.links.len() < 2 { 5 } else { 150 };
        if self.links.len() >= CLIENTS || !self.one_in(rare) {
            return;
        }
        let transport = [Transport::Stream, Transport::Datagram][self.noise.below(2)];
        // Without room the host says so and closes.
        let Ok(connection) = self.endpoint.open(transport) else {
            return self.audit.summary.refused += 1;
        };
        let kind = self.noise.below(KINDS);
        let plan = plan(kind, &mut self.noise, transport);
        let link = Link::open(
            connection,
            transport,
            &plan,
            self.opened,
            now,
            &mut self.noise,
        );
        self.links.push(link);
        self.opened += 1;
    }

    /// Delivers what is due to the server: bytes, closes, resets.
    fn deliver(&mut self, now: Duration) {
        for link in &mut self.links {
            let owns = self.endpoint.session().owner() == Some(link.connection);
            let age = now - link.opened;
            while let Some(bytes) = link.up.pop(age) {
                link.tap.feed(&bytes, link.transport, owns);
                self.endpoint.feed(link.connection, &bytes);
            }
            if link.reset() || link.has_closed() {
                self.endpoint.close(link.connection);
                link.over = true;
            }
        }
    }

    fn step(&mut self, now: Duration) {
        let faulted = self.endpoint.session().phase() == Phase::Fault;
        let owner = self.endpoint.session().owner();
        let stopped = self.one_in(20_000);
        let jumped = self.one_in(30_000);
        let elapsed = if self.one_in(3_000) {
            2 + self.noise.below(2)
        } else {
            1
        };
        self.move_nominal(jumped);
        let input = TickInput {
            elapsed_cycles: elapsed.try_into().unwrap(),
            stop: stopped,
            rearm: faulted && self.one_in(20),
            ..on_time(self.nominal)
        };
        let references = taken(self.endpoint.tick(&input));
        while let Some((to, bytes)) = self.endpoint.poll_transmit() {
            if let Some(link) = self.links.iter_mut().find(|link| link.connection == to) {
                link.down.push(now - link.opened, bytes);
            }
        }
        while let Some(closed) = self.endpoint.poll_close() {
            for link in &mut self.links {
                link.server_closed |= link.connection == closed;
            }
        }
        let output = self.endpoint.output().unwrap();
        let ended = self.audit.see(&Seen {
            state: &output.state,
            references: &references,
            welcomed: output.welcome.is_some(),
            ended: output.ended,
            elapsed: input.elapsed_cycles,
        });
        let skipped = elapsed > 1;
        for link in &mut self.links {
            if owner == Some(link.connection) {
                link.tap.check(&output.state, self.audit.beyond());
                if let Some(cause) = ended {
                    let evidence = Evidence {
                        at: now - link.opened,
                        up: link.up.stats(),
                        down: link.down.stats(),
                        deed: link.client.deed_done,
                        closed: link.client.gone,
                        slow: link.slow,
                        skipped: skipped || self.skipped_before,
                        stopped,
                        jumped,
                    };
                    assert!(
                        evidence.explains(cause),
                        "{cause:?} without a reason: {evidence:?}"
                    );
                    self.audit.summary.end(cause);
                }
            }
            if output.welcome == Some(link.connection) {
                link.tap.begin(output.state.epoch);
            }
            link.tap.next_tick();
        }
        self.skipped_before = skipped;
        self.audit.summary.refused += u64::try_from(output.refusals.len()).unwrap();
        self.bury();
    }

    /// Back and forth at up to half the limit; a jump is just beyond it.
    fn move_nominal(&mut self, jumped: bool) {
        let half = usize::try_from(NOMINAL_STEP_NM / 2).unwrap();
        for nominal in &mut self.nominal {
            let step = i64::try_from(self.noise.below(half)).unwrap();
            let back = nominal.0 > 0;
            nominal.0 += if back { -step } else { step };
            if jumped {
                nominal.0 += i64::from(4 * NOMINAL_STEP_NM);
            }
        }
    }

    /// Links that are of no use to either end.
    fn bury(&mut self) {
        let summary = &mut self.audit.summary;
        self.links.retain(|link| {
            let keep = !(link.over || link.server_closed && link.client.gone);
            if !keep {
                link.add_to(summary);
            }
            keep
        });
    }
}

/// One connection: a client, both directions, and the server's end.
struct Link<const N: usize> {
    connection: Connection,
    transport: Transport,
    opened: Duration,
    slow: bool,
    up: FaultInjector,
    down: FaultInjector,
    client: Client<N>,
    /// Frames that a stalled stream does not take yet.
    waiting: VecDeque<Vec<u8>>,
    tap: Tap<N>,
    server_closed: bool,
    over: bool,
}

impl<const N: usize> Link<N> {
    fn open(
        connection: Connection,
        transport: Transport,
        plan: &FaultPlan,
        number: u64,
        opened: Duration,
        noise: &mut Noise,
    ) -> Self {
        let mut client = Client::new(transport, noise);
        let hello = client.hello();
        Self {
            connection,
            transport,
            opened,
            slow: is_slow(plan),
            up: FaultInjector::new(plan, transport, number, Direction::Up),
            down: FaultInjector::new(plan, transport, number, Direction::Down),
            client,
            waiting: VecDeque::from([hello]),
            tap: Tap::default(),
            server_closed: false,
            over: false,
        }
    }

    fn reset(&self) -> bool {
        self.up.is_reset() || self.down.is_reset()
    }

    /// The server can see that the client has closed: a stream's last bytes have come.
    fn has_closed(&self) -> bool {
        let told = self.waiting.is_empty() && self.up.next_due().is_none() && !self.up.is_silent();
        self.transport == Transport::Stream && self.client.gone && told
    }

    /// The client's half of a tick.
    fn live(&mut self, now: Duration, noise: &mut Noise) {
        let age = now - self.opened;
        let heard: Vec<_> = std::iter::from_fn(|| self.down.pop(age)).collect();
        let closed = self.server_closed
            && self.transport == Transport::Stream
            && self.down.next_due().is_none()
            && !self.down.is_silent();
        if !self.client.gone {
            let said = self.client.live(age, &heard, noise);
            self.waiting.extend(said);
            self.client.gone |= closed;
        }
        while !self.up.is_deaf(age) {
            let Some(frame) = self.waiting.pop_front() else {
                break;
            };
            self.up.push(age, &frame);
        }
    }

    fn add_to(&self, summary: &mut Summary) {
        summary.link(self.up.stats());
        summary.link(self.down.stats());
    }
}

/// Counts what a server is fed on one connection, without its deframer's slot, session or
/// classifier.
#[derive(Default)]
struct Tap<const N: usize> {
    deframer: Deframer,
    epoch: Option<Epoch>,
    received: u32,
    farewells: u64,
    /// Frames since the last tick.
    frames: u8,
    finished: bool,
    /// A command came in this tick.
    commanded: bool,
}

impl<const N: usize> Tap<N> {
    /// The session of this connection begins.
    fn begin(&mut self, epoch: Epoch) {
        *self = Self {
            deframer: std::mem::take(&mut self.deframer),
            epoch: Some(epoch),
            ..Self::default()
        };
    }

    fn next_tick(&mut self) {
        self.frames = 0;
        self.commanded = false;
    }

    fn feed(&mut self, bytes: &[u8], transport: Transport, owns: bool) {
        if transport == Transport::Datagram {
            let frame = Frame::parse(bytes).ok();
            let message = frame.and_then(|frame| decode_client(&frame).ok());
            return self.count(message.as_ref(), owns);
        }
        let mut rest = bytes;
        while !rest.is_empty() && !self.finished {
            let (message, consumed) = match self.deframer.feed(rest) {
                Feed::Incomplete => return,
                Feed::Broken(_) => return self.finished = true,
                Feed::Frame { frame, consumed } => (decode_client(&frame).ok(), consumed),
            };
            rest = &rest[consumed..];
            self.count(message.as_ref(), owns);
        }
    }

    /// Eight frames count, and of those behind them one Stop.
    fn count(&mut self, message: Option<&ClientMessage<N>>, owns: bool) {
        if self.finished || !owns {
            return;
        }
        let stops = matches!(message, Some(ClientMessage::Stop(_)));
        if self.frames >= OWNER_FRAMES && !stops {
            return;
        }
        self.finished = self.frames >= OWNER_FRAMES;
        self.frames = (self.frames + 1).min(OWNER_FRAMES);
        self.received += 1;
        match message {
            Some(ClientMessage::Goodbye(epoch) | ClientMessage::Stop(epoch)) => {
                self.farewells += u64::from(self.epoch == Some(*epoch));
            }
            Some(ClientMessage::Command(_)) => self.commanded = true,
            _ => {}
        }
    }

    /// The server has counted as much, and what it has no other name for are farewells and at most
    /// one command.
    fn check(&self, state: &State<N>, beyond: u64) {
        if self.epoch != Some(state.epoch) {
            return;
        }
        assert_eq!(state.counters.received, self.received, "{state:?}");
        assert!(
            beyond == self.farewells || beyond == self.farewells + 1,
            "{beyond} beyond the counters, {} farewells: {state:?}",
            self.farewells
        );
    }
}

/// Every cause that clients, links and machine can bring about here; with a budget of misses there
/// is [`Cause::Budget`] as well.
pub const CAUSES: [Cause; 10] = [
    Cause::ClientLate,
    Cause::NetworkLate,
    Cause::ServerLate,
    Cause::Malformed,
    Cause::Closed,
    Cause::Goodbye,
    Cause::Stop,
    Cause::Nominal,
    Cause::Flood,
    Cause::HandshakeTimeout,
];
