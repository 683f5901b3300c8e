//! The drives in operation: one exchange per cycle, compared and judged; their states; and the way
//! back after a fault.

mod start;

use std::panic::{AssertUnwindSafe, catch_unwind};

use ethercrab::error::Error;
use ethercrab::subdevice_group::{Op, SafeOp};
use ethercrab::{Command, MainDevice, RegisterAddress, TxRxResponse};

use crate::bring_up::{
    BringUpError, DriveConfig, Extras, Initial, Member, Ready, Settings, bring_up, number,
};
use crate::cia402::{CSP, FOLLOWING_ERROR, Input, PowerState, Target, control};
use crate::discovery::{self, BusError, ERROR, MAX_SUBDEVICES, al_status, code_of};
use crate::fault::Fault;
use crate::instruments::beside_drives::BesideDrives;
use crate::instruments::encoder::{Counter, CounterMap};
use crate::instruments::{Instruments, NoReading};
use crate::main_device::main_device;
use crate::pump::Pump;
use crate::steered_cycle::SteeredCycle;
use crate::steering::SteeringFault;
use crate::wire::Wire;

/// Time for a bring-up, s.
const BRING_UP_S: u32 = 60;
/// Cycles for the way from SAFE-OP to operation enabled.
const ENABLE_CYCLES: u32 = 3_000;
/// Cycles for the way back at an orderly end.
const DISABLE_CYCLES: u32 = 50;
/// Longest time of a cycle for the instruments, µs.
const INSTRUMENTS_US: u64 = 200;
/// Share of every drive in the working counter of an exchange: 1 for its inputs, 2 for its
/// outputs.
const COUNTS_PER_DRIVE: u16 = 3;
/// AL control: requests, and the acknowledgement of an error.
const INIT: u16 = 0x01;
const OPERATIONAL: u16 = 0x08;
const ACKNOWLEDGE_IN_SAFE_OP: u16 = 0x14;

/// Condition of the drives together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Condition {
    /// In SAFE-OP: inputs are read, outputs ignored.
    Prepared,
    /// All follow their references.
    Running,
    /// Stopped by a fault, until a re-arm.
    Stopped(Fault),
    /// On the way back after a re-arm, for so many cycles.
    Rearming {
        /// Cycles since the re-arm.
        cycles: u32,
    },
}

enum Group {
    SafeOp(discovery::Group<SafeOp>),
    Op(discovery::Group<Op>),
    /// A request of OP failed and took the group with it.
    Lost,
}

/// The drives of `M` motors on a bus.
///
/// One [`cycle`](Self::cycle) sends one frame and waits for its answer at most
/// [`Settings::answer_us`]; it neither allocates nor locks.
pub struct Drives<W: Wire, const M: usize> {
    pump: Pump<W>,
    main: &'static MainDevice<'static>,
    group: Group,
    members: [Member; M],
    settings: Settings,
    inputs: [Input; M],
    /// References of the last frame.
    sent: [Target; M],
    /// The working counter of that frame was right: every drive has them.
    is_confirmed: bool,
    /// States of the last answer, by motor; 0 of a drive that gave none.
    states: [u8; M],
    requested: [bool; M],
    /// Last refusal of OP with a code, on the way to operation enabled.
    refusal: Option<Fault>,
    condition: Condition,
    /// Cycles in a row without a right answer.
    missed: u32,
    /// Cycle that follows the reference clock; `None` for drives that run freely.
    steered: Option<SteeredCycle>,
    instruments: Option<Instruments<BesideDrives>>,
}

impl<W: Wire, const M: usize> Drives<W, M> {
    /// Brings drives to SAFE-OP: looks for them, compares them with `drives`, reads the offsets in
    /// force, maps process data, sets the watchdogs. Blocks for some seconds. Memory of about 20
    /// KiB per call is kept to the end of the process.
    ///
    /// # Errors
    /// [`BringUpError`], with the motor that it concerns.
    pub fn bring_up(
        wire: W,
        drives: &[DriveConfig; M],
        settings: Settings,
    ) -> Result<Self, BringUpError> {
        Self::bring_up_with(wire, drives, settings, Extras::default())
    }

