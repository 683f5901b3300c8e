//! Kani harnesses of the kinematics: any numbers for a machine, any bit patterns for positions.

use gantry_tau_core::kinematics::Nominal;

use crate::kinematics::check_is_right;
use crate::{machine, six_link};

#[kani::proof]
#[kani::solver(minisat)]
fn kinematics_check_is_right() {
    let nominal: Nominal = kani::any();
    let q = kani::any();
    check_is_right(&nominal, q);
    kani::cover!(nominal.travels(&q), "some positions are admitted");
}

#[kani::proof]
#[kani::unwind(8)]
#[kani::solver(minisat)]
fn kinematics_six_check_is_right() {
    let geometry = machine::six_link_geometry();
    let Some(kinematics) = machine::six_link(gantry_tau_core::robot::SixLinkGeometry {
        travel: kani::any(),
        ..geometry
    }) else {
        return;
    };
    let q = kani::any();
    six_link::check_is_right(&kinematics, &q);
    kani::cover!(kinematics.travels(&q), "some positions are admitted");
}
