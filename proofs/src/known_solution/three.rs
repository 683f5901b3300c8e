//! The machine with three axes: positions by bisection, the tool by walking round the circle in
//! which two spheres meet.

use gantry_tau_core::model::kinematics::KinematicsError;
use gantry_tau_core::model::l2;

use super::{ARM_OF_LINK, REGULAR, Vector, close, near, share, sign, turned};
use crate::properties::kinematics::{lengths_are_kept, travel_is_finite};
use crate::robots;

/// A machine with three axes as differences from `robots/l2.toml`, the place of its tool, and two
/// more requests.
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

/// T13: core finds the answers that the machine was made of, what the slow solvers find and nothing
/// else, and says why not.
pub fn three_is_solved(input: &Three) {
    let made = Made::new(input);
    let Some((robot, nominal)) = made.machine(input) else {
        return;
    };
    travel_is_finite(&nominal);
    let [elsewhere] = near([made.tool], &[input.elsewhere], 2.0);
    let moved = std::array::from_fn(|arm| made.q[arm] + share(input.moved[arm], 2.0));
    for (tool, q) in [(made.tool, made.q), (elsewhere, moved)] {
        lengths_are_kept(&robot, &nominal, tool.into(), q);
        made.inverse_is_that_of_bisection(&nominal, tool);
        made.forward_is_on_the_circle(&nominal, q);
    }
    made.answer_is_known(&nominal);
}

impl Made {
    fn new(input: &Three) -> Self {
        let base = robots::l2_geometry();
        let first_of_arm = [0, 1, 3];
        let at = first_of_arm.map(|link| base.cart_joints_m[link] - base.platform_joints_m[link]);
        let origins = near(at, &input.origins, 0.3);
        let guideways = near(base.guideways, &input.guideways, 0.5);
        let [tool] = near([robots::l2_home().into()], &[input.tool], 0.3);
        let q = std::array::from_fn(|arm| {
            let towards = [1.0, -1.0, 1.0][arm];
            towards * 0.6 + share(input.positions[arm], 1.0)
        });
        let mut made = Self {
            origins,
            guideways,
            lengths: [0.0; 3],
            sides: [0.0; 3],
            height: 0.0,
            tool,
            q,
        };
        let links = made.links(tool, q);
        made.lengths = links.map(|link| link.norm());
        made.sides = std::array::from_fn(|arm| links[arm].dot(&guideways[arm]));
        made.height = made.height_of(tool, q);
        made
    }

    fn machine(&self, input: &Three) -> Option<(l2::Robot, l2::Kinematics)> {
        let base = robots::l2_geometry();
        let joints = near(base.platform_joints_m, &input.joints, 0.2);
        let mut geometry = l2::Geometry {
            cart_joints_m: std::array::from_fn(|link| {
                self.origins[ARM_OF_LINK[link]] + joints[link]
            }),
            platform_joints_m: joints,
            guideways: self.guideways,
            lengths_m: self.lengths,
            travel: None,
            ..base
        };
        geometry.configuration.inverse = self.sides.map(sign);
        geometry.configuration.forward = sign(self.height);
        robots::l2(geometry)
    }

    fn carts(&self, q: [f64; 3]) -> [Vector; 3] {
        std::array::from_fn(|arm| self.origins[arm] + self.guideways[arm] * q[arm])
    }

    /// From the tool to each cart.
    fn links(&self, tool: Vector, q: [f64; 3]) -> [Vector; 3] {
        self.carts(q).map(|cart| cart - tool)
    }

    /// On which side of the carts' plane the tool is.
    fn height_of(&self, tool: Vector, q: [f64; 3]) -> f64 {
        let [one, two, three] = self.carts(q);
        (two - one).cross(&(three - one)).dot(&(tool - one))
    }

    /// The smallest of the relative measures of regularity, negative in another configuration than
    /// the machine's.
    fn regularity(&self, tool: Vector, q: [f64; 3]) -> f64 {
        let links = self.links(tool, q);
        let mut least = self.height_of(tool, q) * self.height.signum();
        least /= links.iter().map(Vector::norm).product::<f64>();
        for (arm, link) in links.iter().enumerate() {
            let along = link.dot(&self.guideways[arm]) * self.sides[arm].signum();
            least = least.min(along / link.norm() / self.guideways[arm].norm());
        }
        least
    }

    /// Requires the values that the machine was made of, both ways.
    fn answer_is_known(&self, nominal: &l2::Kinematics) {
        if self.regularity(self.tool, self.q) < REGULAR {
            return;
        }
        let inverse = nominal.inverse_in_assembly(&self.tool);
        assert!(
            inverse.is_ok_and(|q| close(&q, &self.q, 1e-9)),
            "T13: the known positions: {inverse:?}"
        );
        let forward = nominal.forward(&self.q);
        assert!(
            forward.is_ok_and(|tool| close(&tool, &self.tool, 1e-9)),
            "T13: the known tool: {forward:?}"
        );
    }

