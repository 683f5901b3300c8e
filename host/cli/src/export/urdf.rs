//! A machine at home as a description for viewers (URDF): a tree, so without the loops.
//!
//! Carts and plates move by their axes, zero at home. Links stand on them as they stand at home, and
//! the platform at home: neither follows.

use gantry_tau_core::model::robot::ARMS;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{RobotFile, RobotFileError};
use nalgebra::{UnitQuaternion, Vector3};

use super::at_home::AtHome;
use super::{CART_M, LINK_RADIUS_M};
use crate::xml::Element;

/// Name of the root.
const WORLD: &str = "world";

/// Returns a machine at home as a description.
///
/// # Errors
/// [`RobotFileError`] if home cannot be reached.
pub fn urdf<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
) -> Result<String, RobotFileError> {
    let at_home = AtHome::of(robot)?;
    let mut range_m = robot
        .limits
        .iter()
        .zip(robot.metres_per_q)
        .map(|(axis, metres)| {
            let travel = axis.machine_travel;
            [travel.lower, travel.upper].map(|end| end.to_metres().0 / metres)
        });
    let ranges: [[f64; 2]; N] = std::array::from_fn(|_| range_m.next().unwrap_or_default());
    let mut tree = Tree(vec![Element::new("link").with("name", WORLD)]);
    for arm in 0..ARMS {
        tree.add_arm(&at_home, arm, &ranges);
    }
    tree.add_platform(&at_home);
    let whole = Element::new("robot")
        .with("name", K::MODEL)
        .containing(tree.0);
    Ok(whole.to_string())
}

/// Links and joints of a description.
struct Tree(Vec<Element>);

impl Tree {
    fn add_arm<const N: usize>(&mut self, at_home: &AtHome<N>, arm: usize, ranges: &[[f64; 2]; N]) {
        let guideway = at_home.geometry.guideways[arm];
        let cart = format!("cart{}", arm + 1);
        self.add_link(&cart, vec![cube(CART_M)]);
        let slide = Moving {
            kind: "prismatic",
            axis: arm,
            about: guideway.normalize(),
            range: ranges[arm].map(|end| (end - at_home.q[arm]) * guideway.norm()),
        };
        let place = at_home.cart_m(arm);
        self.add_moving(slide, [WORLD, &cart], &place, &UnitQuaternion::identity());
        let mut bearer = cart;
        for turn in at_home.turns(arm) {
            let plate = format!("plate{}", turn.axis + 1);
            self.add_link(&plate, Vec::new());
            let hinge = Moving {
                kind: "revolute",
                axis: turn.axis,
                about: turn.about.into_inner(),
                range: ranges[turn.axis].map(|end| end - turn.q),
            };
            self.add_moving(
                hinge,
                [&bearer, &plate],
                &Vector3::zeros(),
                &turn.rotation(),
            );
            bearer = plate;
        }
        for link in at_home.links(arm) {
            let name = format!("link{}", link.name);
            self.add_link(&name, vec![rod(&Vector3::new(0.0, 0.0, link.length_m))]);
            self.add_fixed([&bearer, &name], &link.joint_m, &link.rotation);
        }
    }

    fn add_platform<const N: usize>(&mut self, at_home: &AtHome<N>) {
        let joints_m = &at_home.geometry.platform_joints_m;
        self.add_link("platform", joints_m.iter().map(rod).collect());
        let unturned = UnitQuaternion::identity();
        self.add_fixed([WORLD, "platform"], &at_home.tool_m, &unturned);
    }

    fn add_link(&mut self, name: &str, visuals: Vec<Element>) {
        let link = Element::new("link").with("name", name);
        self.0.push(link.containing(visuals));
    }

    fn add_fixed(&mut self, links: [&str; 2], at_m: &Vector3<f64>, turned: &UnitQuaternion<f64>) {
        let [_, child] = links;
        let joint = Element::new("joint")
            .with("name", format!("on_{child}"))
            .with("type", "fixed");
        self.0.push(joined(joint, links, at_m, turned));
    }

    fn add_moving(
        &mut self,
        moving: Moving,
        links: [&str; 2],
        at_m: &Vector3<f64>,
        turned: &UnitQuaternion<f64>,
    ) {
        let [lower, upper] = moving.range;
        let joint = Element::new("joint")
            .with("name", format!("axis{}", moving.axis + 1))
            .with("type", moving.kind);
        self.0.push(
            joined(joint, links, at_m, turned).containing([
                Element::new("axis").with_numbers("xyz", moving.about.as_slice()),
                // Viewers do not use them; the format asks for them.
                Element::new("limit")
                    .with_numbers("lower", &[lower])
                    .with_numbers("upper", &[upper])
                    .with("effort", 0)
                    .with("velocity", 0),
            ]),
        );
    }
}

/// A joint that an axis moves.
struct Moving {
    kind: &'static str,
    /// Index of the axis.
    axis: usize,
    /// Direction, in the axes of the joint.
    about: Vector3<f64>,
    /// Positions from home, m or rad.
    range: [f64; 2],
}

fn joined(
    joint: Element,
    [parent, child]: [&str; 2],
    at_m: &Vector3<f64>,
    turned: &UnitQuaternion<f64>,
) -> Element {
    joint.containing([
        Element::new("parent").with("link", parent),
        Element::new("child").with("link", child),
        origin(at_m, turned),
    ])
}

/// Roll, pitch and yaw: turns about x, then y, then z, of the axes that stand still.
fn origin(at_m: &Vector3<f64>, turned: &UnitQuaternion<f64>) -> Element {
    let (roll, pitch, yaw) = turned.euler_angles();
    Element::new("origin")
        .with_numbers("xyz", at_m.as_slice())
        .with_numbers("rpy", &[roll, pitch, yaw])
}

fn cube(half_m: f64) -> Element {
    let shape = Element::new("box").with_numbers("size", &[2.0 * half_m; 3]);
    Element::new("visual").containing([Element::new("geometry").containing([shape])])
}

/// Picture of a rod from the origin of a link to a place.
fn rod(to_m: &Vector3<f64>) -> Element {
    let turned = UnitQuaternion::rotation_between(&Vector3::z(), to_m).unwrap_or_default();
    let shape = Element::new("cylinder")
        .with_numbers("radius", &[LINK_RADIUS_M])
        .with_numbers("length", &[to_m.norm()]);
    Element::new("visual").containing([
        origin(&(to_m / 2.0), &turned),
        Element::new("geometry").containing([shape]),
    ])
}
