//! Any axis that a configuration may have.

use gantry_tau_core::axis::Offsets;
use gantry_tau_core::session::config::{AxisConfig, Config};

use crate::axis;

/// Any axis that validation accepts.
fn any_axis() -> AxisConfig {
    let config: Config<1> = kani::any();
    let [axis] = config.parameters().axes;
    axis
}

#[kani::proof]
#[kani::unwind(3)]
#[kani::solver(minisat)]
fn axis_reference_is_inside_travel() {
    let offsets: Offsets = kani::any();
    axis::reference_is_inside_travel(&any_axis(), kani::any(), &offsets);
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::unwind(3)]
#[kani::solver(minisat)]
fn axis_reference_moves_no_further() {
    let (before, after): (Offsets, Offsets) = (kani::any(), kani::any());
    axis::reference_moves_no_further(&any_axis(), kani::any(), (&before, &after));
    kani::cover!(true, "the end is reached");
}
