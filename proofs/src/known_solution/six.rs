//! The machine with six axes: its equations once more, and Newton's method with differences for
//! derivatives and small steps.

use gantry_tau_core::model::f1;
use gantry_tau_core::model::kinematics::{COLD_ITERATIONS, Pose};
use gantry_tau_core::model::robot::Branch;
use nalgebra::{Matrix3, Matrix6, Vector6};

use super::{ARM_OF_LINK, REGULAR, Vector, close, near, share, sign, turned};
use crate::properties::six_link::answers_are_checked;
use crate::robots;

/// Six numbers: positions of the axes, or a place and a rotation vector.
type Numbers = Vector6<f64>;

/// A machine with six axes as differences from the vectors' F1, the place of its tool, and the
/// errors of the seeds.
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

/// T13: seeded near the answer that the machine was made of, core finds it, both ways, as the slow
/// solver does; seeded farther away or not at all it finds an answer of this machine, or says why
/// not.
pub fn six_is_solved(input: &Six) {
    let Some(made) = Made::new(input) else { return };
    let Some(kinematics) = robots::f1(made.geometry) else {
        return;
    };
    let pose = pose(&made.tool);
    made.equations_are_these(&kinematics, &pose);
    for seed in [None, Some(plates(&made.q))] {
        answers_are_checked(&kinematics, &pose, seed, &made.q.into());
    }
    let off = input.off.map(|off| share(off, 0.2)).into();
    made.forward_is_known(&kinematics, &off);
    made.inverse_is_known(&kinematics, &pose, &off);
}

impl Made {
    /// None where the links of a cluster point to different sides: no machine is built so.
    fn new(input: &Six) -> Option<Self> {
        let base = robots::f1_geometry();
        let [x, y, z] = robots::f1_home();
        let tool = Numbers::new(x, y, z, 0.0, 0.0, 0.0)
            + Numbers::from(input.tool.map(|step| share(step, 0.4)));
        let q = Numbers::new(1.5, 1.5, 1.5, 0.0, 0.0, 0.0)
            + Numbers::from(input.positions.map(|step| share(step, 0.5)));
        let [turn_axis, tilt_axis] = near([base.turn_axis, base.tilt_axis], &input.axes, 0.3);
        let signs = input.turn_signs.map(|other| {
            if other {
                Branch::Negative
            } else {
                Branch::Positive
            }
        });
        let geometry = f1::Geometry {
            carts_m: near(base.carts_m, &input.carts, 0.3),
            guideways: near(base.guideways, &input.guideways, 0.3),
            plate_joints_m: near(base.plate_joints_m, &input.plate_joints, 0.05),
            platform_joints_m: near(base.platform_joints_m, &input.joints, 0.05),
            turn_axis,
            tilt_axis,
            turn_signs: signs,
            travel: None,
            ..base
        };
        let mut made = Self { geometry, tool, q };
        made.geometry.lengths_m = made.links(&tool, &q).map(|link| link.norm());
        let sides = made.sides();
        made.geometry.configuration = [0, 1, 3].map(|first| sign(sides[first]));
        (0..6)
            .all(|link| {
                let branch = made.geometry.configuration[ARM_OF_LINK[link]];
                sides[link] * branch.sign() > REGULAR
            })
            .then_some(made)
    }

    /// The cosine of each link to its guideway.
    fn sides(&self) -> [f64; 6] {
        let links = self.links(&self.tool, &self.q);
        std::array::from_fn(|link| {
            let guideway = self.geometry.guideways[ARM_OF_LINK[link]];
            links[link].dot(&guideway) / guideway.norm() / links[link].norm()
        })
    }

    /// From each platform joint to its plate joint `[T 3.1.2]`.
    fn links(&self, tool: &Numbers, q: &Numbers) -> [Vector; 6] {
        let geometry = &self.geometry;
        let turn = geometry.turn_axis;
        let tilt = geometry.tilt_axis;
        let [sigma4, sigma5] = geometry.turn_signs.map(Branch::sign);
        std::array::from_fn(|link| {
            let arm = ARM_OF_LINK[link];
            let joint = geometry.plate_joints_m[link];
            let joint = match arm {
                0 => joint,
                1 => turned(joint, turn, sigma4 * q[3]),
                _ => turned(turned(joint, tilt, q[5]), turn, sigma5 * q[4]),
            };
            let cart = geometry.carts_m[arm] + geometry.guideways[arm] * q[arm];
            cart + joint - placed(geometry.platform_joints_m[link], tool)
        })
    }

    /// By how much each link is too long.
    fn errors(&self, tool: &Numbers, q: &Numbers) -> Numbers {
        Numbers::from(self.links(tool, q).map(|link| link.norm()))
            - Numbers::from(self.geometry.lengths_m)
    }

