//! Configuration of a session, validated once.

use core::fmt;
use core::num::NonZeroU32;

use crate::control::agitation::AgitationBudget;
use crate::control::channel::Limits;
use crate::control::message::{AxisLimits, Capabilities, MAX_AXES};
use crate::units::{OffsetNm, PositionNm};
use crate::zip::each;

/// Largest magnitude of a travel limit, and of a nominal reference for which T3 bounds the change
/// of the reference: 2^61 nm.
pub const MAX_POSITION_NM: i64 = 1 << 61;

/// A closed range of positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Travel {
    /// Lower end.
    pub lower: PositionNm,
    /// Upper end.
    pub upper: PositionNm,
}

impl Travel {
    /// Travel of `reach_nm` to either side of zero.
    #[must_use]
    pub const fn around_zero(reach_nm: u32) -> Self {
        #[expect(
            clippy::as_conversions,
            reason = "u32 to i64 is lossless; `From` is not const"
        )]
        let reach = reach_nm as i64;
        Self {
            lower: PositionNm(reach.saturating_neg()),
            upper: PositionNm(reach),
        }
    }
}

/// Limits of one axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct AxisConfig {
    /// Limits of the three offset channels.
    pub limits: AxisLimits,
    /// Range of the nominal reference.
    pub nominal_travel: Travel,
    /// Range of the drive's reference; at both ends at least `M` of the position channel wider than
    /// `nominal_travel`.
    pub machine_travel: Travel,
    /// Largest change of the nominal reference per tick, nm. Zero means that it must not move.
    pub nominal_step_nm: u32,
    /// Limit of the second difference of the nominal reference; `None`: it is not looked at.
    pub nominal_accel: Option<NominalAccel>,
    /// Budget for the second differences of the position offset; `None`: off.
    pub agitation: Option<AgitationBudget>,
}

/// Limit of the second difference `|n(k) - 2 n(k-1) + n(k-2)|` of the nominal reference. Judged if
/// ticks `k` and `k-1` were on time, were read, and began on the path: after a start, a skipped
/// cycle, a failed reading or a hold two ticks pass first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct NominalAccel {
    /// The limit, nm per tick².
    pub nm: NonZeroU32,
    /// True: beyond it the server stops, as beyond the step. False: it is flagged and passed on.
    pub is_fault: bool,
}

impl AxisConfig {
    /// An axis with position offsets only, without limit of the nominal acceleration and without
    /// agitation budget. Its machine travel is wider than `nominal_travel` by `M`.
    #[must_use]
    pub const fn position_only(
        position: Limits<OffsetNm>,
        nominal_travel: Travel,
        nominal_step_nm: u32,
    ) -> Self {
        #[expect(
            clippy::as_conversions,
            reason = "i32 to i64 is lossless; `From` is not const"
        )]
        let reach = position.max() as i64;
        Self {
            limits: AxisLimits {
                position,
                ..AxisLimits::DISABLED
            },
            nominal_travel,
            machine_travel: Travel {
                lower: PositionNm(nominal_travel.lower.0.saturating_sub(reach)),
                upper: PositionNm(nominal_travel.upper.0.saturating_add(reach)),
            },
            nominal_step_nm,
            nominal_accel: None,
            agitation: None,
        }
    }
}

/// A budget of misses beside the consecutive-miss rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct MissBudget {
    /// Length of the window in ticks, 1 to 128.
    pub window: u8,
    /// Misses tolerated within any window; one more ends the session.
    pub allowed: u8,
}

/// Configuration, not yet checked; [`Config::new`] checks it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Parameters<const N: usize> {
    /// Length of a cycle, µs. Reported to the client; core has no clock.
    pub cycle_us: u32,
    /// `W`: number of ticks that a command's echo may be behind the last State; 0 in the thesis
    /// profile.
    pub echo_window: u8,
    /// Ticks that a granted session waits for its first command; 1 000 in the thesis profile.
    pub handshake_ticks: u32,
    /// Budget of misses; off in the thesis profile.
    pub budget: Option<MissBudget>,
    /// Abilities of the server; a client must have the same.
    pub capabilities: Capabilities,
    /// Checksum of the kinematic parameters, reported to the client.
    pub kinematics_checksum: u32,
    /// The axes.
    #[cfg_attr(feature = "serde", serde(with = "crate::serde_array"))]
    pub axes: [AxisConfig; N],
}

