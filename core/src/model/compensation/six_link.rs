//! Compensation of all six degrees of freedom `[T 3.3, 5.2.3]`.

use super::{CompensatorConfig, CompensatorError, Correction};
use crate::model::kinematics::{COLD_ITERATIONS, KinematicsError, Pose, SixLinkKinematics, Solved};
use crate::model::linalg::{larger, product, rotation_from_vector};
use crate::model::robot::{AXES, Compliances, LINKS};
use crate::model::statics::{LineMatrix, Wrench, finite};
use crate::model::stiffness::Deflection;
use crate::zip::zip;

/// How far apart two rounds of the exact map may be, metres of link length.
const SETTLED_M: f64 = 1e-12;

/// A machine with six axes whose links and axes are springs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SixLinkElastic {
    kinematics: SixLinkKinematics,
    compliances: Compliances<AXES>,
}

impl SixLinkElastic {
    /// A machine and its springs.
    #[must_use]
    pub const fn new(kinematics: SixLinkKinematics, compliances: Compliances<AXES>) -> Self {
        Self {
            kinematics,
            compliances,
        }
    }

    /// The rigid machine.
    #[must_use]
    pub const fn kinematics(&self) -> &SixLinkKinematics {
        &self.kinematics
    }

    /// The springs.
    #[must_use]
    pub const fn compliances(&self) -> &Compliances<AXES> {
        &self.compliances
    }

    /// The pure map to first order: positions that hold `pose` under `load`,
    /// `q_cmd = IK(T - gain dT_links, exp(-gain dtheta_links) R) - gain r` (q-units).
    ///
    /// `q` are the positions that hold it without load. Nothing is limited or filtered; travel is that of the machine.
    ///
    /// # Errors
    /// As [`LineMatrix::of_six_link`] at `pose`, and as [`SixLinkKinematics::inverse`] for the corrected pose.
    pub fn compensated(
        &self,
        pose: &Pose,
        q: &[f64; AXES],
        load: &Wrench,
        gain: f64,
    ) -> Result<[f64; AXES], KinematicsError> {
        let deflection = self.deflection(pose, q, load)?;
        let turn = rotation_from_vector(&(deflection.links.rotation_rad * -gain))
            .ok_or(KinematicsError::NotFinite)?;
        let corrected = Pose {
            position_m: pose.position_m - deflection.links.translation_m * gain,
            rotation: product(&turn, &pose.rotation),
        };
        let [.., q4, q5, q6] = *q;
        let mut command = self
            .kinematics
            .inverse(&corrected, Some([q4, q5, q6]))?
            .answer;
        for (command, yielding) in command.iter_mut().zip(deflection.carts) {
            *command -= gain * yielding;
        }
        Ok(command)
    }

    /// How far springs give way at `pose`. Not inlined, so that its matrices have left the stack when the inverse begins.
    #[inline(never)]
    fn deflection(
        &self,
        pose: &Pose,
        q: &[f64; AXES],
        load: &Wrench,
    ) -> Result<Deflection<AXES>, KinematicsError> {
        // Not moved out of its result: it would be on the stack twice.
        let lines = LineMatrix::of_six_link(&self.kinematics, pose, q);
        let lines = lines.as_ref().map_err(|error| *error)?;
        lines.deflection(&self.compliances, load)
    }

    /// The exact map: positions for which the loaded machine stands in `pose`, with its links as long and its axes as far as the
    /// load leaves them there: `|A(q + r) - B| = L + c f`, `r = c tau`, `q` returned.
    ///
    /// Forces hardly depend on what is sought, so a few rounds settle it. `residual_m` is how far a link's length still moved in
    /// the last one.
    ///
    /// # Errors
    /// As [`compensated`](Self::compensated); `NotConverged` when the rounds do not settle.
    pub fn held(
        &self,
        pose: &Pose,
        q: &[f64; AXES],
        load: &Wrench,
    ) -> Result<Solved<[f64; AXES]>, KinematicsError> {
        let mut standing = *q;
        let mut lengths_m = self.kinematics.robot().geometry().lengths_m;
        let mut residual_m = f64::INFINITY;
        for round in 1..=COLD_ITERATIONS {
            let lines = LineMatrix::of_six_link(&self.kinematics, pose, &standing)?;
            let forces = lines.link_forces_n(load)?;
            let loaded_m = self.loaded_lengths_m(&forces);
            residual_m = zip(&loaded_m, &lengths_m).fold(0.0, |most, (now, before)| {
                larger(most, (now - before).abs())
            });
            lengths_m = loaded_m;
            let [.., q4, q5, q6] = standing;
            let plates = Some([q4, q5, q6]);
            standing = (self
                .kinematics
                .inverse_with_lengths(pose, plates, &lengths_m)?)
            .answer;
            if residual_m <= SETTLED_M {
                return Ok(Solved {
                    answer: finite(self.before_yielding(&standing, &lines.cart_loads(&forces)))?,
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

    /// `q - c tau`: the command whose axes stand at `q` under these loads.
    fn before_yielding(&self, q: &[f64; AXES], loads: &[f64; AXES]) -> [f64; AXES] {
        let mut command = *q;
        let springs = zip(self.compliances.cart_m_per_n(), loads);
        for (axis, (compliance, load)) in command.iter_mut().zip(springs) {
            *axis -= compliance * load;
        }
        command
    }
}

/// The pure map with gain, limits and units: from a wrench to offsets for the server.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SixLinkCompensator {
    machine: SixLinkElastic,
    config: CompensatorConfig<AXES>,
}

impl SixLinkCompensator {
    /// Checks the configuration.
    ///
    /// # Errors
    /// [`CompensatorError`], naming the parameter and its axis.
    pub fn new(
        machine: SixLinkElastic,
        config: CompensatorConfig<AXES>,
    ) -> Result<Self, CompensatorError> {
        config.check()?;
        Ok(Self { machine, config })
    }

    /// The machine and its springs.
    #[must_use]
    pub const fn machine(&self) -> &SixLinkElastic {
        &self.machine
    }

    /// The configuration.
    #[must_use]
    pub const fn config(&self) -> &CompensatorConfig<AXES> {
        &self.config
    }

    /// One cycle: offsets that hold `pose`, which belongs to the nominal positions `q` (q-units), under `load`.
    /// The pose comes from [`SixLinkKinematics::forward_from`], seeded by that of the cycle before.
    ///
    /// Whatever the load, what comes out is within the limits or an error.
    ///
    /// # Errors
    /// As [`SixLinkElastic::compensated`].
    pub fn correction(
        &self,
        pose: &Pose,
        q: &[f64; AXES],
        load: &Wrench,
    ) -> Result<Correction<AXES>, KinematicsError> {
        let command = self.machine.compensated(pose, q, load, self.config.gain)?;
        self.config.bounded(q, &command)
    }

    /// As [`correction`](Self::correction) by the exact map, which costs several inverses; the share `gain` of what it asks for.
    ///
    /// # Errors
    /// As [`SixLinkElastic::held`].
    pub fn exact_correction(
        &self,
        pose: &Pose,
        q: &[f64; AXES],
        load: &Wrench,
    ) -> Result<Correction<AXES>, KinematicsError> {
        let held = self.machine.held(pose, q, load)?;
        self.config.bounded_share(q, &held.answer)
    }
}
