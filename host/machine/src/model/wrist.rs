//! Joints between platform and tool, as springs in series with links and axes `[T 6.1, 7.1]`.

use gantry_tau_core::model::compensation::Correction;
use gantry_tau_core::model::kinematics::{KinematicsError, Pose};
use gantry_tau_core::model::linalg::rotation_from_vector;
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::model::stiffness::Displacement;
use gantry_tau_core::units::{Metres, OffsetNm};
use nalgebra::{Matrix3, Unit, UnitQuaternion, Vector3, Vector6};

use serde::{Deserialize, Serialize};

/// `[[wrist]]`: a joint between platform and tool, as a spring `[T 6.1, 7.1]`, with the wrist at
/// its zero and the platform unturned.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct WristJoint {
    /// Its axis, world axes; a unit vector.
    pub axis: [f64; 3],
    /// A point on the axis, from the tool centre point, world axes, m.
    pub point_m: [f64; 3],
    /// Its compliance, rad/(N m).
    pub c_rad_per_nm: f64,
}

/// Springs between platform and tool, with the wrist at its zero.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Wrist(Vec<WristJoint>);

impl Wrist {
    /// Creates a wrist of these joints; without a joint it is rigid.
    #[must_use]
    pub fn new(joints: &[WristJoint]) -> Self {
        Self(joints.to_vec())
    }

    /// True without a joint.
    #[must_use]
    pub fn is_rigid(&self) -> bool {
        self.0.is_empty()
    }

    /// Number of joints.
    #[must_use]
    pub fn joints(&self) -> usize {
        self.0.len()
    }

    /// Compliances of the joints, rad/(N m), from the platform to the tool.
    pub fn compliances(&self) -> impl Iterator<Item = f64> {
        self.0.iter().map(|joint| joint.c_rad_per_nm)
    }

    /// Returns the same joints with other compliances, rad/(N m).
    #[must_use]
    pub fn with_compliances(&self, c_rad_per_nm: impl IntoIterator<Item = f64>) -> Self {
        let joints = self.0.iter().zip(c_rad_per_nm);
        Self(
            joints
                .map(|(joint, c_rad_per_nm)| WristJoint {
                    c_rad_per_nm,
                    ..*joint
                })
                .collect(),
        )
    }

    /// Returns the joints with the wrist at these angles, rad, from the platform to the tool: each
    /// turns the joints behind it.
    #[must_use]
    pub fn turned(&self, angles_rad: &[f64]) -> Self {
        let mut joints = self.0.clone();
        for (index, angle) in angles_rad.iter().enumerate() {
            let (before, behind) = joints.split_at_mut((index + 1).min(self.joints()));
            let Some(turning) = before.last() else { break };
            let turn =
                UnitQuaternion::from_axis_angle(&Unit::new_normalize(turning.axis.into()), *angle);
            let centre_m = Vector3::from(turning.point_m);
            for joint in behind {
                joint.axis = (turn * Vector3::from(joint.axis)).into();
                joint.point_m =
                    (centre_m + turn * (Vector3::from(joint.point_m) - centre_m)).into();
            }
        }
        Self(joints)
    }

    /// Axes of the joints as lines `(a x t, a)` with `t` from the joint to the tool centre point,
    /// the platform turned by `rotation`: the moment of a load about an axis is its product with
    /// the line, and so is what a small turn about the axis does to the tool.
    pub fn lines(&self, rotation: &Matrix3<f64>) -> impl Iterator<Item = Vector6<f64>> {
        self.0.iter().map(move |joint| {
            let axis = rotation * Vector3::from(joint.axis);
            let sweep_m = axis.cross(&(rotation * -Vector3::from(joint.point_m)));
            Vector6::new(sweep_m.x, sweep_m.y, sweep_m.z, axis.x, axis.y, axis.z)
        })
    }

    /// Returns how far a load (about the tool centre point, world axes) moves the tool against the
    /// platform, which is turned by `rotation`: `sum kappa_j mu_j (a_j x t_j, a_j)` with the moment
    /// `mu_j = a_j . (M + t_j x F)` about each axis, `t_j = T - p_j`.
    #[must_use]
    pub fn displacement(&self, rotation: &Matrix3<f64>, load: &Wrench) -> Displacement {
        let load = Vector6::from(load.to_array());
        let twist: Vector6<f64> = self
            .lines(rotation)
            .zip(self.compliances())
            .map(|(line, kappa)| line * (kappa * line.dot(&load)))
            .sum();
        Displacement {
            translation_m: twist.fixed_rows::<3>(0).into(),
            rotation_rad: twist.fixed_rows::<3>(3).into(),
        }
    }

