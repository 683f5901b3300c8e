//! Kinematics, statics, stiffness and compensation of the Gantry-Tau machines, in `f64` and SI units. Nothing here can reach a drive
//! except through the crossing in [`crate::units`].
//!
//! | module | contents |
//! |---|---|
//! | [`linalg`] | the maths seam (`sqrt`, `sin`, `cos`) and small linear solves |
//! | [`robot`] | parameters of a machine, validated once |
//! | [`kinematics`] | inverse and forward kinematics, Jacobian `[T 3.1]` |
//! | [`statics`] | line matrix, link forces, cart loads `[T 3.3.2, 3.3.3]` |
//! | [`stiffness`] | compliances to displacement `[T 3.3.1]` |
//! | [`sensor`] | force sensor: tare, frame, low-pass filter `[T 4.2.5]` |
//! | [`compensation`] | wrench to bounded cart offsets `[T 5.2.3]` |

pub mod compensation;
pub mod kinematics;
pub mod linalg;
pub mod robot;
pub mod sensor;
pub mod statics;
pub mod stiffness;
