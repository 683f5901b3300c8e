//! Kani harnesses of the kinematics: any numbers for a machine, any bit patterns for positions.

use gantry_tau_core::model::{f1, l2};

use super::kani;
use crate::properties::kinematics::check_is_right;
use crate::properties::six_link;

harnesses! {
    kinematics_check_is_right [minisat] {
        let nominal: l2::Kinematics = kani::any();
        let q = kani::any();
        check_is_right(&nominal, q);
        kani::cover!(nominal.travels(&q), "some positions are admitted");
    }
    kinematics_six_check_is_right [minisat, unwind 8] {
        let kinematics: f1::Kinematics = kani::any();
        let q = kani::any();
        six_link::check_is_right(&kinematics, &q);
        kani::cover!(kinematics.travels(&q), "some positions are admitted");
    }
}