    /// The same, with distributed clocks of the drives, or instruments beside them.
    ///
    /// # Errors
    /// [`BringUpError`], with the motor that it concerns.
    pub fn bring_up_with(
        wire: W,
        drives: &[DriveConfig; M],
        settings: Settings,
        extras: Extras<'_>,
    ) -> Result<Self, BringUpError> {
        if let Some(clocks) = &extras.clocks {
            clocks.check(settings.cycle_ns())?;
        }
        let cycles = settings.watchdog_cycles;
        let is_whole = settings.watchdog_us() % 100 == 0;
        if !(1..=Settings::MAX_WATCHDOG_CYCLES).contains(&cycles) || !is_whole {
            return Err(BringUpError::Watchdog { cycles });
        }
        // Longer than a cycle waits, so that none sends twice.
        let answer_us = settings.answer_us.saturating_add(200);
        let Some((mut pump, main)) = main_device(wire, answer_us) else {
            return Err(BusError::Unhandled.into());
        };
        let future = bring_up(main, drives, &settings, &extras);
        let limit_us = u64::from(BRING_UP_S) * 1_000_000;
        // ethercrab asserts that no emergency message stands between a request and its answer.
        let outcome = catch_unwind(AssertUnwindSafe(|| pump.run(future, limit_us)));
        let outcome = outcome.map_err(|_| BusError::Unhandled)?;
        let Ready {
            group,
            members,
            sync0_start_ns,
            mut instruments,
        } = outcome.ok_or(BusError::Overdue {
            seconds: BRING_UP_S,
        })??;
        let sent = members.map(|member| crate::bring_up::standing(&member.initial));
        if let Some(instruments) = &mut instruments {
            let times_us = [settings.cycle_us, settings.answer_us].map(u64::from);
            let in_operation = instruments.come_into_operation(&mut pump, main, times_us);
            in_operation.map_err(|error| extras.refused(error))?;
        }
        let steered = (extras.clocks)
            .zip(sync0_start_ns)
            .map(|(clocks, start_ns)| SteeredCycle::new(&clocks, settings.cycle_ns(), start_ns));
        Ok(Self {
            pump,
            main,
            group: Group::SafeOp(group),
            inputs: members.map(|member| member.initial.input()),
            sent,
            is_confirmed: true,
            states: [0; M],
            requested: [false; M],
            refusal: None,
            members,
            settings,
            condition: Condition::Prepared,
            missed: 0,
            steered,
            instruments,
        })
    }

    /// Returns what every drive had before it was brought up.
    #[must_use]
    pub fn initial(&self) -> [Initial; M] {
        self.members.map(|member| member.initial)
    }

    /// Returns the measurements of the last answer whose working counter was right.
    #[must_use]
    pub const fn inputs(&self) -> &[Input; M] {
        &self.inputs
    }

    /// Returns the condition.
    #[must_use]
    pub const fn condition(&self) -> Condition {
        self.condition
    }

    /// Returns the references that were sent last.
    #[must_use]
    pub const fn sent(&self) -> &[Target; M] {
        &self.sent
    }

    /// True if the drives are known to have the references that were sent last.
    #[must_use]
    pub const fn is_confirmed(&self) -> bool {
        self.is_confirmed
    }

    /// True if the coming [`cycle`](Self::cycle) sends its `targets`; false if it sends those again
    /// that were sent before.
    #[must_use]
    pub const fn takes_targets(&self) -> bool {
        match self.condition {
            Condition::Running => self.is_confirmed,
            Condition::Rearming { .. } => true,
            Condition::Prepared | Condition::Stopped(_) => false,
        }
    }

    /// Returns force, N, and torque, N m, of the force sensor about its origin, its axes, as of the
    /// last [`cycle`](Self::cycle), or the reason for which there is none. `None` on a bus without
    /// a sensor.
    #[must_use]
    pub fn force(&self) -> Option<Result<[f64; 6], NoReading>> {
        let mut instruments = self.instruments.as_ref()?.each();
        Some(instruments.find_map(BesideDrives::force)?.reading())
    }

