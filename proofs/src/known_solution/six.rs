//! The machine with six axes: its equations once more, and Newton's method with differences for derivatives and small steps.

use gantry_tau_core::model::f1;
use gantry_tau_core::model::kinematics::{COLD_ITERATIONS, Pose};
use gantry_tau_core::model::robot::Branch;

use super::{REGULAR, Vector, add, dot, length, less, near, share, times, turned};
use crate::robots;
use crate::six_link::answers_are_checked;

/// Six numbers: positions of the axes, or a place and a rotation vector.
type Numbers = [f64; 6];

/// A machine with six axes as differences from the vectors' F1, the place of its tool, and the errors of the seeds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "arbitrary", derive(arbitrary::Arbitrary))]
pub struct Six {
    /// Origins of the carts.
    pub carts: [[i16; 3]; 3],
    /// Directions of the guideways.
    pub guideways: [[i16; 3]; 3],
    /// Joints on the plates.
    pub plate_joints: [[i16; 3]; 6],
    /// Joints on the platform.
    pub joints: [[i16; 3]; 6],
    /// The axes of turn and tilt.
    pub axes: [[i16; 3]; 2],
    /// The plates turn the other way.
    pub turn_signs: [bool; 2],
    /// The tool: place and rotation vector.
    pub tool: [i16; 6],
    /// Positions.
    pub positions: [i16; 6],
    /// Errors of the seeds.
    pub off: [i16; 6],
}

/// A machine whose answer is known.
struct Made {
    geometry: f1::Geometry,
    tool: Numbers,
    q: Numbers,
}

/// T13: seeded near the answer that the machine was made of, core finds it, both ways, as the slow solver does; seeded farther away or
/// not at all it finds an answer of this machine, or says why not.
///
/// # Panics
/// When it does not.
pub fn six_is_solved(input: &Six) {
    let Some(made) = Made::new(input) else {
        return;
    };
    let Some(kinematics) = robots::f1(made.geometry) else {
        return;
    };
    let pose = pose(&made.tool);
    made.equations_are_these(&kinematics, &pose);
    let [.., q4, q5, q6] = made.q;
    for seed in [None, Some([q4, q5, q6])] {
        answers_are_checked(&kinematics, &pose, seed, &made.q);
    }
    let off: Numbers = input.off.map(|off| share(off, 0.2));
    made.forward_is_known(&kinematics, &off);
    made.inverse_is_known(&kinematics, &pose, &off);
}

impl Made {
    /// None where the links of a cluster point to different sides: no machine is built so.
    fn new(input: &Six) -> Option<Self> {
        let base = robots::f1_geometry();
        let [x, y, z] = robots::f1_home();
        let [tool_x, tool_y, tool_z, turn_x, turn_y, turn_z] = input.tool;
        let tool = [
            x + share(tool_x, 0.4),
            y + share(tool_y, 0.4),
            z + share(tool_z, 0.4),
            share(turn_x, 0.4),
            share(turn_y, 0.4),
            share(turn_z, 0.4),
        ];
        let q = std::array::from_fn(|axis| {
            let at = if axis < 3 { 1.5 } else { 0.0 };
            at + share(input.positions[axis], 0.5)
        });
        let [turn_axis, tilt_axis] = near([base.turn_axis.into(), base.tilt_axis.into()], &input.axes, 0.3);
        let signs = input.turn_signs.map(|other| if other { Branch::Negative } else { Branch::Positive });
        let geometry = f1::Geometry {
            carts_m: near(base.carts_m.map(Into::into), &input.carts, 0.3).map(Into::into),
            guideways: near(base.guideways.map(Into::into), &input.guideways, 0.3).map(Into::into),
            plate_joints_m: near(base.plate_joints_m.map(Into::into), &input.plate_joints, 0.05).map(Into::into),
            platform_joints_m: near(base.platform_joints_m.map(Into::into), &input.joints, 0.05).map(Into::into),
            turn_axis: turn_axis.into(),
            tilt_axis: tilt_axis.into(),
            turn_signs: signs,
            travel: None,
            ..base
        };
        let mut made = Self { geometry, tool, q };
        made.geometry.lengths_m = made.links(&tool, &q).map(length);
        let sides = made.sides();
        for (arm, first) in [0, 1, 3].into_iter().enumerate() {
            let branch = if sides[first] < 0.0 { Branch::Negative } else { Branch::Positive };
            made.geometry.configuration[arm] = branch;
        }
        let regular = |link: usize| {
            let branch = made.geometry.configuration[ARM_OF_LINK[link]];
            sides[link] * branch.sign() > REGULAR
        };
        (0..6).all(regular).then_some(made)
    }

