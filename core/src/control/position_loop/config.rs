//! Configuration of a position loop, validated once.

use core::fmt;

use crate::control::channel::Limits;
use crate::units::{TorquePermille, VelocityUmS};

/// Largest error and change of a reference that act, nm: 16.8 mm. What is beyond counts as this.
pub const MAX_ERROR_NM: i64 = 1 << 24;
/// Largest window of the following error, nm: below [`MAX_ERROR_NM`], so that the largest error is
/// outside of every window.
pub const MAX_WINDOW_NM: i32 = (1 << 24) - 1;
/// References that are kept, beside the one of the tick.
pub const MAX_LAG: u8 = 10;
/// Largest gain, in 2^-16 µm/s per nm: 500 1/s.
pub const MAX_GAIN: u16 = 32_767;
/// Largest velocity feed-forward and weight of the integral, in 2^-10: 120 %.
pub const MAX_WEIGHT: u16 = 1_228;
/// Largest torque feed-forward, in 2^-16 per mille per (µm/s per tick): 0.5.
pub const MAX_TORQUE_WEIGHT: u16 = 32_767;
/// Largest `gain * (lag + 1)`, in the unit of the gain: half of an error per lag, of 1 ms per tick.
pub const MAX_GAIN_TIMES_LAG: u32 = 32_768;

/// Values of a configuration, not yet checked; [`LoopConfig::new`] checks them.
///
/// Units are those of a cycle of 1 ms, in which nm per tick are µm/s.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct LoopValues {
    /// Velocity per error, in 2^-16 µm/s per nm (65.536 per 1/s); at most [`MAX_GAIN`].
    pub gain: u16,
    /// Velocity feed-forward, in 2^-10 of the reference's velocity; at most [`MAX_WEIGHT`].
    pub velocity_feed_forward: u16,
    /// Torque feed-forward, in 2^-16 per mille of rated torque per µm/s per tick; at most
    /// [`MAX_TORQUE_WEIGHT`].
    pub torque_feed_forward: u16,
    /// Growth of the integral per tick, in 2^-10 of the proportional term; at most [`MAX_WEIGHT`].
    /// 0: no integral.
    pub integral: u16,
    /// Largest magnitude of the integral, µm/s; at least 0.
    pub integral_max: i32,
    /// Ticks between a reference and the actual value that belongs to it: one, and the latencies of
    /// command and measurement. At most [`MAX_LAG`]. 0 compares with the reference of the same
    /// tick, which is right for no drive.
    pub lag: u8,
    /// Window of the following error, nm; 1 to [`MAX_WINDOW_NM`].
    pub window_nm: i32,
    /// Ticks in a row outside the window, or with the velocity cut by its limits, until the trip;
    /// at least 1.
    pub window_ticks: u16,
    /// Limits of the velocity reference, µm/s per tick.
    pub velocity: Limits<VelocityUmS>,
    /// Limits of the torque feed-forward with its offset, per mille per tick.
    pub torque: Limits<TorquePermille>,
}

/// Configuration of a position loop, checked once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(try_from = "LoopValues", into = "LoopValues"))]
pub struct LoopConfig(LoopValues);

impl From<LoopConfig> for LoopValues {
    fn from(config: LoopConfig) -> Self {
        config.0
    }
}

impl TryFrom<LoopValues> for LoopConfig {
    type Error = LoopConfigError;

    fn try_from(values: LoopValues) -> Result<Self, Self::Error> {
        Self::new(values)
    }
}

impl LoopConfig {
    /// A loop that commands nothing: no gain, no feed-forward, no velocity.
    pub const DISABLED: Self = Self(LoopValues {
        gain: 0,
        velocity_feed_forward: 0,
        torque_feed_forward: 0,
        integral: 0,
        integral_max: 0,
        lag: 1,
        window_nm: 1,
        window_ticks: 1,
        velocity: Limits::DISABLED,
        torque: Limits::DISABLED,
    });

