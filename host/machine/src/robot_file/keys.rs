//! Keys of a machine: the top level of a robot file, and the inline robot of `solve`.

use gantry_tau_core::model::kinematics::TAU_TOLERANCE;
use gantry_tau_core::model::robot::{ARMS, Branch, Compliances, LINKS, Parameter, RobotError};
use gantry_tau_core::model::{f1, l2, presets};
use nalgebra::{Matrix3, Vector3};
use serde::de::{DeserializeOwned, Error};
use serde::{Deserialize, Deserializer};

use super::{F1_TEXT, L2_TEXT, Problem, Problems};
use crate::model::{F1, L2, MachineKind};

/// Keys of a kind of machine with `N` axes, read and not yet checked.
pub trait Keys<const N: usize>: DeserializeOwned {
    /// Names of all keys, without `model`.
    const NAMES: &'static [&'static str];
    /// Text of the built-in machine of this kind.
    const BUILT_IN: &'static str;
    /// Key of the compliances of the axes.
    const AXIS_COMPLIANCES: &'static str;
    /// Number of parameters of the geometry, as a calibration counts them.
    const PARAMETERS: usize;
    /// The checked geometry.
    type Robot;
    /// The kinematics in the orientation of the world.
    type Model: MachineKind<N>;

    /// Returns the length of one unit of each `q` whose guideway gives it, m.
    fn metres_per_q(&self) -> [Option<f64>; N];

    /// Checks the geometry. `travel` is in q-units.
    fn robot(
        &self,
        travel: Option<[(f64, f64); N]>,
        problems: &mut Problems,
    ) -> Option<Self::Robot>;

    /// Prepares the kinematics.
    fn model(robot: &Self::Robot) -> Result<Self::Model, Problem>;

    /// Returns the compliances of links and axes, as far as they are given.
    fn springs(&self) -> (Option<[f64; LINKS]>, Option<[f64; N]>);

    /// Checks the compliances; `None` unless both are given.
    fn compliances(&self) -> Result<Option<Compliances<N>>, Problem> {
        let (Some(links), Some(axes)) = self.springs() else {
            return Ok(None);
        };
        Compliances::new(links, axes)
            .map(Some)
            .map_err(|error| problem(error, Self::AXIS_COMPLIANCES))
    }
}

/// Gives one part of a geometry that of another. Core names one wrong number of a geometry, so each
/// part is checked alone, among those of the built-in machine.
type SetPart<G> = fn(&mut G, &G);

const L2_PARTS: [SetPart<l2::Geometry>; 5] = [
    |one, other| one.cart_joints_m = other.cart_joints_m,
    |one, other| one.guideways = other.guideways,
    |one, other| one.platform_joints_m = other.platform_joints_m,
    |one, other| one.lengths_m = other.lengths_m,
    |one, other| one.travel = other.travel,
];

const F1_PARTS: [SetPart<f1::Geometry>; 8] = [
    |one, other| one.carts_m = other.carts_m,
    |one, other| one.guideways = other.guideways,
    |one, other| one.plate_joints_m = other.plate_joints_m,
    |one, other| one.platform_joints_m = other.platform_joints_m,
    |one, other| one.lengths_m = other.lengths_m,
    |one, other| one.turn_axis = other.turn_axis,
    |one, other| one.tilt_axis = other.tilt_axis,
    |one, other| one.travel = other.travel,
];

/// `model = "l2"`: three axes.
#[derive(Deserialize)]
pub struct L2Keys {
    #[serde(rename = "A0")]
    a0: [[f64; 3]; LINKS],
    #[serde(rename = "V")]
    v: [[f64; 3]; ARMS],
    b: [[f64; 3]; LINKS],
    #[serde(rename = "L", deserialize_with = "lengths")]
    l: [f64; LINKS],
    c: [f64; ARMS],
    cf: f64,
    c_link: Option<[f64; LINKS]>,
    c_cart: Option<[f64; l2::AXES]>,
}

