//! A machine as a model of MuJoCo (MJCF): springs, masses and damping of its robot file, at home.
//!
//! | part | in the model |
//! |---|---|
//! | axis | slide or hinge `axis1` to `axis6`; its spring is the position actuator of the same name |
//! | link | body `link11` to `link33`, hung on cart or plate by a ball joint; it stretches along a slide, whose spring it is |
//! | joint on the platform | `connect` of the link's end |
//! | platform, tool | free body `platform`, which carries `tool`; force and torque at the site `sensor` are of the platform on the tool |
//!
//! The control of an actuator is where the drive is, in the metres of its count. A link has a sixth
//! of its mass at each end and four in the middle, which moves half as far as the end: the mass
//! matrix of a uniform thin rod. Springs are damped so that the lowest mode has the damping ratio of
//! the robot file; modes above it have more, in proportion to their frequency. Play, travel and the
//! masses of the motors are left out.

use gantry_tau_core::model::robot::{ARMS, Compliances};
use gantry_tau_machine::dynamics::{MassiveMachine, Modes};
use gantry_tau_machine::elastic::Pose;
use gantry_tau_machine::masses::{GRAVITY_M_PER_S2, Masses, RigidBody};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{RobotFile, RobotFileError};
use gantry_tau_machine::scene::LINK_NAMES;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::at_home::{AtHome, Link, Turn};
use super::{CART_M, LINK_RADIUS_M};
use crate::xml::Element;

/// Step, s. MuJoCo makes no constraint that is faster than two of them.
const STEP_S: f64 = 1e-4;
/// Inertia that MuJoCo asks for where nothing turns, kg m^2.
const SOME_KGM2: f64 = 1e-6;

/// Error of a machine that cannot be a model.
#[derive(Debug, thiserror::Error)]
pub enum MjcfError {
    /// The file has no compliances.
    #[error("{0}: no c_link, or none of the axes: a model needs springs")]
    NoSprings(String),
    /// The file has no masses.
    #[error("{0}: no [masses]: a model needs them")]
    NoMasses(String),
    /// The file has a joint between platform and tool.
    #[error("{0}: [[wrist]] cannot be exported; take it out of a copy of the file")]
    Wrist(String),
    /// Home is out of reach.
    #[error(transparent)]
    Home(#[from] RobotFileError),
    /// Springs and masses have no modes.
    #[error("{0}: springs and masses have no natural frequencies at home")]
    NoModes(String),
}

/// Returns a machine at home as a model.
///
/// # Errors
/// [`MjcfError`].
pub fn mjcf<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
) -> Result<String, MjcfError> {
    let name = || robot.name.clone();
    let compliances = robot
        .compliances
        .ok_or_else(|| MjcfError::NoSprings(name()))?;
    let masses = robot.masses.ok_or_else(|| MjcfError::NoMasses(name()))?;
    let machine = MassiveMachine::of(robot).ok_or_else(|| MjcfError::NoMasses(name()))?;
    if !robot.wrist.is_empty() {
        return Err(MjcfError::Wrist(name()));
    }
    let at_home = AtHome::of(robot)?;
    let pose = Pose {
        translation_m: at_home.tool_m,
        rotation: UnitQuaternion::identity(),
    };
    let modes = Modes::of(&machine, &pose, &at_home.q);
    let lowest = modes.and_then(|modes| modes.rad_per_s.iter().copied().next());
    let lowest_rad_per_s = lowest.ok_or_else(|| MjcfError::NoModes(name()))?;
    let rotation = Matrix3::from_row_iterator(robot.sensor.rotation.into_iter().flatten());
    let rotation = Rotation3::from_matrix_unchecked(rotation);
    let model = MjcfModel {
        kind: K::MODEL,
        at_home,
        compliances,
        masses,
        metres_per_q: robot.metres_per_q,
        sensor: (
            UnitQuaternion::from_rotation_matrix(&rotation),
            robot.sensor.lever_m,
        ),
        damping_s: 2.0 * masses.damping_ratio / lowest_rad_per_s,
    };
    Ok(model.whole().to_string())
}

/// Numbers of a model.
struct MjcfModel<const N: usize> {
    kind: &'static str,
    at_home: AtHome<N>,
    compliances: Compliances<N>,
    masses: Masses<N>,
    /// Metres of the drives' count per unit of `q`.
    metres_per_q: [f64; N],
    /// Platform axes from sensor axes, and from the tool centre point to the sensor, m.
    sensor: (UnitQuaternion<f64>, [f64; 3]),
    /// Damping of a spring, as a share of its stiffness, s.
    damping_s: f64,
}

