//! One code per error: those of this interface first, then core's, family by family.

use core::ffi::{CStr, c_char};

use crate::padding::without_padding;

/// Result of a call: 0 for success, else the error; gt_error has its details. Axes, arms, links and
/// motors count from 0.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum gt_code {
    /// Done.
    Ok = 0,

    /// A required pointer is null.
    NullPointer = 1,
    /// A pointer is not aligned for its type.
    Misaligned = 2,
    /// The memory is smaller than the object. `value`: bytes needed.
    MemoryTooSmall = 3,
    /// The handle does not refer to a live object of this type.
    NoObject = 4,
    /// A length is above the largest size of an object.
    Length = 5,
    /// A buffer is too small. `value`: bytes needed.
    BufferTooSmall = 6,
    /// The index is beyond the last entry.
    Index = 7,
    /// The transport is neither GT_TRANSPORT_STREAM nor GT_TRANSPORT_DATAGRAM.
    Transport = 8,
    /// The number of motors is not 1 to GT_MAX_MOTORS. `value`: the refused number.
    MotorCount = 9,
    /// black_box_ticks is neither GT_BLACK_BOX_NONE nor GT_BLACK_BOX_TICKS. `value`: the refused
    /// number.
    BlackBox = 10,
    /// A branch or a sign is neither 1 nor -1. `index`: its number.
    Branch = 11,
    /// A field of a gt_tick_input is not one of its values; 0 is refused. `parameter`:
    /// GT_PARAMETER_READING, GT_PARAMETER_SENSOR, GT_PARAMETER_STOP or GT_PARAMETER_REARM, `value`:
    /// the refused number.
    TickInput = 12,
    /// All frames or connections have been polled: the end of a loop, not an error.
    Done = 13,
    /// An error of core without a code of its own.
    Other = 14,
    /// There are no references of which nothing was said: no tick has run since they were spoken
    /// of, or its frames were polled, which makes them unknown. Nothing has changed.
    NotPending = 15,
    /// Accepted was said of a tick without references: taken for unknown.
    Withheld = 16,
    /// The fate of the references is not one of its values; 0 is refused. They still wait for it.
    Write = 17,
    /// The memory of a copy overlaps the object.
    Overlap = 18,

    /// M of a channel is negative. `index`: axis, `parameter`: channel, `value`: M.
    LimitsNegativeMax = 100,
    /// rho of a channel is zero or negative. `index`: axis, `parameter`: channel, `value`: rho.
    LimitsRampNotPositive = 101,
    /// rho of a channel is above S. `index`: axis, `parameter`: channel, `value`: rho, `upper`: S.
    LimitsRampAboveStep = 102,
    /// A of a channel is below S + rho. `index`: axis, `parameter`: channel, `value`: A, `lower`: S
    /// + rho.
    LimitsAccelTooSmall = 103,

    /// The number of axes is neither 3 nor 6. `value`: the refused number.
    ConfigAxes = 200,
    /// handshake_ticks is 0: every session would time out at once.
    ConfigHandshakeTicks = 201,
    /// The window of the miss budget is above 128 ticks. `value`: the window.
    ConfigBudgetWindow = 202,
    /// M of a torque channel does not fit 16 bits. `index`: axis.
    ConfigTorqueMax = 203,
    /// A travel has its ends reversed, or beyond 2^61 nm. `index`: axis.
    ConfigTravel = 204,
    /// The nominal travel is less than M of the position channel inside the machine's travel.
    /// `index`: axis.
    ConfigMargin = 205,
    /// The agitation budget is above 1000000 nm per tick. `index`: axis, `value`: the budget.
    ConfigAgitation = 206,

    /// An offset in force is beyond its limits: the server must not start. `index`: axis, `value`:
    /// its position offset in nm, `lower`: velocity in um/s, `upper`: torque in per mille.
    StartOffsetInForce = 300,
    /// The first tick has no reading, or an axis stands further than GT_START_WINDOW_NM from what
    /// gt_start says is in force. Nothing may be written. `index`: axis, or -1 without a reading,
    /// `value`: distance, nm.
    StartDisagrees = 301,

    /// A motor is mapped to an axis beyond the last one. `index`: motor, `value`: the axis,
    /// `upper`: number of axes.
    MotorMap = 400,

    /// GT_MAX_CONNECTIONS are open. Send the frame of gt_server_refusal to the peer.
    Full = 500,

    /// A number of a machine is NaN or infinite. `parameter`, `index`: its place.
    RobotNotFinite = 600,
    /// The magnitude of a number of a machine is outside `lower` to `upper`. `parameter`, `index`:
    /// its place.
    RobotOutOfRange = 601,
    /// The lower end of a travel is above its upper end. `parameter`, `index`: its place.
    RobotReversed = 602,

    /// The matrix of an orientation is not a rotation matrix. `value`: largest deviation of R^T R
    /// from the identity.
    OrientationNotRotation = 700,
    /// The Tau property is violated. `index`: the link that differs from the first of its cluster,
    /// `value`: the difference, m.
    OrientationNotTau = 701,

    /// The gain is outside 0 to 1.
    CompensatorGain = 800,
    /// A limit is negative. `index`: axis.
    CompensatorLimit = 801,
    /// metres_per_q is not finite or out of range. `index`: axis. Not returned by this interface,
    /// where a machine has checked it.
    CompensatorMetresPerQ = 802,

    /// An argument, or a number computed from it, is NaN or infinite.
    KinematicsNotFinite = 900,
    /// The links of an arm are too short to reach the pose. `index`: arm.
    KinematicsUnreachable = 901,
    /// The links cannot meet for these positions of the carts.
    KinematicsNoAssembly = 902,
    /// The pose exists only beyond a singularity. `index`: the arm on the other side of it, -1 for
    /// the tool.
    KinematicsOtherBranch = 903,
    /// The pose is singular, or too close to it. `value`: the measure, 0 at the singularity.
    KinematicsSingular = 904,
    /// An axis would leave its travel. `index`: axis, `value`: its position, `lower`, `upper`: its
    /// travel; q-units.
    KinematicsOutOfRange = 905,
    /// The iteration did not converge. `iterations`: their number, `value`: largest error of a
    /// link's length, m.
    KinematicsNotConverged = 906,
    /// The machine has no synchronised form: a tracker needs gt_f1_tracker_start_from.
    KinematicsSeedRequired = 907,
    /// Pose and positions do not match the length of an arm's links. `index`: arm.
    KinematicsInconsistent = 908,

    /// The rotation of a sensor's mounting is not a rotation matrix.
    SensorNotRotation = 1000,
    /// A number of a sensor is outside `lower` to `upper`. `parameter`: its name.
    SensorOutOfRange = 1001,
    /// A component of a reading is NaN, infinite or beyond 1e6; the reading was not used.
    SensorBadReading = 1002,
    /// The state of a sensor is invalid. Not returned by this interface, where that state never
    /// comes from outside.
    SensorInvalidState = 1003,
    /// The platform's rotation is not a rotation matrix.
    SensorPlatformNotRotation = 1004,

    /// A length to convert is NaN or infinite.
    CrossingNotFinite = 1100,
    /// A length to convert is out of range. `upper`: largest magnitude, nm.
    CrossingOutOfRange = 1101,

    /// The text is not that of a key. `value`: number of the first wrong line.
    KeyText = 1200,
    /// The number of keys is not 1 to GT_MAX_KEYS. `value`: the refused number.
    KeyCount = 1201,
    /// The role of a key is not one of its values; 0 is refused. `index`: its number, `value`: the
    /// role.
    KeyRole = 1202,
    /// A key is given twice. `index`: the second one.
    KeyTwice = 1203,
}

