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

mod element;

use gantry_tau_core::model::f1::Geometry;
use gantry_tau_core::model::robot::{ARM_OF_LINK, ARMS, Compliances};
use gantry_tau_machine::dynamics::{MassiveMachine, Modes};
use gantry_tau_machine::elastic::Pose;
use gantry_tau_machine::elastic::joints::joint;
use gantry_tau_machine::masses::{GRAVITY_M_PER_S2, Masses, RigidBody};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{RobotFile, RobotFileError};
use nalgebra::{Matrix3, Rotation3, Unit, UnitQuaternion, Vector3};

use element::Element;

/// Names of the links, in link order.
const LINKS: [&str; 6] = ["11", "21", "22", "31", "32", "33"];
/// Radius of a link, m: its inertia about itself, and its picture.
const RADIUS_M: f64 = 0.012;
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
    let q = robot.home_q()?;
    let home = Pose {
        translation_m: robot.home_m(),
        rotation: UnitQuaternion::identity(),
    };
    let modes = Modes::of(&machine, &home, &q);
    let lowest = modes.and_then(|modes| modes.rad_per_s.iter().copied().next());
    let lowest_rad_per_s = lowest.ok_or_else(|| MjcfError::NoModes(name()))?;
    let model = Model {
        kind: K::MODEL,
        geometry: robot.model.geometry(),
        compliances,
        masses,
        metres_per_q: robot.metres_per_q,
        sensor: (
            Matrix3::from_row_iterator(robot.sensor.rotation.into_iter().flatten()),
            robot.sensor.lever_m,
        ),
        home_m: home.translation_m,
        q,
        damping_s: 2.0 * masses.damping_ratio / lowest_rad_per_s,
    };
    Ok(model.whole().to_string())
}

/// Numbers of a model.
struct Model<const N: usize> {
    kind: &'static str,
    geometry: Geometry,
    compliances: Compliances<N>,
    masses: Masses<N>,
    /// Metres of the drives' count per unit of `q`.
    metres_per_q: [f64; N],
    /// Platform axes from sensor axes, and from the tool centre point to the sensor, m.
    sensor: (Matrix3<f64>, [f64; 3]),
    home_m: Vector3<f64>,
    /// Axes at home, q-units.
    q: [f64; N],
    /// Damping of a spring, as a share of its stiffness, s.
    damping_s: f64,
}

