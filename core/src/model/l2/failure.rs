//! Diagnosis of a closed form that failed: done after the failure only, so that success stays
//! cheap.

use nalgebra::Vector3;

use super::kinematics::{Arm, MAX_POSITION_M};
use super::{AXES, Kinematics};
use crate::model::kinematics::{KinematicsError, SINGULARITY_TOLERANCE};
use crate::model::linalg::sqrt;

impl Kinematics {
    /// Names the reason after [`inverse`](Self::inverse) failed, in the order in which it could
    /// have been noticed.
    #[cold]
    #[inline(never)]
    pub(super) fn diagnose_inverse(&self, tcp_m: &Vector3<f64>) -> KinematicsError {
        if !tcp_m.iter().all(|value| value.is_finite()) {
            return KinematicsError::NotFinite;
        }
        if tcp_m.amax() > MAX_POSITION_M {
            return KinematicsError::Unreachable { arm: 0 };
        }
        let [r1, r2, r3] = self.arms.map(|arm| arm.reach(tcp_m));
        for (arm, (model, reach)) in self.arms.iter().zip([&r1, &r2, &r3]).enumerate() {
            if reach.along_squared < 0.0 {
                return KinematicsError::Unreachable { arm };
            }
            if reach.along_squared <= model.along_squared_min {
                let cosine_squared = reach.along_squared / model.length_squared;
                return KinematicsError::Singular {
                    measure: sqrt(cosine_squared),
                };
            }
        }
        for (axis, (model, reach)) in self.arms.iter().zip([&r1, &r2, &r3]).enumerate() {
            if !model.travels(reach.q) {
                return model.out_of_range(axis, reach.q);
            }
        }
        KinematicsError::NotFinite
    }

    /// Names the reason after [`forward`](Self::forward) failed.
    #[cold]
    #[inline(never)]
    pub(super) fn diagnose_forward(&self, q: &[f64; AXES]) -> KinematicsError {
        if !q.iter().all(|value| value.is_finite()) {
            return KinematicsError::NotFinite;
        }
        for (axis, (model, q)) in self.arms.iter().zip(q).enumerate() {
            if !model.travels(*q) {
                return model.out_of_range(axis, *q);
            }
        }
        let meeting = self.meet(q);
        let scale = SINGULARITY_TOLERANCE / self.determinant_min;
        let regular = meeting.determinant_squared > self.determinant_squared_min;
        if !regular {
            // Carts in one line leave a circle of solutions; links that cannot meet leave none.
            let [_, a2, a3] = &self.arms;
            let in_line = SINGULARITY_TOLERANCE * SINGULARITY_TOLERANCE * a2.length_squared;
            let carts_in_line = meeting.normal_squared <= in_line * a3.length_squared;
            if !carts_in_line && meeting.determinant_squared < -self.determinant_squared_min {
                return KinematicsError::NoAssembly;
            }
            let squared = meeting.determinant_squared;
            let measure = if squared > 0.0 { sqrt(squared) } else { 0.0 };
            return KinematicsError::Singular {
                measure: if carts_in_line { 0.0 } else { measure * scale },
            };
        }
        // So near to a singularity that rounding decides.
        if meeting.mismatch > self.mismatch_max {
            return KinematicsError::Singular { measure: 0.0 };
        }
        for (arm, (model, link)) in self.arms.iter().zip(meeting.links()).enumerate() {
            let along = model.along(&link);
            if along < -model.along_min {
                return KinematicsError::OtherBranch { arm: Some(arm) };
            }
            if along <= model.along_min {
                return KinematicsError::Singular {
                    measure: along.abs() * SINGULARITY_TOLERANCE / model.along_min,
                };
            }
        }
        KinematicsError::NotFinite
    }
}

impl Arm {
    fn out_of_range(&self, axis: usize, q: f64) -> KinematicsError {
        KinematicsError::OutOfRange {
            axis,
            q,
            lower: self.lower,
            upper: self.upper,
        }
    }
}
