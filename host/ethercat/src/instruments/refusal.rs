//! Reasons for which an instrument cannot be used, and for which one has no reading.

use ethercrab::AlStatusCode;
use ethercrab::error::Error;

use crate::discovery::DevicePlace;

/// Reason for which an instrument cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum InstrumentRefusal {
    /// It is not there.
    #[error("no device at {place} among the {found} SubDevices of the bus")]
    Missing {
        /// Its place.
        place: DevicePlace,
        /// SubDevices that answer.
        found: usize,
    },
    /// Two SubDevices have one alias, or two instruments one device.
    #[error("{place} is not one device for one instrument")]
    Ambiguous {
        /// Its place.
        place: DevicePlace,
    },
    /// Another device stands there.
    #[error(
        "at {place} is product {found_product:#010x} of vendor {found_vendor:#010x}; expected \
         {product:#010x} of {vendor:#010x} (are two devices swapped?)"
    )]
    Identity {
        /// Its place.
        place: DevicePlace,
        /// Vendor expected.
        vendor: u32,
        /// Product expected.
        product: u32,
        /// Vendor found.
        found_vendor: u32,
        /// Product found.
        found_product: u32,
    },
    /// Its inputs are not those that are known.
    #[error("its inputs are of {bits} bits; {expected}")]
    Map {
        /// Bits of the inputs.
        bits: u32,
        /// Values that are expected.
        expected: &'static str,
    },
    /// It lacks an object.
    #[error("it lacks object {object:04X}h:{sub:02X}h, {purpose}")]
    Lacks {
        /// The object.
        object: u16,
        /// Sub-index.
        sub: u8,
        /// Its purpose.
        purpose: &'static str,
    },
    /// An object has a value that cannot be used.
    #[error("object {object:04X}h:{sub:02X}h, {purpose}, is {value}; expected {expected}")]
    Value {
        /// The object.
        object: u16,
        /// Sub-index.
        sub: u8,
        /// Its purpose.
        purpose: &'static str,
        /// Its value.
        value: i32,
        /// Values that are expected.
        expected: &'static str,
    },
    /// An exchange failed.
    #[error("{step} failed: {error}")]
    Exchange {
        /// The step.
        step: &'static str,
        /// The error.
        error: Error,
    },
    /// It does not take the state.
    #[error("the device does not go to OP, and stays in state {state}: {code}")]
    NotOperational {
        /// Its state, as of AL status.
        state: u8,
        /// AL status code.
        code: AlStatusCode,
    },
}

/// Reason for which an instrument has no reading in a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoReading {
    /// The frame did not come back in time.
    #[error("the bus does not answer")]
    NoAnswer,
    /// There was no time left in the cycle: the drives come first.
    #[error("the cycle had no time left for it")]
    Skipped,
    /// The frame came back, and not all instruments had filled it.
    #[error("the working counter is wrong")]
    WorkingCounter,
    /// The device is not in OP.
    #[error("the device is in state {state}, not in OP")]
    State {
        /// Its state, as of AL status; 0 of one that does not answer: it was restarted, or its
        /// cable is open. After a restart it stays without: the count of a terminal is another one.
        state: u8,
    },
    /// A wire of the gauge is open.
    #[error("a wire of the gauge is open")]
    OpenCircuit,
    /// The terminal reports a synchronisation error.
    #[error("the terminal reports a synchronisation error")]
    SyncError,
    /// The terminal reports that its inputs are invalid.
    #[error("the terminal reports that its inputs are invalid")]
    Invalid,
    /// The device has given the same value for three cycles, by its toggle bit or its counter of
    /// samples.
    #[error("the device gives no new values")]
    Frozen,
    /// A counter of 16 bits gave no count for so long that it may have turned.
    #[error("a counter of 16 bits was silent for too long to be followed; begin again")]
    LostTurns,
    /// The force sensor reports a fault, a saturated gauge, or a wrong checksum of its calibration.
    #[error("the sensor reports a fault: status {status:08X}h")]
    SensorFault {
        /// Its status.
        status: u32,
    },
}
