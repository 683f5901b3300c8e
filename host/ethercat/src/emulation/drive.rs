//! A drive of CiA 402 in cyclic synchronous position mode: objects, states, supervision.

use super::device::{Device, MAX_PROCESS_DATA};
use super::mailbox::{self, Dictionary};
use super::mapping::{Mapped, Pdo};
use super::objects::{Mappable, Objects, abort, entries};
use super::sii::{COE, Identity, Sii};

/// Length of a step of the drive, µs.
pub const STEP_US: u64 = 1_000;
/// Steps from the command to the state: voltage on, brake released.
const SWITCH_ON_STEPS: u32 = 3;
/// Cyclic synchronous position mode.
const CSP: i32 = 8;
/// Error codes: no cyclic data in time, following error, and the one of [`Drive::trip`].
const ERROR_BUS: i32 = 0x7500;
const ERROR_FOLLOWING: i32 = 0x8611_u16 as i16 as i32;
const ERROR_FORCED: i32 = 0x2310;

/// Setup of an emulated drive.
#[derive(Clone, Debug)]
pub struct DriveSetup {
    /// Identity of its SII and of object 1018h.
    pub identity: Identity,
    /// Alias in its SII.
    pub alias: u16,
    /// Position at power-on, counts.
    pub position: i32,
    /// Objects that it lacks.
    pub missing: Vec<u16>,
    /// Object 607Dh, counts; none where both are zero.
    pub software_limits: (i32, i32),
    /// Object 608Fh: encoder counts and turns.
    pub encoder: (u32, u32),
    /// Object 6065h, counts, and 6066h, ms.
    pub following_error: (u32, u16),
    /// Object 6085h, counts/s².
    pub quick_stop: u32,
    /// True if sync manager 2 triggers the watchdog, as its SII says.
    pub has_watchdog: bool,
    /// True if the drive takes writes to the watchdog's time.
    pub watchdog_is_writable: bool,
}

/// State of CiA 402.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PowerState {
    /// No voltage, waits for the command to shut down.
    SwitchOnDisabled,
    /// Waits for the command to switch on.
    ReadyToSwitchOn,
    /// Power stage on, no torque.
    SwitchedOn,
    /// Follows its references.
    OperationEnabled,
    /// Brakes after the command to stop.
    QuickStopActive,
    /// Brakes after a fault.
    FaultReactionActive,
    /// Stands, waits for the reset.
    Fault,
}

/// Motor of a drive, as the process behind the chain sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motor {
    /// True while the position loop is closed; else the brake holds.
    pub is_enabled: bool,
    /// Position that the loop follows, counts: 607Ah plus 60B0h, or the ramp of a stop.
    pub reference: i64,
    /// The part of it that is 60B0h, counts.
    pub position_offset: i32,
    /// 60B1h.
    pub velocity_offset: i32,
    /// 60B2h, per mille.
    pub torque_offset: i16,
    /// Way by which somebody has moved it by hand, beside the process, counts.
    pub pushed: i64,
    /// Position, counts: the process writes it.
    pub position: i64,
    /// Velocity, counts/s: the process writes it.
    pub velocity: i32,
    /// Torque, per mille: the process writes it.
    pub torque: i16,
}

/// A drive.
#[derive(Clone, Debug)]
pub struct Drive {
    setup: DriveSetup,
    /// Object 1C32h:04, and the same of 1C33h; a drive without it has neither.
    synchronisation: Option<u16>,
    has_fixed_pdos: bool,
    requires_sync0: bool,
    /// It takes writes to 1C32h and 1C33h, and keeps what they held.
    keeps_synchronisation: bool,
    objects: Objects,
    outputs: Pdo,
    inputs: Pdo,
    state: PowerState,
    /// Steps in the present state.
    steps: u32,
    control: u16,
    /// Error code of the last fault, 0 after its reset; 603Fh shows it where the drive has the
    /// object.
    error: i32,
    /// Mode that the drive keeps, regardless of 6060h.
    forced_mode: Option<i8>,
    /// Process data is valid: the SubDevice is in OP.
    is_operational: bool,
    motor: Motor,
    /// Change of the reference per step, counts.
    velocity: i64,
    outside_steps: u32,
    largest_step: i64,
    followed: Option<i64>,
}

