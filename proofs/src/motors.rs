//! T10: paired motors.

use gantry_tau_core::axis::Reference;
use gantry_tau_core::endpoint::MotorMap;

/// T10: every motor receives its axis' reference, so motors of one axis receive equal ones; and a map to an axis that does not
/// exist is refused.
///
/// # Panics
/// When it does not hold.
pub fn paired_motors_are_equal<const N: usize, const MOTORS: usize>(
    axis_of_motor: [usize; MOTORS],
    axes: &[Reference; N],
    (one, other): (usize, usize),
) {
    let exist = axis_of_motor[one] < N && axis_of_motor[other] < N;
    let Ok(map) = MotorMap::<N, MOTORS>::new(axis_of_motor) else {
        return;
    };
    assert!(exist, "T10: every axis of a map exists");
    let motors = map.spread(axes);
    assert!(
        motors[one] == axes[axis_of_motor[one]],
        "T10: a motor receives its axis' reference"
    );
    if axis_of_motor[one] == axis_of_motor[other] {
        assert!(motors[one] == motors[other], "T10: paired motors are equal");
    }
}
