//! Points of the machine for the page: computed here, projected in the browser.

use gantry_tau_core::model::kinematics::{KinematicsError, Pose};
use gantry_tau_core::model::robot::{ARMS, LINKS};
use nalgebra::Vector3;
use serde::Serialize;

use crate::draw::scene::Scene;
use crate::elastic::joints::joint;
use crate::model::MachineKind;
use crate::monitor::Snapshot;
use crate::robot_file::{RobotFile, RobotFileError};

/// Coordinates, m.
type Point = [f64; 3];

/// What stays as it is, sent once.
#[derive(Debug, Serialize)]
struct Machine {
    name: String,
    axes: usize,
    arms: Vec<Arm>,
    links: Vec<Link>,
}

/// A guideway, and its cart at home.
#[derive(Debug, Serialize)]
struct Arm {
    rail: [Point; 2],
    centre: Point,
    half_edges: [Point; 3],
}

#[derive(Debug, Serialize)]
struct Link {
    name: &'static str,
    arm: usize,
}

/// The machine at the nominal positions of one tick, and what differs from them.
#[derive(Debug, Serialize)]
pub(super) struct Figure {
    /// Way of the carts from home.
    carts: [Point; ARMS],
    /// Joints on carts or plates, link order.
    joints: [Point; LINKS],
    /// Joints on the platform, link order.
    platform: [Point; LINKS],
    tool: Point,
    /// Way of the carts by the offsets in force.
    cart_offsets: [Point; ARMS],
    /// Way of the joints by the offsets in force.
    joint_offsets: [Point; LINKS],
    /// Displacement of the joints on the platform; absent if it is not measured.
    platform_displacements: Option<[Point; LINKS]>,
    tool_displacement: Option<Point>,
}

/// Machine of a page.
pub trait Figures: Send {
    /// Number of axes.
    fn axes(&self) -> usize;
    /// What stays as it is, JSON.
    fn machine(&self) -> String;
    /// Points of a tick, JSON.
    ///
    /// # Errors
    /// [`KinematicsError`]: the machine cannot be at the nominal positions, so that another one is running.
    fn figure(&mut self, snapshot: &Snapshot) -> Result<String, KinematicsError>;
}

/// A machine of a robot file.
pub(super) struct Drawn<K, const N: usize> {
    robot: RobotFile<K, N>,
    scene: Scene,
    home_q: [f64; N],
    last: Option<Pose>,
}

impl<K: MachineKind<N>, const N: usize> Drawn<K, N> {
    /// # Errors
    /// [`RobotFileError`] if home cannot be reached.
    pub(super) fn new(robot: RobotFile<K, N>) -> Result<Self, RobotFileError> {
        let (scene, home_q) = (Scene::at_home(&robot)?, robot.home_q()?);
        Ok(Self { robot, scene, home_q, last: None })
    }

    /// Positions of an axis in m, as q-units.
    fn q(&self, snapshot: &Snapshot, nm: impl Fn(&crate::monitor::Axis) -> i64) -> [f64; N] {
        let mut q = self.home_q;
        for ((place, axis), metres) in q.iter_mut().zip(&snapshot.axes).zip(self.robot.metres_per_q) {
            *place = nm(axis) as f64 * 1e-9 / metres;
        }
        q
    }

    fn points(&mut self, snapshot: &Snapshot) -> Result<Figure, KinematicsError> {
        let geometry = self.robot.model.geometry();
        let nominal = self.q(snapshot, |axis| axis.nominal_nm);
        let offset = self.q(snapshot, |axis| axis.nominal_nm.saturating_add(axis.offset.position_nm.into()));
        let pose = self.robot.model.pose_of(&nominal, &self.robot.home_m(), self.last.as_ref())?;
        self.last = Some(pose);
        let arms = |from: &[f64; N], to: &[f64; N]| {
            let mut ways = geometry.guideways;
            for ((way, from), to) in ways.iter_mut().zip(from).zip(to) {
                *way *= to - from;
            }
            ways
        };
        let levers = geometry.platform_joints_m.map(|on_platform| pose.rotation * on_platform);
        let joints_at = |q: &[f64; N]| std::array::from_fn(|link| joint(&geometry, link, q).place_m);
        let joints: [Vector3<f64>; LINKS] = joints_at(&nominal);
        let mut moved: [Vector3<f64>; LINKS] = joints_at(&offset);
        for (way, joint) in moved.iter_mut().zip(joints) {
            *way -= joint;
        }
        let displaced = snapshot.displacement_m.map(Vector3::from).zip(snapshot.turn_rad.map(Vector3::from));
        Ok(Figure {
            carts: arms(&self.home_q, &nominal).map(coarse),
            joints: joints.map(coarse),
            platform: levers.map(|lever| coarse(pose.position_m + lever)),
            tool: coarse(pose.position_m),
            cart_offsets: arms(&nominal, &offset).map(fine),
            joint_offsets: moved.map(fine),
            platform_displacements: displaced.map(|(way, turn)| levers.map(|lever| fine(way + turn.cross(&lever)))),
            tool_displacement: displaced.map(|(way, _)| fine(way)),
        })
    }
}

impl<K: MachineKind<N>, const N: usize> Figures for Drawn<K, N> {
    fn axes(&self) -> usize {
        N
    }

    fn machine(&self) -> String {
        let arms = self.scene.arms.iter().map(|arm| Arm {
            rail: arm.rail_m.map(coarse),
            centre: coarse(arm.centre_m),
            half_edges: arm.half_edges_m.map(coarse),
        });
        let links = self.scene.links.iter().map(|link| Link { name: link.name, arm: link.arm });
        let machine = Machine { name: self.robot.name.clone(), axes: N, arms: arms.collect(), links: links.collect() };
        // Text and numbers: it cannot fail.
        serde_json::to_string(&machine).unwrap_or_default()
    }

    fn figure(&mut self, snapshot: &Snapshot) -> Result<String, KinematicsError> {
        let figure = self.points(snapshot);
        if figure.is_err() {
            self.last = None;
        }
        Ok(serde_json::to_string(&figure?).unwrap_or_default())
    }
}

/// To a hundredth of a millimetre: what a screen can show, in few digits.
fn coarse(point: Vector3<f64>) -> Point {
    point.map(|value| (value * 1e5).round() / 1e5).into()
}

/// To a nanometre.
fn fine(way: Vector3<f64>) -> Point {
    way.map(|value| (value * 1e9).round() / 1e9).into()
}

#[cfg(test)]
mod tests;
