//! Configuration and start of a server.

use core::num::NonZeroU32;

use gantry_tau_core::control::agitation::AgitationBudget;
use gantry_tau_core::control::axis::{InForce, Offsets};
use gantry_tau_core::control::channel::{LimitValues, Limits};
use gantry_tau_core::control::endpoint::MotorMap;
use gantry_tau_core::control::message::{AxisLimits, Capabilities};
use gantry_tau_core::control::session::config::{
    AxisConfig, Config, ConfigError, MissBudget, NominalAccel, Parameters, Travel,
};
use gantry_tau_core::control::session::{Session, Start};
use gantry_tau_core::units::{
    Epoch, EpochRange, OffsetNm, PositionNm, TorquePermille, VelocityUmS,
};

use super::{GT_BLACK_BOX_NONE, GT_MAX_AXES, GT_MAX_MOTORS};
use crate::code::gt_code;
use crate::error::{count, gt_error, gt_parameter};
use crate::memory::{Reply, resized};
use crate::padding::padded;

/// Limits of one offset channel: 0 < ramp <= step, step + ramp <= accel, max >= 0.
/// Units: nm, um/s or per mille of rated torque, by the channel; per tick.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct gt_limits {
    /// M: largest magnitude; 0 disables the channel.
    pub max: i32,
    /// S: largest change per tick.
    pub step: i32,
    /// A: largest change of the change per tick.
    pub accel: i32,
    /// rho: change per tick on the way back to zero.
    pub ramp: i32,
}

/// Limits of one axis.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct gt_axis_config {
    /// Position offset, nm.
    pub position: gt_limits,
    /// Velocity offset, um/s.
    pub velocity: gt_limits,
    /// Torque offset, per mille of rated torque.
    pub torque: gt_limits,
    /// Range of the nominal reference, lower end, nm.
    pub nominal_lower_nm: i64,
    /// Upper end.
    pub nominal_upper_nm: i64,
    /// Range of the drive's reference, lower end, nm. At both ends at least position.max wider than
    /// the nominal range.
    pub machine_lower_nm: i64,
    /// Upper end.
    pub machine_upper_nm: i64,
    /// Largest change of the nominal reference per tick, nm. 0: it must not move.
    pub nominal_step_nm: u32,
    /// Largest second difference of the nominal reference, nm per tick^2, of two ticks on time; more
    /// sets GT_FLAG_NOMINAL_ACCEL. 0: it is not looked at.
    pub nominal_accel_nm: u32,
    /// Agitation budget: second differences of the position offset that can go on for ever, nm per
    /// tick; a thousand times as much at once ends the session (GT_CAUSE_AGITATED). At most
    /// 1000000; 0: no budget.
    pub agitation_nm_per_tick: u32,
    /// Not 0: more than nominal_accel_nm stops the machine, as more than nominal_step_nm does.
    pub nominal_accel_is_fault: u8,
}

/// Configuration of a server. gt_server_config_thesis fills one.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct gt_server_config {
    /// Number of axes, 3 (L2) or 6 (F1). Of every array per axis, only the first `axes` entries are
    /// read.
    pub axes: u32,
    /// Number of motors, 1 to GT_MAX_MOTORS.
    pub motors: u32,
    /// Axis of each motor, counted from 0. Two motors on one cart have the same axis and always
    /// receive equal references.
    pub axis_of_motor: [u8; GT_MAX_MOTORS],
    /// GT_BLACK_BOX_NONE, or GT_BLACK_BOX_TICKS: number of ticks kept before and after the end of a
    /// session.
    pub black_box_ticks: u32,
    /// Length of a cycle, us. Reported to the client; the library has no clock.
    pub cycle_us: u32,
    /// Ticks that a granted session waits for its first Command; at least 1.
    pub handshake_ticks: u32,
    /// Checksum of the kinematic parameters, reported to the client: gt_l2_checksum,
    /// gt_f1_checksum, or 0.
    pub kinematics_checksum: u32,
    /// Abilities of the server: 0, or 1 for lock-step. A client must have the same.
    pub capabilities: u16,
    /// Number of ticks that the echo of a Command may be behind the last State; usually 0.
    pub echo_window: u8,
    /// Window of the miss budget in ticks, 1 to 128; 0: no budget beside the rule of two in a row.
    pub budget_window: u8,
    /// Misses tolerated within any such window; one more ends the session.
    pub budget_allowed: u8,
    /// The axes.
    pub axis: [gt_axis_config; GT_MAX_AXES],
}

