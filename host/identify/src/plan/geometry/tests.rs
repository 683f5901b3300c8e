//! Plans against the numbers of the specification, section 12.5: 50 um, 100 urad.

use gantry_tau_test_support::seeds::Seeds;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::fit::statistics::median;

fn rms_um<const N: usize>(
    model: &ScaledParameters,
    spots: &[Spot<N>],
    noise: &PoseNoise,
    chosen: &[usize],
) -> f64 {
    let whitening = whitening(noise);
    let rows: Vec<_> = chosen
        .iter()
        .map(|index| whitened(&spots[*index], &whitening))
        .collect();
    let size = rows[0].nrows();
    let mut all = DMatrix::zeros(size * rows.len(), model.parameters.basis.ncols());
    for (index, rows) in rows.iter().enumerate() {
        all.rows_mut(size * index, size).copy_from(rows);
    }
    let expected = Expected::new(
        &model.parameters,
        all,
        size * rows.len(),
        &goal(model, spots),
    );
    expected.rms_m * 1e6
}

#[test]
fn places_of_the_l2_reach_the_limits() {
    let robot = RobotFile::builtin_l2().unwrap();
    let model = ScaledParameters::of(&robot.model);
    let spots = spots(&robot, &model);
    assert_eq!(spots.len(), 607);
    let noise = isotropic(50e-6, None);
    // Specification: limit, and median of random plans, um.
    for (poses, limit_um, random_um) in [
        (12, 55.0, 213.0),
        (20, 40.0, 97.8),
        (30, 32.5, 64.6),
        (60, 23.2, 35.1),
    ] {
        let options = GeometryOptions {
            poses,
            ..GeometryOptions::default()
        };
        let found = chosen(&model, &spots, &vec![true; spots.len()], &noise, &options).unwrap();
        let found_um = rms_um(&model, &spots, &noise, &found);
        assert!(found_um <= limit_um, "{poses}: {found_um}");
        let goal = goal(&model, &spots);
        let candidates: Vec<_> = spots
            .iter()
            .enumerate()
            .map(|(place, spot)| Candidate {
                rows: whitened(spot, &whitening(&noise)),
                place,
                strap: 0,
            })
            .collect();
        let search = Search::new(&candidates, &goal, Criterion::I, poses, poses);
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let draws =
            (0..101).map(|_| 1e6 * (0.5 * search.cost(&search.random(&mut random).unwrap())).exp());
        let usual = median(draws.collect());
        // Random plans of twelve places scatter by a factor of two.
        assert!(
            (0.75..1.35).contains(&(usual / random_um)),
            "{poses}: {usual}"
        );
    }
}

#[test]
fn turned_poses_of_the_f1_determine_sixty_combinations() {
    let robot = RobotFile::builtin_f1().unwrap();
    let model = ScaledParameters::of(&robot.model);
    let spots = spots(&robot, &model);
    assert!(spots.len() > 150, "{}", spots.len());
    let noise = isotropic(50e-6, Some(100e-6));
    let options = GeometryOptions {
        poses: 20,
        ..GeometryOptions::default()
    };
    let found = chosen(&model, &spots, &vec![true; spots.len()], &noise, &options).unwrap();
    let planned_um = rms_um(&model, &spots, &noise, &found);
    // Twenty random ones: 130 um.
    assert!(planned_um < 100.0, "{planned_um}");
    let named: Vec<_> = found
        .iter()
        .map(|index| PlannedPose::new(Name::made(index), &spots[*index].pose, &spots[*index].q))
        .collect();
    let judged = judge(&robot, &noise, &named, "plan").unwrap().expected;
    assert_eq!((judged.seen, judged.lost.len()), ((60, 60), 0), "{judged}");
}

