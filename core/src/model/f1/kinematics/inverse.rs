//! Inverse kinematics, from a pose to the axes.

use nalgebra::Vector3;

use super::newton::{Equations, newton};
use super::plates::{PlateThree, PlateTwo};
use super::{Kinematics, stretch};
use crate::model::f1::AXES;
use crate::model::kinematics::{KinematicsError, Pose, Solution, WARM_ITERATIONS, is_pose};
use crate::model::linalg::sqrt;
use crate::model::robot::{ARM_OF_LINK, Branch, LINKS};
use crate::zip::zip;

/// Most linear solves of an attempt whose answer stands; an error after more than [`WARM_ITERATIONS`] does not.
const DIRECT: u8 = 4;
/// Square of the cosine of a link to its guideway below which a start counts as across, and of the second attempt's: 0.05, 3 degrees.
const ACROSS_SQUARED: f64 = 0.05 * 0.05;

/// Course of an attempt.
struct Course {
    /// Linear solves made; untouched where an arm has no answer.
    made: u8,
    /// True if cluster 2 or 3 started with its first link nearly across its guideway.
    across: bool,
}

impl Kinematics {
    /// Inverse kinematics: positions `q` (q-units: metres for carts on a guideway of unit length, radians for plates) for a pose.
    ///
    /// Plates start from `seed` (`q_4`, `q_5`, `q_6`), else from 0; carts on the side that the configuration names, where the first link
    /// of their cluster has its length with the plates as they start. Where that link is there within 3 degrees of across its guideway and
    /// the attempt takes more than 4 solves or fails, a second one starts at 3 degrees, and the call takes up to twice as long. Of two
    /// answers the one whose plates turned clearly less is returned, of two errors the first.
    ///
    /// # Errors
    /// `Unreachable`, `Singular`, `NotConverged`, `OutOfRange`, `OtherBranch` (no solution near the start has every link on its
    /// side), `NotFinite` (also for an `R` that is not a rotation).
    ///
    /// # Examples
    /// ```
    /// use gantry_tau_core::model::kinematics::Pose;
    /// use gantry_tau_core::model::{f1, nalgebra::Vector3, presets};
    ///
    /// let kinematics = f1::Kinematics::new(&f1::Robot::new(presets::f1())?);
    /// let first = kinematics.inverse(&Pose::at(Vector3::new(0.0, 0.0, 0.3)), None)?;
    /// let [.., q4, q5, q6] = first.value;
    /// // The next cycle starts from the plates of this one.
    /// let next = Pose::at(Vector3::new(0.001, 0.0, 0.3));
    /// let solution = kinematics.inverse(&next, Some([q4, q5, q6]))?;
    /// assert!(kinematics.residual_m(&next, &solution.value) < 1e-9);
    /// # Ok::<(), Box<dyn core::error::Error>>(())
    /// ```
    pub fn inverse(&self, pose: &Pose, seed: Option<[f64; 3]>) -> Result<Solution<[f64; AXES]>, KinematicsError> {
        self.inverse_with_lengths(pose, seed, &self.robot.geometry().lengths_m)
    }

    /// As [`inverse`](Self::inverse), for links of other lengths than they have without load.
    pub(crate) fn inverse_with_lengths(
        &self,
        pose: &Pose,
        seed: Option<[f64; 3]>,
        lengths_m: &[f64; LINKS],
    ) -> Result<Solution<[f64; AXES]>, KinematicsError> {
        let seed = seed.unwrap_or_default();
        let mut course = Course { made: u8::MAX, across: false };
        let mut found = self.solve_arms(pose, &seed, lengths_m, 0.0, &mut course);
        if course.across && course.made > if found.is_ok() { DIRECT } else { WARM_ITERATIONS } {
            self.solve_arms_again(pose, &seed, lengths_m, &mut found);
        }
        found
    }

    /// Solves all arms; the first link of clusters 2 and 3 starts at a squared cosine to its guideway of at least `least_squared`.
    fn solve_arms(
        &self,
        pose: &Pose,
        seed: &[f64; 3],
        lengths_m: &[f64; LINKS],
        least_squared: f64,
        course: &mut Course,
    ) -> Result<Solution<[f64; AXES]>, KinematicsError> {
        if !is_pose(pose) || !seed.iter().all(|value| value.is_finite()) {
            return Err(KinematicsError::NotFinite);
        }
        let ends = self.ends_m(pose);
        self.reaches(&ends, lengths_m)?;
        let [q4, q5, q6] = *seed;
        let [b11, b21, b22, b31, b32, b33] = ends;
        let [l11, l21, l22, l31, l32, l33] = *lengths_m;
        let q1 = self.cart_one(&b11, l11)?;
        let ((q2, q4), made_2) = self.cluster_two(&[b21, b22], &[l21, l22], q4, least_squared, &mut course.across)?;
        let ((q3, q5, q6), made_3) =
            self.cluster_three(&[b31, b32, b33], &[l31, l32, l33], (q5, q6), least_squared, &mut course.across)?;
        let value = [q1, q2, q3, q4, q5, q6];
        let iterations = made_2.max(made_3);
        course.made = iterations;
        let links = self.links_m(pose, &value);
        let residual_m = self.check(&links, &value, lengths_m, iterations)?;
        Ok(Solution { value, iterations, residual_m })
    }

