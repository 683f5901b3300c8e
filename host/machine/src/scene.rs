//! The parts of a machine in world coordinates.

use gantry_tau_core::model::robot::{ARM_OF_LINK, LINKS};
use nalgebra::Vector3;

use crate::elastic::joints::joint;
use crate::model::MachineKind;
use crate::robot_file::{RobotFile, RobotFileError};

/// Names of the links, in link order.
pub const LINK_NAMES: [&str; LINKS] = ["11", "21", "22", "31", "32", "33"];
/// Length of guideway that is drawn to either side of a cart, as a share of the longest link.
const RAIL_SHARE: f64 = 0.6;
/// Length of guideway beyond a cart that is away from home, as a share of what is drawn at home.
const RAIL_MARGIN: f64 = 0.15;
/// Margin of a cart's box around its joints, as a share of the longest link.
const CART_SHARE: f64 = 0.03;

/// A machine with its tool at home.
pub struct Scene {
    /// One per arm.
    pub arms: Vec<SceneArm>,
    /// In link order.
    pub links: Vec<SceneLink>,
    /// Tool centre point, world axes, m.
    pub tool_m: Vector3<f64>,
    /// Number of axes.
    pub axes: usize,
}

/// A guideway and its cart.
pub struct SceneArm {
    /// Number of the arm, from 1.
    pub number: usize,
    /// Ends of the part of the guideway that is drawn, m.
    pub rail_m: [Vector3<f64>; 2],
    /// True for an end beyond which the nominal travel goes on.
    pub goes_on: [bool; 2],
    /// Centre of the cart's box, m.
    pub centre_m: Vector3<f64>,
    /// Half edges of the box, m.
    pub half_edges_m: [Vector3<f64>; 3],
}

/// A link.
pub struct SceneLink {
    /// Index of its arm, from 0.
    pub arm: usize,
    /// Its number, as in the robot file.
    pub name: &'static str,
    /// Joint on the cart, then joint on the platform, m.
    pub ends_m: [Vector3<f64>; 2],
}

impl Scene {
    /// The machine of `robot` with the tool at home and the platform unturned.
    ///
    /// # Errors
    /// [`RobotFileError`] if home cannot be reached.
    pub fn at_home<K: MachineKind<N>, const N: usize>(
        robot: &RobotFile<K, N>,
    ) -> Result<Self, RobotFileError> {
        let geometry = robot.model.geometry();
        let tool_m = robot.home_m();
        let q = robot.home_q()?;
        let mut links = Vec::new();
        let joints = LINK_NAMES
            .into_iter()
            .zip(ARM_OF_LINK)
            .zip(geometry.platform_joints_m);
        for (index, ((name, arm), on_platform)) in joints.enumerate() {
            let ends_m = [joint(&geometry, index, &q).place_m, tool_m + on_platform];
            links.push(SceneLink { arm, name, ends_m });
        }
        let longest_m = geometry.lengths_m.into_iter().fold(0.0, f64::max);
        let guideways = geometry.guideways.into_iter().zip(geometry.carts_m).zip(q);
        let arms = guideways.enumerate().map(|(arm, ((along, start), q))| {
            let own = links.iter().filter(|link| link.arm == arm);
            let mut held: Vec<Vector3<f64>> = own.map(|link| link.ends_m[0]).collect();
            // A machine of three axes has its joints on the carts, and the guideway is drawn
            // through their middle.
            let on_rail = if N > geometry.guideways.len() {
                start + along * q
            } else {
                mean(&held)
            };
            held.push(on_rail);
            let (centre_m, half_edges_m) = enclosing_box(&held, &along, CART_SHARE * longest_m);
            let way = RAIL_SHARE * longest_m / along.norm();
            let travel = geometry.travel.and_then(|all| all.get(arm).copied());
            let (lower, upper) = travel.unwrap_or((q - way, q + way));
            let ends = [lower.max(q - way), upper.min(q + way)];
            SceneArm {
                number: arm + 1,
                rail_m: ends.map(|position| on_rail + along * (position - q)),
                goes_on: [lower < q - way, upper > q + way],
                centre_m,
                half_edges_m,
            }
        });
        let arms = arms.collect();
        Ok(Self {
            arms,
            links,
            tool_m,
            axes: N,
        })
    }
}

impl SceneArm {
    /// The part of the guideway that is drawn, with its cart moved by `way` from home: it reaches
    /// at least as far as the cart.
    pub fn rail_to(&self, way: &Vector3<f64>) -> [Vector3<f64>; 2] {
        let [from, to] = self.rail_m;
        let along = to - from;
        let at = (self.centre_m + way - from).dot(&along) / along.norm_squared();
        let [low, high] = [(at - RAIL_MARGIN).min(0.0), (at + RAIL_MARGIN).max(1.0)];
        [from + along * low, from + along * high]
    }
}

/// Mean of some points; zero of none.
fn mean(points: &[Vector3<f64>]) -> Vector3<f64> {
    points.iter().sum::<Vector3<f64>>() / points.len().max(1) as f64
}

/// Centre and half edges of a box around `points`, one edge along `along`, `margin_m` wider on
/// every side.
fn enclosing_box(
    points: &[Vector3<f64>],
    along: &Vector3<f64>,
    margin_m: f64,
) -> (Vector3<f64>, [Vector3<f64>; 3]) {
    let first = along.normalize();
    let helper = Vector3::from_fn(|row, _| f64::from(u8::from(row == first.iamin())));
    let second = first.cross(&helper).normalize();
    let directions = [first, second, first.cross(&second)];
    let mut centre_m = Vector3::zeros();
    let half_edges_m = directions.map(|direction| {
        let heights = points.iter().map(|point| point.dot(&direction));
        let (low, high) = heights.fold((f64::MAX, f64::MIN), |(low, high), height| {
            (low.min(height), high.max(height))
        });
        centre_m += direction * ((low + high) / 2.0);
        direction * ((high - low) / 2.0 + margin_m)
    });
    (centre_m, half_edges_m)
}
