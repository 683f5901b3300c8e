//! Terms of a position loop.

pub use crate::control::position_loop::terms::{
    INTEGRAL_SHIFT, difference, fed_forward, integrate, product, weighted,
};