    /// Replaces the result of a first attempt by that of a second, for a start of cluster 2 or 3 with its first link nearly across its
    /// guideway. There the link's length hardly depends on the cart: a plate slightly off moves the cart far, and the first step may lead
    /// to the other side or to another answer. Farther from across the steps come down to the answer from one side.
    ///
    /// The attempt where the link just fits stays the first: it starts in the answer if the seed does, however near that is to across,
    /// and its error classifies a pose without an answer.
    #[cold]
    #[inline(never)]
    fn solve_arms_again(
        &self,
        pose: &Pose,
        seed: &[f64; 3],
        lengths_m: &[f64; LINKS],
        found: &mut Result<Solution<[f64; AXES]>, KinematicsError>,
    ) {
        let mut course = Course { made: 0, across: true };
        let Ok(second) = self.solve_arms(pose, seed, lengths_m, ACROSS_SQUARED, &mut course) else {
            return;
        };
        // Half: two attempts with one answer differ by rounding.
        if moved(&second.value, seed) < 0.5 * moved_at_least(found, seed) {
            *found = Ok(second);
        }
    }

    /// Checks that every link reaches its plate: it must be as long as the distance of its end from the line that the plate runs along,
    /// less the plate's own reach.
    fn reaches(&self, ends_m: &[Vector3<f64>; LINKS], lengths_m: &[f64; LINKS]) -> Result<(), KinematicsError> {
        let carts_m = &self.robot.geometry().carts_m;
        let reaches = zip(&self.plate_reaches_m, &ARM_OF_LINK);
        for ((end, length), (reach, arm)) in zip(ends_m, lengths_m).zip(reaches) {
            let (Some(cart), Some(side)) = (carts_m.get(*arm), self.sides.get(*arm)) else {
                continue;
            };
            let (across, farthest) = ((end - cart).cross(side), length + reach);
            if across.dot(&across) > farthest * farthest {
                return Err(KinematicsError::Unreachable { arm: *arm });
            }
        }
        Ok(())
    }

    /// Arm 1 in closed form.
    fn cart_one(&self, end_m: &Vector3<f64>, length_m: f64) -> Result<f64, KinematicsError> {
        let [v1, _, _] = self.plates.guideways();
        let [c1, _, _] = self.robot.geometry().configuration;
        let (q, along_squared) = cart(&(end_m - self.plates.one()), v1, length_m, c1);
        if along_squared < 0.0 {
            return Err(KinematicsError::Unreachable { arm: 0 });
        }
        Ok(q)
    }

    /// Cluster 2: `(q_2, q_4)`, and the solves made.
    fn cluster_two(
        &self,
        ends_m: &[Vector3<f64>; 2],
        lengths_m: &[f64; 2],
        q4: f64,
        least_squared: f64,
        across: &mut bool,
    ) -> Result<((f64, f64), u8), KinematicsError> {
        let [_, v2, _] = self.plates.guideways();
        let [_, c2, _] = self.robot.geometry().configuration;
        let plate = self.plates.two(q4);
        let ([first, _], [a21, _], [length, _]) = (ends_m, plate.joints_m, *lengths_m);
        let (q2, along_squared) = cart_beyond(&(first - a21), v2, length, c2, least_squared);
        *across |= is_across(along_squared, length);
        let place = |&[_, q4]: &[f64; 2]| self.plates.two(q4);
        let equations = |&[q2, _]: &[f64; 2], plate: &PlateTwo| {
            let link = |joint: &Vector3<f64>, end: &Vector3<f64>, turn: &Vector3<f64>, length: f64| {
                let w = joint + v2 * q2 - end;
                let (error, s) = stretch(&w, length);
                (error, [s.dot(v2), s.dot(turn)])
            };
            let ([a1, a2], [t1, t2]) = (&plate.joints_m, &plate.turns);
            let ([b1, b2], [l1, l2]) = (ends_m, *lengths_m);
            let (one, two) = (link(a1, b1, t1, l1), link(a2, b2, t2, l2));
            Equations { errors_m: [one.0, two.0], rows: [one.1, two.1] }
        };
        let ([q2, q4], made) = newton([q2, q4], plate, self.converged_m(), place, equations)
            .map_err(|error| from_the_foot(1, along_squared, error))?;
        Ok(((q2, q4), made))
    }

