//! Reference model of the server, as small as possible: written from the rules in `docs/design.md`
//! and the page `wire.md`, not from core's code.
//!
//! Plain numbers that cannot overflow, a list of deadlines, one function per rule. Only the types
//! of input and output are core's, so that a whole [`Output`] can be compared.

use std::iter::repeat_n;

use gantry_tau_core::control::axis::{Actual, InForce, Offsets, Reference};
use gantry_tau_core::control::message::{
    AxisFlags, AxisLimits, AxisState, Cause, ClientMessage, Command, Counters, Hello, Mode, Phase,
    Refusal, State,
};
use gantry_tau_core::control::session::config::Parameters;
use gantry_tau_core::control::session::{
    Connection, Event, Input, LastWrite, Output, Refusals, Start, TickInput,
};
use gantry_tau_core::units::{
    Epoch, OffsetNm, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS, WrenchSample,
};

use crate::properties::axis;

/// Largest distance of a fresh command's sequence ahead.
const AHEAD: i128 = 65_536;

/// An unoptimised server.
#[derive(Clone, Debug)]
pub struct ReferenceModel<const N: usize> {
    parameters: Parameters<N>,
    phase: Phase,
    owner: Option<Connection>,
    epoch: u64,
    accepted: u64,
    tick: u64,
    /// Deadlines of the session, the latest last: true if missed.
    missed: Vec<bool>,
    /// Consecutive misses.
    run: u32,
    waited: u64,
    rearm_released: bool,
    /// A stop other than a quit has not been re-armed.
    latched: bool,
    /// The owner sent a late command since its last fresh one.
    late: bool,
    cause: Cause,
    counters: Counters,
    /// The values in force at the drives are unknown.
    withheld: bool,
    /// The path has not been met since a start, a refused write or a failed read.
    off_path: bool,
    /// Nominal references before the last ones, if the last tick was on time and on the path.
    path: Option<[i64; N]>,
    nominal: [i64; N],
    /// Last measurements.
    actual: [Actual; N],
    channels: [[Point; 3]; N],
    shadow: [[Point; 3]; N],
    /// Agitation of each axis, nm.
    agitation: [i64; N],
}

/// A channel: its value, and how it changed in the last tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Point {
    value: i64,
    change: i64,
}

/// Judgement of the nominal references of a tick.
struct PathFaults<const N: usize> {
    /// Axes whose nominal reference is further from the last one than its limit.
    stepped: [bool; N],
    /// Axes whose nominal reference accelerated more than its limit.
    accelerated: [bool; N],
    /// One of them stops the machine.
    is_fault: bool,
}

/// Decision of a tick: an action, and the cause if a session ended in it.
type Decision<const N: usize> = (ChannelAction<N>, Option<Cause>);

/// Accepted events of a tick.
#[derive(Default)]
struct Accepted<const N: usize> {
    stop: bool,
    /// Ends of the session by the owner, of [`ENDS`].
    ends: Vec<Cause>,
    command: Option<Command<N>>,
    hello: Option<Connection>,
    refusals: Refusals,
}

/// Causes that end a session, except stop and misses, in their precedence.
const ENDS: [Cause; 4] = [
    Cause::Malformed,
    Cause::Flood,
    Cause::Closed,
    Cause::Goodbye,
];

/// Action of every channel.
#[derive(Clone, Copy)]
enum ChannelAction<const N: usize> {
    Hold,
    Follow([Offsets; N]),
    Ramp,
}

