//! Kani harnesses of the kinematics: any numbers for a machine, any bit patterns for positions.

use gantry_tau_core::kinematics::Nominal;

use crate::kinematics::check_is_right;

#[kani::proof]
#[kani::solver(minisat)]
fn kinematics_check_is_right() {
    let nominal: Nominal = kani::any();
    let q = kani::any();
    check_is_right(&nominal, q);
    kani::cover!(nominal.travels(&q), "some positions are admitted");
}
