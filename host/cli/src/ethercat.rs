//! Drives over EtherCAT behind [`Plant`](gantry_tau_server::plant::Plant): units, axes, and what is
//! in force. The bus is `gantry_tau_ethercat`'s.

mod bus_reports;
mod emulated;
mod fault_log;
mod gauge_link;
pub mod gauges;
mod initial_state;
mod open;
mod places;
mod plant;
mod told;

pub use emulated::{EmulatedBus, EmulatedMachine, emulated_bus, emulated_bus_of};
pub use fault_log::FaultLog;
pub use open::EthercatError;
pub use plant::{EthercatPlant, MachineWire};
