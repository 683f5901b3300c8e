//! The two drives of the thesis as numbers.
//!
//! | | AX5000 | AX2000 |
//! |---|---|---|
//! | position loop | P | PI, 50 ms |
//! | additive velocity (S-0-0037) | yes | no |
//! | velocity feed-forward (S-0-0296) | 0 to 120 %, 100 by default | 0 to 200 %, 100 by default |
//! | peak current | 7 s | 5 s |
//!
//! Sources: the thesis, 4.1.7 and 6.2.4; Beckhoff's parameter lists (S- and P-numbers) and the
//! function manual of the AX5000 (I*t); for the AX2000 its ASCII commands (`GPTN`: 1 to 200 ms,
//! cannot be switched off; `GPFFV`) and its data sheet. The rated force is ASSUMED.

use serde::Deserialize;

/// Force at rated torque, N.
pub const RATED_FORCE_N: f64 = 1000.0;
/// Torque limit, in rated torques.
pub const TORQUE_LIMIT: f64 = 3.0;
/// Longest latency in either direction, cycles.
pub const MAX_DELAY: u8 = 5;

/// Kind of drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Profile {
    /// Beckhoff AX5000.
    Ax5000,
    /// Beckhoff AX2000.
    Ax2000,
}

impl Profile {
    /// Name of the drive.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ax5000 => "AX5000",
            Self::Ax2000 => "AX2000",
        }
    }

    /// True if it adds a velocity to the one of its position loop.
    #[must_use]
    pub const fn takes_velocity_offsets(self) -> bool {
        matches!(self, Self::Ax5000)
    }

    /// Time of the position loop's integral by default, ms; `None` for a P loop.
    #[must_use]
    pub const fn position_integral_ms(self) -> Option<f64> {
        match self {
            Self::Ax5000 => None,
            Self::Ax2000 => Some(50.0),
        }
    }

    /// Largest velocity feed-forward, %.
    #[must_use]
    pub const fn most_feed_forward_percent(self) -> f64 {
        match self {
            Self::Ax5000 => 120.0,
            Self::Ax2000 => 200.0,
        }
    }

    /// Time for which the torque limit can be held, s; then rated torque is the limit.
    #[must_use]
    pub const fn peak_s(self) -> f64 {
        match self {
            Self::Ax5000 => 7.0,
            Self::Ax2000 => 5.0,
        }
    }
}

/// Quantity that a drive follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Interface {
    /// Positions; the position loop is the drive's.
    Position,
    /// Velocities: the velocity offset of a reference is all of it, and its position is ignored.
    Velocity,
}