impl Keys<{ l2::AXES }> for L2Keys {
    const NAMES: &'static [&'static str] = &["A0", "V", "b", "L", "c", "cf", "c_link", "c_cart"];
    const BUILT_IN: &'static str = L2_TEXT;
    const AXIS_COMPLIANCES: &'static str = "c_cart";
    const PARAMETERS: usize = 7 * ARMS;
    type Robot = l2::Robot;
    type Model = L2;

    fn metres_per_q(&self) -> [Option<f64>; l2::AXES] {
        self.v.map(|guideway| Some(Vector3::from(guideway).norm()))
    }

    fn robot(
        &self,
        travel: Option<[(f64, f64); l2::AXES]>,
        problems: &mut Problems,
    ) -> Option<l2::Robot> {
        let lengths_m = problems.keep(arm_lengths(self.l));
        let inverse = branches(self.c, problems);
        let forward = problems.keep(branch("cf", self.cf));
        let known = presets::l2();
        let geometry = l2::Geometry {
            cart_joints_m: self.a0.map(Vector3::from),
            guideways: self.v.map(Vector3::from),
            platform_joints_m: self.b.map(Vector3::from),
            lengths_m: lengths_m.unwrap_or(known.lengths_m),
            configuration: known.configuration,
            travel,
        };
        for set in L2_PARTS {
            let mut alone = known;
            set(&mut alone, &geometry);
            let checked = l2::Robot::new(alone);
            problems.keep(checked.map_err(|error| problem(error, Self::AXIS_COMPLIANCES)));
        }
        let configuration = l2::Configuration {
            inverse: inverse?,
            forward: forward?,
        };
        l2::Robot::new(l2::Geometry {
            configuration,
            ..geometry
        })
        .ok()
    }

    fn model(robot: &l2::Robot) -> Result<L2, Problem> {
        L2::new(robot, &Matrix3::identity()).map_err(|error| Problem::new("A0", error))
    }

    fn springs(&self) -> (Option<[f64; LINKS]>, Option<[f64; l2::AXES]>) {
        (self.c_link, self.c_cart)
    }
}

/// `model = "f1"`: six axes.
#[derive(Deserialize)]
pub struct F1Keys {
    #[serde(rename = "C")]
    c0: [[f64; 3]; ARMS],
    #[serde(rename = "V")]
    v: [[f64; 3]; ARMS],
    #[serde(rename = "P")]
    p: [[f64; 3]; LINKS],
    b: [[f64; 3]; LINKS],
    #[serde(rename = "L", deserialize_with = "lengths")]
    l: [f64; LINKS],
    c: [f64; ARMS],
    ax: [f64; 3],
    ax6: [f64; 3],
    sigma4: f64,
    sigma5: f64,
    c_link: Option<[f64; LINKS]>,
    c_act: Option<[f64; f1::AXES]>,
}