/// Found from outside: machines as far off the file as it says could not stand in the places of a
/// plan, in 24 of 40 trials.
fn every_machine_stands_in_every_pose<K: PlannedMachine<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    poses: usize,
) {
    let options = GeometryOptions {
        poses,
        ..GeometryOptions::default()
    };
    let written = plan_geometry(robot, &options, "poses.csv").unwrap();
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), &written.plan).unwrap();
    let (plan, _) = PosesPlan::read(file.path(), K::MODEL).unwrap();
    assert_eq!(plan.poses.len(), poses);
    for seed in Seeds::new(20, 200).iter() {
        let mut random = ChaCha8Rng::seed_from_u64(1_000 + seed);
        let off_m = robot.simulation.geometry_mm * 1e-3;
        let machine = robot
            .model
            .off(off_m, &mut || StandardNormal.sample(&mut random))
            .unwrap();
        for planned in &plan.poses {
            let q: [f64; N] = planned.q.as_slice().try_into().unwrap();
            assert!(
                machine.stand(&q, &planned.pose()).is_some(),
                "seed {seed}, {}",
                planned.name
            );
        }
    }
}

#[test]
fn machines_off_their_file_stand_in_every_planned_pose() {
    every_machine_stands_in_every_pose(&RobotFile::builtin_l2().unwrap(), 30);
    every_machine_stands_in_every_pose(&RobotFile::builtin_f1().unwrap(), 20);
}

#[test]
fn the_price_of_the_margin_is_reported() {
    let mut robot = RobotFile::builtin_l2().unwrap();
    let written = plan_geometry(&robot, &GeometryOptions::default(), "poses.csv").unwrap();
    let said = written
        .summary
        .lines()
        .find(|line| line.starts_with("margin "))
        .unwrap();
    let words: Vec<&str> = said.split_whitespace().collect();
    let at = words.iter().position(|word| *word == "instead").unwrap();
    let [with_um, without_um] = [at - 1, at + 2].map(|place| words[place].parse::<f64>().unwrap());
    assert!((1.2..1.8).contains(&(with_um / without_um)), "{said}");
    robot.simulation.geometry_mm = 0.0;
    let written = plan_geometry(&robot, &GeometryOptions::default(), "poses.csv").unwrap();
    assert!(!written.summary.contains("margin"), "{}", written.summary);
}

/// Unturned poses do not distinguish the joints of a cluster.
#[test]
fn unturned_poses_of_the_f1_are_refused_by_name() {
    let robot = RobotFile::builtin_f1().unwrap();
    let model = ScaledParameters::of(&robot.model);
    let spots = spots(&robot, &model);
    let unturned = spots
        .iter()
        .filter(|spot| spot.pose.rotation == Matrix3::identity());
    let named: Vec<_> = unturned
        .map(|spot| {
            PlannedPose::new(
                Name::made(format_args!("{:?}", spot.q)),
                &spot.pose,
                &spot.q,
            )
        })
        .collect();
    let judged = judge(&robot, &isotropic(50e-6, Some(100e-6)), &named, "plan")
        .unwrap()
        .expected;
    assert!(judged.seen.0 < 60 && !judged.lost.is_empty(), "{judged}");
}

/// All places in a line: three or more directions of the 21 are lost.
#[test]
fn places_on_a_line_are_judged() {
    let robot = RobotFile::builtin_l2().unwrap();
    let model = ScaledParameters::of(&robot.model);
    let places = (0..12_u32)
        .map(|step| Pose::at(robot.home_m() + Vector3::x() * (f64::from(step) * 0.05 - 0.3)));
    let spots = places.enumerate().map(|(index, pose)| {
        let spot = model.spot(&robot, pose).unwrap();
        PlannedPose::new(Name::made(index), &spot.pose, &spot.q)
    });
    let judged = judge(
        &robot,
        &isotropic(50e-6, None),
        &spots.collect::<Vec<_>>(),
        "plan",
    )
    .unwrap();
    assert!(judged.expected.seen.0 <= 12, "{judged}");
    assert!(
        lost(&judged.expected)
            .unwrap()
            .contains("directions cannot be seen")
    );
}
