//! A machine whose links and axes are springs: what the simulation moves, and what the
//! identification of springs predicts with.
//!
//! Its code is apart from core's models, which the compensation uses; both share the description of
//! the machine.
//!
//! | module | contents |
//! |---|---|
//! | [`machine`] | platform, links, axes as springs: pose under load `[T 3.3]` |
//! | [`joints`] | carts and plates: joints of the links, and their motion by the axes `[T 3.1]` |
//! | [`backlash`] | the jump near 360 N `[T 5.2.2, 6.1]` |
//! | [`compliances`] | compliances of any sign, as an estimate has them |
//! | [`springs`] | compliances of machine and wrist |
//! | [`loaded`] | a machine under load |
//! | [`gauge`] | reading of a gauge, and its derivatives by every spring |
#![expect(
    clippy::indexing_slicing,
    reason = "off the reference path: floats cannot panic, arrays have fixed lengths"
)]
#![cfg_attr(
    test,
    allow(
        clippy::float_cmp,
        clippy::needless_range_loop,
        reason = "the tests compare floats that must be bit-equal, and walk several arrays by one axis number"
    )
)]

pub mod backlash;
pub mod compliances;
#[cfg(test)]
pub(crate) mod fixture;
pub mod gauge;
pub mod joints;
pub mod loaded;
pub mod machine;
pub mod springs;

pub use compliances::RawCompliances;
pub use machine::{ElasticError, ElasticMachine, Equilibrium, Pose, Transmission};