    /// The cosine of each link to its guideway.
    fn sides(&self) -> Numbers {
        let links = self.links(&self.tool, &self.q);
        std::array::from_fn(|link| {
            let guideway = self.guideway(ARM_OF_LINK[link]);
            dot(links[link], guideway) / length(guideway) / length(links[link])
        })
    }

    fn guideway(&self, arm: usize) -> Vector {
        self.geometry.guideways[arm].into()
    }

    /// From each platform joint to its plate joint `[T 3.1.2]`.
    fn links(&self, tool: &Numbers, q: &Numbers) -> [Vector; 6] {
        let geometry = &self.geometry;
        let (turn, tilt) = (geometry.turn_axis.into(), geometry.tilt_axis.into());
        let [sigma4, sigma5] = geometry.turn_signs.map(Branch::sign);
        std::array::from_fn(|link| {
            let arm = ARM_OF_LINK[link];
            let joint: Vector = geometry.plate_joints_m[link].into();
            let joint = match arm {
                0 => joint,
                1 => turned(joint, turn, sigma4 * q[3]),
                _ => turned(turned(joint, tilt, q[5]), turn, sigma5 * q[4]),
            };
            let cart = add(geometry.carts_m[arm].into(), times(self.guideway(arm), q[arm]));
            let platform: Vector = geometry.platform_joints_m[link].into();
            less(add(cart, joint), placed(platform, tool))
        })
    }

    /// By how much each link is too long.
    fn errors(&self, tool: &Numbers, q: &Numbers) -> Numbers {
        let links = self.links(tool, q);
        std::array::from_fn(|link| length(links[link]) - self.geometry.lengths_m[link])
    }

    fn equations_are_these(&self, kinematics: &f1::Kinematics, pose: &Pose) {
        let ours = self.links(&self.tool, &self.q);
        let theirs = kinematics.links_m(pose, &self.q);
        for (ours, theirs) in ours.iter().zip(&theirs) {
            assert!(length(less(*ours, (*theirs).into())) < 1e-13, "the links are where the thesis has them");
        }
    }

    fn forward_is_known(&self, kinematics: &f1::Kinematics, off: &Numbers) {
        let unknown = |tool: &Numbers| self.errors(tool, &self.q);
        if regularity(&derivatives(&unknown, &self.tool)) < REGULAR {
            return;
        }
        // Near enough that no other answer lies on the way.
        let close = std::array::from_fn(|i| self.tool[i] + 0.01 * off[i]);
        let found = kinematics.forward_from(&self.q, &pose(&close), COLD_ITERATIONS);
        let distance = |found: &Pose| {
            let known = pose(&self.tool);
            let place = (found.position_m - known.position_m).norm();
            place.max((found.rotation - known.rotation).norm())
        };
        assert!((found.as_ref()).is_ok_and(|found| distance(&found.value) < 1e-7), "T13: the known pose: {found:?}");
        let slow = creep(&unknown, close);
        assert!(slow.is_some_and(|slow| apart(&slow, &self.tool) < 1e-7), "the slow solver finds it too: {slow:?}");
        // Farther away it may be another one, but it is one, on the seed's side of every singularity.
        let far: Numbers = std::array::from_fn(|i| self.tool[i] + off[i]);
        if let Ok(found) = kinematics.forward_from(&self.q, &pose(&far), COLD_ITERATIONS) {
            let links = kinematics.links_m(&found.value, &self.q);
            for (link, length) in links.iter().zip(&self.geometry.lengths_m) {
                assert!((link.norm() - length).abs() < 2e-9, "T13: every length");
            }
        }
    }

    fn inverse_is_known(&self, kinematics: &f1::Kinematics, pose: &Pose, off: &Numbers) {
        let unknown = |q: &Numbers| self.errors(&self.tool, q);
        if regularity(&derivatives(&unknown, &self.q)) < REGULAR {
            return;
        }
        // The inverse begins where the first link of a cluster would put its cart with the plate as it is seeded, and that link, nearly
        // across its guideway, is too short when the plate is off by more than `L cos^2 / (2 lever)`.
        let [_, side2, _, side3, ..] = self.sides();
        let least = side2.abs().min(side3.abs());
        let near = (2.0 * least * least).min(0.01);
        let close: Numbers = std::array::from_fn(|i| self.q[i] + near * off[i]);
        let [.., q4, q5, q6] = close;
        let found = kinematics.inverse(pose, Some([q4, q5, q6]));
        assert!(
            (found.as_ref()).is_ok_and(|found| apart(&found.value, &self.q) < 1e-7),
            "T13: the known positions {:?}: {found:?}",
            self.q
        );
        let slow = creep(&unknown, close);
        assert!(slow.is_some_and(|slow| apart(&slow, &self.q) < 1e-7), "the slow solver finds them too: {slow:?}");
    }
}

