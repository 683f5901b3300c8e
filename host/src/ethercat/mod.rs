//! Drives over EtherCAT behind [`Plant`](crate::plant::Plant): units, axes, and what is in force. The bus is `gantry_tau_ethercat`'s.

mod emulated;
mod open;
mod plant;
mod standing;

pub use emulated::{EmulatedBus, EmulatedMachine, emulated_bus};
pub use open::EthercatError;
pub use plant::{EthercatPlant, FaultLog, Machine};
