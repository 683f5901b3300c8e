//! A chain of emulated drives and instruments: what MainDevices are tested against, and what a user
//! without hardware tries.
//!
//! It refuses what a SubDevice refuses: states without their sync managers, outputs before SAFE-OP,
//! OP without SYNC0 where a drive requires it, mappings outside PRE-OP, mailboxes that are full,
//! datagrams that are part of a sync manager's area; grants states after a time; and lets its drives
//! brake when it leaves OP. Not emulated: bits in FMMUs, segmented transfers, writes to the EEPROM.

mod chain;
mod device;
mod distributed_clock;
mod drive;
mod instrument;
mod mailbox;
mod mapping;
mod memory;
mod objects;
mod showcase;
mod sii;
mod slots;
mod subdevice;
mod sync_manager;
mod wire;

pub use chain::{Chain, Kinematic, Process, Write};
pub use device::{Device, MAX_PROCESS_DATA};
pub use distributed_clock::ClockSetup;
pub use drive::{Drive, DriveSetup, Motor, PowerState, STEP_US};
pub use instrument::{EncoderModel, EncoderTerminal, ForceTerminal, ForceUnits, Instrument, Plain};
pub use showcase::one_of_every_kind;
pub use sii::{COE, Identity, SOE, Sii};
pub use slots::Node;
pub use subdevice::{ClockHandle, SubDevice, Sync0Intervals};
pub use wire::{Bench, EmulatedWire, Faults};