    /// Returns the counts of the gauges as of the last [`cycle`](Self::cycle), from the first count of
    /// each one on, or the reason for which there is none.
    pub fn gauge_counts(&self) -> impl Iterator<Item = Result<i64, NoReading>> {
        self.gauges().map(Counter::count)
    }

    /// Returns what the inputs of each gauge's terminal hold.
    pub fn gauge_maps(&self) -> impl Iterator<Item = CounterMap> {
        self.gauges().map(Counter::map)
    }

    fn gauges(&self) -> impl Iterator<Item = &Counter> {
        let instruments = self.instruments.iter().flat_map(Instruments::each);
        instruments.filter_map(BesideDrives::gauge)
    }

    /// Returns the wire.
    pub const fn wire_mut(&mut self) -> &mut W {
        &mut self.pump.wire
    }

    /// Steers the cycle by the last exchange.
    fn steer(&mut self) -> Option<SteeringFault> {
        let steered = self.steered.as_mut()?;
        let (shift_ns, fault) = steered.step();
        self.pump.wire.shift_cycles(shift_ns);
        fault
    }

    /// Returns the time of the wire at which the next cycle is to begin, ns, and forgets the shifts
    /// before it; `None` for drives that run freely. After [`start`](Self::start).
    pub fn next_cycle_ns(&mut self) -> Option<u64> {
        let now_ns = self.pump.wire.now_ns();
        let steered = self.steered.as_mut()?;
        steered.take_shift_ns();
        Some(steered.upcoming_ns(now_ns))
    }

    /// Returns the time by which the next cycle is to begin later than a cycle after the last, ns,
    /// and takes it off; at most a thousandth of a cycle.
    pub fn take_shift_ns(&mut self) -> i64 {
        self.steered.as_mut().map_or(0, SteeredCycle::take_shift_ns)
    }

    /// Returns the phase of the last frame against SYNC0, ns; `None` without a sample.
    #[must_use]
    pub fn phase_ns(&self) -> Option<i64> {
        self.steered.as_ref().and_then(SteeredCycle::phase_ns)
    }

    /// True if the cycle is in phase with SYNC0; `None` for drives that run freely.
    #[must_use]
    pub fn is_locked(&self) -> Option<bool> {
        self.steered.as_ref().map(SteeredCycle::is_locked)
    }

    /// Asks for the way back after a fault; [`cycle`](Self::cycle) goes it, one step at a time.
    pub fn rearm(&mut self) {
        if matches!(self.condition, Condition::Stopped(_)) {
            self.condition = Condition::Rearming { cycles: 0 };
            self.requested = [false; M];
            self.refusal = None;
            if let Some(steered) = &mut self.steered {
                steered.forget_faults();
            }
        }
    }

    /// Exchanges process data once. While the drives run, they get `targets`; after a fault they
    /// are stopped, at the references that they had; after a re-arm `targets` must be where the
    /// motors stand, and they are enabled there.
    ///
    /// After a frame without a right answer it is not known which drives have its references. They
    /// are sent again, instead of `targets`, until an answer confirms them: so no drive ever makes
    /// the way of two cycles at once.
    ///
    /// # Errors
    /// [`Fault`]: the drives do not have `targets`, as far as it is known, or do not follow them;
    /// [`Fault::Resent`] when they were not sent, and the measurements are good. After faults of
    /// more than one cycle the drives are stopped until a re-arm.
    pub fn cycle(&mut self, targets: &[Target; M]) -> Result<(), Fault> {
        let began_us = self.pump.wire.now_us();
        let outcome = self.cycle_of_drives(targets);
        self.read_instruments(began_us);
        outcome
    }

    /// Reads the instruments, in what is left of the time for answers: the drives come first.
    fn read_instruments(&mut self, began_us: u64) {
        let Some(instruments) = &mut self.instruments else {
            return;
        };
        let end_us = began_us.saturating_add(self.settings.answer_us.into());
        let left_us = end_us.saturating_sub(self.pump.wire.now_us());
        if left_us < INSTRUMENTS_US {
            instruments.miss(NoReading::Skipped);
        } else {
            instruments.cycle(&mut self.pump, self.main, INSTRUMENTS_US);
        }
    }