impl<const N: usize> Parameters<N> {
    /// The thesis profile `[T 5.1.1]`: 1 kHz, every command answers the last State, one lost
    /// command tolerated, no budget beside it.
    #[must_use]
    pub const fn thesis(axes: [AxisConfig; N]) -> Self {
        Self {
            cycle_us: 1_000,
            echo_window: 0,
            handshake_ticks: 1_000,
            budget: None,
            capabilities: Capabilities::NONE,
            kinematics_checksum: 0,
            axes,
        }
    }
}

/// Error of [`Config::new`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ConfigError {
    /// The number of axes is zero or more than a frame can carry.
    Axes {
        /// The refused number.
        axes: usize,
    },
    /// The handshake would time out at once.
    HandshakeTicks,
    /// The window of the budget is not 1 to 128 ticks.
    BudgetWindow {
        /// The refused window.
        window: u8,
    },
    /// The torque channel's `M` does not fit the wire.
    TorqueMax {
        /// Index of the axis.
        axis: usize,
    },
    /// A lower end is above its upper end, or an end is beyond 2^61 nm.
    Travel {
        /// Index of the axis.
        axis: usize,
    },
    /// The nominal travel lies less than `M` inside the machine's travel.
    Margin {
        /// Index of the axis.
        axis: usize,
    },
    /// `r` of the agitation budget is above [`AgitationBudget::MAX_NM_PER_TICK`].
    Agitation {
        /// Index of the axis.
        axis: usize,
        /// The refused `r`.
        nm_per_tick: u32,
    },
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Axes { axes } => write!(f, "{axes} axes; 1 to {MAX_AXES} are possible"),
            Self::HandshakeTicks => f.write_str("handshake_ticks must be at least 1"),
            Self::BudgetWindow { window } => {
                write!(f, "budget window is {window} ticks; 1 to 128 are possible")
            }
            Self::TorqueMax { axis } => {
                write!(f, "axis {axis}: torque max is above {} per mille", i16::MAX)
            }
            Self::Travel { axis } => {
                write!(
                    f,
                    "axis {axis}: lower end of a travel is above its upper end, or an end is beyond 2^61 nm"
                )
            }
            Self::Margin { axis } => write!(
                f,
                "axis {axis}: machine travel must be wider than nominal travel by the position max at both ends"
            ),
            Self::Agitation { axis, nm_per_tick } => write!(
                f,
                "axis {axis}: agitation budget is {nm_per_tick} nm per tick; 1 to {} are possible",
                AgitationBudget::MAX_NM_PER_TICK
            ),
        }
    }
}

impl core::error::Error for ConfigError {}

/// Validated configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(
    feature = "serde",
    serde(try_from = "Parameters<N>", into = "Parameters<N>")
)]
pub struct Config<const N: usize> {
    parameters: Parameters<N>,
}

impl<const N: usize> From<Config<N>> for Parameters<N> {
    fn from(config: Config<N>) -> Self {
        config.parameters
    }
}

impl<const N: usize> TryFrom<Parameters<N>> for Config<N> {
    type Error = ConfigError;

    fn try_from(parameters: Parameters<N>) -> Result<Self, Self::Error> {
        Self::new(parameters)
    }
}

impl<const N: usize> Config<N> {
    /// Checks every parameter. (The limits of a channel are valid by their type.)
    ///
    /// # Errors
    /// The first invalid parameter.
    pub fn new(parameters: Parameters<N>) -> Result<Self, ConfigError> {
        if N == 0 || N > MAX_AXES {
            return Err(ConfigError::Axes { axes: N });
        }
        if parameters.handshake_ticks == 0 {
            return Err(ConfigError::HandshakeTicks);
        }
        if let Some(MissBudget { window, .. }) = parameters.budget {
            if window == 0 || window > 128 {
                return Err(ConfigError::BudgetWindow { window });
            }
        }
        for (axis, config) in each(&parameters.axes).enumerate() {
            check_axis(axis, config)?;
        }
        Ok(Self { parameters })
    }

    /// Returns the validated parameters.
    #[must_use]
    pub const fn parameters(&self) -> &Parameters<N> {
        &self.parameters
    }
}

#[cfg(kani)]
impl<const N: usize> kani::Arbitrary for Config<N> {
    fn any() -> Self {
        let config = Self {
            parameters: kani::any(),
        };
        kani::assume(Self::new(config.parameters).is_ok());
        kani::cover!(true, "some configurations are valid");
        config
    }
}

