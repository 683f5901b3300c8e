//! Any session, any drives, any fate of the last references, any cycle.

use super::kani;
use crate::drive::{Before, Fate, nothing_jumps};

/// Server and drives that belong together.
fn any_before<const N: usize>() -> Before<N> {
    let fate: Fate = kani::any();
    let before = Before::new(kani::any(), kani::any(), fate, kani::any(), kani::any());
    kani::cover!(fate == Fate::Refused, "a refused write that is read back");
    before
}

harnesses! {
    drive_sees_no_jump [minisat, unwind 3] { nothing_jumps(&any_before::<1>()); }
    drive_sees_no_jump_of_three_axes [minisat, unwind 5] { nothing_jumps(&any_before::<3>()); }
}
