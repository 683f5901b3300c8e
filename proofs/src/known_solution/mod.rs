//! Machines made around a pose: joints, positions and tool are chosen, and the links are given the lengths that they then have.
//! So the answer is known before anything is solved; and what is asked beside it is asked of solvers that are slow, need no
//! derivative, and share nothing with core's but the equations of the thesis `[T 3.4]`.

mod six;
mod three;

pub use six::{Six, six_is_solved};
pub use three::{Three, three_is_solved};

type Vector = [f64; 3];

/// Below this the made pose counts as singular, and nothing is said of its answers but what is said of all.
const REGULAR: f64 = 0.02;

fn add(one: Vector, other: Vector) -> Vector {
    std::array::from_fn(|i| one[i] + other[i])
}

fn less(one: Vector, other: Vector) -> Vector {
    std::array::from_fn(|i| one[i] - other[i])
}

fn times(one: Vector, by: f64) -> Vector {
    one.map(|x| x * by)
}

fn dot(one: Vector, other: Vector) -> f64 {
    one.iter().zip(other).map(|(x, y)| x * y).sum()
}

fn length(one: Vector) -> f64 {
    dot(one, one).sqrt()
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The vector turned about an axis by an angle: Rodrigues.
fn turned(vector: Vector, axis: Vector, angle: f64) -> Vector {
    let axis = times(axis, 1.0 / length(axis));
    let (sin, cos) = angle.sin_cos();
    let along = times(axis, dot(axis, vector) * (1.0 - cos));
    add(add(times(vector, cos), times(cross(axis, vector), sin)), along)
}

/// A small number of a fuzzer: `share` of `most`.
fn share(of: i16, most: f64) -> f64 {
    f64::from(of) / 32_768.0 * most
}

/// Each near the given one.
fn near<const K: usize>(at: [Vector; K], by: &[[i16; 3]; K], most: f64) -> [Vector; K] {
    std::array::from_fn(|k| std::array::from_fn(|i| at[k][i] + share(by[k][i], most)))
}