impl<const N: usize> ReferenceModel<N> {
    /// Starts a server; `None` when an offset in force is beyond its limits.
    #[must_use]
    pub fn new(
        parameters: Parameters<N>,
        start: &Start<N>,
        tick: Tick,
        last_epoch: Epoch,
    ) -> Option<Self> {
        let mut model = Self {
            parameters,
            phase: Phase::Listening,
            owner: None,
            epoch: last_epoch.0,
            accepted: 0,
            tick: tick.0,
            missed: Vec::new(),
            run: 0,
            waited: 0,
            rearm_released: false,
            latched: start.stop_latched,
            late: false,
            cause: Cause::None,
            counters: Counters::default(),
            withheld: false,
            off_path: true,
            path: None,
            actual: [Actual::ZERO; N],
            nominal: start.in_force.map(|axis| axis.nominal.0),
            channels: [[Point::default(); 3]; N],
            shadow: [[Point::default(); 3]; N],
            agitation: [0; N],
        };
        let is_at_rest = start
            .in_force
            .iter()
            .all(|axis| axis.offsets == Offsets::ZERO);
        if !is_at_rest && !model.resume(&start.in_force) {
            return None;
        }
        if start.stop_latched {
            model.phase = Phase::Fault;
            model.cause = Cause::Stop;
        }
        Some(model)
    }

    /// The drives have these values in force instead. False, and no change, if they are beyond
    /// their limits.
    fn resume(&mut self, in_force: &[InForce; N]) -> bool {
        if !self.admits(&in_force.map(|axis| axis.offsets)) {
            return false;
        }
        self.channels = in_force
            .map(|axis| axis::counts(&axis.offsets).map(|value| Point { value, change: 0 }));
        self.nominal = in_force.map(|axis| axis.nominal.0);
        self.off_path = true;
        self.interrupt();
        true
    }

    /// A write failed: the session is over.
    fn interrupt(&mut self) {
        self.shadow = [[Point::default(); 3]; N];
        if self.phase != Phase::Fault {
            self.leave(Phase::SafeDisconnect);
            self.cause = Cause::Restart;
        }
    }

    fn settle(&mut self, last_write: &LastWrite<N>) {
        match last_write {
            LastWrite::Accepted => {}
            LastWrite::Refused { in_force } if self.resume(in_force) => self.withheld = false,
            LastWrite::Refused { .. } | LastWrite::Unknown => {
                self.interrupt();
                self.withheld = true;
            }
        }
    }

    /// Runs a tick that core has run, with the same output.
    ///
    /// # Panics
    /// On any difference.
    pub fn tick(&mut self, input: &Input<N>, output: &Output<N>) {
        let cycle = &input.tick;
        self.settle(&input.last_write);
        let cycles = u64::from(cycle.elapsed_cycles.max(1));
        let owner_before = self.owner;
        let mut accepted = self.classify(input);
        let zero = self.is_zero() && !self.withheld;
        let PathFaults {
            stepped,
            accelerated,
            is_fault: faulty,
        } = self.follow_path(cycle, cycles);
        self.tick = self.tick.saturating_add(cycles);
        let outage = cycle.reading.is_none() || input.last_write != LastWrite::Accepted;
        let stop = accepted.stop || cycle.stop || outage;
        let before = self.phase;
        let (action, ended) = if stop || faulty || cycle.quit {
            let cause = if stop || cycle.quit {
                Cause::Stop
            } else {
                Cause::Nominal
            };
            let decision = self.fault(cause, cycle.rearm);
            self.latched |= stop || faulty;
            decision
        } else {
            self.go_on(&accepted, zero, cycles, input)
        };
        if accepted.ends.iter().any(|cause| *cause != Cause::Goodbye) {
            self.owner = None;
        }
        if accepted.command.is_some() {
            self.late = false;
        }
        if let Some(cause) = ended {
            self.cause = cause;
        }
        let welcome = (before == Phase::Listening && self.phase == Phase::Handshake)
            .then_some(self.owner)
            .flatten();
        if let (None, Some(connection)) = (welcome, accepted.hello) {
            let faulted = Refusal::Faulted { ticks_left: 0 };
            assert!(accepted.refusals.push((connection, faulted)).is_ok());
        }
        let command = accepted.command.as_ref();
        let axes: [_; N] = std::array::from_fn(|axis| {
            self.act(axis, &action, command, [stepped[axis], accelerated[axis]])
        });
        // Only core can make an output; every field of this one is the model's.
        let mut expected = output.clone();
        expected.references = axes.map(|(reference, _)| reference);
        expected.withheld = self.withheld;
        expected.state = self.state(
            axes.map(|(_, state)| state),
            input.arrival_us,
            input.tick.sensor,
        );
        expected.owner = self.owner;
        expected.welcome = welcome;
        expected.refusals = accepted.refusals;
        expected.close = owner_before.filter(|_| self.owner != owner_before);
        expected.ended = ended;
        expected.latched = self.latched;
        assert!(
            *output == expected,
            "the model says otherwise:\n core   {output:?}\n model  {expected:?}\n input  {input:?}"
        );
    }

