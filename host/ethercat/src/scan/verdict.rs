//! Use that the server has for a device.

use std::fmt;

use super::{Answer, ClockWidth, Device, Dictionary, Mapping};

/// Bit of 6502h for cyclic synchronous position mode.
const CSP: u32 = 1 << 7;
/// Objects without which the server refuses a drive, of those that a scan asks for.
const NEEDED: [u16; 4] = [0x607A, 0x6064, 0x606C, 0x6077];
/// Bits of 1C32h:04: free run and the sync manager's event; SYNC0.
const WITHOUT_CLOCK: u32 = 0x03;
const BY_SYNC0: u32 = 0x04;
/// Vendor and products of terminals that count edges.
const BECKHOFF: u32 = 0x0000_0002;
const ENCODERS: [u32; 2] = [0x13ED_3052, 0x141F_3052];
/// Force sensors: vendor and product together, for the product is the default of a stack.
const FORCE_SENSORS: [(u32, u32); 1] = [(0x0000_0732, 0x2648_3052)];

/// Verdict on a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The server can drive it, with all offsets.
    Drivable,
    /// The server can drive it, without the offsets of these objects.
    Partly {
        /// It lacks the velocity offset, 60B1h.
        no_velocity: bool,
        /// It lacks the torque offset, 60B2h.
        no_torque: bool,
    },
    /// The server can drive it, on SYNC0 alone.
    NeedsClocks,
    /// A drive whose mapping this scan has changed, by a bus that lost its messages.
    NotRestored,
    /// A drive whose mapping is fixed.
    FixedMapping,
    /// A drive without cyclic synchronous position mode.
    NoCsp,
    /// A drive that lacks an object that the server needs.
    Lacks(u16),
    /// A drive with these types of synchronisation (1C32h:04) alone, none of which the server can offer
    /// it: others than SYNC0, or SYNC0 without a distributed clock of 64 bits.
    Synchronisation(u16),
    /// A drive that speaks SoE.
    Soe,
    /// A terminal that counts the edges of a gauge.
    Encoder,
    /// A force sensor.
    ForceSensor,
    /// A device that refuses PRE-OP, with its AL status code; 0 for one that does not reach it.
    Refused(u16),
    /// A device with CoE that does not answer, to the end.
    NoAnswer,
    /// A device that the server leaves alone.
    Unknown,
}

impl Verdict {
    pub(super) fn of(device: &Device) -> Self {
        if let Some(code) = device.refused_pre_op {
            return Self::Refused(code);
        }
        if device.vendor == BECKHOFF && ENCODERS.contains(&device.product) {
            return Self::Encoder;
        }
        if FORCE_SENSORS.contains(&(device.vendor, device.product)) {
            return Self::ForceSensor;
        }
        match &device.dictionary {
            Some(dictionary) if dictionary.is_of_drive() => of_drive(dictionary, device.clock),
            Some(dictionary) if dictionary.modes == Answer::Silent => Self::NoAnswer,
            None if device.protocols.has_soe() => Self::Soe,
            _ => Self::Unknown,
        }
    }

    /// True for a drive that can stand in a robot file.
    #[must_use]
    pub const fn is_drivable(self) -> bool {
        matches!(
            self,
            Self::Drivable | Self::Partly { .. } | Self::NeedsClocks
        )
    }
}

/// Verdict on a drive with CoE.
fn of_drive(dictionary: &Dictionary, clock: ClockWidth) -> Verdict {
    let modes = dictionary.modes.value();
    if modes.is_some_and(|modes| modes & CSP == 0) {
        return Verdict::NoCsp;
    }
    let needed = NEEDED.map(|object| (object, dictionary.of_first_axis(object)));
    for (object, answer) in needed.into_iter().chain([(0x6061, dictionary.mode)]) {
        match answer {
            Answer::Value(_) => {}
            Answer::Aborted(_) => return Verdict::Lacks(object),
            Answer::Silent => return Verdict::NoAnswer,
        }
    }
    for tried in dictionary.mapping.into_iter().flatten() {
        match tried {
            Mapping::Written | Mapping::TooLong => {}
            Mapping::Fixed(_) => return Verdict::FixedMapping,
            Mapping::NotRestored => return Verdict::NotRestored,
            Mapping::Silent => return Verdict::NoAnswer,
        }
    }
    let [outputs, _] = dictionary.synchronisation;
    if let Some(types) = outputs
        .value()
        .filter(|types| *types != 0 && types & WITHOUT_CLOCK == 0)
    {
        let has_clock = clock == ClockWidth::Bits64;
        return if types & BY_SYNC0 != 0 && has_clock {
            Verdict::NeedsClocks
        } else {
            Verdict::Synchronisation(types as u16)
        };
    }
    let has = |object| dictionary.of_first_axis(object).value().is_some();
    match (!has(0x60B1), !has(0x60B2)) {
        (false, false) => Verdict::Drivable,
        (no_velocity, no_torque) => Verdict::Partly {
            no_velocity,
            no_torque,
        },
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Drivable => f.write_str("the server can drive it"),
            Self::Partly {
                no_velocity: true,
                no_torque: true,
            } => f.write_str("position offsets only: no 60B1h, no 60B2h"),
            Self::Partly {
                no_velocity: true, ..
            } => f.write_str("position offsets only: no 60B1h"),
            Self::Partly { .. } => f.write_str("no torque offsets: no 60B2h"),
            Self::NeedsClocks => f.write_str("only with clocks = \"sync0\""),
            Self::NotRestored => {
                f.write_str("its mapping is not as it was before this scan: power it off and on")
            }
            Self::FixedMapping => f.write_str("its mapping is fixed: not supported"),
            Self::NoCsp => {
                f.write_str("no cyclic synchronous position mode (6502h bit 7): not supported")
            }
            Self::Lacks(object) => write!(f, "lacks {object:04X}h: not supported"),
            Self::Soe => f.write_str("speaks SoE: not supported"),
            Self::Encoder => f.write_str("an encoder: gauges"),
            Self::ForceSensor => f.write_str("a force sensor"),
            Self::Synchronisation(types) => write!(
                f,
                "offers no synchronisation that the server has (1C32h:04 is {types:04X}h, or it has no clock of 64 bits): not supported"
            ),
            Self::Refused(0) => f.write_str("does not reach PRE-OP"),
            Self::Refused(code) => write!(f, "refuses PRE-OP: AL status code {code:04X}h"),
            Self::NoAnswer => f.write_str("no answer in its mailbox: unknown"),
            Self::Unknown => f.write_str("unknown: ignored"),
        }
    }
}
