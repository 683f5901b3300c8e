//! Sessions as black boxes of version 4 have them: without agitation budgets.

use serde::{Deserialize, Serialize};

use super::act::Axis;
use super::channels::AxisChannels;
use super::config::{AxisConfig, Config, MissBudget, Parameters, Travel};
use super::fsm::FsmState;
use super::{Parts, Session};
use crate::control::agitation::Agitation;
use crate::control::axis::{Actual, InForce};
use crate::control::message::{AxisLimits, Capabilities, Cause, Counters};
use crate::units::PositionNm;

/// A session of version 4, not yet checked.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct SessionV4<const N: usize> {
    config: ParametersV4<N>,
    parts: PartsV4<N>,
}

/// Parameters of version 4.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct ParametersV4<const N: usize> {
    cycle_us: u32,
    echo_window: u8,
    handshake_ticks: u32,
    budget: Option<MissBudget>,
    capabilities: Capabilities,
    kinematics_checksum: u32,
    #[serde(with = "crate::serde_array")]
    axes: [AxisConfigV4; N],
}

/// Limits of an axis of version 4.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct AxisConfigV4 {
    limits: AxisLimits,
    nominal_travel: Travel,
    machine_travel: Travel,
    nominal_step_nm: u32,
}

/// Parts of a session of version 4.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct PartsV4<const N: usize> {
    discrete: FsmState,
    #[serde(with = "crate::serde_array")]
    axes: [AxisV4; N],
    withheld: bool,
    off_path: bool,
    #[serde(with = "crate::serde_array")]
    in_force: [InForce; N],
    cause: Cause,
    late: bool,
    counters: Counters,
}

/// An axis of version 4.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct AxisV4 {
    channels: AxisChannels,
    shadow: AxisChannels,
    nominal: PositionNm,
    actual: Actual,
}

impl<const N: usize> SessionV4<N> {
    /// Returns the session, without agitation budgets; `None` if it is not valid.
    #[must_use]
    pub fn session(self) -> Option<Session<N>> {
        let Self { config, parts } = self;
        let parameters = Parameters {
            cycle_us: config.cycle_us,
            echo_window: config.echo_window,
            handshake_ticks: config.handshake_ticks,
            budget: config.budget,
            capabilities: config.capabilities,
            kinematics_checksum: config.kinematics_checksum,
            axes: config.axes.map(AxisConfig::from),
        };
        let parts = Parts {
            discrete: parts.discrete,
            axes: parts.axes.map(Axis::from),
            withheld: parts.withheld,
            off_path: parts.off_path,
            in_force: parts.in_force,
            cause: parts.cause,
            late: parts.late,
            counters: parts.counters,
        };
        Session::from_parts(Config::new(parameters).ok()?, parts)
    }
}

impl From<AxisConfigV4> for AxisConfig {
    fn from(axis: AxisConfigV4) -> Self {
        Self {
            limits: axis.limits,
            nominal_travel: axis.nominal_travel,
            machine_travel: axis.machine_travel,
            nominal_step_nm: axis.nominal_step_nm,
            agitation: None,
        }
    }
}

impl From<AxisV4> for Axis {
    fn from(axis: AxisV4) -> Self {
        Self {
            channels: axis.channels,
            shadow: axis.shadow,
            nominal: axis.nominal,
            actual: axis.actual,
            agitation: Agitation::ZERO,
        }
    }
}