    fn classify(&mut self, input: &Input<N>) -> Accepted<N> {
        let mut accepted = Accepted::default();
        for (from, event) in &input.events {
            if self.owner == Some(*from) {
                self.classify_owner(event, &mut accepted);
            } else if let Event::Message(ClientMessage::Hello(hello)) = event {
                match self.refusal(hello, accepted.hello.is_some(), self.next_epoch(input)) {
                    None => accepted.hello = Some(*from),
                    Some(why) => assert!(accepted.refusals.push((*from, why)).is_ok()),
                }
            } else if *event != Event::Closed {
                add(&mut self.counters.non_owner, 1);
            }
        }
        add(&mut self.counters.non_owner, input.unauthentic.into());
        accepted
    }

    fn classify_owner(&mut self, event: &Event<N>, accepted: &mut Accepted<N>) {
        match event {
            Event::Broken(_) => accepted.ends.push(Cause::Malformed),
            Event::Flood => accepted.ends.push(Cause::Flood),
            Event::Closed => accepted.ends.push(Cause::Closed),
            Event::Malformed(_) | Event::Dropped(_) => {
                add(&mut self.counters.received, 1);
                add(&mut self.counters.malformed, 1);
            }
            Event::Message(message) => {
                add(&mut self.counters.received, 1);
                match message {
                    ClientMessage::Command(command) => self.classify_command(command, accepted),
                    ClientMessage::Goodbye(epoch) if epoch.0 == self.epoch => {
                        accepted.ends.push(Cause::Goodbye)
                    }
                    ClientMessage::Stop(epoch) if epoch.0 == self.epoch => accepted.stop = true,
                    ClientMessage::Goodbye(_) | ClientMessage::Stop(_) => {
                        add(&mut self.counters.stale, 1)
                    }
                    ClientMessage::Hello(_) => add(&mut self.counters.malformed, 1),
                }
            }
        }
    }

    fn classify_command(&mut self, command: &Command<N>, accepted: &mut Accepted<N>) {
        let ahead = i128::from(command.sequence.0) - i128::from(self.accepted);
        let behind = i128::from(self.tick) - i128::from(command.echo.0);
        if !self.phase_is_live() || command.epoch.0 != self.epoch {
            return add(&mut self.counters.stale, 1);
        }
        if ahead == 0 {
            return add(&mut self.counters.duplicate, 1);
        }
        if ahead > AHEAD || (ahead > 0 && behind < 0) {
            return add(&mut self.counters.stale, 1);
        }
        if ahead < 0 || behind > i128::from(self.parameters.echo_window) {
            self.late = true;
            return add(&mut self.counters.late, 1);
        }
        if self.phase == Phase::Handshake && command.mode == Mode::Obtain {
            return add(&mut self.counters.malformed, 1);
        }
        if !self.admits(&command.targets) {
            add(&mut self.counters.malformed, 1);
            return add(&mut self.counters.out_of_range, 1);
        }
        match accepted
            .command
            .map(|best| best.sequence.cmp(&command.sequence))
        {
            Some(std::cmp::Ordering::Equal) => add(&mut self.counters.duplicate, 1),
            Some(std::cmp::Ordering::Greater) => add(&mut self.counters.late, 1),
            Some(std::cmp::Ordering::Less) => {
                add(&mut self.counters.late, 1);
                accepted.command = Some(*command);
            }
            None => accepted.command = Some(*command),
        }
    }

