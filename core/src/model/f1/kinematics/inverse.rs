//! Inverse kinematics, from a pose to the axes.

use nalgebra::Vector3;

use super::newton::{Answer, newton};
use super::plates::{PlateThree, PlateTwo, PlatesAt};
use super::{Kinematics, surplus};
use crate::model::f1::AXES;
use crate::model::kinematics::{KinematicsError, Pose, Solution, WARM_ITERATIONS, is_pose};
use crate::model::linalg::sqrt;
use crate::model::robot::{ARM_OF_LINK, Branch, LINKS};
use crate::zip::zip;

/// Most linear solves of an attempt whose answer stands; an error after more than
/// [`WARM_ITERATIONS`] does not.
const DIRECT: u8 = 4;
/// Square of the cosine of a link to its guideway below which a start counts as across, and of the
/// second attempt's: 0.05, 3 degrees.
const ACROSS_SQUARED: f64 = 0.05 * 0.05;

/// Start of the iterations.
struct Start<'a> {
    /// `q_4`, `q_5`, `q_6`.
    seed: [f64; 3],
    /// Plate 2 there.
    two: &'a PlateTwo,
    /// Plate 3 there.
    three: &'a PlateThree,
}

/// Course of an attempt.
struct Course {
    /// Linear solves made; untouched where an arm has no answer.
    made: u8,
    /// True if cluster 2 or 3 started with its first link nearly across its guideway.
    across: bool,
}

impl Kinematics {
    /// Inverse kinematics: positions `q` (q-units: metres for carts on a guideway of unit length,
    /// radians for plates) for a pose.
    ///
    /// Plates start from `seed` (`q_4`, `q_5`, `q_6`), else from 0; carts on the side that the
    /// configuration names, where the first link of their cluster has its length with the plates as
    /// they start. Where that link is there within 3 degrees of across its guideway and the attempt
    /// takes more than 4 solves or fails, a second one starts at 3 degrees, and the call takes up
    /// to twice as long. Of two answers the one whose plates turned clearly less is returned, of
    /// two errors the first.
    ///
    /// # Errors
    /// `Unreachable`, `Singular`, `NotConverged`, `OutOfRange`, `OtherBranch` (no solution near the
    /// start has every link on its side), `NotFinite` (also for an `R` that is not a rotation).
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
    pub fn inverse(
        &self,
        pose: &Pose,
        seed: Option<[f64; 3]>,
    ) -> Result<Solution<[f64; AXES]>, KinematicsError> {
        self.inverse_with_lengths(pose, seed, &self.robot.geometry().lengths_m)
    }

    /// As [`inverse`](Self::inverse), from the plates of `q`, which are placed.
    pub(in crate::model::f1) fn inverse_from(
        &self,
        pose: &Pose,
        [_, _, _, q4, q5, q6]: &[f64; AXES],
        plates: &PlatesAt<'_>,
    ) -> Result<Solution<[f64; AXES]>, KinematicsError> {
        let start = Start {
            seed: [*q4, *q5, *q6],
            two: &plates.two,
            three: &plates.three,
        };
        self.inverse_from_start(pose, &start, &self.robot.geometry().lengths_m)
    }

    /// As [`inverse`](Self::inverse), for links of other lengths than they have without load.
    pub(crate) fn inverse_with_lengths(
        &self,
        pose: &Pose,
        seed: Option<[f64; 3]>,
        lengths_m: &[f64; LINKS],
    ) -> Result<Solution<[f64; AXES]>, KinematicsError> {
        let [q4, q5, q6] = seed.unwrap_or_default();
        let (two, three) = (self.plates.two(q4), self.plates.three(q5, q6));
        let start = Start {
            seed: [q4, q5, q6],
            two: &two,
            three: &three,
        };
        self.inverse_from_start(pose, &start, lengths_m)
    }

    fn inverse_from_start(
        &self,
        pose: &Pose,
        start: &Start<'_>,
        lengths_m: &[f64; LINKS],
    ) -> Result<Solution<[f64; AXES]>, KinematicsError> {
        let mut course = Course {
            made: u8::MAX,
            across: false,
        };
        let mut found = self.solve_arms(pose, start, lengths_m, 0.0, &mut course);
        if course.across
            && course.made
                > if found.is_ok() {
                    DIRECT
                } else {
                    WARM_ITERATIONS
                }
        {
            self.solve_arms_again(pose, start, lengths_m, &mut found);
        }
        found
    }