/// The external offsets of one axis.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct gt_offsets {
    /// Added to the position reference (CiA 402 object 60B0h), nm.
    pub position_nm: i32,
    /// Added to the velocity reference (60B1h), um/s.
    pub velocity_um_s: i32,
    /// Added to the torque reference (60B2h), per mille of rated torque.
    pub torque_permille: i16,
}

/// Values in force at the drive of one axis.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct gt_in_force {
    /// Nominal reference, without offset, nm.
    pub nominal_nm: i64,
    /// Offsets.
    pub offsets: gt_offsets,
}

/// State of the machine at the start of a server.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct gt_start {
    /// Values in force at the drives, read back from them. Nonzero offsets ramp to zero before a
    /// session is granted.
    pub in_force: [gt_in_force; GT_MAX_AXES],
    /// First epoch that may be granted. Epochs come from a counter in storage that survives a
    /// restart: reserve a range, write the counter back, then start the server.
    pub first_epoch: u64,
    /// Last epoch of the range; below first_epoch for none. gt_server_set_epochs extends it.
    pub last_epoch: u64,
    /// Not 0: a stop was asserted before and has not been re-armed. The server then starts in
    /// GT_PHASE_FAULT.
    pub stop_latched: u8,
}

padded! {
    gt_limits { max step accel ramp }
    gt_axis_config {
        position velocity torque nominal_lower_nm nominal_upper_nm machine_lower_nm machine_upper_nm nominal_step_nm
        nominal_accel_nm agitation_nm_per_tick nominal_accel_is_fault
    }
    gt_server_config {
        axes motors axis_of_motor black_box_ticks cycle_us handshake_ticks kinematics_checksum capabilities echo_window
        budget_window budget_allowed axis
    }
    gt_offsets { position_nm velocity_um_s torque_permille }
}

impl gt_limits {
    /// Limits of a channel that stays at zero.
    const DISABLED: Self = Self {
        max: 0,
        step: 1,
        accel: 2,
        ramp: 1,
    };

    fn checked<U>(self, axis: usize, channel: gt_parameter) -> Reply<Limits<U>> {
        let values = LimitValues {
            max: self.max,
            step: self.step,
            accel: self.accel,
            ramp: self.ramp,
        };
        Limits::new(values).map_err(|error| gt_error::from(error).at(axis).of(channel))
    }
}

impl gt_axis_config {
    /// Position offsets of the thesis; an axis without travel.
    const THESIS: Self = Self {
        position: gt_limits {
            max: 2_000_000,
            step: 5_000,
            accel: 10_000,
            ramp: 100,
        },
        velocity: gt_limits::DISABLED,
        torque: gt_limits::DISABLED,
        nominal_lower_nm: 0,
        nominal_upper_nm: 0,
        machine_lower_nm: -2_000_000,
        machine_upper_nm: 2_000_000,
        nominal_step_nm: 0,
        nominal_accel_nm: 0,
        agitation_nm_per_tick: 0,
        nominal_accel_is_fault: 0,
    };

    pub(crate) fn checked(&self, axis: usize) -> Reply<AxisConfig> {
        Ok(AxisConfig {
            limits: AxisLimits {
                position: self.position.checked(axis, gt_parameter::Position)?,
                velocity: self.velocity.checked(axis, gt_parameter::Velocity)?,
                torque: self.torque.checked(axis, gt_parameter::Torque)?,
            },
            nominal_travel: travel(self.nominal_lower_nm, self.nominal_upper_nm),
            machine_travel: travel(self.machine_lower_nm, self.machine_upper_nm),
            nominal_step_nm: self.nominal_step_nm,
            nominal_accel: NonZeroU32::new(self.nominal_accel_nm).map(|nm| NominalAccel {
                nm,
                is_fault: self.nominal_accel_is_fault != 0,
            }),
            agitation: AgitationBudget::new(self.agitation_nm_per_tick),
        })
    }
}

