//! Mirror images of an L2 at places in a plane: the distances from a place to a joint and to its
//! image are the same, arm by arm.

use gantry_tau_core::model::l2::Configuration;
use gantry_tau_core::model::robot::{ARMS, Branch};

use super::shape::Shape;
use crate::fit::least_squares::fit;
use crate::geometry::l2::{Calibrated, Nominal, Places};
use crate::geometry::robust_fit::Model;

/// Difference of chi-squared at which one of two machines is a thousand times as likely as the
/// other.
const SIGNIFICANT: f64 = 13.8;

/// True where places near a plane fit the image of an arm, or of several, as well as the calibrated
/// machine.
pub(super) fn fits_as_well(calibrated: &Calibrated, places: &Places<'_>, shape: &Shape) -> bool {
    if !shape.is_thin() {
        return false;
    }
    let machine = &calibrated.fit.state;
    let used = calibrated.used(places.count());
    // Where the stated noise is too small, it is what the residuals say.
    let limit =
        calibrated.fit.chi_squared() + SIGNIFICANT * calibrated.fit.reduced_chi_squared().max(1.0);
    (1..1_usize << ARMS).any(|arms| {
        [Branch::Positive, Branch::Negative]
            .into_iter()
            .any(|forward| {
                let configuration = Configuration {
                    forward,
                    ..places.configuration
                };
                let places = Places {
                    configuration,
                    ..*places
                };
                let image = image(machine, arms, shape);
                let found = fit(
                    image,
                    &image.scales(),
                    |state| places.rows(state, &used),
                    Places::stepped,
                );
                // A fit may also lead back to the machine.
                found.is_ok_and(|found| {
                    found.chi_squared() <= limit
                        && sides(&found.state, &places, shape) != sides(machine, &places, shape)
                })
            })
    })
}

/// True for each arm whose joint, in the first pose, is on the side of the plane that its normal
/// points to.
fn sides(nominal: &Nominal, places: &Places<'_>, shape: &Shape) -> [bool; ARMS] {
    let q = places.poses.first().map_or([0.0; ARMS], |pose| pose.q);
    std::array::from_fn(|arm| {
        let joint = nominal.origins_m[arm] + nominal.guideways[arm] * q[arm];
        (joint - shape.centre_m).dot(&shape.normal) > 0.0
    })
}

/// The machine with the arms of the bits of `arms` reflected by the plane of the places.
fn image(nominal: &Nominal, arms: usize, shape: &Shape) -> Nominal {
    let mut image = *nominal;
    for arm in (0..ARMS).filter(|arm| arms & (1 << arm) != 0) {
        let across = 2.0 * shape.normal;
        image.origins_m[arm] -=
            across * shape.normal.dot(&(nominal.origins_m[arm] - shape.centre_m));
        image.guideways[arm] -= across * shape.normal.dot(&nominal.guideways[arm]);
    }
    image
}

#[cfg(test)]
mod tests {
    use gantry_tau_core::model::presets;
    use nalgebra::{Matrix3, Vector3};

    use super::*;
    use crate::measurements::poses::MeasuredPose;
    use gantry_tau_system::output::Name;

    #[test]
    fn a_side_is_that_of_the_joint_in_the_first_pose() {
        let machine = Nominal::of(&presets::l2());
        let first = [0.3, -0.4, 0.9];
        let pose = MeasuredPose {
            name: Name::made("p1"),
            q: first,
            position_m: Vector3::zeros(),
            rotation: None,
        };
        let places = Places {
            poses: &[pose],
            whitening: Matrix3::identity(),
            configuration: presets::l2().configuration,
        };
        for (arm, q) in first.into_iter().enumerate() {
            let joint_m = machine.origins_m[arm] + machine.guideways[arm] * q;
            for (off_m, is_beyond) in [(-1e-3, true), (1e-3, false)] {
                let normal = machine.guideways[arm].normalize();
                let shape = Shape {
                    centre_m: joint_m + normal * off_m,
                    normal,
                    extents_m: [0.5, 0.4, 0.0],
                };
                assert_eq!(sides(&machine, &places, &shape)[arm], is_beyond, "{arm}");
            }
        }
    }

    #[test]
    fn an_image_has_the_distances_of_the_machine_to_the_plane() {
        let machine = Nominal::of(&presets::l2());
        let normal = Vector3::new(1.0, 2.0, -2.0) / 3.0;
        let shape = Shape {
            centre_m: Vector3::new(0.1, 0.4, 0.6),
            normal,
            extents_m: [0.5, 0.4, 0.0],
        };
        let [across, beside] = [1.0, 0.3].map(|share| Vector3::new(2.0, -1.0, 0.0) * share);
        for arms in 0..1_usize << ARMS {
            let image = image(&machine, arms, &shape);
            for arm in 0..ARMS {
                let is_reflected = arms >> arm & 1 == 1;
                assert_eq!(image.origins_m[arm] != machine.origins_m[arm], is_reflected);
                // Along its guideway, as far from each place of the plane, and as far beside it on
                // one side or the other.
                for q in [0.0, 0.7] {
                    let [joint_m, of_image_m] =
                        [&machine, &image].map(|of| of.origins_m[arm] + of.guideways[arm] * q);
                    for place in [across, beside].map(|in_plane| shape.centre_m + in_plane) {
                        assert!(
                            ((joint_m - place).norm() - (of_image_m - place).norm()).abs() < 1e-12
                        );
                    }
                    let [side, of_image] =
                        [joint_m, of_image_m].map(|at| (at - shape.centre_m).dot(&normal));
                    let sign = if is_reflected { -1.0 } else { 1.0 };
                    assert!((of_image - sign * side).abs() < 1e-12);
                }
            }
        }
    }
}
