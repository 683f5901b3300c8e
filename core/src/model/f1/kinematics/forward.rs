//! Forward kinematics, from the axes to a pose.

use nalgebra::{Matrix3, Vector3};

use super::step::System;
use super::{Kinematics, surplus};
use crate::model::f1::{AXES, Geometry};
use crate::model::kinematics::{COLD_ITERATIONS, KinematicsError, Pose, Solution, is_pose};
use crate::model::linalg::{norm, product, rotation_from_vector, sqrt, times};
use crate::model::robot::LINKS;

/// Largest deviation from the synchronised form, over the machine's size.
const SYNCHRONISED_TOLERANCE: f64 = 1e-9;

impl Kinematics {
    /// Forward kinematics without a seed: from the synchronised form, for any angles of the plates.
    /// That form is the solution where they turn together (`q_4 = -q_5` for drives of opposite
    /// signs), and no iteration is needed unless the links of a cluster are parallel only to the
    /// tolerance.
    ///
    /// # Errors
    /// `SeedRequired` where the machine has no such form (`b_22 - b_21` is not parallel to `a_6`,
    /// or the links of a cluster do not run parallel), `NoAssembly` where the links cannot meet,
    /// else as [`forward_from`](Self::forward_from).
    pub fn forward(&self, q: &[f64; AXES]) -> Result<Solution<Pose>, KinematicsError> {
        let start = self.start(q)?;
        self.forward_from(q, &start, COLD_ITERATIONS)
    }

    /// Forward kinematics from a pose nearby: Newton on the group, `T <- T + dT`,
    /// `R <- exp(dtheta) R`, with `[w; l x w] (dT, dtheta) = (|w|^2 - L^2) / 2` per link. At most
    /// `iterations` linear solves ([`WARM_ITERATIONS`](crate::model::kinematics::WARM_ITERATIONS),
    /// [`COLD_ITERATIONS`]).
    ///
    /// # Errors
    /// `NotConverged`, `Singular`, `OutOfRange`, `NotFinite`; `OtherBranch` where the solution is
    /// not in the seed's assembly mode (`arm: None`), or an arm not on its side.
    pub fn forward_from(
        &self,
        q: &[f64; AXES],
        seed: &Pose,
        iterations: u8,
    ) -> Result<Solution<Pose>, KinematicsError> {
        if !q.iter().all(|value| value.is_finite()) || !is_pose(seed) {
            return Err(KinematicsError::NotFinite);
        }
        let joints = self.plates.at(q).joints_m;
        let mut pose = *seed;
        let mut mode = None;
        for made in 0..=iterations {
            let system = self.system(&pose, &joints);
            if made == iterations || system.is_settled(&self.settled()) {
                pose.rotation = orthonormal(&pose.rotation);
                let (links_m, _) = self.links_and_levers(&pose, &joints);
                let residual_m = self.check(&links_m, q, &self.robot.geometry().lengths_m, made)?;
                return Ok(Solution {
                    value: pose,
                    iterations: made,
                    residual_m,
                });
            }
            let step = system.solve()?;
            if *mode.get_or_insert(step.det_is_negative) != step.det_is_negative {
                return Err(KinematicsError::OtherBranch { arm: None });
            }
            let turn =
                rotation_from_vector(&step.rotation_rad).ok_or(KinematicsError::NotFinite)?;
            pose.position_m += step.translation_m;
            pose.rotation = product(&turn, &pose.rotation);
        }
        // Not reached: the last round returns.
        Err(KinematicsError::NotFinite)
    }

    /// As [`inverse`](Self::inverse), for a tool in the assembly mode of the synchronised form
    /// only, where there is one: [`forward`](Self::forward) starts there, and cannot pass the
    /// singularity between two modes.
    ///
    /// # Errors
    /// As [`inverse`](Self::inverse); `OtherBranch { arm: None }` in another mode, `Singular`
    /// between two.
    pub fn inverse_in_assembly(
        &self,
        pose: &Pose,
        seed: Option<[f64; 3]>,
    ) -> Result<Solution<[f64; AXES]>, KinematicsError> {
        let found = self.inverse(pose, seed)?;
        let joints = self.plates.at(&found.value).joints_m;
        let det_is_negative = self.system(pose, &joints).solve()?.det_is_negative;
        if self.is_synchronisable() {
            let start = self.start(&found.value)?;
            if self.system(&start, &joints).solve()?.det_is_negative != det_is_negative {
                return Err(KinematicsError::OtherBranch { arm: None });
            }
        }
        Ok(found)
    }

