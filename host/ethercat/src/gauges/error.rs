//! Errors of a bring-up of gauges, and reasons for which a gauge has no count.

use ethercrab::AlStatusCode;
use ethercrab::error::Error;

use crate::discovery::{DevicePlace, DiscoveryError, MAX_SUBDEVICES};

/// Error of a bring-up of gauges.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GaugesError {
    /// No device answers.
    #[error("no SubDevice answers; is it the right interface, and is the bus powered?")]
    Silent,
    /// There are more SubDevices than this program handles.
    #[error("there are more than {MAX_SUBDEVICES} SubDevices on the bus")]
    TooMany,
    /// The bus as a whole failed.
    #[error("the bus failed in {step}: {error}")]
    Bus {
        /// The step.
        step: &'static str,
        /// The error.
        error: Error,
    },
    /// It took too long.
    #[error("the bus is not ready after {seconds} s")]
    Overdue {
        /// Time, s.
        seconds: u32,
    },
    /// A message came that the bus library does not handle.
    #[error("the bus sent a message that this program does not handle: an emergency, say")]
    Unhandled,
    /// A terminal cannot be used.
    #[error("{reason}")]
    Gauge {
        /// Index of its gauge.
        gauge: usize,
        /// The reason.
        reason: GaugeRefusal,
    },
}

/// Reason for which the terminal of a gauge cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GaugeRefusal {
    /// It is not there.
    #[error("no device at {place} among the {found} SubDevices of the bus")]
    Missing {
        /// Its place.
        place: DevicePlace,
        /// SubDevices that answer.
        found: usize,
    },
    /// Two SubDevices have one alias, or two gauges one terminal.
    #[error("{place} is not one terminal for one gauge")]
    Ambiguous {
        /// Its place.
        place: DevicePlace,
    },
    /// Another device stands there.
    #[error(
        "at {place} is product {found_product:#010x} of vendor {found_vendor:#010x}; expected \
         {product:#010x} of {vendor:#010x} (are two terminals swapped?)"
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
    /// Its inputs are not those of a counter.
    #[error(
        "its inputs are of {bits} bits; a counter's are of 80, 48 or 40: status, counter and latch"
    )]
    Map {
        /// Bits of the inputs.
        bits: u32,
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
    #[error("the terminal does not go to OP, and stays in state {state}: {code}")]
    NotOperational {
        /// Its state, as of AL status.
        state: u8,
        /// AL status code.
        code: AlStatusCode,
    },
}

impl From<DiscoveryError> for GaugesError {
    fn from(error: DiscoveryError) -> Self {
        match error {
            DiscoveryError::Silent => Self::Silent,
            DiscoveryError::TooMany => Self::TooMany,
            DiscoveryError::Bus(error) => Self::Bus {
                step: "looking for SubDevices",
                error,
            },
        }
    }
}

/// Reason for which a gauge has no count in a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoCount {
    /// The frame did not come back in time.
    #[error("the bus does not answer")]
    NoAnswer,
    /// The frame came back, and not all terminals had filled it.
    #[error("the working counter is wrong")]
    WorkingCounter,
    /// The terminal is not in OP.
    #[error("the terminal is in state {state}, not in OP")]
    State {
        /// Its state, as of AL status; 0 of one that does not answer: it was restarted, or its
        /// cable is open. After a restart its count is another one, and the gauge stays without.
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
    /// The terminal has given the same value for three cycles, by its toggle bit.
    #[error("the terminal gives no new values")]
    Frozen,
    /// A counter of 16 bits gave no count for so long that it may have turned.
    #[error("a counter of 16 bits was silent for too long to be followed; begin again")]
    LostTurns,
}