fn check_axis(axis: usize, config: &AxisConfig) -> Result<(), ConfigError> {
    if i16::try_from(config.limits.torque.max()).is_err() {
        return Err(ConfigError::TorqueMax { axis });
    }
    let nominal = config.nominal_travel;
    let machine = config.machine_travel;
    for travel in [nominal, machine] {
        let far =
            travel.lower.0 < MAX_POSITION_NM.saturating_neg() || travel.upper.0 > MAX_POSITION_NM;
        if far || travel.lower > travel.upper {
            return Err(ConfigError::Travel { axis });
        }
    }
    // Both ends are within 2^61, so neither sum saturates.
    let reach = i64::from(config.limits.position.max());
    let below = nominal.lower.0.saturating_sub(reach);
    let above = nominal.upper.0.saturating_add(reach);
    if below < machine.lower.0 || above > machine.upper.0 {
        return Err(ConfigError::Margin { axis });
    }
    match config.agitation {
        Some(budget) if !budget.is_valid() => Err(ConfigError::Agitation {
            axis,
            nm_per_tick: budget.nm_per_tick.get(),
        }),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::fixture;
    use crate::control::message::AxisLimits;

    /// A valid axis: 1 m of nominal travel to both sides, and 1 mm of offset.
    fn valid_axis() -> AxisConfig {
        fixture::axis(
            fixture::limits(1_000_000, 5_000, 10_000, 100),
            1_000_000_000,
            1_000_000,
        )
    }

    /// A travel, nm.
    fn travel(lower: i64, upper: i64) -> Travel {
        Travel {
            lower: PositionNm(lower),
            upper: PositionNm(upper),
        }
    }

    /// The valid axis with this nominal travel, nm.
    fn nominal(lower: i64, upper: i64) -> AxisConfig {
        AxisConfig {
            nominal_travel: travel(lower, upper),
            ..valid_axis()
        }
    }

    /// The valid axis with this machine travel, nm.
    fn machine(lower: i64, upper: i64) -> AxisConfig {
        AxisConfig {
            machine_travel: travel(lower, upper),
            ..valid_axis()
        }
    }

    /// The valid axis with this largest torque offset, per mille.
    fn torque(max: i32) -> AxisConfig {
        let good = valid_axis();
        AxisConfig {
            limits: AxisLimits {
                torque: fixture::limits(max, 3, 5, 1),
                ..good.limits
            },
            ..good
        }
    }

    /// The valid axis with this agitation budget.
    fn agitation(nm_per_tick: u32) -> AxisConfig {
        AxisConfig {
            agitation: AgitationBudget::new(nm_per_tick),
            ..valid_axis()
        }
    }

    #[test]
    fn a_configuration_is_refused_by_name() {
        let good = valid_axis();
        let travel = Err(ConfigError::Travel { axis: 1 });
        let margin = Err(ConfigError::Margin { axis: 1 });
        let axis = 1;
        let refused = |nm_per_tick| Err(ConfigError::Agitation { axis, nm_per_tick });
        // Nominal travel and offset.
        let reach = 1_001_000_000;
        let beyond = MAX_POSITION_NM + 1;
        let cases = [
            (machine(-MAX_POSITION_NM, MAX_POSITION_NM), Ok(())),
            (machine(-beyond, MAX_POSITION_NM), travel),
            (machine(-MAX_POSITION_NM, beyond), travel),
            (nominal(5, 5), Ok(())),
            (nominal(5, 4), travel),
            (machine(-reach, reach), Ok(())),
            (machine(1 - reach, reach), margin),
            (machine(-reach, reach - 1), margin),
            (nominal(-MAX_POSITION_NM, 0), margin),
            (torque(32_767), Ok(())),
            (torque(32_768), Err(ConfigError::TorqueMax { axis: 1 })),
            (agitation(1), Ok(())),
            (agitation(1_000_000), Ok(())),
            (agitation(1_000_001), refused(1_000_001)),
        ];
        for (axis, expected) in cases {
            assert_eq!(
                Config::new(Parameters::thesis([good, axis])).map(|_| ()),
                expected,
                "{axis:?}"
            );
        }
        let only = AxisConfig::position_only(good.limits.position, good.nominal_travel, 1);
        let limits = AxisLimits {
            position: good.limits.position,
            ..AxisLimits::DISABLED
        };
        assert_eq!(
            (only.limits, only.machine_travel),
            (limits, good.machine_travel)
        );
    }
}
