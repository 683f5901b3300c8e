//! Points of the machine for the page, which the browser projects.

use gantry_tau_core::model::kinematics::KinematicsError;
use gantry_tau_core::model::robot::{ARMS, LINKS};
use gantry_tau_machine::figure::{self, Displaced, Moving, Position};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{RobotFile, RobotFileError};
use nalgebra::Vector3;
use serde::Serialize;

use crate::monitor::Snapshot;

/// Coordinates, m.
type Point = [f64; 3];

/// Constant parts, sent once.
#[derive(Debug, Serialize)]
struct MachineParts {
    name: String,
    axes: usize,
    arms: Vec<ArmParts>,
    links: Vec<LinkParts>,
}

/// A guideway, and its cart at home.
#[derive(Debug, Serialize)]
struct ArmParts {
    rail: [Point; 2],
    centre: Point,
    half_edges: [Point; 3],
}

#[derive(Debug, Serialize)]
struct LinkParts {
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

/// Machine that can be drawn.
pub(super) trait Figures: Send {
    /// Number of axes.
    fn axes(&self) -> usize;
    /// Constant parts, JSON.
    fn machine(&self) -> String;
    /// Points of a tick, JSON.
    ///
    /// # Errors
    /// [`KinematicsError`]: the machine cannot be at the nominal positions, so that another one is
    /// running.
    fn figure(&mut self, snapshot: &Snapshot) -> Result<String, KinematicsError>;
}

/// A machine of a robot file.
pub(super) struct Drawn<K, const N: usize>(figure::MovingMachine<K, N>);

impl<K: MachineKind<N>, const N: usize> Drawn<K, N> {
    /// # Errors
    /// [`RobotFileError`] if home cannot be reached.
    pub(super) fn new(robot: RobotFile<K, N>) -> Result<Self, RobotFileError> {
        figure::MovingMachine::new(robot).map(Self)
    }
}

impl<K: MachineKind<N>, const N: usize> Figures for Drawn<K, N> {
    fn axes(&self) -> usize {
        N
    }

    fn machine(&self) -> String {
        let scene = self.0.scene();
        let arms = scene.arms.iter().map(|arm| ArmParts {
            rail: arm.rail_m.map(coarse),
            centre: coarse(arm.centre_m),
            half_edges: arm.half_edges_m.map(coarse),
        });
        let links = scene.links.iter().map(|link| LinkParts {
            name: link.name,
            arm: link.arm,
        });
        let name = self.0.name().to_owned();
        let machine = MachineParts {
            name,
            axes: N,
            arms: arms.collect(),
            links: links.collect(),
        };
        // Text and numbers: it cannot fail.
        serde_json::to_string(&machine).unwrap_or_default()
    }

    fn figure(&mut self, snapshot: &Snapshot) -> Result<String, KinematicsError> {
        let axes = snapshot.axes.iter();
        let positions: Vec<Position> = axes
            .map(|axis| Position {
                nominal_nm: axis.nominal_nm,
                offset_nm: axis.offset.position_nm,
            })
            .collect();
        let displaced = snapshot.displacement_m.zip(snapshot.turn_rad);
        let displaced = displaced.map(|(way_m, turn_rad)| Displaced {
            way_m: way_m.into(),
            turn_rad: turn_rad.into(),
        });
        let figure = Figure::from(self.0.figure(&positions, displaced)?);
        Ok(serde_json::to_string(&figure).unwrap_or_default())
    }
}

impl From<figure::Figure> for Figure {
    fn from(of: figure::Figure) -> Self {
        Self {
            carts: of.carts.map(coarse),
            joints: of.joints.map(coarse),
            platform: of.platform.map(coarse),
            tool: coarse(of.tool),
            cart_offsets: of.cart_offsets.map(fine),
            joint_offsets: of.joint_offsets.map(fine),
            platform_displacements: of.platform_displacements.map(|ways| ways.map(fine)),
            tool_displacement: of.tool_displacement.map(fine),
        }
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