    fn equations_are_these(&self, kinematics: &f1::Kinematics, pose: &Pose) {
        let ours = self.links(&self.tool, &self.q);
        let theirs = kinematics.links_m(pose, &self.q.into());
        for (ours, theirs) in ours.iter().zip(&theirs) {
            assert!(
                (ours - theirs).norm() < 1e-13,
                "the links are where the thesis has them"
            );
        }
    }

    fn forward_is_known(&self, kinematics: &f1::Kinematics, off: &Numbers) {
        let unknown = |tool: &Numbers| self.errors(tool, &self.q);
        if regularity(derivatives(&unknown, &self.tool)) < REGULAR {
            return;
        }
        // Near enough that no other answer lies on the way.
        let nearby = self.tool + 0.01 * off;
        let q = self.q.into();
        let found = kinematics.forward_from(&q, &pose(&nearby), COLD_ITERATIONS);
        let known = pose(&self.tool);
        assert!(
            (found.as_ref()).is_ok_and(|found| distance(&found.value, &known) < 1e-7),
            "T13: the known pose: {found:?}"
        );
        let slow = creep(&unknown, nearby);
        assert!(
            slow.is_some_and(|slow| close(&slow, &self.tool, 1e-7)),
            "the slow solver finds it too: {slow:?}"
        );
        // Farther away it may be another one, but it is one, on the seed's side of every
        // singularity.
        if let Ok(found) = kinematics.forward_from(&q, &pose(&(self.tool + off)), COLD_ITERATIONS) {
            let lengths = kinematics.links_m(&found.value, &q).map(|link| link.norm());
            assert!(
                close(&lengths, &self.geometry.lengths_m, 2e-9),
                "T13: every length"
            );
        }
    }

    fn inverse_is_known(&self, kinematics: &f1::Kinematics, pose: &Pose, off: &Numbers) {
        let unknown = |q: &Numbers| self.errors(&self.tool, q);
        if regularity(derivatives(&unknown, &self.q)) < REGULAR {
            return;
        }
        let nearby = self.q + 0.01 * off;
        let found = kinematics.inverse(pose, Some(plates(&nearby)));
        assert!(
            (found.as_ref()).is_ok_and(|found| close(&found.value, &self.q, 1e-7)),
            "T13: the known positions {:?}: {found:?}",
            self.q
        );
        let slow = creep(&unknown, nearby);
        assert!(
            slow.is_some_and(|slow| close(&slow, &self.q, 1e-7)),
            "the slow solver finds them too: {slow:?}"
        );
    }
}

/// Distance of two poses: of their positions, metres, or of their rotation matrices (Frobenius
/// norm), whichever is larger.
fn distance(one: &Pose, other: &Pose) -> f64 {
    let position_m = (one.position_m - other.position_m).norm();
    position_m.max((one.rotation - other.rotation).norm())
}

/// Positions of the plates.
fn plates(q: &Numbers) -> [f64; 3] {
    [q[3], q[4], q[5]]
}

/// A point of the platform in the world.
fn placed(point: Vector, tool: &Numbers) -> Vector {
    let place = tool.fixed_rows::<3>(0);
    let turn = tool.fixed_rows::<3>(3).into_owned();
    let angle = turn.norm();
    place
        + if angle > 0.0 {
            turned(point, turn, angle)
        } else {
            point
        }
}

fn pose(tool: &Numbers) -> Pose {
    let position_m = placed(Vector::zeros(), tool);
    let columns =
        [Vector::x(), Vector::y(), Vector::z()].map(|axis| placed(axis, tool) - position_m);
    Pose {
        position_m,
        rotation: Matrix3::from_columns(&columns),
    }
}

/// Derivatives of the errors by the unknowns, by differences; rows are errors.
fn derivatives(errors: &dyn Fn(&Numbers) -> Numbers, at: &Numbers) -> Matrix6<f64> {
    const STEP: f64 = 1e-6;
    let columns: [Numbers; 6] = std::array::from_fn(|unknown| {
        let step = Numbers::ith(unknown, STEP);
        (errors(&(at + step)) - errors(&(at - step))) / (2.0 * STEP)
    });
    Matrix6::from_columns(&columns)
}

/// Newton's method, never further than a hundredth in one step.
fn creep(errors: &dyn Fn(&Numbers) -> Numbers, from: Numbers) -> Option<Numbers> {
    let mut at = from;
    for _ in 0..60 {
        let step = derivatives(errors, &at).full_piv_lu().solve(&errors(&at))?;
        at -= step * (0.01 / step.amax()).min(1.0);
        if step.amax() < 1e-12 {
            break;
        }
    }
    close(&errors(&at), &Numbers::zeros(), 1e-10).then_some(at)
}

/// The smallest pivot over the largest; nought for NaN.
fn regularity(rows: Matrix6<f64>) -> f64 {
    let pivots = rows.full_piv_lu().u().diagonal().abs();
    (pivots.min() / pivots.max()).max(0.0)
}