    fn cycle_of_drives(&mut self, targets: &[Target; M]) -> Result<(), Fault> {
        if let Some(steered) = &mut self.steered {
            steered.begin(self.pump.wire.now_ns());
        }
        let outcome = self.cycle_in_condition(targets);
        let is_running = !matches!(self.condition, Condition::Prepared | Condition::Stopped(_));
        match self.steer() {
            Some(fault) if is_running => {
                let fault = Fault::Clock(fault);
                self.condition = Condition::Stopped(fault);
                Err(fault)
            }
            _ => outcome,
        }
    }

    fn cycle_in_condition(&mut self, targets: &[Target; M]) -> Result<(), Fault> {
        match self.condition {
            Condition::Prepared => Err(Fault::NotStarted),
            Condition::Running => {
                let resends = !self.is_confirmed;
                let sent = if resends { self.sent } else { *targets };
                let outcome = self
                    .exchange(&[control::ENABLED; M], &sent)
                    .and_then(|()| self.judge());
                self.missed = if outcome.is_ok() {
                    0
                } else {
                    self.missed.saturating_add(1)
                };
                if let Err(fault) = outcome {
                    if !fault.is_of_one_cycle() || self.missed >= self.settings.watchdog_cycles {
                        self.condition = Condition::Stopped(fault);
                    }
                }
                if resends {
                    outcome.and(Err(Fault::Resent))
                } else {
                    outcome
                }
            }
            Condition::Stopped(fault) => {
                let held = self.sent;
                let stop = self.inputs.map(|input| stopping(&input));
                let _seen = self.exchange(&stop, &held);
                Err(fault)
            }
            Condition::Rearming { .. } => self.step_towards_operation(targets, true),
        }
    }

    /// Goes one step from SAFE-OP, or a fault, towards operation enabled.
    fn step_towards_operation(
        &mut self,
        targets: &[Target; M],
        may_reset: bool,
    ) -> Result<(), Fault> {
        let Condition::Rearming { cycles } = self.condition else {
            return Err(Fault::NotStarted);
        };
        let all_operational = self.states.iter().all(|state| *state == 8);
        // Drives with a clock are led on in phase with it only.
        let is_in_phase = self.is_locked() != Some(false);
        // The reset is an edge, a cycle in eight.
        let resets = may_reset && cycles % 8 == 4;
        let commands = self.inputs.map(|input| match input.state() {
            _ if !is_in_phase => stopping(&input),
            _ if !all_operational => 0,
            // It is not enabled in another mode.
            PowerState::SwitchedOn if input.mode != CSP => control::SWITCHED_ON,
            state => state.towards_operation(resets),
        });
        let outcome = self.exchange(&commands, targets);
        self.condition = Condition::Rearming {
            cycles: cycles.saturating_add(1),
        };
        let fault = match outcome {
            Ok(()) => match self.judge() {
                Ok(()) => {
                    self.condition = Condition::Running;
                    self.missed = 0;
                    return Ok(());
                }
                Err(fault @ Fault::Drive { .. } | fault @ Fault::FollowingError { .. })
                    if !may_reset =>
                {
                    self.condition = Condition::Stopped(fault);
                    return Err(fault);
                }
                Err(fault) => fault,
            },
            Err(
                fault @ Fault::State {
                    motor,
                    state: 4 | 8,
                    ..
                },
            ) => {
                if is_in_phase {
                    self.lead(motor);
                }
                fault
            }
            Err(fault) => {
                self.condition = Condition::Stopped(fault);
                return Err(fault);
            }
        };
        if matches!(fault, Fault::State { code, .. } if code != 0) {
            self.refusal = Some(fault);
        }
        if cycles >= ENABLE_CYCLES {
            // Its code is acknowledged as soon as it comes.
            let fault = self.refusal.take().unwrap_or(fault);
            self.condition = Condition::Stopped(fault);
            return Err(fault);
        }
        Err(Fault::Rearming)
    }

