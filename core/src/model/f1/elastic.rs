//! The F1 with links and axes as springs `[T 3.3]`, and the commands that hold a pose under load
//! `[T 5.2.3]`.

use super::kinematics::plates::PlatesAt;
use super::{AXES, Kinematics};
use crate::model::kinematics::{COLD_ITERATIONS, KinematicsError, Pose, Solution};
use crate::model::linalg::{max_propagating_nan, product, rotation_from_vector};
use crate::model::robot::{Compliances, LINKS};
use crate::model::statics::{LineMatrix, Wrench, finite};
use crate::model::stiffness::{Displacement, Yielding};
use crate::zip::zip;

/// Largest change of a link length in the last round of the exact map, metres.
const SETTLED_M: f64 = 1e-12;

/// Displacements of the axes (q-units), and of the platform by the links alone.
type Displaced = ([f64; AXES], Displacement);

/// An F1 with its springs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Elastic {
    kinematics: Kinematics,
    compliances: Compliances<AXES>,
}

impl Elastic {
    /// A machine and its springs.
    #[must_use]
    pub const fn new(kinematics: &Kinematics, compliances: &Compliances<AXES>) -> Self {
        Self {
            kinematics: *kinematics,
            compliances: *compliances,
        }
    }

    /// The rigid machine.
    #[must_use]
    pub const fn kinematics(&self) -> &Kinematics {
        &self.kinematics
    }

    /// The springs.
    #[must_use]
    pub const fn compliances(&self) -> &Compliances<AXES> {
        &self.compliances
    }

    /// Returns the command to first order: positions that hold `pose` under `load`,
    /// `q_cmd = IK(T - gain dT_links, exp(-gain dtheta_links) R) - gain r` (q-units).
    ///
    /// `q` are the positions that hold it without load. The command is neither limited nor
    /// filtered; travel is that of the machine.
    ///
    /// # Errors
    /// As [`Kinematics::line_matrix`] at `pose`, and as [`Kinematics::inverse`] for the corrected
    /// pose.
    pub fn command(
        &self,
        pose: &Pose,
        q: &[f64; AXES],
        load: &Wrench,
        gain: f64,
    ) -> Result<[f64; AXES], KinematicsError> {
        // Placed once: the inverse starts from them.
        let plates = self.kinematics.place(q);
        let displaced = self.displaced(pose, &plates, load)?;
        self.command_against(&displaced, pose, q, &plates, gain)
    }

    /// As [`command`](Self::command), where the line matrix at `pose` is known.
    ///
    /// # Errors
    /// As [`command`](Self::command).
    pub fn command_of(
        &self,
        lines: &LineMatrix<AXES>,
        pose: &Pose,
        q: &[f64; AXES],
        load: &Wrench,
        gain: f64,
    ) -> Result<[f64; AXES], KinematicsError> {
        let displaced = self.displaced_of(lines, load)?;
        self.command_against(&displaced, pose, q, &self.kinematics.place(q), gain)
    }

    /// Command that takes the share `gain` of displacements back.
    #[inline(never)]
    fn command_against(
        &self,
        (carts, links): &Displaced,
        pose: &Pose,
        q: &[f64; AXES],
        plates: &PlatesAt<'_>,
        gain: f64,
    ) -> Result<[f64; AXES], KinematicsError> {
        let turn = rotation_from_vector(&(links.rotation_rad * -gain))
            .ok_or(KinematicsError::NotFinite)?;
        let corrected = Pose {
            position_m: pose.position_m - links.translation_m * gain,
            rotation: product(&turn, &pose.rotation),
        };
        let mut command = self.kinematics.inverse_from(&corrected, q, plates)?.value;
        for (command, yielding) in command.iter_mut().zip(carts) {
            *command -= gain * yielding;
        }
        Ok(command)
    }

    /// Not inlined, so that its matrices have left the stack when the inverse begins.
    #[inline(never)]
    fn displaced(
        &self,
        pose: &Pose,
        plates: &PlatesAt<'_>,
        load: &Wrench,
    ) -> Result<Displaced, KinematicsError> {
        // Borrowed: moving the matrix out of the `Result` would put a second copy on the stack.
        let lines = self.kinematics.line_matrix_of(pose, plates);
        let lines = lines.as_ref().map_err(|error| *error)?;
        self.displaced_of(lines, load)
    }

    #[inline]
    fn displaced_of(
        &self,
        lines: &LineMatrix<AXES>,
        load: &Wrench,
    ) -> Result<Displaced, KinematicsError> {
        let Yielding {
            carts,
            elongations_m,
        } = lines.yielding(&self.compliances, load)?;
        Ok((carts, lines.displacement_by_links(&elongations_m)?))
    }

    /// Returns the exact command: positions for which the loaded machine stands in `pose`, with its
    /// links as long and its axes as far as the load leaves them there: `|A(q + r) - B| = L + c f`,
    /// `r = c tau`, `q` returned.
    ///
    /// Forces hardly depend on the command, so a few rounds suffice. `residual_m` is the largest
    /// change of a link's length in the last.
    ///
    /// # Errors
    /// As [`command`](Self::command); `NotConverged` when the rounds do not settle.
    pub fn exact_command(
        &self,
        pose: &Pose,
        q: &[f64; AXES],
        load: &Wrench,
    ) -> Result<Solution<[f64; AXES]>, KinematicsError> {
        let mut standing = *q;
        let mut lengths_m = self.kinematics.robot().geometry().lengths_m;
        let mut residual_m = f64::INFINITY;
        for round in 1..=COLD_ITERATIONS {
            let lines = self.kinematics.line_matrix(pose, &standing)?;
            let forces = lines.link_forces_n(load)?;
            let loaded_m = self.loaded_lengths_m(&forces);
            residual_m = zip(&loaded_m, &lengths_m).fold(0.0, |most, (now, before)| {
                max_propagating_nan(most, (now - before).abs())
            });
            lengths_m = loaded_m;
            let [.., q4, q5, q6] = standing;
            let plates = Some([q4, q5, q6]);
            standing = (self
                .kinematics
                .inverse_with_lengths(pose, plates, &lengths_m)?)
            .value;
            if residual_m <= SETTLED_M {
                let value = finite(
                    self.compliances
                        .before_yielding(&standing, &lines.cart_loads(&forces)),
                )?;
                return Ok(Solution {
                    value,
                    iterations: round,
                    residual_m,
                });
            }
        }
        Err(KinematicsError::NotConverged {
            iterations: COLD_ITERATIONS,
            residual_m,
        })
    }

    /// `L + c f`, metres.
    fn loaded_lengths_m(&self, forces_n: &[f64; LINKS]) -> [f64; LINKS] {
        let mut lengths_m = self.kinematics.robot().geometry().lengths_m;
        let springs = zip(self.compliances.link_m_per_n(), forces_n);
        for (length, (compliance, force)) in lengths_m.iter_mut().zip(springs) {
            *length += compliance * force;
        }
        lengths_m
    }
}
