//! What a server is told before it starts.

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::channel::Limits;
use gantry_tau_core::control::endpoint::MotorMap;
use gantry_tau_core::control::message::{AxisLimits, Capabilities};
use gantry_tau_core::control::session::Session;
use gantry_tau_core::control::session::config::{
    AxisConfig, Config, ConfigError, MissBudget, Parameters, Travel,
};
use gantry_tau_core::units::{Epoch, OffsetNm, PositionNm, Tick, TorquePermille, VelocityUmS};

use super::{GT_BLACK_BOX_NONE, GT_BLACK_BOX_TICKS, GT_MAX_AXES, GT_MAX_MOTORS};
use crate::code::gt_code;
use crate::error::{count, gt_error, gt_parameter};
use crate::memory::Reply;

/// Limits of one offset channel. It takes 0 < ramp <= step, step + ramp <= accel, and max >= 0.
/// Units: nm, um/s or per mille of rated torque, by the channel; per tick.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

/// How one axis may be moved.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct gt_axis_config {
    /// Position offset, nm.
    pub position: gt_limits,
    /// Velocity offset, um/s.
    pub velocity: gt_limits,
    /// Torque offset, per mille of rated torque.
    pub torque: gt_limits,
    /// Where the nominal reference may be, lower end, nm.
    pub nominal_lower_nm: i64,
    /// Upper end.
    pub nominal_upper_nm: i64,
    /// Where the drive's reference may be, lower end, nm; at least position.max further out than the nominal one, at both ends.
    pub machine_lower_nm: i64,
    /// Upper end.
    pub machine_upper_nm: i64,
    /// Largest change of the nominal reference per tick, nm. 0: it must not move.
    pub nominal_step_nm: u32,
}

/// Configuration of a server. gt_server_config_thesis fills one.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct gt_server_config {
    /// Number of axes, 3 (L2) or 6 (F1). Of every array per axis only so many entries are looked at.
    pub axes: u32,
    /// Number of motors, 1 to GT_MAX_MOTORS.
    pub motors: u32,
    /// Which axis drives each motor, counted from 0. Two motors on one cart have the same axis, and always get equal references.
    pub axis_of_motor: [u8; GT_MAX_MOTORS],
    /// GT_BLACK_BOX_NONE, or GT_BLACK_BOX_TICKS: so many ticks before the end of a session and after it are kept.
    pub black_box_ticks: u32,
    /// Length of a cycle, us; only told to the client, the library has no clock.
    pub cycle_us: u32,
    /// Ticks that a granted session may wait for its first Command; at least 1.
    pub handshake_ticks: u32,
    /// Checksum of the kinematic parameters, told to the client: gt_l2_checksum, gt_f1_checksum, or 0.
    pub kinematics_checksum: u32,
    /// What the server does: 0, or 1 for lock-step. A client must have the same abilities.
    pub capabilities: u16,
    /// How many ticks the echo of a Command may be behind the last State; 0 as a rule.
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
pub struct gt_offsets {
    /// Added to the position reference (CiA 402 object 60B0h), nm.
    pub position_nm: i32,
    /// Added to the velocity reference (60B1h), um/s.
    pub velocity_um_s: i32,
    /// Added to the torque reference (60B2h), per mille of rated torque.
    pub torque_permille: i16,
}

/// Where a server starts from.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct gt_start {
    /// Offsets that the drives have in force, read back from them. Nonzero ones are ramped to zero before anybody gets a session.
    pub in_force: [gt_offsets; GT_MAX_AXES],
    /// Nominal references of the cycle before the first, nm.
    pub nominal_nm: [i64; GT_MAX_AXES],
    /// Number of that cycle.
    pub tick: u64,
    /// The last epoch that was ever given, from storage that survives a restart; 0: none.
    pub last_epoch: u64,
}

/// The first `N` of an array of C.
pub(super) fn first<T: Copy, U, const M: usize, const N: usize>(
    all: &[T; M],
    otherwise: T,
    convert: impl Fn(T) -> U,
) -> [U; N] {
    core::array::from_fn(|index| convert(all.get(index).copied().unwrap_or(otherwise)))
}

impl gt_limits {
    /// A channel that stays at zero.
    const DISABLED: Self = Self {
        max: 0,
        step: 1,
        accel: 2,
        ramp: 1,
    };

    fn checked(self, axis: usize, channel: gt_parameter) -> Reply<Limits> {
        Limits::new(self.max, self.step, self.accel, self.ramp)
            .map_err(|error| gt_error::from(error).at(axis).of(channel))
    }
}

impl gt_axis_config {
    /// Position offsets of the thesis, and an axis that goes nowhere.
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
    };

    /// A place that is overwritten.
    const NOTHING: AxisConfig = AxisConfig {
        limits: AxisLimits {
            position: Limits::DISABLED,
            velocity: Limits::DISABLED,
            torque: Limits::DISABLED,
        },
        nominal_travel: Travel::around_zero(0),
        machine_travel: Travel::around_zero(0),
        nominal_step_nm: 0,
    };

    fn checked(&self, axis: usize) -> Reply<AxisConfig> {
        let travel = |lower, upper| Travel {
            lower: PositionNm(lower),
            upper: PositionNm(upper),
        };
        Ok(AxisConfig {
            limits: AxisLimits {
                position: self.position.checked(axis, gt_parameter::Position)?,
                velocity: self.velocity.checked(axis, gt_parameter::Velocity)?,
                torque: self.torque.checked(axis, gt_parameter::Torque)?,
            },
            nominal_travel: travel(self.nominal_lower_nm, self.nominal_upper_nm),
            machine_travel: travel(self.machine_lower_nm, self.machine_upper_nm),
            nominal_step_nm: self.nominal_step_nm,
        })
    }
}

impl gt_server_config {
    /// The thesis profile for so many axes, with a motor each and no way to go.
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

    /// Everything that can be said against it.
    pub(super) fn check(&self) -> Reply {
        match self.black_box_ticks {
            GT_BLACK_BOX_NONE | GT_BLACK_BOX_TICKS => {}
            other => return Err(gt_error::new(gt_code::BlackBox).value(other.into())),
        }
        match self.axes {
            3 => self.checked::<3>().map(drop),
            6 => self.checked::<6>().map(drop),
            _ => Err(self.refused_axes()),
        }
    }

    /// Core takes any number up to six; this interface is made for two of them.
    pub(super) fn refused_axes(&self) -> gt_error {
        let axes = usize::try_from(self.axes).unwrap_or(usize::MAX);
        ConfigError::Axes { axes }.into()
    }

    /// As core takes it.
    pub(super) fn checked<const N: usize>(&self) -> Reply<(Config<N>, MotorMap<N, GT_MAX_MOTORS>)> {
        let mut axes = [gt_axis_config::NOTHING; N];
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

    /// Motors that are not there follow axis 0, and nobody looks at them.
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

impl gt_start {
    /// The session that starts there.
    pub(super) fn session<const N: usize>(&self, config: Config<N>) -> Reply<Session<N>> {
        let in_force = in_force(&self.in_force);
        let nominal = first(&self.nominal_nm, 0, PositionNm);
        let (tick, epoch) = (Tick(self.tick), Epoch(self.last_epoch));
        Ok(Session::new(config, &in_force, nominal, tick, epoch)?)
    }
}

/// Offsets in force of `N` axes.
pub(super) fn in_force<const N: usize>(offsets: &[gt_offsets; GT_MAX_AXES]) -> [Offsets; N] {
    first(offsets, gt_offsets::default(), Offsets::from)
}
