//! Any axis that a configuration may have.

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::session::config::{AxisConfig, Config};
use gantry_tau_core::verification::control::{Axis, AxisCommand};

use super::kani;
use crate::properties::axis::{self, Kind};

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
    let valid = axis.channels.is_valid(limits) && axis.shadow.is_valid(limits);
    assume!(valid, !axis.channels.is_zero(), "some axes are not at zero");
    axis
}

/// Checks one property of any axis under any command.
fn check(property: fn(&Axis, &AxisCommand, &AxisConfig, Kind), kind: Kind) {
    let config = any_axis();
    property(&any_state(&config), &kani::any(), &config, kind);
    kani::cover!(true, "the property returns");
}

harnesses! {
    axis_position_is_bounded [minisat, unwind 3] { check(axis::order_is_bounded, Kind::Position); }
    axis_velocity_is_bounded [minisat, unwind 3] { check(axis::order_is_bounded, Kind::Velocity); }
    axis_torque_is_bounded [minisat, unwind 3] { check(axis::order_is_bounded, Kind::Torque); }
    axis_shadow_is_bounded [minisat, unwind 5] {
        for kind in Kind::ALL {
            check(axis::shadow_is_bounded, kind);
        }
    }
    axis_reference_is_inside_travel [minisat, unwind 3] {
        let offsets: Offsets = kani::any();
        axis::reference_is_inside_travel(&any_axis(), kani::any(), &offsets);
    }
    axis_reference_moves_no_further [minisat, unwind 3] {
        let (before, after): (Offsets, Offsets) = (kani::any(), kani::any());
        axis::reference_moves_no_further(&any_axis(), kani::any(), (&before, &after));
    }
    nominal_step_is_flagged_exactly [minisat, unwind 3] { axis::step_is_exact(kani::any(), kani::any(), &any_axis()); }
    nominal_that_stands_is_within [minisat, unwind 3] { axis::standing_is_within(kani::any(), &any_axis(), kani::any()); }
    nominal_accel_is_flagged_exactly [minisat, unwind 5] { axis::acceleration_is_exact(kani::any(), kani::any()); }
}