    /// Acknowledges the error of a drive, or asks it for OP, once.
    fn lead(&mut self, motor: u8) {
        let index = usize::from(motor);
        let (Some(member), Some(requested)) =
            (self.members.get(index), self.requested.get_mut(index))
        else {
            return;
        };
        let station = member.station;
        let main = self.main;
        let limit_us = u64::from(self.settings.answer_us);
        let Some(Some((status, _))) = self.pump.run(al_status(main, station), limit_us) else {
            return;
        };
        let request = match (status & ERROR != 0, *requested) {
            (true, _) => ACKNOWLEDGE_IN_SAFE_OP,
            (false, false) => OPERATIONAL,
            (false, true) => return,
        };
        *requested = request == OPERATIONAL;
        let write = Command::fpwr(station, RegisterAddress::AlControl.into()).send(main, request);
        let _sent = self.pump.run(write, limit_us);
    }

    /// Sends one frame and compares its answer. Measurements are taken over only if the working
    /// counter is right.
    fn exchange(&mut self, commands: &[u16; M], targets: &[Target; M]) -> Result<(), Fault> {
        // An answer that comes too late does not belong to this frame: it has the index of its own
        // datagrams, and ethercrab takes no other.
        (self.sent, self.is_confirmed) = (*targets, false);
        if !self.pack(commands, targets) {
            return Err(Fault::Image);
        }
        let limit_us = u64::from(self.settings.answer_us);
        if self.steered.is_some() {
            return self.exchange_with_time(limit_us);
        }
        let answer = match &self.group {
            Group::SafeOp(group) => self.pump.run(group.tx_rx(self.main), limit_us),
            Group::Op(group) => self.pump.run(group.tx_rx(self.main), limit_us),
            Group::Lost => None,
        };
        let Some(Ok(answer)) = answer else {
            return Err(Fault::NoAnswer);
        };
        self.apply_answer(&answer)
    }

    /// The same with the time of the reference in front, which all clocks follow. A time that is
    /// missing is no fault.
    fn exchange_with_time(&mut self, limit_us: u64) -> Result<(), Fault> {
        let main = self.main;
        let answer = match &self.group {
            Group::SafeOp(group) => self.pump.run(group.tx_rx_sync_system_time(main), limit_us),
            Group::Op(group) => self.pump.run(group.tx_rx_sync_system_time(main), limit_us),
            Group::Lost => None,
        };
        let Some(Ok(answer)) = answer else {
            return Err(Fault::NoAnswer);
        };
        // The frame leaves with zeros, and comes back with them if the reference did not answer.
        let time = answer.extra.filter(|time| *time != 0);
        if let (Some(steered), Some(time)) = (&mut self.steered, time) {
            steered.note_time(time);
        }
        self.apply_answer(&answer)
    }

    fn pack(&self, commands: &[u16; M], targets: &[Target; M]) -> bool {
        self.members
            .iter()
            .zip(commands.iter().zip(targets))
            .all(|(member, (command, target))| match &self.group {
                Group::SafeOp(group) => {
                    group.subdevice(self.main, member.index).is_ok_and(|drive| {
                        member
                            .mapping
                            .pack(*command, target, &mut drive.outputs_raw_mut())
                    })
                }
                Group::Op(group) => group.subdevice(self.main, member.index).is_ok_and(|drive| {
                    member
                        .mapping
                        .pack(*command, target, &mut drive.outputs_raw_mut())
                }),
                Group::Lost => false,
            })
    }