impl Drive {
    /// Creates a drive that has just been powered.
    #[must_use]
    pub fn new(setup: &DriveSetup) -> Self {
        let [output, input, no] = [Mappable::Output, Mappable::Input, Mappable::No];
        let id = setup.identity;
        let rows = [
            (0x1000, 0, 32, false, no, 0x0002_0192),
            (0x1018, 0, 8, false, no, 4),
            (0x1018, 1, 32, false, no, id.vendor.into()),
            (0x1018, 2, 32, false, no, id.product.into()),
            (0x1018, 3, 32, false, no, id.revision.into()),
            (0x1018, 4, 32, false, no, id.serial.into()),
            (0x1C00, 0, 8, false, no, 4),
            (0x1C00, 1, 8, false, no, 1),
            (0x1C00, 2, 8, false, no, 2),
            (0x1C00, 3, 8, false, no, 3),
            (0x1C00, 4, 8, false, no, 4),
            (0x603F, 0, 16, false, input, 0),
            (0x6040, 0, 16, true, output, 0),
            (0x6041, 0, 16, false, input, 0),
            (0x6060, 0, 8, true, output, 0),
            (0x6061, 0, 8, false, input, 0),
            (0x6064, 0, 32, false, input, setup.position.into()),
            (0x6065, 0, 32, true, no, setup.following_error.0.into()),
            (0x6066, 0, 16, true, no, setup.following_error.1.into()),
            (0x606C, 0, 32, false, input, 0),
            (0x6077, 0, 16, false, input, 0),
            (0x607A, 0, 32, true, output, setup.position.into()),
            (0x607D, 0, 8, false, no, 2),
            (0x607D, 1, 32, true, no, setup.software_limits.0.into()),
            (0x607D, 2, 32, true, no, setup.software_limits.1.into()),
            (0x6085, 0, 32, true, no, setup.quick_stop.into()),
            (0x608F, 0, 8, false, no, 2),
            (0x608F, 1, 32, false, no, setup.encoder.0.into()),
            (0x608F, 2, 32, false, no, setup.encoder.1.into()),
            (0x60B0, 0, 32, true, output, 0),
            (0x60B1, 0, 32, true, output, 0),
            (0x60B2, 0, 16, true, output, 0),
            (0x6502, 0, 32, false, no, 0x80),
        ];
        let mut present = entries(&rows);
        present.retain(|entry| !setup.missing.contains(&entry.index));
        let outputs = [Mapped::whole(0x6040, 16), Mapped::whole(0x607A, 32)];
        let inputs = [Mapped::whole(0x6041, 16), Mapped::whole(0x6064, 32)];
        let position = setup.position.into();
        Self {
            setup: setup.clone(),
            synchronisation: None,
            has_fixed_pdos: false,
            requires_sync0: false,
            keeps_synchronisation: false,
            objects: Objects::new(present),
            outputs: Pdo::new(output, 0x1600, 0x1C12, &outputs),
            inputs: Pdo::new(input, 0x1A00, 0x1C13, &inputs),
            state: PowerState::SwitchOnDisabled,
            steps: 0,
            control: 0,
            error: 0,
            forced_mode: None,
            is_operational: false,
            motor: Motor {
                pushed: 0,
                is_enabled: false,
                reference: position,
                position_offset: 0,
                velocity_offset: 0,
                torque_offset: 0,
                position,
                velocity: 0,
                torque: 0,
            },
            velocity: 0,
            outside_steps: 0,
            largest_step: 0,
            followed: None,
        }
    }

    /// Adds the objects of synchronisation, 1C32h and 1C33h, with the supported types (sub-index
    /// 04): bit 0 free run, bit 1 the sync manager's event, bits 2 and 3 SYNC0 and SYNC1.
    #[must_use]
    pub fn with_synchronisation(mut self, types: u16) -> Self {
        self.synchronisation = Some(types);
        for object in [0x1C32, 0x1C33] {
            self.objects.extend(entries(&[
                (object, 0, 8, false, Mappable::No, 4),
                (object, 1, 16, true, Mappable::No, 0),
                (object, 2, 32, true, Mappable::No, 0),
                (object, 4, 16, false, Mappable::No, types.into()),
            ]));
        }
        self
    }

