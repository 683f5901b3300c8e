//! The crossing from the float path to the integers of the reference path: T15.

use gantry_tau_core::units::{CROSSING_LIMIT_NM, CrossingError, Metres, OffsetNm, PositionNm};

/// T15: every float leads to a position inside the limit, or to the error that names what is wrong
/// with it.
pub fn position_is_total(metres: f64) {
    match PositionNm::from_metres(Metres(metres)) {
        Ok(PositionNm(nm)) => {
            assert!(metres.is_finite(), "T15: only a finite float crosses");
            assert!(
                nm.unsigned_abs() < CROSSING_LIMIT_NM.unsigned_abs(),
                "T15: inside the limit"
            );
        }
        Err(CrossingError::NotFinite) => {
            assert!(!metres.is_finite(), "T15: NotFinite only for what is not");
        }
        Err(CrossingError::OutOfRange { limit_nm }) => {
            assert!(metres.is_finite(), "T15: OutOfRange only for a number");
            assert!(limit_nm == CROSSING_LIMIT_NM, "T15: the limit is named");
        }
    }
}

/// T15, for offsets.
pub fn offset_is_total(metres: f64) {
    match OffsetNm::from_metres(Metres(metres)) {
        Ok(_) => assert!(metres.is_finite(), "T15: only a finite float crosses"),
        Err(CrossingError::NotFinite) => {
            assert!(!metres.is_finite(), "T15: NotFinite only for what is not");
        }
        Err(CrossingError::OutOfRange { .. }) => {
            assert!(metres.is_finite(), "T15: OutOfRange only for a number");
        }
    }
}

/// T15: the nearest whole nanometre, or beyond the limit. The difference of two neighbours is
/// exact, so this has no tolerance.
#[allow(
    clippy::as_conversions,
    reason = "an integer below 2^53 is an f64 exactly"
)]
pub fn rounding_is_exact(count: f64) {
    match PositionNm::from_nanometres(count) {
        Ok(PositionNm(nm)) => {
            assert!(
                nm.unsigned_abs() < CROSSING_LIMIT_NM.unsigned_abs(),
                "T15: inside the limit"
            );
            let error = count - nm as f64;
            assert!(
                (-0.5..=0.5).contains(&error),
                "T15: within half a nanometre"
            );
        }
        Err(CrossingError::NotFinite) => assert!(count.is_nan(), "T15: NotFinite only for NaN"),
        Err(CrossingError::OutOfRange { .. }) => {
            assert!(
                count.abs() >= CROSSING_LIMIT_NM as f64,
                "T15: OutOfRange only beyond the limit"
            )
        }
    }
}

/// T15: more nanometres never become fewer.
pub fn rounding_keeps_order(lower: f64, upper: f64) {
    let crossed = (
        PositionNm::from_nanometres(lower),
        PositionNm::from_nanometres(upper),
    );
    if let (true, (Ok(lower), Ok(upper))) = (lower <= upper, crossed) {
        assert!(lower <= upper, "T15: the order is kept");
    }
}

/// T15: every position is a finite float.
pub fn back_is_finite(position: PositionNm) {
    assert!(position.to_metres().0.is_finite(), "T15: back is finite");
}

/// T15: to half a nanometre plus one ulp of the product `metres * 1e9`. Tested.
#[allow(
    clippy::as_conversions,
    reason = "an integer below 2^53 is an f64 exactly"
)]
pub fn crossing_is_exact(metres: f64) {
    if let Ok(PositionNm(nm)) = PositionNm::from_metres(Metres(metres)) {
        // An exact product: Dekker's error term through the fused multiply-add.
        let product = metres * 1e9;
        let rest = metres.mul_add(1e9, -product);
        let ulp = (product.abs() * f64::EPSILON).max(f64::MIN_POSITIVE);
        assert!(
            ((nm as f64 - product) - rest).abs() <= 0.5 + ulp,
            "T15: half a nanometre and an ulp"
        );
    }
}

/// T15: every offset survives the way to metres and back. Tested.
pub fn offset_survives(offset: OffsetNm) {
    assert!(
        OffsetNm::from_metres(offset.to_metres()) == Ok(offset),
        "T15: there and back"
    );
}
