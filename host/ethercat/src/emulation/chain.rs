//! A chain of SubDevices that frames pass through, and the process that their motors move.

use super::drive::{Drive, DriveSetup, STEP_US};
use super::instrument::Instrument;
use super::slots::{Controller, Node, Slots};
use super::subdevice::SubDevice;

/// Time that a frame takes to the chain, ns.
const FRAME_NS: u64 = 10_000;
/// Time that a frame takes from one SubDevice to the next, ns.
const HOP_NS: u64 = 310;
/// Step of the drives and the process, ns.
const STEP_NS: u64 = STEP_US * 1_000;
/// Headers of a frame and of a datagram, bytes.
const FRAME_HEADER: usize = 16;
const DATAGRAM_HEADER: usize = 10;
/// EtherType.
const ETHERCAT: [u8; 2] = [0x88, 0xA4];
/// Longest datagram, bytes.
const MAX_DATAGRAM: usize = 1_500;

/// Machine behind the drives.
pub trait Process: Send {
    /// Runs one millisecond: motors that are enabled follow their references, the others are held
    /// by their brakes.
    fn step(&mut self, drives: &mut [SubDevice]);

    /// Shows the instruments what they measure, after each step.
    fn measure(&mut self, instruments: &mut [SubDevice<Instrument>]) {
        let _ = instruments;
    }
}

/// A write of a MainDevice that a SubDevice took.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Write {
    /// Place of the SubDevice.
    pub position: usize,
    /// Physical address; `None` for one by logical address.
    pub address: Option<u16>,
    /// Data.
    pub data: Vec<u8>,
}

/// Motors that close in on their references, half of the way in each step: enough where no machine
/// is behind them.
#[derive(Clone, Copy, Debug, Default)]
pub struct Kinematic;

impl Process for Kinematic {
    fn step(&mut self, drives: &mut [SubDevice]) {
        for subdevice in drives {
            let motor = subdevice.drive_mut().motor_mut();
            let way = motor.reference - motor.position;
            let step = if motor.is_enabled {
                (way + way.signum()) / 2
            } else {
                0
            };
            motor.position += step;
            motor.velocity = (step * 1_000).clamp(i32::MIN.into(), i32::MAX.into()) as i32;
        }
    }
}

/// A chain of drives and other devices. Its time is given by the caller: nothing happens between two calls.
#[derive(Clone, Debug)]
pub struct Chain<P> {
    slots: Slots,
    process: P,
    now_ns: u64,
    step_ns: u64,
    /// SubDevices that frames reach; a cut cable is closed to a ring before it.
    reached: usize,
    /// A SubDevice that frames pass by.
    bypassed: Option<usize>,
    /// Writes since the log began.
    writes: Option<Vec<Write>>,
}

impl<P: Process> Chain<P> {
    /// Creates a chain of drives that have just been powered.
    pub fn new(drives: &[DriveSetup], process: P) -> Self {
        let drives = drives.iter().map(SubDevice::new).map(Node::Drive);
        Self::of(drives.collect(), process)
    }

    /// Creates a chain.
    pub fn of(nodes: Vec<Node>, process: P) -> Self {
        let mut chain = Self {
            reached: nodes.len(),
            slots: Slots::new(nodes),
            process,
            now_ns: 0,
            step_ns: STEP_NS,
            bypassed: None,
            writes: None,
        };
        chain.set_ports();
        chain
    }

    /// Returns the time, µs.
    #[must_use]
    pub const fn now_us(&self) -> u64 {
        self.now_ns / 1_000
    }

    /// Returns the time, ns.
    #[must_use]
    pub const fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// Returns the drive at a place, from 0 at the MainDevice; `None` where another device stands.
    #[must_use]
    pub fn subdevice(&self, position: usize) -> Option<&SubDevice> {
        self.slots.drive(position)
    }

    /// Returns the drive at a place, to be handled.
    pub fn subdevice_mut(&mut self, position: usize) -> Option<&mut SubDevice> {
        self.slots.drive_mut(position)
    }

    /// Returns the device at a place that is no drive, to be handled.
    pub fn instrument_mut(&mut self, position: usize) -> Option<&mut SubDevice<Instrument>> {
        self.slots.instrument_mut(position)
    }

