//! The machine with three axes: positions by bisection, the tool by walking round the circle in which two spheres meet.

use gantry_tau_core::model::kinematics::KinematicsError;
use gantry_tau_core::model::l2;
use gantry_tau_core::model::robot::Branch;

use super::{REGULAR, Vector, add, cross, dot, length, less, near, share, times};
use crate::kinematics::{lengths_are_kept, travel_is_finite};
use crate::robots;

/// A machine with three axes as differences from `robots/l2.toml`, the place of its tool, and two more requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "arbitrary", derive(arbitrary::Arbitrary))]
pub struct Three {
    /// Origins of the arms.
    pub origins: [[i16; 3]; 3],
    /// Directions of the guideways.
    pub guideways: [[i16; 3]; 3],
    /// Joints on the platform.
    pub joints: [[i16; 3]; 6],
    /// The tool.
    pub tool: [i16; 3],
    /// Positions.
    pub positions: [i16; 3],
    /// Another tool, farther away, that may be out of reach.
    pub elsewhere: [i16; 3],
    /// Other positions, from which the links may not meet.
    pub moved: [i16; 3],
}

/// A machine whose answer is known.
struct Made {
    origins: [Vector; 3],
    guideways: [Vector; 3],
    lengths: [f64; 3],
    sides: [f64; 3],
    height: f64,
    tool: Vector,
    q: [f64; 3],
}

/// T13: core finds the answers that the machine was made of, what the slow solvers find and nothing else, and says why not.
///
/// # Panics
/// When it does not.
pub fn three_is_solved(input: &Three) {
    let made = Made::new(input);
    let Some((robot, nominal)) = made.machine(input) else {
        return;
    };
    travel_is_finite(&nominal);
    let elsewhere = add(made.tool, input.elsewhere.map(|step| share(step, 2.0)));
    let moved = std::array::from_fn(|arm| made.q[arm] + share(input.moved[arm], 2.0));
    for (tool, q) in [(made.tool, made.q), (elsewhere, moved)] {
        lengths_are_kept(&robot, &nominal, tool, q);
        made.inverse_is_that_of_bisection(&nominal, tool);
        made.forward_is_on_the_circle(&nominal, q);
    }
    made.answer_is_known(&nominal);
}

fn sign(number: f64) -> Branch {
    if number < 0.0 { Branch::Negative } else { Branch::Positive }
}

impl Made {
    fn new(input: &Three) -> Self {
        let base = robots::l2_geometry();
        let first_of_arm = [0, 1, 3];
        let at = first_of_arm.map(|link| <Vector>::from(base.cart_joints_m[link] - base.platform_joints_m[link]));
        let origins = near(at, &input.origins, 0.3);
        let guideways = near(base.guideways.map(Into::into), &input.guideways, 0.5);
        let [tool] = near([robots::l2_home()], &[input.tool], 0.3);
        let q = std::array::from_fn(|arm| {
            let towards = [1.0, -1.0, 1.0][arm];
            towards * 0.6 + share(input.positions[arm], 1.0)
        });
        let mut made = Self { origins, guideways, lengths: [0.0; 3], sides: [0.0; 3], height: 0.0, tool, q };
        let links = made.links(tool, q);
        made.lengths = links.map(length);
        made.sides = std::array::from_fn(|arm| dot(links[arm], guideways[arm]));
        made.height = made.height_of(tool, q);
        made
    }

    fn machine(&self, input: &Three) -> Option<(l2::Robot, l2::Kinematics)> {
        let base = robots::l2_geometry();
        let joints = near(base.platform_joints_m.map(Into::into), &input.joints, 0.2);
        let arm_of_link = [0, 1, 1, 2, 2, 2];
        let carts: [Vector; 6] = std::array::from_fn(|link| add(self.origins[arm_of_link[link]], joints[link]));
        let mut geometry = l2::Geometry {
            cart_joints_m: carts.map(Into::into),
            platform_joints_m: joints.map(Into::into),
            guideways: self.guideways.map(Into::into),
            lengths_m: self.lengths,
            travel: None,
            ..base
        };
        geometry.configuration.inverse = self.sides.map(sign);
        geometry.configuration.forward = sign(self.height);
        robots::l2(geometry)
    }

    fn carts(&self, q: [f64; 3]) -> [Vector; 3] {
        std::array::from_fn(|arm| add(self.origins[arm], times(self.guideways[arm], q[arm])))
    }

    /// From the tool to each cart.
    fn links(&self, tool: Vector, q: [f64; 3]) -> [Vector; 3] {
        self.carts(q).map(|cart| less(cart, tool))
    }

    /// On which side of the carts' plane the tool is.
    fn height_of(&self, tool: Vector, q: [f64; 3]) -> f64 {
        let [one, two, three] = self.carts(q);
        dot(cross(less(two, one), less(three, one)), less(tool, one))
    }

    /// The smallest of the relative measures of regularity, negative in another configuration than the machine's.
    fn regularity(&self, tool: Vector, q: [f64; 3]) -> f64 {
        let links = self.links(tool, q);
        let mut least = self.height_of(tool, q) * self.height.signum();
        least /= links.map(length).iter().product::<f64>();
        for (arm, link) in links.iter().enumerate() {
            let along = dot(*link, self.guideways[arm]) * self.sides[arm].signum();
            least = least.min(along / length(*link) / length(self.guideways[arm]));
        }
        least
    }

