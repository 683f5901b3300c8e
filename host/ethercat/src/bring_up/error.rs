//! Errors of a bring-up.

use ethercrab::AlStatusCode;
use ethercrab::error::Error;

use crate::discovery::{BusError, DevicePlace};
use crate::instruments::InstrumentRefusal;

/// Error of a bring-up. Motors are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BringUpError {
    /// Settings that cannot be.
    #[error(
        "a watchdog of {cycles} cycles; expected 1 to 10 (EtherCAT's default of 100 ms is too long), a whole number of 100 us"
    )]
    Watchdog {
        /// Cycles asked for.
        cycles: u32,
    },
    /// The bus as a whole failed.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// The force sensor cannot be used.
    #[error("the force sensor: {reason}")]
    ForceSensor {
        /// The reason.
        reason: InstrumentRefusal,
    },
    /// A gauge cannot be used. Gauges are counted from 0.
    #[error("gauge {gauge}: {reason}")]
    Gauge {
        /// Index of the gauge.
        gauge: u8,
        /// The reason.
        reason: InstrumentRefusal,
    },
    /// A drive is not there.
    #[error("motor {motor}: no drive at {place} among the {found} SubDevices of the bus")]
    Missing {
        /// The motor.
        motor: u8,
        /// Its place.
        place: DevicePlace,
        /// SubDevices that answer.
        found: u8,
    },
    /// Two SubDevices have one alias, or two motors one drive.
    #[error("motor {motor}: {place} is not one drive for one motor")]
    Ambiguous {
        /// The motor.
        motor: u8,
        /// Its place.
        place: DevicePlace,
    },
    /// Another device stands at a drive's place.
    #[error(
        "motor {motor}: at {place} is product {found_product:#x} of vendor {found_vendor:#x}; \
         expected {product:#x} of {vendor:#x} (are two drives swapped?)"
    )]
    Identity {
        /// The motor.
        motor: u8,
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
    /// Another drive of the same kind stands at a drive's place.
    #[error(
        "motor {motor}: the drive at {place} has serial number {found}, expected {expected} (are two drives swapped, or was it replaced?)"
    )]
    Serial {
        /// The motor.
        motor: u8,
        /// Its place.
        place: DevicePlace,
        /// Serial number expected.
        expected: u32,
        /// Serial number found.
        found: u32,
    },
    /// A drive lacks an object.
    #[error("motor {motor}: the drive lacks object {object:04X}h, {purpose}")]
    MissingObject {
        /// The motor.
        motor: u8,
        /// The object.
        object: u16,
        /// The reason why it is needed, with what to do.
        purpose: &'static str,
    },
    /// The encoder is another one.
    #[error("motor {motor}: the drive's encoder has {found} counts per turn, expected {expected}")]
    Encoder {
        /// The motor.
        motor: u8,
        /// Counts per turn expected.
        expected: u32,
        /// Counts per turn of object 608Fh.
        found: u32,
    },
    /// The travel is wider than the drive's software limits.
    #[error("motor {motor}: the travel of {} to {} counts is beyond the drive's software limits (607Dh) of {} to {}", travel.0, travel.1, limits.0, limits.1)]
    SoftwareLimits {
        /// The motor.
        motor: u8,
        /// Travel, counts.
        travel: (i32, i32),
        /// Object 607Dh.
        limits: (i32, i32),
    },
    /// The watchdog has another time than was written.
    #[error("motor {motor}: the watchdog reads {found_us} us after {wanted_us} us were written")]
    WatchdogTime {
        /// The motor.
        motor: u8,
        /// Time written, µs.
        wanted_us: u32,
        /// Time read back, µs.
        found_us: u32,
    },
    /// The outputs do not trigger the watchdog.
    #[error(
        "motor {motor}: its outputs do not trigger the watchdog (sync manager 2): it would not stop by itself"
    )]
    WatchdogOff {
        /// The motor.
        motor: u8,
    },
    /// Settings of distributed clocks that cannot be.
    #[error("{reason}")]
    Clocks {
        /// The reason.
        reason: &'static str,
    },
    /// A drive has no distributed clock.
    #[error("motor {motor}: the drive has no distributed clock (register 0008h)")]
    NoClock {
        /// The motor.
        motor: u8,
    },
    /// The clock of a drive does not follow the reference.
    #[error(
        "motor {motor}: its clock does not follow that of the bus: {difference_ns} ns apart (register 092Ch) after 10 s"
    )]
    ClockApart {
        /// The motor.
        motor: u8,
        /// Last difference, ns.
        difference_ns: u32,
    },
    /// A drive does not offer SYNC0.
    #[error(
        "motor {motor}: the drive does not offer SYNC0 (1C32h:04 is {types:#06x}); set ethercat.clocks to \"free\""
    )]
    NoSync0 {
        /// The motor.
        motor: u8,
        /// Object 1C32h:04.
        types: u16,
    },
    /// An object of the synchronisation has another value than was written.
    #[error(
        "motor {motor}: object {object:04X}h:{sub:02X} reads {found} after {wanted} was written"
    )]
    Synchronisation {
        /// The motor.
        motor: u8,
        /// The object.
        object: u16,
        /// Its sub-index.
        sub: u8,
        /// Value written.
        wanted: u32,
        /// Value read back.
        found: u32,
    },
    /// A register of the clock has another value than was written.
    #[error("motor {motor}: register {register:04X}h of its clock does not read as it was written")]
    ClockRegister {
        /// The motor.
        motor: u8,
        /// The register.
        register: u16,
    },
    /// A drive refused a state.
    #[error("motor {motor}: the drive refused to leave state {state}: AL status code {code}")]
    Refused {
        /// The motor.
        motor: u8,
        /// State that it stayed in: 1 INIT, 2 PRE-OP, 4 SAFE-OP.
        state: u8,
        /// Its reason.
        code: AlStatusCode,
    },
    /// An exchange with one drive failed.
    #[error("motor {motor}: {step}: {error}")]
    Exchange {
        /// The motor.
        motor: u8,
        /// The step.
        step: &'static str,
        /// Error of the exchange.
        error: Error,
    },
}