    /// Makes it a drive that refuses OP without SYNC0, and leaves it when references stay away.
    #[must_use]
    pub const fn requiring_sync0(mut self) -> Self {
        self.requires_sync0 = true;
        self
    }

    /// Makes it a drive that takes another synchronisation, and does not change its own.
    #[must_use]
    pub const fn keeping_synchronisation(mut self) -> Self {
        self.keeps_synchronisation = true;
        self
    }

    /// Makes the contents of its PDOs fixed: 6040h and 607Ah, 6041h and 6064h.
    #[must_use]
    pub fn with_fixed_pdos(mut self) -> Self {
        self.has_fixed_pdos = true;
        self.outputs.fix();
        self.inputs.fix();
        self
    }

    /// Returns the state of CiA 402.
    #[must_use]
    pub const fn state(&self) -> PowerState {
        self.state
    }

    /// Returns the motor.
    #[must_use]
    pub const fn motor(&self) -> &Motor {
        &self.motor
    }

    /// Returns the motor, for the process behind the chain.
    pub const fn motor_mut(&mut self) -> &mut Motor {
        &mut self.motor
    }

    /// Returns an object's value as the drive has it; 0 where it is missing.
    #[must_use]
    pub fn object(&self, index: u16, sub: u8) -> i32 {
        self.objects.get(index, sub)
    }

    /// Sets an object from inside the drive, as an operator at its panel would.
    pub fn set_object(&mut self, index: u16, sub: u8, value: i32) {
        self.objects.set(index, sub, value);
    }

    /// Takes an object out of the dictionary: the drive is one that never had it.
    pub fn remove_object(&mut self, index: u16) {
        self.objects.remove(index);
    }

    /// Returns the largest change of the reference of the position loop from one step to the next,
    /// counts, since the last call; enabling counts as a change from the position at which the
    /// motor stood.
    pub const fn take_largest_step(&mut self) -> i64 {
        let largest = self.largest_step;
        self.largest_step = 0;
        largest
    }

    /// Keeps the drive in a mode of operation, as a parameter of its vendor would: it ignores
    /// 6060h, and can be enabled. `None` ends it.
    pub const fn force_mode(&mut self, mode: Option<i8>) {
        self.forced_mode = mode;
    }

    /// Trips the drive: overcurrent.
    pub fn trip(&mut self) {
        self.fail(ERROR_FORCED);
    }

    pub(super) fn set_watchdog(&mut self, is_writable: bool, has_watchdog: bool) {
        (self.setup.watchdog_is_writable, self.setup.has_watchdog) = (is_writable, has_watchdog);
    }

    const fn has_torque(&self) -> bool {
        matches!(
            self.state,
            PowerState::OperationEnabled | PowerState::QuickStopActive
        )
    }

    fn fail(&mut self, code: i32) {
        if matches!(
            self.state,
            PowerState::Fault | PowerState::FaultReactionActive
        ) {
            return;
        }
        self.set_error(code);
        let next = if self.has_torque() {
            PowerState::FaultReactionActive
        } else {
            PowerState::Fault
        };
        self.enter(next);
    }

    fn set_error(&mut self, code: i32) {
        self.error = code;
        self.objects.set(0x603F, 0, code);
    }

    fn enter(&mut self, state: PowerState) {
        self.state = state;
        self.steps = 0;
        if state == PowerState::OperationEnabled {
            // The loop closes at the reference; a step from where the motor stands would be a jump.
            self.followed = Some(self.motor.position);
            self.velocity = 0;
        }
    }

    /// Returns the status word.
    #[must_use]
    pub fn status(&self) -> u16 {
        let quick_stop_off = 0x20;
        let of_state = match self.state {
            PowerState::SwitchOnDisabled => 0x40,
            PowerState::ReadyToSwitchOn => 0x01 | quick_stop_off,
            PowerState::SwitchedOn => 0x03 | quick_stop_off,
            PowerState::OperationEnabled => 0x07 | quick_stop_off,
            PowerState::QuickStopActive => 0x07,
            PowerState::FaultReactionActive => 0x0F,
            PowerState::Fault => 0x08,
        };
        // The mains are on in every state; remote.
        let always = 0x0010 | 0x0200;
        let follows = self.state == PowerState::OperationEnabled && self.mode() == CSP;
        of_state
            | always
            | if follows { 0x1000 } else { 0 }
            | if self.error == ERROR_FOLLOWING {
                0x2000
            } else {
                0
            }
    }

