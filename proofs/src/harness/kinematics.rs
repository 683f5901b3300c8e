//! Kani harnesses of the kinematics: the machine of `robots/l2.toml`, any bit patterns of what it is asked.

use crate::kinematics::{forward_is_inside, inverse_in_assembly_is_inside, inverse_is_inside};
use crate::machine::{TRAVEL, geometry, nominal};

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
#[kani::unwind(10)]
#[kani::stub(gantry_tau_core::linalg::sqrt, any_root)]
fn kinematics_inverse_is_inside() {
    let machine = nominal(geometry());
    kani::assume(machine.is_some());
    kani::cover!(true, "the machine is one");
    let Some((_, nominal)) = machine else { return };
    let tcp_m: [f64; 3] = kani::any();
    inverse_is_inside(&nominal, &TRAVEL, tcp_m);
    kani::cover!(tcp_m[0].is_nan(), "any point passes");
}