const ARM_OF_LINK: [usize; 6] = [0, 1, 1, 2, 2, 2];

/// A point of the platform in the world.
fn placed(point: Vector, [x, y, z, turn @ ..]: &Numbers) -> Vector {
    let angle = length(*turn);
    let rotated = if angle > 0.0 { turned(point, *turn, angle) } else { point };
    add([*x, *y, *z], rotated)
}

fn pose(tool: &Numbers) -> Pose {
    let [x, y, z, ..] = *tool;
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let columns = axes.map(|axis| less(placed(axis, tool), [x, y, z]));
    Pose { position_m: [x, y, z].into(), rotation: columns.into() }
}

/// Derivatives of the errors by the unknowns, by differences; rows are errors.
fn derivatives(errors: &dyn Fn(&Numbers) -> Numbers, at: &Numbers) -> [Numbers; 6] {
    const STEP: f64 = 1e-6;
    let mut rows = [[0.0; 6]; 6];
    for unknown in 0..6 {
        let (mut more, mut fewer) = (*at, *at);
        more[unknown] += STEP;
        fewer[unknown] -= STEP;
        let (more, fewer) = (errors(&more), errors(&fewer));
        for row in 0..6 {
            rows[row][unknown] = (more[row] - fewer[row]) / (2.0 * STEP);
        }
    }
    rows
}

/// Newton's method, never further than a hundredth in one step.
fn creep(errors: &dyn Fn(&Numbers) -> Numbers, from: Numbers) -> Option<Numbers> {
    let mut at = from;
    for _ in 0..60 {
        let wrong = errors(&at);
        let (step, _) = eliminated(derivatives(errors, &at), wrong)?;
        let longest = step.iter().fold(0.0, |most, x| f64::max(most, x.abs()));
        let damped = (0.01 / longest).min(1.0);
        for unknown in 0..6 {
            at[unknown] -= damped * step[unknown];
        }
        if longest < 1e-12 {
            break;
        }
    }
    let wrong = errors(&at);
    (wrong.iter().all(|error| error.abs() < 1e-10)).then_some(at)
}

/// The smallest pivot over the largest.
fn regularity(rows: &[Numbers; 6]) -> f64 {
    eliminated(*rows, [0.0; 6]).map_or(0.0, |(_, regularity)| regularity)
}

/// Gauss and Jordan, with the largest of all remaining numbers as pivot.
fn eliminated(mut rows: [Numbers; 6], mut right: Numbers) -> Option<(Numbers, f64)> {
    let mut column_of_row = [None; 6];
    let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
    for _ in 0..6 {
        let free = |row: &usize| column_of_row[*row].is_none();
        let places = (0..6).filter(free).flat_map(|row| (0..6).map(move |column| (row, column)));
        let size = |(row, column): &(usize, usize)| rows[*row][*column].abs();
        let (row, column) = places.max_by(|one, other| size(one).total_cmp(&size(other)))?;
        let pivot = rows[row][column];
        (least, most) = (least.min(pivot.abs()), most.max(pivot.abs()));
        // False for NaN.
        let usable = pivot.abs() > 1e-12;
        if !usable {
            return None;
        }
        column_of_row[row] = Some(column);
        let (pivots, from) = (rows[row], right[row]);
        for other in (0..6).filter(|other| *other != row) {
            let factor = rows[other][column] / pivot;
            let less = |(number, above): (&mut f64, f64)| *number -= factor * above;
            rows[other].iter_mut().zip(pivots).for_each(less);
            right[other] -= factor * from;
        }
    }
    let mut solution = [0.0; 6];
    for row in 0..6 {
        let column = column_of_row[row]?;
        solution[column] = right[row] / rows[row][column];
    }
    Some((solution, least / most))
}

fn apart(one: &Numbers, other: &Numbers) -> f64 {
    let pairs = one.iter().zip(other);
    pairs.fold(0.0, |most, (x, y)| f64::max(most, (x - y).abs()))
}
