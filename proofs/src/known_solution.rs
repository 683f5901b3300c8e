//! Machines made around a pose: joints, positions and tool are chosen, and the links are given the
//! lengths that they then have. So the answer is known before anything is solved; and what is asked
//! beside it is asked of solvers that are slow, need no derivative, and share nothing with core's
//! but the equations of the thesis `[T 3.4]`.

mod six;
mod three;

use gantry_tau_core::model::robot::Branch;
use nalgebra::Vector3;

pub use six::{Six, six_is_solved};
pub use three::{Three, three_is_solved};

type Vector = Vector3<f64>;

/// Below this the made pose counts as singular, and nothing is said of its answers but what is said
/// of all.
const REGULAR: f64 = 0.02;

const ARM_OF_LINK: [usize; 6] = [0, 1, 1, 2, 2, 2];

/// The vector turned about an axis by an angle: Rodrigues.
fn turned(vector: Vector, axis: Vector, angle: f64) -> Vector {
    let axis = axis / axis.norm();
    let (sin, cos) = angle.sin_cos();
    vector * cos + axis.cross(&vector) * sin + axis * (axis.dot(&vector) * (1.0 - cos))
}

/// A small number of a fuzzer: `share` of `most`.
fn share(of: i16, most: f64) -> f64 {
    f64::from(of) / 32_768.0 * most
}

/// Each near the given one.
fn near<const K: usize>(at: [Vector; K], by: &[[i16; 3]; K], most: f64) -> [Vector; K] {
    std::array::from_fn(|k| at[k] + Vector::from(by[k].map(|step| share(step, most))))
}

fn sign(number: f64) -> Branch {
    if number < 0.0 {
        Branch::Negative
    } else {
        Branch::Positive
    }
}

/// True if each number is nearer to the other than this; NaN is near to nothing.
fn close<'a>(
    one: impl IntoIterator<Item = &'a f64>,
    other: impl IntoIterator<Item = &'a f64>,
    distance: f64,
) -> bool {
    one.into_iter()
        .zip(other)
        .all(|(x, y)| (x - y).abs() < distance)
}