    /// Cluster 3: `(q_3, q_5, q_6)`, and the solves made.
    fn cluster_three(
        &self,
        ends_m: &[Vector3<f64>; 3],
        lengths_m: &[f64; 3],
        (q5, q6): (f64, f64),
        least_squared: f64,
        across: &mut bool,
    ) -> Result<((f64, f64, f64), u8), KinematicsError> {
        let [_, _, v3] = self.plates.guideways();
        let [_, _, c3] = self.robot.geometry().configuration;
        let plate = self.plates.three(q5, q6);
        let ([first, ..], [a31, ..], [length, ..]) = (ends_m, plate.joints_m, *lengths_m);
        let (q3, along_squared) = cart_beyond(&(first - a31), v3, length, c3, least_squared);
        *across |= is_across(along_squared, length);
        let place = |&[_, q5, q6]: &[f64; 3]| self.plates.three(q5, q6);
        let equations = |&[q3, _, _]: &[f64; 3], plate: &PlateThree| {
            let link = |joint: &Vector3<f64>, end: &Vector3<f64>, rates: [&Vector3<f64>; 2], length: f64| {
                let w = joint + v3 * q3 - end;
                let (error, s) = stretch(&w, length);
                (error, [s.dot(v3), s.dot(rates[0]), s.dot(rates[1])])
            };
            let ([a1, a2, a3], [t1, t2, t3], [k1, k2, k3]) = (&plate.joints_m, &plate.turns, &plate.tilts);
            let ([b1, b2, b3], [l1, l2, l3]) = (ends_m, *lengths_m);
            let one = link(a1, b1, [t1, k1], l1);
            let two = link(a2, b2, [t2, k2], l2);
            let three = link(a3, b3, [t3, k3], l3);
            Equations { errors_m: [one.0, two.0, three.0], rows: [one.1, two.1, three.1] }
        };
        let ([q3, q5, q6], made) = newton([q3, q5, q6], plate, self.converged_m(), place, equations)
            .map_err(|error| from_the_foot(2, along_squared, error))?;
        Ok(((q3, q5, q6), made))
    }
}

/// True if a link is nearly across its guideway, or a little too short to be so. One that is shorter does not reach: no second attempt is
/// made of it.
fn is_across(along_squared: f64, length_m: f64) -> bool {
    along_squared.abs() < ACROSS_SQUARED * length_m * length_m
}

/// Largest turn of a plate from where it started, radians.
fn moved(&[_, _, _, q4, q5, q6]: &[f64; AXES], [start4, start5, start6]: &[f64; 3]) -> f64 {
    (q4 - start4).abs().max((q5 - start5).abs()).max((q6 - start6).abs())
}

/// Lower bound of [`moved`] for the result of an attempt: of an answer out of range only the first such axis is known; infinite where there
/// was no answer.
fn moved_at_least(found: &Result<Solution<[f64; AXES]>, KinematicsError>, seed: &[f64; 3]) -> f64 {
    match found {
        Ok(found) => moved(&found.value, seed),
        Err(KinematicsError::OutOfRange { axis, q, .. }) => {
            zip(&[3, 4, 5], seed).find(|(plate, _)| *plate == axis).map_or(0.0, |(_, start)| (q - start).abs())
        }
        Err(_) => f64::INFINITY,
    }
}

/// Error of a cluster that started with its first link too short, at the foot of the perpendicular: there the link is across its
/// guideway, which looks like a singularity, but the cause is that the link does not reach with its plate at the start.
fn from_the_foot(arm: usize, along_squared: f64, error: KinematicsError) -> KinematicsError {
    match error {
        KinematicsError::Singular { .. } if along_squared < 0.0 => KinematicsError::Unreachable { arm },
        error => error,
    }
}

/// Position of the cart of one link whose end is at `from_origin_m` from the joint at `q = 0`: `q`, and the square of the link's length
/// along the guideway (metres squared), below zero where the link is too short; then `q` is the nearest point.
pub(super) fn cart(from_origin_m: &Vector3<f64>, guideway: &Vector3<f64>, length_m: f64, branch: Branch) -> (f64, f64) {
    cart_beyond(from_origin_m, guideway, length_m, branch, 0.0)
}

/// As [`cart`], but `q` is no nearer to the nearest point than where the squared cosine of the link to its guideway is `least_squared`.
fn cart_beyond(
    from_origin_m: &Vector3<f64>,
    guideway: &Vector3<f64>,
    length_m: f64,
    branch: Branch,
    least_squared: f64,
) -> (f64, f64) {
    let scale_squared = guideway.dot(guideway);
    let foot = from_origin_m.dot(guideway) / scale_squared;
    let across = from_origin_m - guideway * foot;
    let length_squared = length_m * length_m;
    let along_squared = length_squared - across.dot(&across);
    let along = branch.sign() * sqrt(along_squared.max(least_squared * length_squared) / scale_squared);
    (foot + along, along_squared)
}