impl<const N: usize> MjcfModel<N> {
    fn whole(&self) -> Element {
        let gravity = if self.masses.has_weight {
            GRAVITY_M_PER_S2
        } else {
            0.0
        };
        let option = Element::new("option")
            .with("timestep", STEP_S)
            .with_numbers("gravity", &[0.0, 0.0, -gravity])
            .with("integrator", "implicitfast")
            .containing([Element::new("flag").with("contact", "disable")]);
        let defaults = Element::new("default").containing([
            Element::new("geom")
                .with("contype", 0)
                .with("conaffinity", 0),
            // As hard as MuJoCo makes a constraint in steps of this length.
            Element::new("equality")
                .with_numbers("solref", &[2.0 * STEP_S, 1.0])
                .with_numbers("solimp", &[0.9999, 0.9999, 0.001]),
        ]);
        let bodies = (0..ARMS).map(|arm| self.cart(arm)).chain([self.platform()]);
        Element::new("mujoco").with("model", self.kind).containing([
            Element::new("compiler").with("angle", "radian"),
            option,
            defaults,
            Element::new("worldbody").containing(bodies),
            Element::new("equality").containing(LINK_NAMES.iter().flat_map(held)),
            Element::new("actuator").containing(self.drives()),
            Element::new("sensor").containing([
                Element::new("force")
                    .with("name", "force")
                    .with("site", "sensor"),
                Element::new("torque")
                    .with("name", "torque")
                    .with("site", "sensor"),
            ]),
            Element::new("keyframe").containing([Element::new("key")
                .with("name", "home")
                .with_numbers("ctrl", &self.controls())]),
        ])
    }

    /// Places of the drives, m.
    fn controls(&self) -> Vec<f64> {
        let axes = self.at_home.q.iter().zip(self.metres_per_q);
        axes.map(|(q, metres)| q * metres).collect()
    }

    /// Springs of the axes, in the metres of the drives' count: `k = 1 / (c m^2)` of a compliance
    /// `c` of the unit of `q`, which is `m` long.
    fn drives(&self) -> impl Iterator<Item = Element> {
        let axes = self
            .compliances
            .cart_m_per_n()
            .iter()
            .zip(self.metres_per_q);
        axes.enumerate().map(|(axis, (compliance, metres))| {
            let guideway = self.at_home.geometry.guideways.get(axis);
            let stiffness = 1.0 / (compliance * metres * metres);
            Element::new("position")
                .with("name", name_of(axis))
                .with("joint", name_of(axis))
                .with_numbers("gear", &[metres / guideway.map_or(1.0, Vector3::norm)])
                .with_numbers("kp", &[stiffness])
                .with_numbers("kv", &[self.damping_s * stiffness])
        })
    }

    /// A cart, with plate and links.
    fn cart(&self, arm: usize) -> Element {
        let guideway = self.at_home.geometry.guideways[arm];
        let links = self.at_home.links(arm).map(|link| self.link(&link));
        // The innermost plate carries them.
        let turns = self.at_home.turns(arm).into_iter().rev();
        let carried = turns.fold(links.collect(), |inner: Vec<Element>, turn| {
            vec![self.plate(&turn).containing(inner)]
        });
        Element::new("body")
            .with("name", format!("cart{}", arm + 1))
            .with_numbers("pos", self.at_home.cart_m(arm).as_slice())
            .containing([
                Element::new("joint")
                    .with("name", name_of(arm))
                    .with("type", "slide")
                    .with_numbers("axis", guideway.normalize().as_slice())
                    .with_numbers("ref", &[self.at_home.q[arm] * guideway.norm()]),
                point(self.masses.carts_kg[arm], SOME_KGM2),
                Element::new("geom")
                    .with("type", "box")
                    .with_numbers("size", &[CART_M; 3]),
            ])
            .containing(carried)
    }

    /// A plate as one axis turns it.
    fn plate(&self, turn: &Turn) -> Element {
        Element::new("body")
            .with("name", format!("plate{}", turn.axis + 1))
            .with_numbers("quat", &quaternion(&turn.rotation()))
            .containing([
                Element::new("joint")
                    .with("name", name_of(turn.axis))
                    .with("type", "hinge")
                    .with_numbers("axis", turn.about.as_slice())
                    .with_numbers("ref", &[turn.q])
                    .with_numbers("armature", &[self.masses.plates_kgm2[turn.axis - ARMS]]),
                // What it weighs belongs to its cart.
                point(SOME_KGM2, SOME_KGM2),
            ])
    }

