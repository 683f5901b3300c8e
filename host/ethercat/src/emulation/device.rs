//! The application behind the controller of a SubDevice.

use super::sii::Sii;

/// Longest process data of one direction, bytes.
pub const MAX_PROCESS_DATA: usize = 40;

/// An emulated application: what its EEPROM says, what its mailbox answers, and its process data.
///
/// Registers, states, sync managers and FMMUs belong to the controller, [`SubDevice`].
///
/// [`SubDevice`]: super::SubDevice
pub trait Device: std::fmt::Debug {
    /// Returns the contents of the EEPROM.
    fn sii(&self) -> Sii;

    /// Returns the lengths of outputs and inputs, bytes: SAFE-OP is refused to any others.
    fn lengths(&self) -> [usize; 2];

    /// Answers a request in the mailbox. `None` for one that is ignored: a repeated one, or any
    /// where the device has no mailbox.
    fn answer(&mut self, request: &[u8], last_counter: &mut u8, is_pre_op: bool)
    -> Option<Vec<u8>>;

    /// Says whether process data is valid: the SubDevice is in OP.
    fn set_operational(&mut self, is_operational: bool);

    /// Takes outputs that have just been written whole.
    fn take_outputs(&mut self, data: &[u8]);

    /// Writes the inputs; returns their length.
    fn inputs(&mut self, data: &mut [u8; MAX_PROCESS_DATA]) -> usize;

    /// Starts over as after a loss of power: what was configured is lost, what the machine behind
    /// the device has stays.
    fn power_cycle(&mut self);

    /// Runs a cycle of the device, with the outputs that came before this pulse of SYNC0.
    fn sync0(&mut self) {}

    /// True if the device leaves OP without SYNC0.
    fn requires_sync0(&self) -> bool {
        false
    }

    /// True if the controller takes writes to the time of the watchdog.
    fn watchdog_is_writable(&self) -> bool {
        true
    }
}
