//! Kani harnesses of the kinematics: any numbers for a machine, any bit patterns for positions.

use gantry_tau_core::model::{f1, l2};

use crate::kinematics::check_is_right;
use crate::six_link;

#[kani::proof]
#[kani::solver(minisat)]
fn kinematics_check_is_right() {
    let nominal: l2::Kinematics = kani::any();
    let q = kani::any();
    check_is_right(&nominal, q);
    kani::cover!(nominal.travels(&q), "some positions are admitted");
}

#[kani::proof]
#[kani::unwind(8)]
#[kani::solver(minisat)]
fn kinematics_six_check_is_right() {
    let kinematics: f1::Kinematics = kani::any();
    let q = kani::any();
    six_link::check_is_right(&kinematics, &q);
    kani::cover!(kinematics.travels(&q), "some positions are admitted");
}
