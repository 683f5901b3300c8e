//! Any session, any drives, any fate of the last references, any cycle.

use super::kani;
use crate::properties::axis::Kind;
use crate::properties::drive::{self, Before, Fate};
use crate::stand_in;

/// Axes of a session whose axes could affect each other.
const AXES: usize = 3;

/// Server and drives that belong together.
fn any_before<const N: usize>() -> Before<N> {
    let fate: Fate = kani::any();
    let before = Before::new(kani::any(), kani::any(), fate, kani::any(), kani::any());
    kani::cover!(fate == Fate::Refused, "a refused write that is read back");
    before
}

harnesses! {
    drive_position_changes_by_a_step [minisat, unwind 5] { drive::offset_changes_by_a_step(&any_before::<1>(), Kind::Position); }
    drive_velocity_changes_by_a_step [minisat, unwind 5] { drive::offset_changes_by_a_step(&any_before::<1>(), Kind::Velocity); }
    drive_torque_changes_by_a_step [minisat, unwind 5] { drive::offset_changes_by_a_step(&any_before::<1>(), Kind::Torque); }
    drive_waits_for_the_path [minisat, unwind 5, stub(gantry_tau_core::verification::control::nominal_stepped, crate::stand_in::nominal_stepped)] {
        stand_in::choose_bit(kani::any());
        drive::path_is_waited_for(&any_before::<1>());
    }
    drive_gets_what_is_demanded [minisat, unwind 5] { drive::demanded_is_written(&any_before::<1>()); }
    drive_gets_nothing_while_unknown [minisat, unwind 5] { drive::unknown_is_not_written(&any_before::<AXES>()); }
    drive_is_at_zero_when_granted [minisat, unwind 5] { drive::granted_at_zero_in_force(&any_before::<AXES>()); }
}
