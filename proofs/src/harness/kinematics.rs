//! Kani harnesses of the kinematics: any numbers for a machine, any bit patterns of what it is asked.

use gantry_tau_core::kinematics::Nominal;

use crate::kinematics::{forward_is_inside, inverse_is_inside};

/// The contract of [`gantry_tau_core::linalg::sqrt`], all that is assumed of it: of a number that is not negative, a number that
/// is not negative, finite if the argument is; NaN otherwise.
fn any_root(x: f64) -> f64 {
    if !(x >= 0.0) {
        return f64::NAN;
    }
    let root: f64 = kani::any();
    kani::assume(root >= 0.0 && (root.is_finite() || x.is_infinite()));
    kani::cover!(true, "some roots are admitted");
    root
}

#[kani::proof]
#[kani::solver(minisat)]
#[kani::unwind(4)]
#[kani::stub(gantry_tau_core::linalg::sqrt, any_root)]
fn kinematics_inverse_is_inside() {
    let nominal: Nominal = kani::any();
    let tcp_m: [f64; 3] = kani::any();
    inverse_is_inside(&nominal, tcp_m);
    kani::cover!(tcp_m[0].is_nan(), "a point that is none passes");
}

#[kani::proof]
#[kani::solver(minisat)]
#[kani::unwind(4)]
#[kani::stub(gantry_tau_core::linalg::sqrt, any_root)]
fn kinematics_forward_is_inside() {
    let nominal: Nominal = kani::any();
    let q: [f64; 3] = kani::any();
    forward_is_inside(&nominal, q);
    kani::cover!(q[0].is_nan(), "a position that is none passes");
}
