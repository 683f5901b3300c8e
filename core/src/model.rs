//! Kinematics, statics, stiffness and compensation of the Gantry-Tau machines, in `f64` and SI
//! units. Nothing here can reach a drive except through the crossing in [`crate::units`].
//!
//! | module | contents |
//! |---|---|
//! | [`l2`] | the machine with three axes: geometry, kinematics, compensator `[T 3.1.1]` |
//! | [`f1`] | the machine with six axes: geometry, kinematics, pose tracker, compensator `[T 3.1.2]` |
//! | [`presets`] | an example of each |
//! | [`robot`] | parameters that both share, validated once |
//! | [`kinematics`] | poses, errors and tolerances |
//! | [`statics`] | line matrix, link forces, cart loads `[T 3.3.2, 3.3.3]` |
//! | [`stiffness`] | compliances to displacement `[T 3.3.1]` |
//! | [`sensor`] | force sensor: tare, frame, low-pass filter `[T 4.2.5]` |
//! | [`compensation`] | configuration and output of the compensators `[T 5.2.3]` |
//! | [`linalg`] | the maths seam (`sqrt`, `sin`, `cos`) and rotations |
//!
//! Vectors and matrices are nalgebra's, which is re-exported.

mod block_solve;
pub mod compensation;
pub mod f1;
pub mod kinematics;
pub mod l2;
pub mod linalg;
pub mod load_filter;
mod lu;
pub mod presets;
pub mod robot;
pub mod sensor;
pub mod statics;
pub mod stiffness;

pub use nalgebra;