    /// Returns the drives.
    pub fn drives(&self) -> impl Iterator<Item = &Drive> {
        self.slots.drives.iter().map(SubDevice::drive)
    }

    /// Returns the drives, to be handled.
    pub fn drives_mut(&mut self) -> impl Iterator<Item = &mut Drive> {
        self.slots.drives.iter_mut().map(SubDevice::drive_mut)
    }

    /// Returns the highest state of the application layer that any SubDevice has had.
    pub fn highest_state(&mut self) -> u8 {
        let mut highest = 0;
        self.slots
            .for_each(|_, controller| highest = highest.max(controller.highest_state()));
        highest
    }

    /// Logs from now on what SubDevices take.
    pub fn log_writes(&mut self) {
        self.writes = Some(Vec::new());
    }

    /// Returns what SubDevices took since the log began.
    #[must_use]
    pub fn writes(&self) -> &[Write] {
        self.writes.as_deref().unwrap_or(&[])
    }

    /// Returns the process behind the drives.
    pub const fn process_mut(&mut self) -> &mut P {
        &mut self.process
    }

    /// Swaps the places of two SubDevices.
    pub fn swap(&mut self, first: usize, second: usize) {
        self.slots.swap(first, second);
        self.set_ports();
    }

    /// Cuts the cable behind the first `reached` SubDevices; their number mends it.
    pub fn cut_behind(&mut self, reached: usize) {
        self.reached = reached.min(self.slots.len());
        self.set_ports();
    }

    /// Lets frames pass by a SubDevice, as if it had no power and a closed relay; `None` mends it.
    pub const fn bypass(&mut self, subdevice: Option<usize>) {
        self.bypassed = subdevice;
    }

    fn set_ports(&mut self) {
        let last = self.reached.saturating_sub(1);
        self.slots
            .for_each(|position, controller| controller.set_ports(position < last));
    }

    /// Runs to a time, µs; see [`advance_to_ns`](Self::advance_to_ns).
    pub fn advance_to(&mut self, now_us: u64) {
        self.advance_to_ns(now_us.saturating_mul(1_000));
    }

    /// Runs to a time, ns: state machines, watchdogs, pulses of SYNC0, and the process once per
    /// millisecond.
    pub fn advance_to_ns(&mut self, now_ns: u64) {
        while self.step_ns <= now_ns {
            let at = self.step_ns;
            self.now_ns = self.now_ns.max(at);
            self.slots
                .for_each(|_, controller| controller.advance_to(at));
            // A drive with SYNC0 runs by its pulses.
            let freely = self
                .slots
                .drives
                .iter_mut()
                .filter(|drive| !drive.has_sync0());
            freely.for_each(|subdevice| subdevice.drive_mut().command());
            self.process.step(&mut self.slots.drives);
            self.drives_mut().for_each(Drive::measure);
            self.process.measure(&mut self.slots.instruments);
            self.step_ns += STEP_NS;
        }
        self.now_ns = self.now_ns.max(now_ns);
        let now_ns = self.now_ns;
        self.slots
            .for_each(|_, controller| controller.advance_to(now_ns));
    }

    /// Passes a frame through the chain and back, in place; the time goes on by its way. False if
    /// it is not of EtherCAT, or broken.
    pub fn pass(&mut self, frame: &mut [u8]) -> bool {
        self.advance_to_ns(self.now_ns + FRAME_NS);
        if frame.get(12..14) != Some(&ETHERCAT) || self.reached == 0 {
            return false;
        }
        let header = frame
            .get(14..16)
            .and_then(|bytes| bytes.try_into().ok())
            .map_or(0, u16::from_le_bytes);
        let end = FRAME_HEADER + usize::from(header & 0x07FF);
        // The first SubDevice marks the source address as locally administered.
        if let Some(source) = frame.get_mut(6) {
            *source |= 0x02;
        }
        let mut at = FRAME_HEADER;
        while let Some(datagram) = frame.get_mut(at..end) {
            let Some((length, is_last)) = self.datagram(datagram) else {
                return false;
            };
            at += length;
            if is_last {
                return true;
            }
        }
        false
    }