    fn mode(&self) -> i32 {
        self.forced_mode
            .map_or_else(|| self.objects.get(0x6060, 0), i32::from)
    }

    fn may_be_enabled(&self) -> bool {
        self.forced_mode.is_some() || self.mode() == CSP
    }

    /// Runs the state machine and the generator of the loop's reference for one step.
    pub(super) fn command(&mut self) {
        self.steps = self.steps.saturating_add(1);
        let control = if self.is_operational {
            self.objects.get(0x6040, 0) as u16
        } else {
            0
        };
        let is_reset = control & 0x80 != 0 && self.control & 0x80 == 0;
        self.control = control;
        if let Some(next) = self.next_state(control, is_reset) {
            if self.state == PowerState::Fault {
                self.set_error(0);
            }
            self.enter(next);
        }
        self.objects.set(0x6061, 0, self.mode());
        self.follow();
    }

    /// Transitions of CiA 402 by the control word.
    fn next_state(&self, control: u16, is_reset: bool) -> Option<PowerState> {
        use PowerState as S;
        let disable_voltage = control & 0x02 == 0;
        let quick_stop = control & 0x06 == 0x02;
        let shutdown = control & 0x87 == 0x06;
        let switch_on = control & 0x87 == 0x07;
        let enable = control & 0x8F == 0x0F;
        let powered_long_enough = self.steps >= SWITCH_ON_STEPS;
        Some(match self.state {
            S::SwitchOnDisabled if shutdown => S::ReadyToSwitchOn,
            S::ReadyToSwitchOn if disable_voltage || quick_stop => S::SwitchOnDisabled,
            S::ReadyToSwitchOn if switch_on && powered_long_enough => S::SwitchedOn,
            S::SwitchedOn | S::OperationEnabled | S::QuickStopActive if disable_voltage => {
                S::SwitchOnDisabled
            }
            S::SwitchedOn if quick_stop => S::SwitchOnDisabled,
            S::SwitchedOn if shutdown => S::ReadyToSwitchOn,
            S::SwitchedOn if enable && self.may_be_enabled() && powered_long_enough => {
                S::OperationEnabled
            }
            S::OperationEnabled if quick_stop => S::QuickStopActive,
            S::OperationEnabled if shutdown => S::ReadyToSwitchOn,
            S::OperationEnabled if switch_on && !enable => S::SwitchedOn,
            S::QuickStopActive if self.velocity == 0 => S::SwitchOnDisabled,
            S::FaultReactionActive if self.velocity == 0 => S::Fault,
            S::Fault if is_reset => S::SwitchOnDisabled,
            _ => return None,
        })
    }

    /// Moves the reference of the position loop: along the process data, or to a stop.
    fn follow(&mut self) {
        let motor = &mut self.motor;
        motor.is_enabled = matches!(
            self.state,
            PowerState::OperationEnabled
                | PowerState::QuickStopActive
                | PowerState::FaultReactionActive
        );
        if self.state == PowerState::OperationEnabled {
            motor.position_offset = self.objects.get(0x60B0, 0);
            motor.velocity_offset = self.objects.get(0x60B1, 0);
            motor.torque_offset = self.objects.get(0x60B2, 0) as i16;
            motor.reference =
                i64::from(self.objects.get(0x607A, 0)) + i64::from(motor.position_offset);
            let from = self.followed.unwrap_or(motor.position);
            self.velocity = motor.reference - from;
            self.largest_step = self.largest_step.max(self.velocity.abs());
            self.followed = Some(motor.reference);
        } else if motor.is_enabled {
            (motor.velocity_offset, motor.torque_offset) = (0, 0);
            let per_step = i64::from(self.objects.get(0x6085, 0) as u32) / 1_000_000;
            let braked = (self.velocity.abs() - per_step.max(1)).max(0);
            self.velocity = self.velocity.signum() * braked;
            motor.reference += self.velocity;
        } else {
            (motor.velocity_offset, motor.torque_offset) = (0, 0);
            motor.reference = motor.position;
            self.velocity = 0;
            self.followed = None;
        }
    }

