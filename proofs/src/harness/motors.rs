//! Six axes, nine motors: the F1, and any other map.

use gantry_tau_core::control::axis::Reference;

use crate::motors;

const AXES: usize = 6;
const MOTORS: usize = 9;

#[kani::proof]
#[kani::unwind(11)]
#[kani::solver(minisat)]
fn motors_paired_are_equal() {
    let axis_of_motor: [usize; MOTORS] = kani::any();
    let axes: [Reference; AXES] = kani::any();
    motors::paired_motors_are_equal(axis_of_motor, &axes);
    let [first, second, ..] = axis_of_motor;
    kani::cover!(first == second && first < AXES, "the first two are a pair");
}