    fn refusal(&self, hello: &Hello, asked: bool, next_epoch: Option<u64>) -> Option<Refusal> {
        let ticks_left = self.ticks_left();
        let needed = self.parameters.capabilities;
        let axes = u8::try_from(N).unwrap_or(u8::MAX);
        match self.phase {
            Phase::Handshake | Phase::Submit | Phase::Obtain => Some(Refusal::Busy),
            Phase::SafeDisconnect => Some(Refusal::Ramping { ticks_left }),
            Phase::Fault => Some(Refusal::Faulted { ticks_left }),
            Phase::Listening if asked => Some(Refusal::Busy),
            Phase::Listening if hello.axes != axes => Some(Refusal::Axes { expected: axes }),
            Phase::Listening if hello.capabilities.0 & needed.0 != needed.0 => {
                Some(Refusal::Capability { needed })
            }
            Phase::Listening if next_epoch.is_none() => Some(Refusal::Unavailable),
            Phase::Listening => None,
        }
    }

    /// Stopped, or the nominal reference stepped. The re-arm must be seen released in Fault, from
    /// its first tick on.
    fn fault(&mut self, cause: Cause, rearm: bool) -> Decision<N> {
        let entered = self.phase != Phase::Fault;
        if entered {
            self.leave(Phase::Fault);
        }
        self.rearm_released |= !rearm;
        (ChannelAction::Ramp, entered.then_some(cause))
    }

    /// Neither stop nor fault.
    fn go_on(
        &mut self,
        accepted: &Accepted<N>,
        zero: bool,
        cycles: u64,
        input: &Input<N>,
    ) -> Decision<N> {
        let end = ENDS.into_iter().find(|cause| accepted.ends.contains(cause));
        let end = end.or(self.is_agitated().then_some(Cause::Agitated));
        if let (true, Some(cause)) = (self.phase_is_live(), end) {
            return self.disconnect(cause);
        }
        match self.phase {
            Phase::Listening => {
                if let (Some(owner), Some(epoch)) = (accepted.hello, self.next_epoch(input)) {
                    self.grant(owner, epoch);
                }
                (ChannelAction::Hold, None)
            }
            Phase::Handshake => self.shake_hands(accepted, cycles),
            Phase::Submit | Phase::Obtain => self.run(accepted, zero, cycles),
            Phase::SafeDisconnect if zero => self.listen(),
            Phase::SafeDisconnect => (ChannelAction::Ramp, None),
            Phase::Fault if zero && input.tick.rearm && self.rearm_released => self.listen(),
            Phase::Fault => {
                self.rearm_released |= !input.tick.rearm;
                (ChannelAction::Ramp, None)
            }
        }
    }

    /// First epoch of the range that was not granted yet.
    fn next_epoch(&self, input: &Input<N>) -> Option<u64> {
        let (first, last) = (u128::from(input.epochs.first.0), input.epochs.last.0);
        let next = first.max(u128::from(self.epoch) + 1);
        u64::try_from(next).ok().filter(|next| *next <= last)
    }

    fn grant(&mut self, owner: Connection, epoch: u64) {
        self.phase = Phase::Handshake;
        self.owner = Some(owner);
        self.epoch = epoch;
        self.accepted = 0;
        self.missed.clear();
        self.late = false;
        self.counters = Counters::default();
    }

    fn shake_hands(&mut self, accepted: &Accepted<N>, cycles: u64) -> Decision<N> {
        if let Some(command) = accepted.command {
            self.phase = Phase::Submit;
            self.accepted = command.sequence.0;
            self.waited = 0;
            return (ChannelAction::Hold, None);
        }
        self.waited += cycles;
        if self.waited >= u64::from(self.parameters.handshake_ticks) {
            return self.disconnect(Cause::HandshakeTimeout);
        }
        (ChannelAction::Hold, None)
    }