impl Keys<{ f1::AXES }> for F1Keys {
    const NAMES: &'static [&'static str] = &[
        "C", "V", "P", "b", "L", "c", "ax", "ax6", "sigma4", "sigma5", "c_link", "c_act",
    ];
    const BUILT_IN: &'static str = F1_TEXT;
    const AXIS_COMPLIANCES: &'static str = "c_act";
    const PARAMETERS: usize = 64;
    type Robot = f1::Robot;
    type Model = F1;

    /// The screws of the plates have a law of their own.
    fn metres_per_q(&self) -> [Option<f64>; f1::AXES] {
        let [v1, v2, v3] = self.v.map(|guideway| Some(Vector3::from(guideway).norm()));
        [v1, v2, v3, None, None, None]
    }

    fn robot(
        &self,
        travel: Option<[(f64, f64); f1::AXES]>,
        problems: &mut Problems,
    ) -> Option<f1::Robot> {
        let configuration = branches(self.c, problems);
        let turn_signs = [("sigma4", self.sigma4), ("sigma5", self.sigma5)]
            .map(|(key, sign)| problems.keep(branch(key, sign)));
        let known = presets::f1();
        let geometry = f1::Geometry {
            carts_m: self.c0.map(Vector3::from),
            guideways: self.v.map(Vector3::from),
            plate_joints_m: self.p.map(Vector3::from),
            platform_joints_m: self.b.map(Vector3::from),
            lengths_m: self.l,
            turn_axis: self.ax.into(),
            tilt_axis: self.ax6.into(),
            travel,
            ..known
        };
        for set in F1_PARTS {
            let mut alone = known;
            set(&mut alone, &geometry);
            let checked = f1::Robot::new(alone);
            problems.keep(checked.map_err(|error| problem(error, Self::AXIS_COMPLIANCES)));
        }
        let [turn, tilt] = turn_signs;
        let checked = f1::Geometry {
            configuration: configuration?,
            turn_signs: [turn?, tilt?],
            ..geometry
        };
        f1::Robot::new(checked).ok()
    }

    fn model(robot: &f1::Robot) -> Result<F1, Problem> {
        Ok(F1::new(robot))
    }

    fn springs(&self) -> (Option<[f64; LINKS]>, Option<[f64; f1::AXES]>) {
        (self.c_link, self.c_act)
    }
}

/// Reads one length per arm, or one per link.
fn lengths<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[f64; LINKS], D::Error> {
    match Vec::deserialize(deserializer)?.as_slice() {
        &[l1, l2, l3] => Ok([l1, l2, l2, l3, l3, l3]),
        &[l11, l21, l22, l31, l32, l33] => Ok([l11, l21, l22, l31, l32, l33]),
        lengths => Err(Error::custom(format!(
            "has {} lengths, it must have 3 (one per arm) or 6 (one per link)",
            lengths.len()
        ))),
    }
}

/// Returns the length of each arm. Those of a cluster are equal: the Tau property.
/// True if two lengths of a cluster differ. NaN differs from nothing here: the robot's own check
/// names it.
fn differ(one: f64, other: f64) -> bool {
    (one - other).abs() > TAU_TOLERANCE * one.abs()
}

fn arm_lengths([l11, l21, l22, l31, l32, l33]: [f64; LINKS]) -> Result<[f64; ARMS], Problem> {
    if differ(l21, l22) || differ(l31, l32) || differ(l31, l33) {
        return Err(Problem::new(
            "L",
            "differs within a cluster, so the machine has no Tau property",
        ));
    }
    Ok([l11, l21, l31])
}

/// The branches of the three arms.
fn branches([c1, c2, c3]: [f64; ARMS], problems: &mut Problems) -> Option<[Branch; ARMS]> {
    let signs = [("c[0]", c1), ("c[1]", c2), ("c[2]", c3)];
    let [c1, c2, c3] = signs.map(|(key, sign)| problems.keep(branch(key, sign)));
    Some([c1?, c2?, c3?])
}

/// Branch of a sign; scripts write it as an integer or as a float.
fn branch(key: &str, sign: f64) -> Result<Branch, Problem> {
    if (sign - 1.0).abs() < f64::EPSILON {
        Ok(Branch::Positive)
    } else if (sign + 1.0).abs() < f64::EPSILON {
        Ok(Branch::Negative)
    } else {
        Err(Problem::new(key, format!("is {sign}; expected 1 or -1")))
    }
}

/// Splits core's error into key and reason. Compliances of axes stand under `axes_key`.
fn problem(error: RobotError, axes_key: &str) -> Problem {
    let (RobotError::NotFinite { parameter, index }
    | RobotError::OutOfRange {
        parameter, index, ..
    }
    | RobotError::Reversed { parameter, index }) = error;
    let text = error.to_string();
    let (_, reason) = text.split_once(' ').unwrap_or(("", &text));
    let key = if parameter == Parameter::CartCompliance {
        axes_key
    } else {
        parameter.key()
    };
    Problem::new(format!("{key}[{index}]"), reason)
}