    /// Solves all arms; the first link of clusters 2 and 3 starts at a squared cosine to its
    /// guideway of at least `least_squared`.
    fn solve_arms(
        &self,
        pose: &Pose,
        start: &Start<'_>,
        lengths_m: &[f64; LINKS],
        least_squared: f64,
        course: &mut Course,
    ) -> Result<Solution<[f64; AXES]>, KinematicsError> {
        if !is_pose(pose) || !start.seed.iter().all(|value| value.is_finite()) {
            return Err(KinematicsError::NotFinite);
        }
        let ends = self.ends_m(pose);
        self.reaches(&ends, lengths_m)?;
        let [b11, b21, b22, b31, b32, b33] = ends;
        let [l11, l21, l22, l31, l32, l33] = *lengths_m;
        let (q1, w11) = self.cart_one(&b11, l11)?;
        let across = &mut course.across;
        let two = self.cluster_two(&[b21, b22], &[l21, l22], start, least_squared, across)?;
        let three = self.cluster_three(
            &[b31, b32, b33],
            &[l31, l32, l33],
            start,
            least_squared,
            across,
        )?;
        let [q2, q4] = two.unknowns;
        let [q3, q5, q6] = three.unknowns;
        let [w21, w22] = two.links_m;
        let [w31, w32, w33] = three.links_m;
        let value = [q1, q2, q3, q4, q5, q6];
        let iterations = two.made.max(three.made);
        course.made = iterations;
        let residual_m = self.check(
            &[w11, w21, w22, w31, w32, w33],
            &value,
            lengths_m,
            iterations,
        )?;
        Ok(Solution {
            value,
            iterations,
            residual_m,
        })
    }

    /// Replaces the result of a first attempt by that of a second, for a start of cluster 2 or 3
    /// with its first link nearly across its guideway. There the link's length hardly depends on
    /// the cart: a plate slightly off moves the cart far, and the first step may lead to the other
    /// side or to another answer. Farther from across the steps come down to the answer from one
    /// side.
    ///
    /// The attempt where the link just fits stays the first: it starts in the answer if the seed
    /// does, however near that is to across, and its error classifies a pose without an answer.
    #[cold]
    #[inline(never)]
    fn solve_arms_again(
        &self,
        pose: &Pose,
        start: &Start<'_>,
        lengths_m: &[f64; LINKS],
        found: &mut Result<Solution<[f64; AXES]>, KinematicsError>,
    ) {
        let mut course = Course {
            made: 0,
            across: true,
        };
        let Ok(second) = self.solve_arms(pose, start, lengths_m, ACROSS_SQUARED, &mut course)
        else {
            return;
        };
        // Half: two attempts with one answer differ by rounding.
        if moved(&second.value, &start.seed) < 0.5 * moved_at_least(found, &start.seed) {
            *found = Ok(second);
        }
    }

    /// Checks that every link reaches its plate: it must be as long as the distance of its end from
    /// the line that the plate runs along, less the plate's own reach.
    fn reaches(
        &self,
        ends_m: &[Vector3<f64>; LINKS],
        lengths_m: &[f64; LINKS],
    ) -> Result<(), KinematicsError> {
        let carts_m = &self.robot.geometry().carts_m;
        let reaches = zip(&self.plate_reaches_m, &ARM_OF_LINK);
        for ((end, length), (reach, arm)) in zip(ends_m, lengths_m).zip(reaches) {
            let (Some(cart), Some(side)) = (carts_m.get(*arm), self.sides.get(*arm)) else {
                continue;
            };
            let across = (end - cart).cross(side);
            let farthest = length + reach;
            if across.dot(&across) > farthest * farthest {
                return Err(KinematicsError::Unreachable { arm: *arm });
            }
        }
        Ok(())
    }

    /// Arm 1 in closed form: `q_1`, and its link, metres.
    fn cart_one(
        &self,
        end_m: &Vector3<f64>,
        length_m: f64,
    ) -> Result<(f64, Vector3<f64>), KinematicsError> {
        let [v1, _, _] = self.plates.guideways();
        let [c1, _, _] = self.robot.geometry().configuration;
        let joint_m = self.plates.one();
        let q = cart(0, &(end_m - joint_m), v1, length_m, c1)?;
        Ok((q, joint_m + v1 * q - end_m))
    }

    /// Cluster 2: `(q_2, q_4)`.
    #[inline]
    fn cluster_two(
        &self,
        [end1, end2]: &[Vector3<f64>; 2],
        [length1, length2]: &[f64; 2],
        start: &Start<'_>,
        least_squared: f64,
        across: &mut bool,
    ) -> Result<Answer<[Vector3<f64>; 2], 2>, KinematicsError> {
        let [_, v2, _] = self.plates.guideways();
        let [_, c2, _] = self.robot.geometry().configuration;
        let [q4, ..] = start.seed;
        let plate = *start.two;
        let [lever, _] = plate.levers_m;
        let (q2, along_squared) = cart_beyond(
            &(end1 - (self.plates.cart_two(0.0) + lever)),
            v2,
            *length1,
            c2,
            least_squared,
        );
        *across |= is_across(along_squared, *length1);
        let [_, settled1, settled2, ..] = self.settled();
        newton(
            [q2, q4],
            plate,
            &[settled1, settled2],
            |&[_, q4]| self.plates.two(q4),
            |&[q2, _], plate| {
                let cart_m = self.plates.cart_two(q2);
                let [lever1, lever2] = plate.levers_m;
                let [w1, w2] = [cart_m + lever1 - end1, cart_m + lever2 - end2];
                ([w1, w2], [surplus(&w1, *length1), surplus(&w2, *length2)])
            },
            |plate, links_m| plate.drives(links_m, v2),
        )
        .map_err(|error| from_the_foot(1, along_squared, error))
    }