    /// A deadline in Submit or Obtain, and one that no client could meet for each skipped cycle.
    fn run(&mut self, accepted: &Accepted<N>, zero: bool, cycles: u64) -> Decision<N> {
        let skipped = u32::try_from(cycles - 1).unwrap_or(u32::MAX);
        let missed = accepted.command.is_none();
        // No window is longer than 128 deadlines.
        let many = usize::try_from(skipped.min(128)).unwrap_or(128);
        self.missed.extend(repeat_n(true, many));
        self.missed.push(missed);
        let consecutive = self.run.saturating_add(skipped);
        let longest = consecutive.saturating_add(u32::from(missed));
        add(
            &mut self.counters.missed,
            skipped.saturating_add(u32::from(missed)),
        );
        let longest_run = &mut self.counters.longest_miss_run;
        *longest_run = (*longest_run).max(u16::try_from(longest).unwrap_or(u16::MAX));
        if consecutive >= 2 || (consecutive == 1 && missed) {
            let cause = match (skipped > 0, self.late) {
                (true, _) => Cause::ServerLate,
                (false, true) => Cause::NetworkLate,
                (false, false) => Cause::ClientLate,
            };
            return self.disconnect(cause);
        }
        if let Some(budget) = self.parameters.budget {
            if self.missed_of(budget.window) > usize::from(budget.allowed) {
                return self.disconnect(Cause::Budget);
            }
        }
        let Some(command) = accepted.command else {
            self.run = 1;
            return (ChannelAction::Hold, None);
        };
        self.run = 0;
        self.accepted = command.sequence.0;
        match (command.mode, self.phase) {
            (Mode::Obtain, _) => {
                self.phase = Phase::Obtain;
                (ChannelAction::Follow(command.targets), None)
            }
            (Mode::Submit, Phase::Obtain) if !zero => {
                (ChannelAction::Follow([Offsets::ZERO; N]), None)
            }
            (Mode::Submit, _) => {
                self.phase = Phase::Submit;
                (ChannelAction::Hold, None)
            }
        }
    }

    fn disconnect(&mut self, cause: Cause) -> Decision<N> {
        self.leave(Phase::SafeDisconnect);
        (ChannelAction::Ramp, Some(cause))
    }

    fn listen(&mut self) -> Decision<N> {
        self.leave(Phase::Listening);
        self.owner = None;
        (ChannelAction::Hold, None)
    }

    fn leave(&mut self, to: Phase) {
        self.phase = to;
        self.run = 0;
        self.waited = 0;
        self.rearm_released = false;
        self.latched = false;
    }

    /// Takes the nominal references and measurements of the tick.
    fn follow_path(&mut self, cycle: &TickInput<N>, cycles: u64) -> PathFaults<N> {
        let before = std::mem::take(&mut self.path);
        let Some(reading) = &cycle.reading else {
            self.off_path = true;
            return PathFaults {
                stepped: [false; N],
                accelerated: [false; N],
                is_fault: false,
            };
        };
        self.actual = reading.actual;
        let stepped = std::array::from_fn(|axis| {
            let limit = u128::from(self.parameters.axes[axis].nominal_step_nm) * u128::from(cycles);
            let change = i128::from(reading.nominal[axis].0) - i128::from(self.nominal[axis]);
            change.unsigned_abs() > limit
        });
        let is_on_path = cycles == 1 && !self.off_path;
        let accelerated = std::array::from_fn(|axis| {
            let limit = self.parameters.axes[axis].nominal_accel;
            limit.zip(before).is_some_and(|(limit, before)| {
                let places = [before[axis], self.nominal[axis], reading.nominal[axis].0];
                is_on_path && second_difference(places) > limit.nm.get().into()
            })
        });
        let is_fault = (0..N).any(|axis| {
            let stops = self.parameters.axes[axis]
                .nominal_accel
                .is_some_and(|limit| limit.is_fault);
            stepped[axis] || stops && accelerated[axis]
        });
        self.path = is_on_path.then_some(self.nominal);
        self.off_path &= stepped.contains(&true);
        if !self.off_path {
            self.nominal = reading.nominal.map(|nominal| nominal.0);
        }
        PathFaults {
            stepped,
            accelerated,
            is_fault,
        }
    }

