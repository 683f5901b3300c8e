//! Crossing from SI to integers: any bit pattern of a float.

use gantry_tau_core::units::{Metres, PositionNm};

use super::kani;
use crate::properties::crossing::{
    back_is_finite, offset_is_total, position_is_total, rounding_is_exact, rounding_keeps_order,
};

harnesses! {
    crossing_of_a_position_is_total [minisat] {
        let metres: f64 = kani::any();
        position_is_total(metres);
        kani::cover!(PositionNm::from_metres(Metres(metres)) == Ok(PositionNm(-1)), "some floats cross");
    }
    crossing_of_an_offset_is_total [minisat] { offset_is_total(kani::any()); }
    crossing_rounds_exactly [minisat] {
        let count = kani::any();
        rounding_is_exact(count);
        kani::cover!(count > 1e15 && count < 2e15, "a large count passes");
    }
    crossing_keeps_order [minisat] {
        let (lower, upper) = (kani::any(), kani::any());
        rounding_keeps_order(lower, upper);
        kani::cover!(lower < upper && lower > 0.6 && upper < 1.4, "two neighbours pass");
    }
    crossing_back_is_finite [minisat] {
        let position = kani::any();
        back_is_finite(position);
        kani::cover!(position < PositionNm(0), "a negative position passes");
    }
}
