//! Six axes, nine motors: the F1's map, and any other.

use gantry_tau_core::control::axis::Reference;

use super::kani;
use crate::properties::motors;

const AXES: usize = 6;
const MOTORS: usize = 9;

harnesses! {
    motors_paired_are_equal [minisat, unwind 11] {
        let axis_of_motor: [usize; MOTORS] = kani::any();
        let axes: [Reference; AXES] = kani::any();
        motors::paired_motors_are_equal(axis_of_motor, &axes);
        let [first, second, ..] = axis_of_motor;
        kani::cover!(first == second && first < AXES, "the first two are a pair");
    }
}