    /// Applies the action to the channels of an axis; in Submit, the shadow does what the channel
    /// would.
    fn act(
        &mut self,
        axis: usize,
        action: &ChannelAction<N>,
        command: Option<&Command<N>>,
        [stepped, accelerated]: [bool; 2],
    ) -> (Reference, AxisState) {
        let config = &self.parameters.axes[axis];
        let before = self.channels[axis];
        self.channels[axis] = apply(before, action, axis, &config.limits);
        self.agitation[axis] = match config.agitation {
            Some(budget) if self.phase == Phase::Obtain => {
                let second_difference = self.channels[axis][0].change - before[0].change;
                let sum = self.agitation[axis] + second_difference.abs();
                (sum - i64::from(budget.nm_per_tick.get())).max(0)
            }
            _ => 0,
        };
        let limited = if self.phase == Phase::Submit {
            let action = command.map_or(ChannelAction::Hold, |command| {
                ChannelAction::Follow(command.targets)
            });
            self.shadow[axis] = apply(self.shadow[axis], &action, axis, &config.limits);
            behind(self.shadow[axis], &action, axis)
        } else {
            self.shadow[axis] = [Point::default(); 3];
            behind(self.channels[axis], action, axis)
        };
        let nominal = PositionNm(self.nominal[axis]);
        let (offsets, shadow) = (offsets(&self.channels[axis]), offsets(&self.shadow[axis]));
        let travel = &config.machine_travel;
        let wanted = i128::from(nominal.0) + i128::from(offsets.position.0);
        let inside = wanted.clamp(travel.lower.0.into(), travel.upper.0.into());
        add(&mut self.counters.clamped, u32::from(inside != wanted));
        add(
            &mut self.counters.limited,
            limited.map(u32::from).iter().sum(),
        );
        let [position, velocity, torque] = limited;
        let flags = AxisFlags::default()
            .with(AxisFlags::TRAVEL, inside != wanted)
            .with(AxisFlags::NOMINAL_STEP, stepped)
            .with(AxisFlags::NOMINAL_ACCEL, accelerated)
            .with(AxisFlags::POSITION_LIMITED, position)
            .with(AxisFlags::VELOCITY_LIMITED, velocity)
            .with(AxisFlags::TORQUE_LIMITED, torque);
        let reference = Reference {
            position: PositionNm(i64::try_from(inside).unwrap_or(i64::MAX)),
            velocity_offset: offsets.velocity,
            torque_offset: offsets.torque,
        };
        (
            reference,
            AxisState {
                nominal,
                offsets,
                shadow,
                actual: self.actual[axis],
                flags,
            },
        )
    }

    fn state(
        &self,
        axes: [AxisState; N],
        arrival_us: u16,
        sensor: Option<WrenchSample>,
    ) -> State<N> {
        State {
            tick: Tick(self.tick),
            epoch: Epoch(self.epoch),
            accepted: Sequence(self.accepted),
            phase: self.phase,
            cause: self.cause,
            on_time_of_100: u8::try_from(100 - self.missed_of(100)).unwrap_or(0),
            arrival_us,
            ramp_ticks_left: self.ticks_left(),
            counters: self.counters,
            sensor,
            axes,
        }
    }

    /// Number of missed deadlines among the latest.
    fn missed_of(&self, latest: u8) -> usize {
        self.missed
            .iter()
            .rev()
            .take(latest.into())
            .filter(|missed| **missed)
            .count()
    }

    fn phase_is_live(&self) -> bool {
        matches!(self.phase, Phase::Handshake | Phase::Submit | Phase::Obtain)
    }

    fn is_zero(&self) -> bool {
        self.channels.iter().flatten().all(|point| point.value == 0)
    }

