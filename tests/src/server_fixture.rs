//! The server's cycle, stepped by hand, listening on a real loopback socket.
//!
//! Every step of every test asserts what `docs/design.md` 6 promises for any traffic: see
//! [`ServerFixture::step_with`] and `control::monitor`.

use std::io::ErrorKind;
use std::net::{Ipv4Addr, SocketAddr};

use gantry_tau_core::control::channel::{LimitValues, Limits};
use gantry_tau_core::control::endpoint::{MotorMap, Transport};
use gantry_tau_core::control::keys::Keyring;
use gantry_tau_core::control::message::{AxisLimits, Cause, Notice, Phase, Refusal};
use gantry_tau_core::control::session::config::{AxisConfig, Config, Parameters, Travel};
use gantry_tau_core::control::session::{Input, Reading};
use gantry_tau_core::units::{EpochRange, PositionNm};
use gantry_tau_core::verification::control::Internals;
use gantry_tau_core::{InForce, Monitor, Offsets, Reference, TickInput, Write};
use gantry_tau_server::black_box::swap_channel::{self, Receiver};
use gantry_tau_server::plant::Plant;
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::connections::{Listen, Listening};
use gantry_tau_server::server::cycle::{Cycle, OperatorInputs};
use gantry_tau_server::server::tick_source::TickSource;
use gantry_tau_server::server::{Server, ServerError};
use gantry_tau_server::state::StopLatch;

use crate::client::Client;
use crate::fake_plant::Bus;
use crate::wait_for;

/// `rho` of the position channels, nm per tick `[T 5.1.1]`.
pub const RAMP_NM: i32 = 100;
/// `S` of the position channels, nm per tick.
pub const STEP_NM: i32 = 5_000;
/// `M` of the position channels, nm.
pub const MAX_NM: i32 = 2_000_000;
/// Largest step of the nominal, nm per tick.
pub const NOMINAL_STEP_NM: u32 = 100_000;
/// Any free loopback port.
pub const LOOPBACK: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 0);

/// Limits from M, S, A and rho.
#[must_use]
pub fn limits<U>(max: i32, step: i32, accel: i32, ramp: i32) -> Limits<U> {
    let values = LimitValues {
        max,
        step,
        accel,
        ramp,
    };
    Limits::new(values).unwrap()
}

/// The thesis profile: no echo window, no budget, 0.1 µm per tick.
#[must_use]
pub fn parameters<const N: usize>() -> Parameters<N> {
    let limits = AxisLimits {
        position: limits(MAX_NM, STEP_NM, 10_000, RAMP_NM),
        velocity: limits(5_000, 200, 400, 50),
        torque: limits(50, 5, 10, 1),
    };
    let travel = Travel::around_zero(1_000_000_000);
    let axis = AxisConfig {
        limits,
        machine_travel: Travel::around_zero(1_010_000_000),
        ..AxisConfig::position_only(limits.position, travel, NOMINAL_STEP_NM)
    };
    Parameters {
        kinematics_checksum: 0x1234_5678,
        ..Parameters::thesis([axis; N])
    }
}

/// Input of a tick on time, in which nothing special happens.
#[must_use]
pub fn on_time<const N: usize>(nominal: [PositionNm; N]) -> TickInput<N> {
    TickInput {
        reading: Some(Reading::unmeasured(nominal)),
        ..Input::empty(EpochRange::VOLATILE).tick
    }
}

/// The references of a tick, which the drives take.
///
/// # Panics
/// Without references.
pub fn taken<const N: usize>(write: Write<'_, N>) -> [Reference; N] {
    let Write::Due(write) = write else {
        panic!("references are withheld")
    };
    let references = *write.references();
    write.accepted();
    references
}

/// A server of `N` axes with one motor each.
pub struct ServerFixture<const N: usize> {
    /// The machine.
    pub bus: Bus<N>,
    cycle: Cycle<N, N, Bus<N>>,
    monitor: Monitor<N>,
    /// The machine failed in the last tick.
    fails: bool,
}

