//! Kani harnesses of the crossing: any bit pattern of a float.

use gantry_tau_core::units::{Metres, PositionNm};

use crate::crossing::{
    back_is_finite, offset_is_total, position_is_total, rounding_is_exact, rounding_keeps_order,
};

#[kani::proof]
#[kani::solver(minisat)]
fn crossing_of_a_position_is_total() {
    let metres: f64 = kani::any();
    position_is_total(metres);
    kani::cover!(
        PositionNm::from_metres(Metres(metres)) == Ok(PositionNm(-1)),
        "some floats cross"
    );
}

#[kani::proof]
#[kani::solver(minisat)]
fn crossing_of_an_offset_is_total() {
    offset_is_total(kani::any());
    kani::cover!(true, "some float passes");
}

#[kani::proof]
#[kani::solver(minisat)]
fn crossing_rounds_exactly() {
    let count = kani::any();
    rounding_is_exact(count);
    kani::cover!(count > 1e15 && count < 2e15, "a large count passes");
}

#[kani::proof]
#[kani::solver(minisat)]
fn crossing_keeps_order() {
    let (lower, upper) = (kani::any(), kani::any());
    rounding_keeps_order(lower, upper);
    kani::cover!(
        lower < upper && lower > 0.6 && upper < 1.4,
        "two neighbours pass"
    );
}

#[kani::proof]
#[kani::solver(minisat)]
fn crossing_back_is_finite() {
    let position = kani::any();
    back_is_finite(position);
    kani::cover!(position < PositionNm(0), "a negative position passes");
}