without_padding!(gt_code);

/// Codes and their names.
const NAMES: [(gt_code, &CStr); 62] = {
    use gt_code as Code;
    [
        (Code::Ok, c"GT_CODE_OK"),
        (Code::NullPointer, c"GT_CODE_NULL_POINTER"),
        (Code::Misaligned, c"GT_CODE_MISALIGNED"),
        (Code::MemoryTooSmall, c"GT_CODE_MEMORY_TOO_SMALL"),
        (Code::NoObject, c"GT_CODE_NO_OBJECT"),
        (Code::Length, c"GT_CODE_LENGTH"),
        (Code::BufferTooSmall, c"GT_CODE_BUFFER_TOO_SMALL"),
        (Code::Index, c"GT_CODE_INDEX"),
        (Code::Transport, c"GT_CODE_TRANSPORT"),
        (Code::MotorCount, c"GT_CODE_MOTOR_COUNT"),
        (Code::BlackBox, c"GT_CODE_BLACK_BOX"),
        (Code::Branch, c"GT_CODE_BRANCH"),
        (Code::TickInput, c"GT_CODE_TICK_INPUT"),
        (Code::Done, c"GT_CODE_DONE"),
        (Code::Other, c"GT_CODE_OTHER"),
        (Code::NotPending, c"GT_CODE_NOT_PENDING"),
        (Code::Withheld, c"GT_CODE_WITHHELD"),
        (Code::Write, c"GT_CODE_WRITE"),
        (Code::Overlap, c"GT_CODE_OVERLAP"),
        (Code::LimitsNegativeMax, c"GT_CODE_LIMITS_NEGATIVE_MAX"),
        (
            Code::LimitsRampNotPositive,
            c"GT_CODE_LIMITS_RAMP_NOT_POSITIVE",
        ),
        (Code::LimitsRampAboveStep, c"GT_CODE_LIMITS_RAMP_ABOVE_STEP"),
        (Code::LimitsAccelTooSmall, c"GT_CODE_LIMITS_ACCEL_TOO_SMALL"),
        (Code::ConfigAxes, c"GT_CODE_CONFIG_AXES"),
        (
            Code::ConfigHandshakeTicks,
            c"GT_CODE_CONFIG_HANDSHAKE_TICKS",
        ),
        (Code::ConfigBudgetWindow, c"GT_CODE_CONFIG_BUDGET_WINDOW"),
        (Code::ConfigTorqueMax, c"GT_CODE_CONFIG_TORQUE_MAX"),
        (Code::ConfigTravel, c"GT_CODE_CONFIG_TRAVEL"),
        (Code::ConfigMargin, c"GT_CODE_CONFIG_MARGIN"),
        (Code::ConfigAgitation, c"GT_CODE_CONFIG_AGITATION"),
        (Code::StartOffsetInForce, c"GT_CODE_START_OFFSET_IN_FORCE"),
        (Code::StartDisagrees, c"GT_CODE_START_DISAGREES"),
        (Code::MotorMap, c"GT_CODE_MOTOR_MAP"),
        (Code::Full, c"GT_CODE_FULL"),
        (Code::RobotNotFinite, c"GT_CODE_ROBOT_NOT_FINITE"),
        (Code::RobotOutOfRange, c"GT_CODE_ROBOT_OUT_OF_RANGE"),
        (Code::RobotReversed, c"GT_CODE_ROBOT_REVERSED"),
        (
            Code::OrientationNotRotation,
            c"GT_CODE_ORIENTATION_NOT_ROTATION",
        ),
        (Code::OrientationNotTau, c"GT_CODE_ORIENTATION_NOT_TAU"),
        (Code::CompensatorGain, c"GT_CODE_COMPENSATOR_GAIN"),
        (Code::CompensatorLimit, c"GT_CODE_COMPENSATOR_LIMIT"),
        (
            Code::CompensatorMetresPerQ,
            c"GT_CODE_COMPENSATOR_METRES_PER_Q",
        ),
        (Code::KinematicsNotFinite, c"GT_CODE_KINEMATICS_NOT_FINITE"),
        (
            Code::KinematicsUnreachable,
            c"GT_CODE_KINEMATICS_UNREACHABLE",
        ),
        (
            Code::KinematicsNoAssembly,
            c"GT_CODE_KINEMATICS_NO_ASSEMBLY",
        ),
        (
            Code::KinematicsOtherBranch,
            c"GT_CODE_KINEMATICS_OTHER_BRANCH",
        ),
        (Code::KinematicsSingular, c"GT_CODE_KINEMATICS_SINGULAR"),
        (
            Code::KinematicsOutOfRange,
            c"GT_CODE_KINEMATICS_OUT_OF_RANGE",
        ),
        (
            Code::KinematicsNotConverged,
            c"GT_CODE_KINEMATICS_NOT_CONVERGED",
        ),
        (
            Code::KinematicsSeedRequired,
            c"GT_CODE_KINEMATICS_SEED_REQUIRED",
        ),
        (
            Code::KinematicsInconsistent,
            c"GT_CODE_KINEMATICS_INCONSISTENT",
        ),
        (Code::SensorNotRotation, c"GT_CODE_SENSOR_NOT_ROTATION"),
        (Code::SensorOutOfRange, c"GT_CODE_SENSOR_OUT_OF_RANGE"),
        (Code::SensorBadReading, c"GT_CODE_SENSOR_BAD_READING"),
        (Code::SensorInvalidState, c"GT_CODE_SENSOR_INVALID_STATE"),
        (
            Code::SensorPlatformNotRotation,
            c"GT_CODE_SENSOR_PLATFORM_NOT_ROTATION",
        ),
        (Code::CrossingNotFinite, c"GT_CODE_CROSSING_NOT_FINITE"),
        (Code::CrossingOutOfRange, c"GT_CODE_CROSSING_OUT_OF_RANGE"),
        (Code::KeyText, c"GT_CODE_KEY_TEXT"),
        (Code::KeyCount, c"GT_CODE_KEY_COUNT"),
        (Code::KeyRole, c"GT_CODE_KEY_ROLE"),
        (Code::KeyTwice, c"GT_CODE_KEY_TWICE"),
    ]
};

impl gt_code {
    /// Returns the number in C.
    #[expect(
        clippy::as_conversions,
        reason = "the number of an enum has no other conversion"
    )]
    const fn number(self) -> i32 {
        self as i32
    }
}

/// Returns the name of a code, such as "GT_CODE_NULL_POINTER", or "GT_CODE_UNKNOWN": a static
/// string, not to be freed.
#[unsafe(no_mangle)]
pub extern "C" fn gt_code_name(code: i32) -> *const c_char {
    let known = NAMES.iter().find(|(known, _)| known.number() == code);
    known.map_or(c"GT_CODE_UNKNOWN", |(_, name)| name).as_ptr()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_is_that_of_the_header() {
        let header = include_str!("../include/gantry_tau.h");
        for (code, name) in NAMES {
            let line = format!("  {} = {},", name.to_str().unwrap(), code.number());
            assert!(header.contains(&line), "{line}");
        }
        let codes = header
            .lines()
            .filter(|line| line.starts_with("  GT_CODE_") && line.contains(" = "));
        assert_eq!(codes.count(), NAMES.len(), "codes in the header and names");
    }
}