impl<const N: usize> Default for ServerFixture<N> {
    fn default() -> Self {
        Self::start(parameters(), Bus::default(), EpochRange::VOLATILE).unwrap()
    }
}

impl<const N: usize> ServerFixture<N> {
    /// Starts a server on `bus` and a free port.
    ///
    /// # Errors
    /// As [`Cycle::new`].
    pub fn start(
        parameters: Parameters<N>,
        bus: Bus<N>,
        epochs: EpochRange,
    ) -> Result<Self, ServerError> {
        Self::listen(
            parameters,
            bus,
            epochs,
            StopLatch::volatile(),
            LOOPBACK.into(),
        )
    }

    /// Starts a server that keeps its stop latch.
    #[must_use]
    pub fn with_latch(bus: Bus<N>, latch: StopLatch) -> Self {
        Self::listen(
            parameters(),
            bus,
            EpochRange::VOLATILE,
            latch,
            LOOPBACK.into(),
        )
        .unwrap()
    }

    /// The same over UDP.
    #[must_use]
    pub fn over_datagrams() -> Self {
        let listen = Listen {
            transport: Transport::Datagram,
            ..LOOPBACK.into()
        };
        Self::listen(
            parameters(),
            Bus::default(),
            EpochRange::VOLATILE,
            StopLatch::volatile(),
            listen,
        )
        .unwrap()
    }

    /// Starts a server wherever it shall listen.
    ///
    /// # Errors
    /// As [`Cycle::new`].
    pub fn listen(
        parameters: Parameters<N>,
        bus: Bus<N>,
        epochs: EpochRange,
        latch: StopLatch,
        listen: Listen,
    ) -> Result<Self, ServerError> {
        Self::listening(parameters, bus, epochs, latch, Listening::bind(&listen)?)
    }

    /// Starts a server that answers holders of these keys only.
    #[must_use]
    pub fn keyed(transport: Transport, keyring: Keyring) -> Self {
        let listen = Listen {
            transport,
            ..LOOPBACK.into()
        };
        let listening = Listening::bind(&listen).unwrap().with_keys(Some(keyring));
        let (epochs, latch) = (EpochRange::VOLATILE, StopLatch::volatile());
        Self::listening(parameters(), Bus::default(), epochs, latch, listening).unwrap()
    }

    fn listening(
        parameters: Parameters<N>,
        bus: Bus<N>,
        epochs: EpochRange,
        latch: StopLatch,
        listening: Listening,
    ) -> Result<Self, ServerError> {
        let motors = MotorMap::new(std::array::from_fn(|motor| motor)).unwrap();
        let config = Config::new(parameters).unwrap();
        let cycle = Cycle::listening(config, motors, bus.clone(), epochs, latch, listening)?;
        let limits = parameters.axes.map(|axis| axis.limits);
        let travel = parameters.axes.map(|axis| axis.machine_travel);
        let mut fixture = Self {
            monitor: Monitor::new(limits, Some(travel)),
            fails: false,
            bus,
            cycle,
        };
        fixture.rebase();
        Ok(fixture)
    }

    /// From here on the server hands its black boxes over.
    #[must_use]
    pub fn handing_over(mut self) -> (Self, Receiver<N>) {
        let (sender, windows) = swap_channel::channel();
        self.cycle = self.cycle.with_black_box(sender);
        (self, windows)
    }

