//! Targets and settings that a pacer refuses.

use core::error::Error;
use core::fmt;

use super::{MAX_WAITING, Settings};

/// Reason for which a target is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum TargetError {
    /// Its time has been played.
    Late {
        /// Ticks by which it is too late; 0 for the tick that was played last.
        ticks: u64,
    },
    /// Its time is beyond the horizon.
    Far {
        /// Ticks by which it is too far.
        ticks: u64,
    },
    /// As many targets as there is room for wait for their time.
    Full,
}

impl fmt::Display for TargetError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Late { ticks } => write!(
                f,
                "the time of the target has been played {ticks} ticks ago; send targets earlier, or raise the latency"
            ),
            Self::Far { ticks } => {
                write!(f, "the target is {ticks} ticks too far in the future")
            }
            Self::Full => write!(
                f,
                "too many targets wait for their time (at most {MAX_WAITING})"
            ),
        }
    }
}

impl Error for TargetError {}

/// Reason for which settings are refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum SettingsError {
    /// The latency is out of range.
    Latency(u32),
    /// The program would be given up before the targets hold, or too late.
    GiveUp {
        /// Ticks until it is given up.
        give_up_ticks: u32,
        /// Ticks until the targets hold.
        hold_ticks: u32,
    },
    /// The horizon is out of range.
    Horizon(u32),
}

impl fmt::Display for SettingsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let max = Settings::MAX_TICKS;
        match self {
            Self::Latency(ticks) => {
                write!(f, "latency of {ticks} ticks is not between 0 and {max}")
            }
            Self::GiveUp {
                give_up_ticks,
                hold_ticks,
            } => write!(
                f,
                "giving up after {give_up_ticks} ticks is not between holding after {hold_ticks} and {max}"
            ),
            Self::Horizon(ticks) => {
                write!(f, "horizon of {ticks} ticks is not between 1 and {max}")
            }
        }
    }
}

impl Error for SettingsError {}