    /// Pose of the synchronised form with plate 3 as it is (`[T 3.1.2]`: plates that turn together
    /// leave `R = Rot(a, theta) Rot(a_6, q_6)`, and three spheres give `T`); a start where plate 2
    /// is not in step. Not inlined: a solution from a seed needs none of its stack.
    #[inline(never)]
    fn start(&self, q: &[f64; AXES]) -> Result<Pose, KinematicsError> {
        if !q.iter().all(|value| value.is_finite()) {
            return Err(KinematicsError::NotFinite);
        }
        if !self.is_synchronisable() {
            return Err(KinematicsError::SeedRequired);
        }
        let geometry = self.robot.geometry();
        let [q1, q2, q3, _, q5, q6] = *q;
        let [v1, v2, v3] = self.plates.guideways();
        let rotation = self.plates.orientation(q5, q6);
        let [p11, p21, _, p31, ..] = geometry.plate_joints_m;
        let [b11, b21, _, b31, ..] = geometry.platform_joints_m;
        let [c1, c2, c3] = geometry.carts_m;
        let [l1, l2, _, l3, ..] = geometry.lengths_m;
        let turned = self.plates.orientation(q5, 0.0);
        let centres = [
            c1 + v1 * q1 + p11 - times(&rotation, &b11),
            c2 + v2 * q2 + times(&turned, &p21) - times(&rotation, &b21),
            c3 + v3 * q3 + times(&rotation, &(p31 - b31)),
        ];
        let poses = three_spheres(&centres, &[l1, l2, l3])?.map(|position_m| Pose {
            position_m,
            rotation,
        });
        let joints = self.plates.at(q).joints_m;
        let [one, other] = poses.map(|pose| {
            let (links_m, _) = self.links_and_levers(&pose, &joints);
            (self.on_their_sides(&links_m), pose)
        });
        match (one, other) {
            ((Ok(()), _), (Ok(()), _)) => Err(KinematicsError::SeedRequired),
            ((Ok(()), pose), _) | (_, (Ok(()), pose)) => Ok(pose),
            ((Err(error), _), _) => Err(error),
        }
    }

    /// True if plates in step leave every cluster's links parallel.
    pub(in crate::model::f1) fn is_synchronisable(&self) -> bool {
        let geometry = self.robot.geometry();
        let tolerance = SYNCHRONISED_TOLERANCE * self.size_m;
        let [_, p21, p22, p31, p32, p33] = geometry.plate_joints_m;
        let [_, b21, b22, b31, b32, b33] = geometry.platform_joints_m;
        let across_tilt = (b22 - b21).cross(self.plates.tilt_axis());
        norm(&across_tilt) <= tolerance
            && norm(&(p22 - p21 - (b22 - b21))) <= tolerance
            && norm(&(p32 - p31 - (b32 - b31))) <= tolerance
            && norm(&(p33 - p31 - (b33 - b31))) <= tolerance
            && equal_in_clusters(geometry, tolerance)
    }

    /// System of a Newton step from this pose.
    #[inline]
    pub(super) fn system(&self, pose: &Pose, joints_m: &[Vector3<f64>; LINKS]) -> System {
        let (links_m, levers_m) = self.links_and_levers(pose, joints_m);
        let [w11, w21, w22, w31, w32, w33] = &links_m;
        let [l11, l21, l22, l31, l32, l33] = self.robot.geometry().lengths_m;
        let surpluses = [
            surplus(w11, l11),
            surplus(w21, l21),
            surplus(w22, l22),
            surplus(w31, l31),
            surplus(w32, l32),
            surplus(w33, l33),
        ];
        System {
            links_m,
            levers_m,
            surpluses,
        }
    }
}

/// True if the links of each cluster are equally long.
fn equal_in_clusters(geometry: &Geometry, tolerance_m: f64) -> bool {
    let [_, l21, l22, l31, l32, l33] = geometry.lengths_m;
    (l21 - l22).abs() <= tolerance_m
        && (l31 - l32).abs() <= tolerance_m
        && (l31 - l33).abs() <= tolerance_m
}

/// Nearest rotation, to second order in the deviation of `R`: one step of `R <- R (3 - R^T R) / 2`.
/// Without it a cyclic seed would drift by an ulp per cycle.
pub(super) fn orthonormal(rotation: &Matrix3<f64>) -> Matrix3<f64> {
    let gram = product(&rotation.transpose(), rotation);
    product(rotation, &(Matrix3::identity() * 1.5 - gram * 0.5))
}

/// Returns both points at the given distances from three centres.
fn three_spheres(
    centres_m: &[Vector3<f64>; 3],
    radii_m: &[f64; 3],
) -> Result<[Vector3<f64>; 2], KinematicsError> {
    let [p1, p2, p3] = centres_m;
    let [l1, l2, l3] = *radii_m;
    let (e1, e2) = (p2 - p1, p3 - p1);
    let normal = e1.cross(&e2);
    let normal_squared = normal.dot(&normal);
    // x . e1 = k1, x . e2 = k2 for x = T - P1.
    let k1 = 0.5 * (e1.dot(&e1) + l1 * l1 - l2 * l2);
    let k2 = 0.5 * (e2.dot(&e2) + l1 * l1 - l3 * l3);
    let base = (e2.cross(&normal) * k1 + normal.cross(&e1) * k2) / normal_squared;
    let height_squared = (l1 * l1 - base.dot(&base)) / normal_squared;
    if height_squared < 0.0 {
        return Err(KinematicsError::NoAssembly);
    }
    let height = normal * sqrt(height_squared);
    // Carts in one line leave a circle.
    if !height
        .iter()
        .chain(base.iter())
        .all(|value| value.is_finite())
    {
        return Err(KinematicsError::Singular { measure: 0.0 });
    }
    Ok([p1 + base + height, p1 + base - height])
}