    /// Cluster 3: `(q_3, q_5, q_6)`.
    #[inline]
    fn cluster_three(
        &self,
        [end1, end2, end3]: &[Vector3<f64>; 3],
        [length1, length2, length3]: &[f64; 3],
        start: &Start<'_>,
        least_squared: f64,
        across: &mut bool,
    ) -> Result<Answer<[Vector3<f64>; 3], 3>, KinematicsError> {
        let [_, _, v3] = self.plates.guideways();
        let [_, _, c3] = self.robot.geometry().configuration;
        let [_, q5, q6] = start.seed;
        let plate = *start.three;
        let [lever, _, _] = plate.levers_m;
        let (q3, along_squared) = cart_beyond(
            &(end1 - (self.plates.cart_three(0.0) + lever)),
            v3,
            *length1,
            c3,
            least_squared,
        );
        *across |= is_across(along_squared, *length1);
        let [_, _, _, settled @ ..] = self.settled();
        newton(
            [q3, q5, q6],
            plate,
            &settled,
            |&[_, q5, q6]| self.plates.three(q5, q6),
            |&[q3, _, _], plate| {
                let cart_m = self.plates.cart_three(q3);
                let [lever1, lever2, lever3] = plate.levers_m;
                let w1 = cart_m + lever1 - end1;
                let w2 = cart_m + lever2 - end2;
                let w3 = cart_m + lever3 - end3;
                let surpluses = [
                    surplus(&w1, *length1),
                    surplus(&w2, *length2),
                    surplus(&w3, *length3),
                ];
                ([w1, w2, w3], surpluses)
            },
            |plate, links_m| plate.drives(links_m, v3),
        )
        .map_err(|error| from_the_foot(2, along_squared, error))
    }
}

/// True if a link is nearly across its guideway, or a little too short to be so. One that is
/// shorter does not reach: no second attempt is made of it.
fn is_across(along_squared: f64, length_m: f64) -> bool {
    along_squared.abs() < ACROSS_SQUARED * length_m * length_m
}

/// Largest turn of a plate from where it started, radians.
fn moved(&[_, _, _, q4, q5, q6]: &[f64; AXES], [start4, start5, start6]: &[f64; 3]) -> f64 {
    (q4 - start4)
        .abs()
        .max((q5 - start5).abs())
        .max((q6 - start6).abs())
}

/// Lower bound of [`moved`] for the result of an attempt: of an answer out of range only the first
/// such axis is known; infinite where there was no answer.
fn moved_at_least(found: &Result<Solution<[f64; AXES]>, KinematicsError>, seed: &[f64; 3]) -> f64 {
    match found {
        Ok(found) => moved(&found.value, seed),
        Err(KinematicsError::OutOfRange { axis, q, .. }) => zip(&[3, 4, 5], seed)
            .find(|(plate, _)| *plate == axis)
            .map_or(0.0, |(_, start)| (q - start).abs()),
        Err(_) => f64::INFINITY,
    }
}

/// Error of a cluster that started with its first link too short, at the foot of the perpendicular:
/// there the link is across its guideway, which looks like a singularity, but the cause is that the
/// link does not reach with its plate at the start.
fn from_the_foot(arm: usize, along_squared: f64, error: KinematicsError) -> KinematicsError {
    match error {
        KinematicsError::Singular { .. } if along_squared < 0.0 => {
            KinematicsError::Unreachable { arm }
        }
        error => error,
    }
}

/// Position of the cart of one link whose end is at `from_origin_m` from the joint at `q = 0`,
/// q-units.
///
/// # Errors
/// [`KinematicsError::Unreachable`] for `arm` where the link is too short.
pub(super) fn cart(
    arm: usize,
    from_origin_m: &Vector3<f64>,
    guideway: &Vector3<f64>,
    length_m: f64,
    branch: Branch,
) -> Result<f64, KinematicsError> {
    let (q, along_squared) = cart_beyond(from_origin_m, guideway, length_m, branch, 0.0);
    if along_squared < 0.0 {
        return Err(KinematicsError::Unreachable { arm });
    }
    Ok(q)
}

/// As [`cart`], but `q` is no nearer to the nearest point than where the squared cosine of the link
/// to its guideway is `least_squared`. Also returns the square of the link's length along the
/// guideway (metres squared), below zero where the link is too short; then `q` is as far from the
/// nearest point as `least_squared` requires.
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
    let along =
        branch.sign() * sqrt(along_squared.max(least_squared * length_squared) / scale_squared);
    (foot + along, along_squared)
}