impl<const N: usize> Model<N> {
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
            Element::new("equality").containing(LINKS.iter().flat_map(held)),
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
                .with_numbers("ctrl", &self.at_home().map(|(_, metres)| metres))]),
        ])
    }

    /// Axes at home: `q`, and where their drives are, m.
    fn at_home(&self) -> [(f64, f64); N] {
        let mut all = [(0.0, 0.0); N];
        for ((at, q), metres) in all.iter_mut().zip(self.q).zip(self.metres_per_q) {
            *at = (q, q * metres);
        }
        all
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
            let unit = self.geometry.guideways.get(axis).map_or(1.0, Vector3::norm);
            let stiffness = 1.0 / (compliance * metres * metres);
            let name = format!("axis{}", axis + 1);
            Element::new("position")
                .with("name", &name)
                .with("joint", &name)
                .with_numbers("gear", &[metres / unit])
                .with_numbers("kp", &[stiffness])
                .with_numbers("kv", &[self.damping_s * stiffness])
        })
    }

    /// A cart, with plate and links.
    fn cart(&self, arm: usize) -> Element {
        let at = |axis: usize| self.q.get(axis).copied().unwrap_or(0.0);
        let guideway = self
            .geometry
            .guideways
            .get(arm)
            .copied()
            .unwrap_or_default();
        let start = self.geometry.carts_m.get(arm).copied().unwrap_or_default();
        let slide = Element::new("joint")
            .with("name", format!("axis{}", arm + 1))
            .with("type", "slide")
            .with_numbers("axis", guideway.normalize().as_slice())
            .with_numbers("ref", &[at(arm) * guideway.norm()]);
        let mass = self.masses.carts_kg.get(arm).copied().unwrap_or_default();
        Element::new("body")
            .with("name", format!("cart{}", arm + 1))
            .with_numbers("pos", (start + guideway * at(arm)).as_slice())
            .containing([
                slide,
                inertial(mass, &Vector3::zeros(), &diagonal(SOME_KGM2)),
                Element::new("geom")
                    .with("type", "box")
                    .with_numbers("size", &[3.0 * RADIUS_M; 3]),
            ])
            .containing(self.on_cart(arm))
    }

    /// Links of a cart, on its plate if that turns.
    fn on_cart(&self, arm: usize) -> Vec<Element> {
        let turn = Unit::new_normalize(self.geometry.turn_axis);
        let tilt = Unit::new_normalize(self.geometry.tilt_axis);
        let [q4, q5] = self.geometry.turn_signs.map(|sign| sign.sign());
        let turns = match arm {
            1 if N > ARMS => vec![(3, turn, q4)],
            2 if N > ARMS => vec![(4, turn, q5), (5, tilt, 1.0)],
            _ => Vec::new(),
        };
        let angles = turns.iter().map(|(axis, about, sign)| {
            let q = self.q.get(*axis).copied().unwrap_or_default();
            Rotation3::from_axis_angle(about, sign * q)
        });
        let rotation = angles.fold(Rotation3::identity(), |all, turn| all * turn);
        let links = LINKS.iter().zip(ARM_OF_LINK).enumerate();
        let own = links.filter(|(_, (_, of))| *of == arm);
        let hung: Vec<Element> = own.map(|(link, _)| self.link(link, &rotation)).collect();
        // The innermost plate carries the links.
        turns
            .into_iter()
            .rev()
            .fold(hung, |inner, (axis, about, sign)| {
                vec![self.plate(axis, about, sign).containing(inner)]
            })
    }

    /// A plate that an axis turns.
    fn plate(&self, axis: usize, about: Unit<Vector3<f64>>, sign: f64) -> Element {
        let q = self.q.get(axis).copied().unwrap_or_default();
        let inertia = self.masses.plates_kgm2.get(axis - ARMS).copied();
        let turned = UnitQuaternion::from_axis_angle(&about, sign * q);
        Element::new("body")
            .with("name", format!("plate{}", axis + 1))
            .with_numbers("quat", &quaternion(&turned))
            .containing([
                Element::new("joint")
                    .with("name", format!("axis{}", axis + 1))
                    .with("type", "hinge")
                    .with_numbers("axis", (about.into_inner() * sign).as_slice())
                    .with_numbers("ref", &[q])
                    .with_numbers("armature", &[inertia.unwrap_or_default()]),
                // What it weighs belongs to its cart.
                inertial(SOME_KGM2, &Vector3::zeros(), &diagonal(SOME_KGM2)),
            ])
    }

    /// A link on a cart, or on a plate that is turned by `plate`: its z axis points to the platform.
    fn link(&self, index: usize, plate: &Rotation3<f64>) -> Element {
        let name = LINKS.get(index).copied().unwrap_or_default();
        let of = |all: &[f64]| all.get(index).copied().unwrap_or_default();
        let length = of(&self.geometry.lengths_m);
        let mass = of(&self.masses.links_kg);
        let stiffness = 1.0 / of(self.compliances.link_m_per_n());
        let lever = self
            .geometry
            .plate_joints_m
            .get(index)
            .copied()
            .unwrap_or_default();
        let end = self
            .geometry
            .platform_joints_m
            .get(index)
            .copied()
            .unwrap_or_default();
        let along = self.home_m + end - joint(&self.geometry, index, &self.q).place_m;
        let turned = UnitQuaternion::rotation_between(&Vector3::z(), &(plate.inverse() * along))
            .unwrap_or_else(|| {
                UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI)
            });
        let spin = diagonal(mass * RADIUS_M * RADIUS_M / 6.0);
        let part = |part: &str, share: f64, sixths: f64| {
            let slide = Element::new("joint")
                .with("name", format!("{part}{name}"))
                .with("type", "slide")
                .with_numbers("axis", &[0.0, 0.0, 1.0]);
            let slide = if share < 1.0 {
                slide
            } else {
                slide
                    .with_numbers("stiffness", &[stiffness])
                    .with_numbers("damping", &[self.damping_s * stiffness])
            };
            Element::new("body")
                .with("name", format!("{part}{name}"))
                .with_numbers("pos", &[0.0, 0.0, share * length])
                .containing([
                    slide,
                    inertial(sixths * mass / 6.0, &Vector3::zeros(), &spin),
                    Element::new("site").with("name", format!("{part}{name}")),
                ])
        };
        Element::new("body")
            .with("name", format!("link{name}"))
            .with_numbers("pos", lever.as_slice())
            .with_numbers("quat", &quaternion(&turned))
            .containing([
                Element::new("joint")
                    .with("name", format!("link{name}"))
                    .with("type", "ball"),
                inertial(mass / 6.0, &Vector3::zeros(), &spin),
                rod(&[0.0, 0.0, 0.0], &[0.0, 0.0, length]),
                part("middle", 0.5, 4.0),
                part("end", 1.0, 1.0),
            ])
    }

    fn platform(&self) -> Element {
        let (rotation, lever_m) = &self.sensor;
        let rotation = Rotation3::from_matrix_unchecked(*rotation);
        let sensor = Element::new("site")
            .with("name", "sensor")
            .with_numbers("pos", lever_m)
            .with_numbers(
                "quat",
                &quaternion(&UnitQuaternion::from_rotation_matrix(&rotation)),
            );
        let joints = LINKS.iter().zip(self.geometry.platform_joints_m);
        let held = joints.flat_map(|(name, place)| {
            let site = Element::new("site").with("name", format!("on_platform{name}"));
            [
                site.with_numbers("pos", place.as_slice()),
                rod(&[0.0, 0.0, 0.0], place.as_slice()),
            ]
        });
        Element::new("body")
            .with("name", "platform")
            .with_numbers("pos", self.home_m.as_slice())
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

fn rod(from: &[f64], to: &[f64]) -> Element {
    Element::new("geom")
        .with("type", "capsule")
        .with_numbers("fromto", &[from, to].concat())
        .with_numbers("size", &[RADIUS_M])
}

fn of_body(body: &RigidBody) -> Element {
    inertial(body.mass_kg, &body.centre_m, &body.inertia_kgm2)
}

fn inertial(mass_kg: f64, centre_m: &Vector3<f64>, inertia_kgm2: &Matrix3<f64>) -> Element {
    let i = inertia_kgm2;
    Element::new("inertial")
        .with_numbers("pos", centre_m.as_slice())
        .with_numbers("mass", &[mass_kg])
        .with_numbers("fullinertia", &[i.m11, i.m22, i.m33, i.m12, i.m13, i.m23])
}

fn diagonal(value: f64) -> Matrix3<f64> {
    Matrix3::from_diagonal_element(value)
}

/// Real part first.
fn quaternion(rotation: &UnitQuaternion<f64>) -> [f64; 4] {
    [rotation.w, rotation.i, rotation.j, rotation.k]
}
