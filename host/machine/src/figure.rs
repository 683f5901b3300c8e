//! A machine in motion: its points at the nominal positions of a tick, and what differs from them.

use gantry_tau_core::model::kinematics::{KinematicsError, Pose};
use gantry_tau_core::model::robot::{ARMS, LINKS};
use nalgebra::Vector3;

use super::scene::Scene;
use crate::elastic::joints::joint;
use crate::model::MachineKind;
use crate::robot_file::{RobotFile, RobotFileError};

/// Positions of one axis, nm.
#[derive(Clone, Copy, Debug)]
pub struct Position {
    /// Nominal reference.
    pub nominal_nm: i64,
    /// Offset in force.
    pub offset_nm: i32,
}

/// Displacement of the tool, m, and turn of the platform, rotation vector, rad; world axes.
#[derive(Clone, Copy, Debug)]
pub struct Displaced {
    /// Displacement of the tool centre point.
    pub way_m: Vector3<f64>,
    /// Rotation vector of the platform.
    pub turn_rad: Vector3<f64>,
}

/// The machine at the nominal positions of one tick, and what differs from them; world axes, m.
#[derive(Clone, Debug)]
pub struct Figure {
    /// Way of the carts from home.
    pub carts: [Vector3<f64>; ARMS],
    /// Joints on carts or plates, link order.
    pub joints: [Vector3<f64>; LINKS],
    /// Joints on the platform, link order.
    pub platform: [Vector3<f64>; LINKS],
    /// Tool centre point.
    pub tool: Vector3<f64>,
    /// Way of the carts by the offsets in force.
    pub cart_offsets: [Vector3<f64>; ARMS],
    /// Way of the joints by the offsets in force.
    pub joint_offsets: [Vector3<f64>; LINKS],
    /// Displacement of the joints on the platform; `None` if it is not measured.
    pub platform_displacements: Option<[Vector3<f64>; LINKS]>,
    /// Displacement of the tool; `None` if it is not measured.
    pub tool_displacement: Option<Vector3<f64>>,
}

impl Figure {
    /// The machine at home, nothing of it displaced.
    pub fn at_home(scene: &Scene) -> Self {
        let ends: [_; LINKS] = std::array::from_fn(|link| match scene.links.get(link) {
            Some(link) => link.ends_m,
            None => [scene.tool_m; 2],
        });
        Self {
            carts: Default::default(),
            joints: ends.map(|[on_cart, _]| on_cart),
            platform: ends.map(|[_, on_platform]| on_platform),
            tool: scene.tool_m,
            cart_offsets: Default::default(),
            joint_offsets: Default::default(),
            platform_displacements: Some(Default::default()),
            tool_displacement: Some(Default::default()),
        }
    }
}

/// Machine of a robot file of any kind, which moves.
pub trait Moving: Send {
    /// Returns the parts at home.
    fn scene(&self) -> &Scene;

    /// Returns the points at these positions, one per axis.
    ///
    /// # Errors
    /// [`KinematicsError`]: the machine cannot be at the nominal positions.
    fn figure(
        &mut self,
        positions: &[Position],
        displaced: Option<Displaced>,
    ) -> Result<Figure, KinematicsError>;
}

/// A machine, and its last pose, from which the next is found.
pub struct MovingMachine<K, const N: usize> {
    robot: RobotFile<K, N>,
    scene: Scene,
    home_q: [f64; N],
    last: Option<Pose>,
}

impl<K: MachineKind<N>, const N: usize> MovingMachine<K, N> {
    /// Machine of a robot file.
    ///
    /// # Errors
    /// [`RobotFileError`] if home cannot be reached.
    pub fn new(robot: RobotFile<K, N>) -> Result<Self, RobotFileError> {
        let (scene, home_q) = (Scene::at_home(&robot)?, robot.home_q()?);
        Ok(Self {
            robot,
            scene,
            home_q,
            last: None,
        })
    }

    /// Name of the robot file.
    pub fn name(&self) -> &str {
        &self.robot.name
    }

    /// Checksum of the kinematic parameters.
    pub fn kinematics(&self) -> u32 {
        self.robot.checksum()
    }

    /// Positions of the axes as q-units; home without one.
    fn q(&self, positions: &[Position], nm: impl Fn(&Position) -> i64) -> [f64; N] {
        let mut q = self.home_q;
        for ((place, position), metres) in q.iter_mut().zip(positions).zip(self.robot.metres_per_q)
        {
            *place = nm(position) as f64 * 1e-9 / metres;
        }
        q
    }

    fn points(&self, positions: &[Position], pose: &Pose, displaced: Option<Displaced>) -> Figure {
        let geometry = self.robot.model.geometry();
        let nominal = self.q(positions, |axis| axis.nominal_nm);
        let offset = self.q(positions, |axis| {
            axis.nominal_nm.saturating_add(axis.offset_nm.into())
        });
        let levers = geometry
            .platform_joints_m
            .map(|on_platform| pose.rotation * on_platform);
        let [joints, mut moved]: [[_; LINKS]; 2] = [nominal, offset]
            .map(|q| std::array::from_fn(|link| joint(&geometry, link, &q).place_m));
        for (way, joint) in moved.iter_mut().zip(joints) {
            *way -= joint;
        }
        Figure {
            carts: cart_ways(&geometry.guideways, &self.home_q, &nominal),
            joints,
            platform: levers.map(|lever| pose.position_m + lever),
            tool: pose.position_m,
            cart_offsets: cart_ways(&geometry.guideways, &nominal, &offset),
            joint_offsets: moved,
            platform_displacements: displaced
                .map(|by| levers.map(|lever| by.way_m + by.turn_rad.cross(&lever))),
            tool_displacement: displaced.map(|by| by.way_m),
        }
    }
}

/// Ways of the carts along their guideways.
fn cart_ways<const N: usize>(
    guideways: &[Vector3<f64>; ARMS],
    from: &[f64; N],
    to: &[f64; N],
) -> [Vector3<f64>; ARMS] {
    let mut ways = *guideways;
    for ((way, from), to) in ways.iter_mut().zip(from).zip(to) {
        *way *= to - from;
    }
    ways
}

impl<K: MachineKind<N>, const N: usize> Moving for MovingMachine<K, N> {
    fn scene(&self) -> &Scene {
        &self.scene
    }

    fn figure(
        &mut self,
        positions: &[Position],
        displaced: Option<Displaced>,
    ) -> Result<Figure, KinematicsError> {
        let nominal = self.q(positions, |axis| axis.nominal_nm);
        // After positions out of reach the search begins at home.
        let pose =
            self.robot
                .model
                .pose_of(&nominal, &self.robot.home_m(), self.last.take().as_ref())?;
        self.last = Some(pose);
        Ok(self.points(positions, &pose, displaced))
    }
}