    /// Requires the values that the machine was made of, both ways.
    fn answer_is_known(&self, nominal: &l2::Kinematics) {
        if self.regularity(self.tool, self.q) < REGULAR {
            return;
        }
        let inverse = nominal.inverse_in_assembly(&self.tool.into());
        assert!(inverse.is_ok_and(|q| apart(&q, &self.q) < 1e-9), "T13: the known positions: {inverse:?}");
        let forward = nominal.forward(&self.q).map(<Vector>::from);
        assert!(forward.is_ok_and(|tool| apart(&tool, &self.tool) < 1e-9), "T13: the known tool: {forward:?}");
    }

    fn inverse_is_that_of_bisection(&self, nominal: &l2::Kinematics, tool: Vector) {
        let found = nominal.inverse(&tool.into());
        let mut slow = [0.0; 3];
        let mut grazes = false;
        for (arm, slow) in slow.iter_mut().enumerate() {
            let (q, spare) = self.bisect(arm, tool);
            if spare < -1e-9 {
                // Which arm is told, not only that one is; unless one before it barely reaches.
                let named = found == Err(KinematicsError::Unreachable { arm });
                assert!(named || grazes, "T13: arm {arm} is out of reach: {found:?}");
                return;
            }
            // The square of the measure of regularity is twice this.
            grazes |= spare < 1e-5;
            *slow = q;
        }
        match found {
            Ok(q) => assert!(grazes || apart(&q, &slow) < 1e-9, "T13: {q:?}, by bisection {slow:?}"),
            Err(error) => assert!(grazes, "T13: within reach at {slow:?}: {error:?}"),
        }
    }

    /// The position of one arm, and by how much of its length it reaches further than it must.
    fn bisect(&self, arm: usize, tool: Vector) -> (f64, f64) {
        let scale = length(self.guideways[arm]);
        let from_origin = less(tool, self.origins[arm]);
        let foot = dot(from_origin, self.guideways[arm]) / (scale * scale);
        let distance = |q: f64| {
            let cart = add(self.origins[arm], times(self.guideways[arm], q));
            length(less(cart, tool))
        };
        let reach = self.lengths[arm];
        let outwards = self.sides[arm].signum() / scale;
        let (mut near, mut far) = (0.0, 2.0 * reach);
        for _ in 0..200 {
            let middle = 0.5 * (near + far);
            if distance(foot + outwards * middle) < reach {
                near = middle;
            } else {
                far = middle;
            }
        }
        (foot + outwards * near, 1.0 - distance(foot) / reach)
    }

    /// Every regular place of the tool is found that there is, and no other.
    fn forward_is_on_the_circle(&self, nominal: &l2::Kinematics, q: [f64; 3]) {
        let places = self.walk_round(q);
        let found = nominal.forward(&q).map(<Vector>::from);
        let regular: Vec<&Vector> = places.iter().filter(|place| self.regularity(**place, q) > REGULAR).collect();
        match (&found, regular.first()) {
            (Ok(tool), Some(place)) => {
                assert!(apart(tool, place) < 1e-6, "T13: {tool:?}, on the circle {place:?}");
            }
            (Err(error), Some(place)) => panic!("T13: on the circle is {place:?}: {error:?}"),
            (Ok(tool), None) => {
                let measure = self.regularity(*tool, q);
                assert!(
                    measure > 0.0 && measure < 2.0 * REGULAR,
                    "T13: {tool:?} is in this configuration, and hardly regular: {measure}"
                );
            }
            (Err(_), None) => {}
        }
    }

    /// Possible meeting points of the links: points of the circle about the first two carts that are as far from the third as its link is long.
    fn walk_round(&self, q: [f64; 3]) -> Vec<Vector> {
        let [one, two, three] = self.carts(q);
        let [l1, l2, l3] = self.lengths;
        let apart = length(less(two, one));
        let axis = times(less(two, one), 1.0 / apart);
        let along = (l1 * l1 - l2 * l2 + apart * apart) / (2.0 * apart);
        let radius = (l1 * l1 - along * along).sqrt();
        if radius.is_nan() || apart < 1e-3 {
            return Vec::new();
        }
        let smallest = (0..3).min_by(|i, j| axis[*i].abs().total_cmp(&axis[*j].abs()));
        let mut aside = [0.0; 3];
        aside[smallest.unwrap_or(0)] = 1.0;
        let across = cross(axis, aside);
        let across = times(across, radius / length(across));
        let centre = add(one, times(axis, along));
        let point = |angle: f64| add(centre, super::turned(across, axis, angle));
        let error = |angle: f64| length(less(point(angle), three)) - l3;
        let step = std::f64::consts::TAU / 500.0;
        let mut places = Vec::new();
        for number in 0..500 {
            let (mut low, mut high) = (f64::from(number) * step, f64::from(number + 1) * step);
            if (error(low) < 0.0) == (error(high) < 0.0) {
                continue;
            }
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if (error(low) < 0.0) == (error(middle) < 0.0) {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            places.push(point(low));
        }
        places
    }
}

fn apart(one: &[f64; 3], other: &[f64; 3]) -> f64 {
    let pairs = one.iter().zip(other);
    pairs.fold(0.0, |most, (x, y)| f64::max(most, (x - y).abs()))
}