    /// A link: a sixth of it at its joint, the rest along its z axis.
    fn link(&self, link: &Link) -> Element {
        let sixth_kg = self.masses.links_kg[link.index] / 6.0;
        let spin_kgm2 = sixth_kg * LINK_RADIUS_M * LINK_RADIUS_M;
        let stiffness = 1.0 / self.compliances.link_m_per_n()[link.index];
        let part = |part: &str, share: f64, sixths: f64, slide: Element| {
            let name = format!("{part}{}", link.name);
            Element::new("body")
                .with("name", &name)
                .with_numbers("pos", &[0.0, 0.0, share * link.length_m])
                .containing([
                    slide
                        .with("name", &name)
                        .with("type", "slide")
                        .with_numbers("axis", &[0.0, 0.0, 1.0]),
                    point(sixths * sixth_kg, spin_kgm2),
                    Element::new("site").with("name", &name),
                ])
        };
        let spring = Element::new("joint")
            .with_numbers("stiffness", &[stiffness])
            .with_numbers("damping", &[self.damping_s * stiffness]);
        let name = format!("link{}", link.name);
        Element::new("body")
            .with("name", &name)
            .with_numbers("pos", link.joint_m.as_slice())
            .with_numbers("quat", &quaternion(&link.rotation))
            .containing([
                Element::new("joint")
                    .with("name", &name)
                    .with("type", "ball"),
                point(sixth_kg, spin_kgm2),
                rod(&[0.0, 0.0, link.length_m]),
                part("middle", 0.5, 4.0, Element::new("joint")),
                part("end", 1.0, 1.0, spring),
            ])
    }

    fn platform(&self) -> Element {
        let (rotation, lever_m) = &self.sensor;
        let sensor = Element::new("site")
            .with("name", "sensor")
            .with_numbers("pos", lever_m)
            .with_numbers("quat", &quaternion(rotation));
        let joints = LINK_NAMES
            .iter()
            .zip(self.at_home.geometry.platform_joints_m);
        let held = joints.flat_map(|(name, place)| {
            let site = Element::new("site").with("name", format!("on_platform{name}"));
            [
                site.with_numbers("pos", place.as_slice()),
                rod(place.as_slice()),
            ]
        });
        Element::new("body")
            .with("name", "platform")
            .with_numbers("pos", self.at_home.tool_m.as_slice())
            .containing([
                Element::new("freejoint").with("name", "platform"),
                of_body(&self.masses.platform),
            ])
            .containing(held)
            .containing([Element::new("body").with("name", "tool").containing([
                of_body(&self.masses.tool),
                sensor,
                Element::new("site").with("name", "tool"),
            ])])
    }
}

/// Constraints of a link: its end is on the platform, its middle moves half as far.
fn held(name: &&str) -> [Element; 2] {
    [
        Element::new("connect")
            .with("site1", format!("end{name}"))
            .with("site2", format!("on_platform{name}")),
        Element::new("joint")
            .with("joint1", format!("middle{name}"))
            .with("joint2", format!("end{name}"))
            .with_numbers("polycoef", &[0.0, 0.5, 0.0, 0.0, 0.0]),
    ]
}

/// Name of an axis, of its joint and its actuator.
fn name_of(axis: usize) -> String {
    format!("axis{}", axis + 1)
}

/// Picture of a rod from the origin of a body.
fn rod(to: &[f64]) -> Element {
    Element::new("geom")
        .with("type", "capsule")
        .with_numbers("fromto", &[&[0.0; 3], to].concat())
        .with_numbers("size", &[LINK_RADIUS_M])
}

fn of_body(body: &RigidBody) -> Element {
    let i = body.inertia_kgm2;
    Element::new("inertial")
        .with_numbers("pos", body.centre_m.as_slice())
        .with_numbers("mass", &[body.mass_kg])
        .with_numbers("fullinertia", &[i.m11, i.m22, i.m33, i.m12, i.m13, i.m23])
}

/// A mass at the origin of a body.
fn point(mass_kg: f64, inertia_kgm2: f64) -> Element {
    Element::new("inertial")
        .with_numbers("pos", &[0.0; 3])
        .with_numbers("mass", &[mass_kg])
        .with_numbers("diaginertia", &[inertia_kgm2; 3])
}

/// Real part first.
fn quaternion(rotation: &UnitQuaternion<f64>) -> [f64; 4] {
    [rotation.w, rotation.i, rotation.j, rotation.k]
}