    /// Takes note of what the process did to the motor.
    pub(super) fn measure(&mut self) {
        let motor = self.motor;
        let position =
            (motor.position + motor.pushed).clamp(i32::MIN.into(), i32::MAX.into()) as i32;
        self.objects.set(0x6064, 0, position);
        self.objects.set(0x606C, 0, motor.velocity);
        self.objects.set(0x6077, 0, motor.torque.into());
        self.objects.set(0x6041, 0, self.status().into());
        let window = i64::from(self.objects.get(0x6065, 0) as u32);
        let is_outside = motor.is_enabled && (motor.reference - motor.position).abs() > window;
        self.outside_steps = if is_outside {
            self.outside_steps.saturating_add(1)
        } else {
            0
        };
        if self.outside_steps > (self.objects.get(0x6066, 0) as u16).into() {
            self.fail(ERROR_FOLLOWING);
        }
    }
}

impl Device for Drive {
    fn sii(&self) -> Sii {
        Sii {
            identity: self.setup.identity,
            alias: self.setup.alias,
            name: self.name(),
            protocols: COE,
            has_process_data: true,
            has_watchdog: self.setup.has_watchdog,
        }
    }

    fn lengths(&self) -> [usize; 2] {
        [&self.outputs, &self.inputs].map(Pdo::length)
    }

    fn answer(
        &mut self,
        request: &[u8],
        last_counter: &mut u8,
        is_pre_op: bool,
    ) -> Option<Vec<u8>> {
        mailbox::answer(self, request, last_counter, is_pre_op)
    }

    /// A drive that leaves OP while it has power brakes, and is in fault.
    fn set_operational(&mut self, is_operational: bool) {
        if self.is_operational && !is_operational && self.has_torque() {
            self.fail(ERROR_BUS);
        }
        if !is_operational {
            self.control = 0;
        }
        self.is_operational = is_operational;
    }

    fn take_outputs(&mut self, data: &[u8]) {
        if self.is_operational {
            self.outputs.unpack(data, &mut self.objects);
        }
    }

    fn inputs(&mut self, data: &mut [u8; MAX_PROCESS_DATA]) -> usize {
        self.objects.set(0x6041, 0, self.status().into());
        self.inputs.pack(&self.objects, data)
    }

    fn power_cycle(&mut self) {
        let position = self.motor.position;
        let mut again = Self::new(&DriveSetup {
            position: position.clamp(i32::MIN.into(), i32::MAX.into()) as i32,
            ..self.setup.clone()
        });
        if let Some(types) = self.synchronisation {
            again = again.with_synchronisation(types);
        }
        if self.has_fixed_pdos {
            again = again.with_fixed_pdos();
        }
        again.requires_sync0 = self.requires_sync0;
        again.keeps_synchronisation = self.keeps_synchronisation;
        *self = again;
    }

    fn sync0(&mut self) {
        self.command();
    }

    fn requires_sync0(&self) -> bool {
        self.requires_sync0
    }

    fn watchdog_is_writable(&self) -> bool {
        self.setup.watchdog_is_writable
    }
}

impl Dictionary for Drive {
    fn name(&self) -> &'static str {
        "emulated drive"
    }

    fn upload(&self, index: u16, sub: u8) -> Result<([u8; 4], usize), u32> {
        for pdo in [&self.outputs, &self.inputs] {
            if pdo.owns(index) {
                return pdo.upload(index, sub);
            }
        }
        self.objects.upload(index, sub)
    }

    fn download(&mut self, index: u16, sub: u8, bytes: &[u8], is_pre_op: bool) -> Result<(), u32> {
        for pdo in [&mut self.outputs, &mut self.inputs] {
            if pdo.owns(index) {
                return if is_pre_op {
                    pdo.download(index, sub, bytes, &self.objects)
                } else {
                    Err(abort::STATE)
                };
            }
        }
        if self.keeps_synchronisation && matches!(index, 0x1C32 | 0x1C33) {
            return Ok(());
        }
        self.objects.download(index, sub, bytes)
    }
}
