//! T10: paired motors.

use gantry_tau_core::control::axis::Reference;
use gantry_tau_core::control::endpoint::MotorMap;

/// T10: every motor receives its axis' reference, so motors of one axis receive equal ones; and a
/// map to an axis that does not exist is refused.
pub fn paired_motors_are_equal<const N: usize, const MOTORS: usize>(
    axis_of_motor: [usize; MOTORS],
    axes: &[Reference; N],
) {
    let exist = axis_of_motor.iter().all(|axis| *axis < N);
    let map = MotorMap::<N, MOTORS>::new(axis_of_motor);
    assert!(exist == map.is_ok(), "T10: a map to axes that exist");
    let Ok(map) = map else {
        return;
    };
    let Some(motors) = map.spread(axes) else {
        panic!("T10: every motor receives a reference");
    };
    for one in 0..MOTORS {
        for other in 0..one {
            let paired = axis_of_motor[one] == axis_of_motor[other];
            assert!(
                !paired || motors[one] == motors[other],
                "T10: paired motors are equal"
            );
        }
    }
    for one in 0..MOTORS {
        assert!(
            motors[one] == axes[axis_of_motor[one]],
            "T10: a motor receives its axis' reference"
        );
    }
}