    /// Returns the pose of the platform that puts the tool into `pose` under a load, for the share
    /// `gain` of what the wrist gives way.
    ///
    /// # Errors
    /// [`KinematicsError::NotFinite`] where the wrist gives way without end.
    pub(super) fn held(
        &self,
        pose: &Pose,
        load: &Wrench,
        gain: f64,
    ) -> Result<Pose, KinematicsError> {
        let moved = self.displacement(&pose.rotation, load);
        let turn = rotation_from_vector(&(moved.rotation_rad * -gain))
            .ok_or(KinematicsError::NotFinite)?;
        Ok(Pose {
            position_m: pose.position_m - moved.translation_m * gain,
            rotation: turn * pose.rotation,
        })
    }
}

/// Limit of a correction that another one is added to; [`sum`] applies the limits of the machine.
pub(super) const UNLIMITED: OffsetNm = OffsetNm(i32::MAX);

/// Adds the way from `q` to `held` (q-units) to a correction, within `limits`.
///
/// # Errors
/// [`KinematicsError::NotFinite`].
pub(super) fn sum<const N: usize>(
    correction: &Correction<N>,
    [q, held]: [&[f64; N]; 2],
    metres_per_q: &[f64; N],
    limits: &[OffsetNm; N],
) -> Result<Correction<N>, KinematicsError> {
    let mut sum = *correction;
    let ways = q
        .iter()
        .zip(held)
        .zip(metres_per_q)
        .map(|((q, held), metres)| (held - q) * metres);
    let axes = sum.offsets.iter_mut().zip(&mut sum.saturated);
    for (((offset, saturated), way_m), limit) in axes.zip(ways).zip(limits) {
        let whole = Metres(offset.to_metres().0 + way_m);
        let (within, is_cut) =
            OffsetNm::from_metres_within(whole, *limit).map_err(|_| KinematicsError::NotFinite)?;
        *offset = within;
        *saturated |= is_cut;
    }
    Ok(sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A joint along y, 0.2 m above the tool centre point: 100 N in x turn it by 20 N m, and the
    /// tool goes 0.2 m times the angle in x.
    #[test]
    fn a_force_turns_the_joint_and_moves_the_tool() {
        let joint = WristJoint {
            axis: [0.0, 1.0, 0.0],
            point_m: [0.0, 0.0, 0.2],
            c_rad_per_nm: 1e-5,
        };
        let wrist = Wrist::new(&[joint]);
        let load = Wrench::from_array([100.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let moved = wrist.displacement(&Matrix3::identity(), &load);
        assert!(
            (moved.rotation_rad - Vector3::new(0.0, -2e-4, 0.0)).amax() < 1e-18,
            "{moved:?}"
        );
        assert!(
            (moved.translation_m - Vector3::new(4e-5, 0.0, 0.0)).amax() < 1e-18,
            "{moved:?}"
        );
        // With the platform turned by a quarter about z the axis lies along -x, and the force no
        // longer turns the joint.
        let turned = rotation_from_vector(&(Vector3::z() * std::f64::consts::FRAC_PI_2)).unwrap();
        assert!(wrist.displacement(&turned, &load).translation_m.amax() < 1e-18);
        // A joint before it turns its axis as the platform does.
        let first = WristJoint {
            axis: [0.0, 0.0, 1.0],
            point_m: [0.0; 3],
            c_rad_per_nm: 0.0,
        };
        let behind = Wrist::new(&[first, joint]).turned(&[std::f64::consts::FRAC_PI_2, 0.3]);
        assert!(
            behind
                .displacement(&Matrix3::identity(), &load)
                .translation_m
                .amax()
                < 1e-18
        );
        // The tool does not move against any load.
        let load = Wrench::from_array([3.0, -7.0, 2.0, 1.0, -1.0, 4.0]);
        let moved = wrist.displacement(&turned, &load);
        assert!(
            moved.translation_m.dot(&load.force_n) + moved.rotation_rad.dot(&load.moment_nm) > 0.0
        );
    }
}