    /// Checks the values.
    ///
    /// # Errors
    /// [`LoopConfigError`]: the first value that is refused.
    pub fn new(values: LoopValues) -> Result<Self, LoopConfigError> {
        for (name, value, max) in [
            (LoopValue::Gain, values.gain, MAX_GAIN),
            (
                LoopValue::VelocityFeedForward,
                values.velocity_feed_forward,
                MAX_WEIGHT,
            ),
            (
                LoopValue::TorqueFeedForward,
                values.torque_feed_forward,
                MAX_TORQUE_WEIGHT,
            ),
            (LoopValue::Integral, values.integral, MAX_WEIGHT),
            (LoopValue::Lag, u16::from(values.lag), u16::from(MAX_LAG)),
        ] {
            in_range(name, value.into(), 0, max.into())?;
        }
        in_range(LoopValue::IntegralMax, values.integral_max, 0, i32::MAX)?;
        in_range(LoopValue::WindowNm, values.window_nm, 1, MAX_WINDOW_NM)?;
        in_range(
            LoopValue::WindowTicks,
            values.window_ticks.into(),
            1,
            u16::MAX.into(),
        )?;
        let torque_max = values.torque.max();
        in_range(LoopValue::TorqueMax, torque_max, 0, i16::MAX.into())?;
        let lag = values.lag.max(1);
        let product = u32::from(values.gain).saturating_mul(u32::from(lag).saturating_add(1));
        if product > MAX_GAIN_TIMES_LAG {
            return Err(LoopConfigError::GainTimesLag {
                gain: values.gain,
                lag,
            });
        }
        Ok(Self(values))
    }

    /// Returns the values.
    #[must_use]
    pub const fn values(&self) -> &LoopValues {
        &self.0
    }
}

#[cfg(kani)]
impl kani::Arbitrary for LoopConfig {
    /// Any configuration that validation accepts. Nothing is assumed: refused ones become
    /// [`LoopConfig::DISABLED`].
    fn any() -> Self {
        Self::new(kani::any()).unwrap_or(Self::DISABLED)
    }
}

/// A value of a configuration, in an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum LoopValue {
    /// [`LoopValues::gain`].
    Gain,
    /// [`LoopValues::velocity_feed_forward`].
    VelocityFeedForward,
    /// [`LoopValues::torque_feed_forward`].
    TorqueFeedForward,
    /// [`LoopValues::integral`].
    Integral,
    /// [`LoopValues::integral_max`].
    IntegralMax,
    /// [`LoopValues::lag`].
    Lag,
    /// [`LoopValues::window_nm`].
    WindowNm,
    /// [`LoopValues::window_ticks`].
    WindowTicks,
    /// `M` of [`LoopValues::torque`].
    TorqueMax,
}

impl LoopValue {
    const fn name(self) -> &'static str {
        match self {
            Self::Gain => "gain",
            Self::VelocityFeedForward => "velocity feed-forward",
            Self::TorqueFeedForward => "torque feed-forward",
            Self::Integral => "integral",
            Self::IntegralMax => "largest integral",
            Self::Lag => "lag",
            Self::WindowNm => "window in nm",
            Self::WindowTicks => "window in ticks",
            Self::TorqueMax => "largest torque",
        }
    }
}

/// Error of [`LoopConfig::new`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum LoopConfigError {
    /// A value is outside its range.
    OutOfRange {
        /// Name of the value.
        value: LoopValue,
        /// The refused value.
        found: i32,
        /// Smallest value accepted.
        lower: i32,
        /// Largest value accepted.
        upper: i32,
    },
    /// The gain is too large for the lag: the loop would be near its limit of stability.
    GainTimesLag {
        /// The refused gain.
        gain: u16,
        /// The lag that counts, ticks.
        lag: u8,
    },
}

impl fmt::Display for LoopConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfRange {
                value,
                found,
                lower,
                upper,
            } => {
                write!(
                    f,
                    "{} is {found}; it must be from {lower} to {upper}",
                    value.name()
                )
            }
            Self::GainTimesLag { gain, lag } => {
                let most = MAX_GAIN_TIMES_LAG
                    .checked_div(u32::from(*lag).saturating_add(1))
                    .unwrap_or(0);
                write!(
                    f,
                    "gain is {gain}; with a lag of {lag} ticks it must be at most {most} (2^-16 um/s per nm)"
                )
            }
        }
    }
}

impl core::error::Error for LoopConfigError {}

const fn in_range(
    value: LoopValue,
    found: i32,
    lower: i32,
    upper: i32,
) -> Result<(), LoopConfigError> {
    if lower <= found && found <= upper {
        Ok(())
    } else {
        Err(LoopConfigError::OutOfRange {
            value,
            found,
            lower,
            upper,
        })
    }
}
