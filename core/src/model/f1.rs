//! The F1: six axes, six links, a platform that moves and turns `[T 3.1.2]`. Newton's method, with
//! checked solutions.
//!
//! Positions `q` are in q-units: metres for a cart on a guideway of unit length, radians for plates
//! (`q_4`, `q_5`, `q_6`).
//!
//! | type | contents |
//! |---|---|
//! | [`Geometry`], [`Robot`] | parameters, as given and validated |
//! | [`Kinematics`] | inverse, forward, line matrix |
//! | [`PoseTracker`] | forward kinematics cycle by cycle |
//! | [`Elastic`] | the machine with its springs: commands |
//! | [`Compensator`] | one call per cycle, from nominal positions and load to bounded offsets |

mod compensator;
mod elastic;
mod kinematics;
mod pose_tracker;
mod robot;

pub use compensator::Compensator;
pub use elastic::Elastic;
pub use kinematics::Kinematics;
pub use pose_tracker::PoseTracker;
pub use robot::{Geometry, Robot};

/// Number of axes: three carts, then the turns of plates 2 and 3 and the tilt of plate 3.
pub const AXES: usize = 6;