    /// Returns the address to which clients connect.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.cycle.address().unwrap()
    }

    /// The phase.
    #[must_use]
    pub fn phase(&self) -> Phase {
        self.cycle.phase()
    }

    /// Consecutive misses so far.
    #[must_use]
    pub fn misses(&self) -> u8 {
        self.cycle.endpoint().session().parts().discrete.misses
    }

    /// Sequence of the last accepted command.
    #[must_use]
    pub fn accepted(&self) -> u64 {
        self.cycle.endpoint().session().parts().discrete.accepted.0
    }

    /// Frames of non-owners counted in this session.
    #[must_use]
    pub fn non_owner(&self) -> u32 {
        self.cycle.endpoint().session().parts().counters.non_owner
    }

    /// Makes the monitor go on from the values in force at the drives.
    fn rebase(&mut self) {
        assert_eq!(
            self.monitor.rebase(&self.bus.record().parts_in_force()),
            Ok(())
        );
    }

    /// True if the server may end, once asked to.
    #[must_use]
    pub fn may_end(&self, quit: bool) -> bool {
        self.cycle.may_end(quit)
    }

    /// Runs the server in a thread of its own. Its rows are not looked at.
    #[must_use]
    pub fn spawn(self) -> Server<N> {
        self.try_spawn().unwrap()
    }

    /// The same.
    ///
    /// # Errors
    /// As [`Server::spawn`].
    pub fn try_spawn(self) -> Result<Server<N>, ServerError> {
        let (server, _rows) = Server::spawn(self.cycle, TickSource::Lockstep)?;
        Ok(server)
    }

    /// Takes in what has arrived; returns the owner's frames that the coming tick has.
    pub fn receive(&mut self) -> u8 {
        self.cycle.receive()
    }

    /// Waits until `count` bytes of the owner lie unread at the server's end.
    pub fn await_bytes(&mut self, count: usize) {
        await_bytes(&mut self.cycle, count);
    }

    /// Returns the number of the owner's bytes unread at the server's end, up to `most`.
    pub fn unread(&mut self, most: usize) -> usize {
        let mut buffer = vec![0; most];
        let stream = self.cycle.owner_stream().expect("the owner has no stream");
        stream.peek(&mut buffer).unwrap_or(0)
    }

    /// True if the server still has the owner's connection.
    #[must_use]
    pub fn has_owner(&mut self) -> bool {
        self.cycle.owner_stream().is_some()
    }

    /// Takes in what arrives until the owner's connection is known to be gone.
    pub fn await_loss_of_owner(&mut self) {
        wait_for("the loss of the owner's connection", || {
            self.receive();
            self.cycle.owner_stream().is_none()
        });
    }

    /// Takes in what arrives and steps, tick by tick, until a tick is as wanted.
    pub fn step_until(
        &mut self,
        what: &str,
        mut wanted: impl FnMut(&TickRecord<N>) -> bool,
    ) -> TickRecord<N> {
        let mut last = None;
        wait_for(what, || {
            self.receive();
            let row = self.step();
            let is_wanted = wanted(&row);
            last = Some(row);
            is_wanted
        });
        last.unwrap()
    }

    /// A newcomer sends bytes; the server goes on until it has answered, which must be with a
    /// refusal.
    pub fn refusal(&mut self, bytes: &[u8]) -> Refusal {
        self.answered(bytes).refusal()
    }

    /// As [`Self::refusal`], with a notice.
    pub fn notice(&mut self, bytes: &[u8]) -> Notice {
        self.answered(bytes).notice()
    }

    fn answered(&mut self, bytes: &[u8]) -> Client<N> {
        let mut newcomer = Client::<N>::connect(self.address());
        newcomer.send_bytes(bytes);
        self.step_until("an answer", |row| {
            assert!(!row.welcomed);
            !newcomer.is_quiet()
        });
        newcomer
    }

    /// One tick, on time.
    pub fn step(&mut self) -> TickRecord<N> {
        self.step_with(1, OperatorInputs::default())
    }

    /// One tick with the stop at the machine asserted.
    pub fn step_stopped(&mut self) -> TickRecord<N> {
        self.step_with(
            1,
            OperatorInputs {
                stop: true,
                ..OperatorInputs::default()
            },
        )
    }

    /// One tick of a server that was asked to end.
    pub fn step_quitting(&mut self) -> TickRecord<N> {
        self.step_with(
            1,
            OperatorInputs {
                quit: true,
                ..OperatorInputs::default()
            },
        )
    }

    /// One tick in which somebody at the machine re-arms.
    pub fn step_rearmed(&mut self) -> TickRecord<N> {
        self.step_with(
            1,
            OperatorInputs {
                rearm: true,
                ..OperatorInputs::default()
            },
        )
    }

    /// One tick. Asserts, by what the machine was written, that the State says what the drives got,
    /// and what `control::monitor` does.
    pub fn step_with(&mut self, elapsed: u32, operator: OperatorInputs) -> TickRecord<N> {
        let writes = self.bus.writes();
        let row = self.cycle.step(elapsed, operator);
        let told = row.state.axes.map(|axis| axis.offsets);
        let parts = row.state.axes.map(|axis| InForce {
            nominal: axis.nominal,
            offsets: axis.offsets,
        });
        assert_eq!(
            self.bus.record().parts_in_force(),
            parts,
            "the State is not what is in force"
        );
        if row.plant_failed && self.bus.writes() == writes {
            let is_withheld = self.fails;
            assert!(self.bus.record().write_fails || is_withheld, "not written");
            // The drives hold what they have in force, and the next references go on from there.
            self.rebase();
        } else {
            assert_eq!(self.bus.writes(), writes + 1, "one write per tick");
            assert_eq!(self.bus.last_written(), row.references);
            if row.welcomed {
                assert_eq!(told, [Offsets::ZERO; N], "granted during a ramp");
            }
            let checked = self.monitor.check_tick(&row.state, &row.references);
            assert_eq!(checked, Ok(()), "{:?}", row.state);
        }
        self.fails = row.plant_failed;
        row
    }

    /// Steps ticks without traffic: positions ramp from `from` to zero in `phase`, to the
    /// nanometre.
    pub fn assert_ramp(&mut self, from: [i32; N], phase: Phase) -> Vec<TickRecord<N>> {
        let ticks = from.map(|nm| nm.unsigned_abs().div_ceil(100));
        let ticks = ticks.into_iter().max().unwrap();
        (1..=ticks)
            .map(|tick| {
                self.receive();
                let row = self.step();
                assert_eq!(self.bus.positions(), from.map(|nm| ramped(nm, tick)));
                assert_eq!(row.state.phase, phase);
                assert_eq!(row.state.ramp_ticks_left, ticks - tick);
                row
            })
            .collect()
    }

    /// The coming ramp in SafeDisconnect, because of which `cause`; then the server listens again.
    pub fn assert_disconnect(&mut self, from: [i32; N], cause: Cause) {
        let rows = self.assert_ramp(from, Phase::SafeDisconnect);
        assert_eq!(rows[0].ended, Some(cause));
        assert!(
            rows.iter()
                .all(|row| row.state.cause == cause && !row.welcomed)
        );
        assert_eq!(self.step().state.phase, Phase::Listening);
    }
}

/// Waits until `count` bytes of the owner lie unread at the end of a server's cycle.
pub fn await_bytes<const N: usize, const M: usize, P: Plant<N, M>>(
    cycle: &mut Cycle<N, M, P>,
    count: usize,
) {
    let mut buffer = vec![0; count];
    wait_for("the owner's bytes", || {
        let stream = cycle.owner_stream().expect("the owner has no stream");
        match stream.peek(&mut buffer) {
            Ok(seen) => seen >= count,
            Err(error) => {
                assert_eq!(error.kind(), ErrorKind::WouldBlock, "{error}");
                false
            }
        }
    });
}

/// `offset` after `tick` steps of the ramp.
fn ramped(offset: i32, tick: u32) -> i32 {
    let way = i32::try_from(tick).unwrap() * RAMP_NM;
    offset.signum() * (offset.abs() - way).max(0)
}