    /// Executes a datagram. Returns its length and true for the last one; `None` if it is broken.
    fn datagram(&mut self, bytes: &mut [u8]) -> Option<(usize, bool)> {
        let command = *bytes.first()?;
        let (mut address, offset) = (word(bytes, 2)?, word(bytes, 4)?);
        let flags = word(bytes, 6)?;
        let length = usize::from(flags & 0x07FF);
        let end = DATAGRAM_HEADER + length;
        let mut counter = word(bytes, end)?;
        let data = bytes.get_mut(DATAGRAM_HEADER..end)?;
        for position in 0..self.reached {
            if self.bypassed == Some(position) {
                continue;
            }
            let Some(controller) = self.slots.controller(position) else {
                continue;
            };
            let (before, behind) = (position as u64, (self.reached - 1 - position) as u64);
            let here_ns = self.now_ns + before * HOP_NS;
            controller.set_passing(here_ns, here_ns + 2 * behind * HOP_NS);
            let is_selected = match command {
                1..=3 | 13 => address == 0,
                4..=6 | 14 => controller.answers_to(address),
                _ => true,
            };
            let sent = self.writes.is_some().then(|| data.to_vec());
            let grown = execute(controller, command, is_selected, (address, offset), data);
            counter = counter.wrapping_add(grown);
            if let (Some(log), Some(data)) = (&mut self.writes, sent) {
                if grown > 0 && writes(command, is_selected) {
                    let address = (!matches!(command, 10..=12)).then_some(offset);
                    log.push(Write {
                        position,
                        address,
                        data,
                    });
                }
            }
            if matches!(command, 1..=3 | 7..=9 | 13) {
                address = address.wrapping_add(1);
            }
        }
        bytes.get_mut(2..4)?.copy_from_slice(&address.to_le_bytes());
        bytes
            .get_mut(end..end + 2)?
            .copy_from_slice(&counter.to_le_bytes());
        Some((end + 2, flags & 0x8000 == 0))
    }
}

/// Word at a place of a datagram.
fn word(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(bytes.get(at..at + 2)?.try_into().ok()?))
}

/// True for a command that writes at a SubDevice.
const fn writes(command: u8, is_selected: bool) -> bool {
    match command {
        2 | 3 | 5 | 6 | 8 | 9 | 11 | 12 => true,
        13 | 14 => !is_selected,
        _ => false,
    }
}

/// Executes a command at one SubDevice. Returns what the working counter grows by.
fn execute(
    subdevice: &mut dyn Controller,
    command: u8,
    is_selected: bool,
    (address, offset): (u16, u16),
    data: &mut [u8],
) -> u16 {
    let logical = u32::from(offset) << 16 | u32::from(address);
    match command {
        1 | 4 if is_selected => subdevice.read(offset, data).into(),
        2 | 5 | 8 if is_selected => subdevice.write(offset, data).into(),
        3 | 6 | 9 if is_selected => read_and_write(subdevice, offset, data, command == 9),
        7 => read_broadcast(subdevice, offset, data),
        10 => subdevice.logical(logical, data, true, 0),
        11 => subdevice.logical(logical, data, false, 1),
        12 => subdevice.logical(logical, data, true, 2),
        // Read at one, write at all others.
        13 | 14 if is_selected => subdevice.read(offset, data).into(),
        13 | 14 => subdevice.write(offset, data).into(),
        _ => 0,
    }
}

/// Reads into the datagram by a logical or, as broadcasts do.
fn read_broadcast(subdevice: &mut dyn Controller, offset: u16, data: &mut [u8]) -> u16 {
    let mut room = [0_u8; MAX_DATAGRAM];
    let Some(own) = room.get_mut(..data.len()) else {
        return 0;
    };
    let was_read = subdevice.read(offset, own);
    for (byte, own) in data.iter_mut().zip(own) {
        *byte |= *own;
    }
    was_read.into()
}

fn read_and_write(
    subdevice: &mut dyn Controller,
    offset: u16,
    data: &mut [u8],
    broadcast: bool,
) -> u16 {
    let mut room = [0_u8; MAX_DATAGRAM];
    let Some(sent) = room.get_mut(..data.len()) else {
        return 0;
    };
    sent.copy_from_slice(data);
    let was_read = if broadcast {
        read_broadcast(subdevice, offset, data)
    } else {
        subdevice.read(offset, data).into()
    };
    was_read + if subdevice.write(offset, sent) { 2 } else { 0 }
}
