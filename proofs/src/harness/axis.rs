//! Any axis that a configuration may have.

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::session::act::{Axis, AxisCommand};
use gantry_tau_core::control::session::config::{AxisConfig, Config};

use crate::axis::{self, Kind};

/// Any axis that validation accepts.
fn any_axis() -> AxisConfig {
    let config: Config<1> = kani::any();
    let [axis] = config.parameters().axes;
    axis
}

/// Any axis whose channels and shadow are within their limits.
fn any_state(config: &AxisConfig) -> Axis {
    let axis: Axis = kani::any();
    let limits = &config.limits;
    kani::assume(axis.channels.is_valid(limits) && axis.shadow.is_valid(limits));
    kani::cover!(!axis.channels.is_zero(), "some axes are not at zero");
    axis
}

/// Any axis, any command, checked against one property.
fn check(property: fn(&Axis, &AxisCommand, &AxisConfig, Kind), kind: Kind) {
    let config = any_axis();
    property(&any_state(&config), &kani::any(), &config, kind);
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::unwind(3)]
#[kani::solver(minisat)]
fn axis_position_is_bounded() {
    check(axis::order_is_bounded, Kind::Position);
}

#[kani::proof]
#[kani::unwind(3)]
#[kani::solver(minisat)]
fn axis_velocity_is_bounded() {
    check(axis::order_is_bounded, Kind::Velocity);
}

#[kani::proof]
#[kani::unwind(3)]
#[kani::solver(minisat)]
fn axis_torque_is_bounded() {
    check(axis::order_is_bounded, Kind::Torque);
}

#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn axis_shadow_is_bounded() {
    for kind in Kind::ALL {
        check(axis::shadow_is_bounded, kind);
    }
    kani::cover!(true, "the end is reached");
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