impl gt_server_config {
    /// The thesis profile, with one motor per axis and no travel.
    pub(super) fn thesis(axes: u32) -> Self {
        Self {
            axes,
            motors: axes,
            axis_of_motor: [0, 1, 2, 3, 4, 5, 0, 0, 0, 0, 0, 0],
            black_box_ticks: GT_BLACK_BOX_NONE,
            cycle_us: 1_000,
            handshake_ticks: 1_000,
            kinematics_checksum: 0,
            capabilities: 0,
            echo_window: 0,
            budget_window: 0,
            budget_allowed: 0,
            axis: [gt_axis_config::THESIS; GT_MAX_AXES],
        }
    }

    /// Error for a number of axes that this interface is not built for.
    pub(super) fn refused_axes(&self) -> gt_error {
        let axes = usize::try_from(self.axes).unwrap_or(usize::MAX);
        ConfigError::Axes { axes }.into()
    }

    /// Converts to core's configuration.
    pub(crate) fn checked<const N: usize>(&self) -> Reply<(Config<N>, MotorMap<N, GT_MAX_MOTORS>)> {
        let mut axes = [AxisConfig::position_only(Limits::DISABLED, Travel::around_zero(0), 0); N];
        for (index, (place, axis)) in axes.iter_mut().zip(&self.axis).enumerate() {
            *place = axis.checked(index)?;
        }
        let budget = (self.budget_window > 0).then_some(MissBudget {
            window: self.budget_window,
            allowed: self.budget_allowed,
        });
        let config = Config::new(Parameters {
            cycle_us: self.cycle_us,
            echo_window: self.echo_window,
            handshake_ticks: self.handshake_ticks,
            budget,
            capabilities: Capabilities(self.capabilities),
            kinematics_checksum: self.kinematics_checksum,
            axes,
        })?;
        Ok((config, self.motor_map()?))
    }

    /// Converts the map; unused motors follow axis 0 and are never reported.
    fn motor_map<const N: usize>(&self) -> Reply<MotorMap<N, GT_MAX_MOTORS>> {
        let motors = usize::try_from(self.motors).unwrap_or(usize::MAX);
        if motors == 0 || motors > GT_MAX_MOTORS {
            return Err(gt_error::new(gt_code::MotorCount).value(count(motors)));
        }
        let mut axes = [0; GT_MAX_MOTORS];
        for (place, axis) in axes.iter_mut().zip(self.axis_of_motor).take(motors) {
            *place = usize::from(axis);
        }
        Ok(MotorMap::new(axes)?)
    }
}

impl From<gt_offsets> for Offsets {
    fn from(offsets: gt_offsets) -> Self {
        Self {
            position: OffsetNm(offsets.position_nm),
            velocity: VelocityUmS(offsets.velocity_um_s),
            torque: TorquePermille(offsets.torque_permille),
        }
    }
}

impl From<Offsets> for gt_offsets {
    fn from(offsets: Offsets) -> Self {
        Self {
            position_nm: offsets.position.0,
            velocity_um_s: offsets.velocity.0,
            torque_permille: offsets.torque.0,
        }
    }
}

impl From<gt_in_force> for InForce {
    fn from(in_force: gt_in_force) -> Self {
        Self {
            nominal: PositionNm(in_force.nominal_nm),
            offsets: in_force.offsets.into(),
        }
    }
}

impl gt_start {
    /// Returns the session that starts there.
    pub(crate) fn session<const N: usize>(&self, config: Config<N>) -> Reply<Session<N>> {
        let start = Start {
            in_force: in_force(&self.in_force),
            stop_latched: self.stop_latched != 0,
        };
        Ok(Session::new(config, &start)?)
    }

    pub(super) const fn epochs(&self) -> EpochRange {
        EpochRange {
            first: Epoch(self.first_epoch),
            last: Epoch(self.last_epoch),
        }
    }
}

const fn travel(lower_nm: i64, upper_nm: i64) -> Travel {
    Travel {
        lower: PositionNm(lower_nm),
        upper: PositionNm(upper_nm),
    }
}

/// Returns the values in force of `N` axes.
pub(super) fn in_force<const N: usize>(all: &[gt_in_force; GT_MAX_AXES]) -> [InForce; N] {
    resized(all, gt_in_force::default()).map(InForce::from)
}
