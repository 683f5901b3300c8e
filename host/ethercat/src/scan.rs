//! Lists the devices of a bus, without moving anything: who is there, what it speaks, and whether
//! the server could drive it.
//!
//! Devices are brought to PRE-OP, read, and taken back to INIT. They are read by their registers
//! and mailboxes directly: ethercrab's own initialisation also writes FMMUs and distributed clocks,
//! and asserts that no emergency message comes between a request and its answer.

mod dictionary;
mod mailbox;
mod station;
mod verdict;

use ethercrab::error::Error;
use ethercrab::{Command, MainDevice, RegisterAddress};

use crate::discovery::FIRST_STATION;
use crate::main_device::main_device;
use crate::wire::Wire;
pub use dictionary::{Answer, Dictionary, FIRST_AXIS, Mapping, SECOND_AXIS};
use mailbox::Mailbox;
use station::Station;
pub use verdict::Verdict;

/// Longest wait for the answer to a frame, µs.
const ANSWER_US: u32 = 5_000;
/// Largest number of devices.
const MAX_DEVICES: u16 = 256;
/// Time for a scan, s.
const SCAN_S: u32 = 600;

/// Options of a scan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// Writes to 1C12h, 1C13h, 1600h and 1A00h of drives what they hold, to find out whether their
    /// mapping can be written.
    pub tries_mapping: bool,
}

/// Error of a scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ScanError {
    /// No device answers.
    #[error("no SubDevice answers; is it the right interface, and is the bus powered?")]
    Silent,
    /// There are more devices than a scan lists.
    #[error("there are more than {MAX_DEVICES} SubDevices on the bus")]
    TooMany,
    /// An exchange failed.
    #[error("{step}: {error}")]
    Bus {
        /// The step.
        step: &'static str,
        /// Error of the exchange.
        error: Error,
    },
    /// The scan did not end.
    #[error("the bus answers, but the scan did not end within {seconds} s")]
    Overdue {
        /// Time given, s.
        seconds: u32,
    },
}

/// Mailbox protocols of a device, as word 1Ch of its EEPROM lists them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Protocols(pub u16);

impl Protocols {
    const NAMES: [(u16, &'static str); 6] = [
        (0x01, "AoE"),
        (0x02, "EoE"),
        (0x04, "CoE"),
        (0x08, "FoE"),
        (0x10, "SoE"),
        (0x20, "VoE"),
    ];

    /// True with CAN application protocol over EtherCAT.
    #[must_use]
    pub const fn has_coe(self) -> bool {
        self.0 & 0x04 != 0
    }

    /// True with the servo drive profile over EtherCAT.
    #[must_use]
    pub const fn has_soe(self) -> bool {
        self.0 & 0x10 != 0
    }

    /// Returns the names of the protocols.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Self::NAMES
            .into_iter()
            .filter(move |(bit, _)| self.0 & bit != 0)
            .map(|(_, name)| name)
    }
}

/// Distributed clock of a device, by bits 2 and 3 of register 0008h.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClockWidth {
    /// None.
    None,
    /// A clock of 32 bits.
    Bits32,
    /// A clock of 64 bits.
    Bits64,
}

/// A device of the bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Device {
    /// Number of devices before it.
    pub position: u16,
    /// Alias of its EEPROM; 0 for none.
    pub alias: u16,
    /// Name of its EEPROM; empty for none.
    pub name: String,
    /// Vendor.
    pub vendor: u32,
    /// Product code.
    pub product: u32,
    /// Revision.
    pub revision: u32,
    /// Serial number.
    pub serial: u32,
    /// Mailbox protocols.
    pub protocols: Protocols,
    /// Distributed clock.
    pub clock: ClockWidth,
    /// AL status code by which it refused PRE-OP.
    pub refused_pre_op: Option<u16>,
    /// Objects; `None` of a device without CoE, or without PRE-OP.
    pub dictionary: Option<Dictionary>,
    /// Error codes of the emergency messages that came while it was read.
    pub emergencies: Vec<u16>,
}

impl Device {
    /// Returns what the server can do with it.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        Verdict::of(self)
    }
}

/// Lists the devices behind a wire, from the nearest on. Blocks; a device that answers nothing
/// costs a few seconds. Memory of about 20 KiB per call is kept to the end of the process.
///
/// # Errors
/// [`ScanError`]: nothing answers, or the bus as a whole fails.
pub fn scan<W: Wire>(wire: W, options: Options) -> Result<Vec<Device>, ScanError> {
    let Some((mut pump, main)) = main_device(wire, ANSWER_US) else {
        return Err(ScanError::Silent);
    };
    let limit_us = u64::from(SCAN_S) * 1_000_000;
    let overdue = ScanError::Overdue { seconds: SCAN_S };
    let found = pump.run(devices(main, options), limit_us).ok_or(overdue);
    // After an error, too: no device is left in PRE-OP.
    let init = Command::bwr(RegisterAddress::AlControl.into())
        .ignore_wkc()
        .send(main, station::ACKNOWLEDGE | station::INIT);
    let _sent = pump.run(init, u64::from(ANSWER_US) * 20);
    found?
}

async fn devices(
    main: &'static MainDevice<'static>,
    options: Options,
) -> Result<Vec<Device>, ScanError> {
    let mut count = 0_u16;
    while station::answers(main, count).await? {
        count += 1;
        if count > MAX_DEVICES {
            return Err(ScanError::TooMany);
        }
    }
    if count == 0 {
        return Err(ScanError::Silent);
    }
    for position in 0..count {
        station::address(main, position, FIRST_STATION.wrapping_add(position)).await?;
    }
    let mut devices = Vec::new();
    for position in 0..count {
        let station = Station::new(main, FIRST_STATION.wrapping_add(position));
        devices.push(device(&station, position, options).await?);
    }
    Ok(devices)
}

/// Reads one device.
async fn device(station: &Station, position: u16, options: Options) -> Result<Device, ScanError> {
    let sii = station.sii().await?;
    let mut device = Device {
        position,
        alias: sii.alias,
        name: sii.name,
        vendor: sii.vendor,
        product: sii.product,
        revision: sii.revision,
        serial: sii.serial,
        protocols: Protocols(sii.protocols),
        clock: station.clock().await?,
        refused_pre_op: None,
        dictionary: None,
        emergencies: Vec::new(),
    };
    let mailboxes = sii.mailboxes.filter(|_| sii.protocols != 0);
    device.refused_pre_op = station.to_pre_op(mailboxes).await?;
    let Some(mailboxes) = mailboxes.filter(|_| device.refused_pre_op.is_none()) else {
        return Ok(device);
    };
    if device.protocols.has_coe() {
        let mut mailbox = Mailbox::new(station, mailboxes);
        device.dictionary = Some(dictionary::read(&mut mailbox, options).await?);
        device.emergencies = mailbox.emergencies;
    }
    Ok(device)
}