    /// An axis is above a thousand times what its budget refills per tick.
    fn is_agitated(&self) -> bool {
        let mut axes = self.parameters.axes.iter().zip(&self.agitation);
        axes.any(|(axis, agitation)| {
            let budget = axis.agitation;
            budget.is_some_and(|budget| *agitation > 1_000 * i64::from(budget.nm_per_tick.get()))
        })
    }

    fn admits(&self, targets: &[Offsets; N]) -> bool {
        let axes = self.parameters.axes.iter().zip(targets);
        axes.flat_map(|(axis, target)| {
            axis::limit_values(&axis.limits)
                .into_iter()
                .zip(axis::counts(target))
        })
        .all(|(limits, value)| value.abs() <= limits.max.into())
    }

    /// The longest ramp of all channels.
    fn ticks_left(&self) -> u32 {
        let axes = self.parameters.axes.iter().zip(&self.channels);
        let left = axes.flat_map(|(axis, points)| {
            let channels = axis::limit_values(&axis.limits).into_iter().zip(points);
            channels.map(|(limits, point)| {
                point
                    .value
                    .unsigned_abs()
                    .div_ceil(limits.ramp.unsigned_abs().into())
            })
        });
        u32::try_from(left.max().unwrap_or(0)).unwrap_or(u32::MAX)
    }
}

fn offsets(points: &[Point; 3]) -> Offsets {
    let [position, velocity, torque] = points.map(|point| point.value);
    Offsets {
        position: OffsetNm(i32::try_from(position).unwrap_or(i32::MAX)),
        velocity: VelocityUmS(i32::try_from(velocity).unwrap_or(i32::MAX)),
        torque: TorquePermille(i16::try_from(torque).unwrap_or(i16::MAX)),
    }
}

/// Magnitude of the second difference of three nominal references, nm. Of 64 bits the lowest, which
/// are all that there are of positions within 2^61 nm.
fn second_difference(places: [i64; 3]) -> u64 {
    let [before, last, now] = places.map(i128::from);
    let wrapped = (now - 2 * last + before).rem_euclid(1 << 64);
    u64::try_from(wrapped.min((1 << 64) - wrapped)).unwrap_or(u64::MAX)
}

fn apply<const N: usize>(
    points: [Point; 3],
    action: &ChannelAction<N>,
    axis: usize,
    limits: &AxisLimits,
) -> [Point; 3] {
    let limits = axis::limit_values(limits);
    std::array::from_fn(|kind| {
        let point = points[kind];
        let limits = &limits[kind];
        let ramp = i64::from(limits.ramp);
        match action {
            // Holding a push would not hold the machine.
            ChannelAction::Hold if kind == 0 => moved(point, 0),
            ChannelAction::Hold | ChannelAction::Ramp => {
                moved(point, (-point.value).clamp(-ramp, ramp))
            }
            ChannelAction::Follow(targets) => {
                let (step, accel) = (i64::from(limits.step), i64::from(limits.accel));
                let wish = axis::counts(&targets[axis])[kind] - point.value;
                let fastest = (point.change + accel).min(step);
                let slowest = (point.change - accel).max(-step);
                moved(point, wish.clamp(slowest, fastest))
            }
        }
    })
}

fn moved(point: Point, change: i64) -> Point {
    Point {
        value: point.value + change,
        change,
    }
}

/// Channels that follow and have not reached their target.
fn behind<const N: usize>(points: [Point; 3], action: &ChannelAction<N>, axis: usize) -> [bool; 3] {
    match action {
        ChannelAction::Follow(targets) => {
            let targets = axis::counts(&targets[axis]);
            std::array::from_fn(|kind| points[kind].value != targets[kind])
        }
        ChannelAction::Hold | ChannelAction::Ramp => [false; 3],
    }
}

/// Counters saturate.
fn add(counter: &mut u32, count: u32) {
    *counter = counter.saturating_add(count);
}
