//! A machine at home in the formats of other programs: a [model of MuJoCo](mjcf()), and a
//! [description for viewers](urdf()).
#![expect(
    clippy::indexing_slicing,
    reason = "off the reference path; arms, links and plates are arrays of fixed lengths"
)]

mod at_home;
mod mjcf;
mod urdf;

pub use mjcf::{MjcfError, mjcf};
pub use urdf::urdf;

/// Radius of a link, m: in pictures, and of its inertia about itself.
const LINK_RADIUS_M: f64 = 0.012;
/// Half an edge of a cart in pictures, m.
const CART_M: f64 = 0.036;