    fn inverse_is_that_of_bisection(&self, nominal: &l2::Kinematics, tool: Vector) {
        let found = nominal.inverse(&tool);
        let mut slow = [0.0; 3];
        let mut grazes = false;
        for (arm, slow) in slow.iter_mut().enumerate() {
            let (q, spare) = self.bisect(arm, tool);
            if spare < -1e-9 {
                // The error names the arm, not only that there is one; unless one before it barely
                // reaches.
                let named = found == Err(KinematicsError::Unreachable { arm });
                assert!(named || grazes, "T13: arm {arm} is out of reach: {found:?}");
                return;
            }
            // The square of the measure of regularity is twice this.
            grazes |= spare < 1e-5;
            *slow = q;
        }
        match found {
            Ok(q) => assert!(
                grazes || close(&q, &slow, 1e-9),
                "T13: {q:?}, by bisection {slow:?}"
            ),
            Err(error) => assert!(grazes, "T13: within reach at {slow:?}: {error:?}"),
        }
    }

    /// The position of one arm, and by how much of its length it reaches further than it must.
    fn bisect(&self, arm: usize, tool: Vector) -> (f64, f64) {
        let origin = self.origins[arm];
        let guideway = self.guideways[arm];
        let reach = self.lengths[arm];
        let foot = guideway.dot(&(tool - origin)) / guideway.norm_squared();
        let outwards = self.sides[arm].signum() / guideway.norm();
        let along = bisected((0.0, 2.0 * reach), 200, |along| {
            self.distance(arm, foot + outwards * along, tool) < reach
        });
        let spare = 1.0 - self.distance(arm, foot, tool) / reach;
        (foot + outwards * along, spare)
    }

    /// Distance of the tool from where the link of an arm begins at `q`, metres.
    fn distance(&self, arm: usize, q: f64, tool: Vector) -> f64 {
        (self.origins[arm] + self.guideways[arm] * q - tool).norm()
    }

    /// Every regular place of the tool is found that there is, and no other.
    fn forward_is_on_the_circle(&self, nominal: &l2::Kinematics, q: [f64; 3]) {
        let places = self.walk_round(q);
        let regular = places
            .iter()
            .find(|place| self.regularity(**place, q) > REGULAR);
        match (nominal.forward(&q), regular) {
            (Ok(tool), Some(place)) => {
                assert!(
                    close(&tool, place, 1e-6),
                    "T13: {tool:?}, on the circle {place:?}"
                );
            }
            (Err(error), Some(place)) => panic!("T13: on the circle is {place:?}: {error:?}"),
            (Ok(tool), None) => {
                let measure = self.regularity(tool, q);
                assert!(
                    measure > 0.0 && measure < 2.0 * REGULAR,
                    "T13: {tool:?} is in this configuration, and hardly regular: {measure}"
                );
            }
            (Err(_), None) => {}
        }
    }

    /// Possible meeting points of the links: points of the circle about the first two carts that
    /// are as far from the third as its link is long.
    fn walk_round(&self, q: [f64; 3]) -> Vec<Vector> {
        let [one, two, three] = self.carts(q);
        let [l1, l2, l3] = self.lengths;
        let apart = (two - one).norm();
        let axis = (two - one) / apart;
        let along = (l1 * l1 - l2 * l2 + apart * apart) / (2.0 * apart);
        let radius = (l1 * l1 - along * along).sqrt();
        if radius.is_nan() || apart < 1e-3 {
            return Vec::new();
        }
        // Half a turn from the point nearest to the third cart is the farthest, and between them
        // the distance changes one way.
        let towards = three - one - axis * axis.dot(&(three - one));
        let across = towards * (radius / towards.norm());
        let circle = Circle {
            centre: one + axis * along,
            axis,
            across,
        };
        let half = std::f64::consts::PI;
        let changes = [(0.0, half), (half, 2.0 * half)]
            .into_iter()
            .filter(|(low, high)| {
                circle.is_within(*low, three, l3) != circle.is_within(*high, three, l3)
            });
        changes
            .map(|(low, high)| {
                let is_low = circle.is_within(low, three, l3);
                let angle = bisected((low, high), 60, |angle| {
                    circle.is_within(angle, three, l3) == is_low
                });
                circle.point(angle)
            })
            .collect()
    }
}

/// A circle in space, metres.
struct Circle {
    centre: Vector,
    /// Unit vector along the axis of the circle.
    axis: Vector,
    /// From the centre to the point at angle 0.
    across: Vector,
}

impl Circle {
    /// Point at an angle, radians.
    fn point(&self, angle: f64) -> Vector {
        self.centre + turned(self.across, self.axis, angle)
    }

    /// True if the point at an angle (radians) is nearer to another one than `distance`, metres.
    fn is_within(&self, angle: f64, other: Vector, distance: f64) -> bool {
        (self.point(angle) - other).norm() - distance < 0.0
    }
}

/// The end of the numbers that are like the lowest.
fn bisected((mut low, mut high): (f64, f64), times: usize, is_low: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..times {
        let middle = 0.5 * (low + high);
        if is_low(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}