    /// Applies an answer: states, then the working counter, then the measurements.
    fn apply_answer<T>(&mut self, answer: &TxRxResponse<MAX_SUBDEVICES, T>) -> Result<(), Fault> {
        let states = self.members.map(|member| {
            answer
                .subdevice_states
                .get(member.index)
                .copied()
                .map_or(0, code_of)
        });
        self.states = states;
        let expected = COUNTS_PER_DRIVE.saturating_mul(M as u16);
        let received = answer.working_counter;
        self.is_confirmed = received == expected;
        let absent = states.iter().position(|state| *state == 0);
        let mut fresh = self.inputs;
        if received == expected {
            for (input, member) in fresh.iter_mut().zip(&self.members) {
                let taken = match &self.group {
                    Group::SafeOp(group) => group
                        .subdevice(self.main, member.index)
                        .ok()
                        .and_then(|drive| member.mapping.unpack(&drive.inputs_raw())),
                    Group::Op(group) => group
                        .subdevice(self.main, member.index)
                        .ok()
                        .and_then(|drive| member.mapping.unpack(&drive.inputs_raw())),
                    Group::Lost => None,
                };
                *input = taken.ok_or(Fault::Image)?;
            }
            self.inputs = fresh;
        }
        if matches!(self.group, Group::SafeOp(_)) && received == expected {
            return Ok(());
        }
        if let Some(motor) = states.iter().position(|state| !matches!(*state, 0 | 8)) {
            return Err(self.state_fault(motor));
        }
        match absent {
            Some(motor) => Err(Fault::Absent {
                motor: number(motor),
            }),
            None if received != expected => Err(Fault::WorkingCounter { expected, received }),
            None => Ok(()),
        }
    }

    /// Asks a drive that left OP for its reason.
    fn state_fault(&mut self, motor: usize) -> Fault {
        let main = self.main;
        let limit_us = u64::from(self.settings.answer_us);
        let station = self.members.get(motor).map_or(0, |member| member.station);
        let (status, code) = self
            .pump
            .run(al_status(main, station), limit_us)
            .flatten()
            .unwrap_or((0, 0));
        Fault::State {
            motor: number(motor),
            state: (status & 0x0F) as u8,
            code,
        }
    }

    /// Judges the status words and the modes: all must be in operation enabled, in cyclic
    /// synchronous position mode.
    fn judge(&self) -> Result<(), Fault> {
        for (motor, input) in self.inputs.iter().enumerate() {
            let motor = number(motor);
            match input.state() {
                PowerState::SwitchedOn | PowerState::OperationEnabled if input.mode != CSP => {
                    return Err(Fault::Mode {
                        motor,
                        mode: input.mode,
                    });
                }
                PowerState::OperationEnabled => {}
                PowerState::Fault | PowerState::FaultReactionActive => {
                    let error_code = input.error_code;
                    let follows_not = error_code == 0x8611
                        || error_code == 0 && input.status & FOLLOWING_ERROR != 0;
                    return Err(if follows_not {
                        Fault::FollowingError { motor }
                    } else {
                        Fault::Drive { motor, error_code }
                    });
                }
                state => return Err(Fault::NotEnabled { motor, state }),
            }
        }
        Ok(())
    }

    /// Takes the power away in order, and the bus to INIT: an orderly end leaves no drive in fault.
    fn stop(&mut self) {
        if matches!(self.group, Group::Op(_)) {
            for _ in 0..DISABLE_CYCLES {
                let held = self.sent;
                let shutdown = self.inputs.map(|input| match input.state() {
                    PowerState::OperationEnabled | PowerState::SwitchedOn => control::SHUTDOWN,
                    _ => 0,
                });
                if self.exchange(&shutdown, &held).is_err()
                    || shutdown.iter().all(|word| *word == 0)
                {
                    break;
                }
                let _fault = self.steer();
                self.rest();
            }
        }
        let init = Command::bwr(RegisterAddress::AlControl.into())
            .ignore_wkc()
            .send(self.main, INIT);
        let _sent: Option<Result<(), Error>> =
            self.pump.run(init, u64::from(self.settings.answer_us));
    }
}

impl<W: Wire, const M: usize> Drop for Drives<W, M> {
    fn drop(&mut self) {
        self.stop();
    }
}

impl<W: Wire, const M: usize> std::fmt::Debug for Drives<W, M> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Drives")
            .field("condition", &self.condition)
            .field("members", &self.members)
            .finish_non_exhaustive()
    }
}

/// Control word that stops a drive, and leaves one that is stopped.
fn stopping(input: &Input) -> u16 {
    match input.state() {
        PowerState::OperationEnabled | PowerState::QuickStopActive => control::QUICK_STOP,
        _ => 0,
    }
}
