//! The parts of a machine with its tool at home and the platform unturned, from arm to platform.

use std::f64::consts::PI;

use gantry_tau_core::model::f1::Geometry;
use gantry_tau_core::model::robot::{ARM_OF_LINK, ARMS, LINKS};
use gantry_tau_machine::elastic::joints::joint;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{RobotFile, RobotFileError};
use gantry_tau_machine::scene::LINK_NAMES;
use nalgebra::{Rotation3, Unit, UnitQuaternion, Vector3};

/// Index of `q_4`.
const Q4: usize = ARMS;

/// A machine at home.
pub(super) struct AtHome<const N: usize> {
    pub(super) geometry: Geometry,
    /// Tool centre point, world axes, m.
    pub(super) tool_m: Vector3<f64>,
    /// Axes, q-units.
    pub(super) q: [f64; N],
}

/// A turn of a plate by an axis.
pub(super) struct Turn {
    /// Index of the axis.
    pub(super) axis: usize,
    /// Direction that positive `q` turns about, plate axes.
    pub(super) about: Unit<Vector3<f64>>,
    /// Position of the axis, rad.
    pub(super) q: f64,
}

/// A link.
pub(super) struct Link {
    /// In link order.
    pub(super) index: usize,
    pub(super) name: &'static str,
    /// Joint on the plate, from its origin, plate axes, m.
    pub(super) joint_m: Vector3<f64>,
    /// Turns the z axis to the platform, plate axes.
    pub(super) rotation: UnitQuaternion<f64>,
    pub(super) length_m: f64,
}

impl Turn {
    pub(super) fn rotation(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_axis_angle(&self.about, self.q)
    }
}

impl<const N: usize> AtHome<N> {
    /// # Errors
    /// [`RobotFileError`] if home cannot be reached.
    pub(super) fn of<K: MachineKind<N>>(robot: &RobotFile<K, N>) -> Result<Self, RobotFileError> {
        Ok(Self {
            geometry: robot.model.geometry(),
            tool_m: robot.home_m(),
            q: robot.home_q()?,
        })
    }

    /// Returns the origin of an arm's cart, world axes, m.
    pub(super) fn cart_m(&self, arm: usize) -> Vector3<f64> {
        self.geometry.carts_m[arm] + self.geometry.guideways[arm] * self.q[arm]
    }

    /// Returns the turns of an arm's plate, the outermost first; none of a plate that is fixed.
    pub(super) fn turns(&self, arm: usize) -> Vec<Turn> {
        let [q4, q5] = self.geometry.turn_signs.map(|sign| sign.sign());
        let (turn, tilt) = (self.geometry.turn_axis, self.geometry.tilt_axis);
        let of_arm = match arm {
            1 => vec![(Q4, turn * q4)],
            2 => vec![(Q4 + 1, turn * q5), (Q4 + 2, tilt)],
            _ => Vec::new(),
        };
        of_arm
            .into_iter()
            .filter_map(|(axis, about)| {
                Some(Turn {
                    axis,
                    about: Unit::new_normalize(about),
                    q: *self.q.get(axis)?,
                })
            })
            .collect()
    }

    /// Returns the links of an arm.
    pub(super) fn links(&self, arm: usize) -> impl Iterator<Item = Link> {
        let turns = self.turns(arm);
        let plate = turns.iter().fold(UnitQuaternion::identity(), |all, turn| {
            all * turn.rotation()
        });
        let own = (0..LINKS).filter(move |link| ARM_OF_LINK[*link] == arm);
        own.map(move |index| {
            let end_m = self.tool_m + self.geometry.platform_joints_m[index];
            let along = plate.inverse() * (end_m - joint(&self.geometry, index, &self.q).place_m);
            let opposite = || Rotation3::from_axis_angle(&Vector3::x_axis(), PI).into();
            Link {
                index,
                name: LINK_NAMES[index],
                joint_m: self.geometry.plate_joints_m[index],
                rotation: UnitQuaternion::rotation_between(&Vector3::z(), &along)
                    .unwrap_or_else(opposite),
                length_m: self.geometry.lengths_m[index],
            }
        })
    }
}
