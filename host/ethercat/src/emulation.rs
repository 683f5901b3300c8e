//! A chain of emulated drives: what MainDevices are tested against, and what a user without
//! hardware tries.
//!
//! It refuses what a SubDevice refuses: states without their sync managers, outputs before SAFE-OP,
//! mappings outside PRE-OP, mailboxes that are full, datagrams that are part of a sync manager's
//! area; grants states after a time; and lets its drives brake when it leaves OP. Not emulated:
//! distributed clocks, bits in FMMUs, segmented transfers, emergencies, writes to the EEPROM.

mod chain;
mod device;
mod drive;
mod instrument;
mod mailbox;
mod mapping;
mod memory;
mod objects;
mod sii;
mod slots;
mod subdevice;
mod sync_manager;
mod wire;

pub use chain::{Chain, Kinematic, Process, Write};
pub use device::{Device, MAX_PROCESS_DATA};
pub use drive::{Drive, DriveSetup, Motor, PowerState, STEP_US};
pub use instrument::{Encoder, EncoderModel, ForceSensor, ForceUnits, Instrument, Plain};
pub use sii::{COE, Identity, SOE, Sii};
pub use slots::Node;
pub use subdevice::SubDevice;
pub use wire::{Bench, EmulatedWire, Faults};
