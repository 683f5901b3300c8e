//! Plans against the numbers of the specification, section 12.5: 1 um, 1 N, 0.05 N m, the file's
//! springs.

use std::f64::consts::FRAC_1_SQRT_2;

use gantry_tau_core::model::robot::LINKS;
use gantry_tau_machine::model::L2;
use gantry_tau_machine::robot_file::WristJoint;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::plan::expected::Status;

fn l2() -> RobotFile<L2, 3> {
    RobotFile::builtin_l2().unwrap()
}

/// A campaign at home: straps in x, y and z at each hook, levels up and down.
fn at_home<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    hooks: &[[f64; 3]],
    gauges: Vec<NamedGauge>,
) -> Setup {
    let poses = vec![(Name::made("home"), Pose::at(robot.home_m()))];
    let mut setup = Setup {
        measurements: "a.csv".to_owned(),
        noise: Some(Noise::USUAL),
        setup: None,
        poses,
        gauges,
        plan: Vec::new(),
    };
    for hook in hooks {
        for direction in [Vector3::x(), Vector3::y(), Vector3::z()] {
            let levels = LEVELS.map(|share| 300.0 * share).to_vec();
            setup.push(
                0,
                &Strap {
                    hook_m: (*hook).into(),
                    direction,
                },
                levels,
            );
        }
    }
    setup
}

fn without_axes(gauges: Vec<NamedGauge>, first: usize) -> Vec<NamedGauge> {
    gauges
        .into_iter()
        .filter(|gauge| !matches!(gauge.gauge, Gauge::Axis { axis, .. } if axis >= first))
        .collect()
}

/// Within 2 %: the specification prints three digits, of a prototype that took its derivatives
/// otherwise.
fn close(found: f64, expected: f64, name: &str) {
    assert!(
        (found / expected - 1.0).abs() < 0.02,
        "{name}: {found}, not {expected}"
    );
}

fn sds(judgement: &Judgement) -> Vec<f64> {
    judgement
        .expected
        .parameters
        .iter()
        .map(|known| known.sd)
        .collect()
}

fn agrees(judgement: &Judgement, deviations: &[f64], indices: &[f64], readings: usize) {
    for (index, (found, expected)) in sds(judgement).iter().zip(deviations).enumerate() {
        close(
            *found,
            *expected,
            &judgement.expected.parameters[index].name,
        );
    }
    for (index, (found, expected)) in judgement.expected.indices.iter().zip(indices).enumerate() {
        close(*found, *expected, &format!("O{}", index + 1));
    }
    assert_eq!(judgement.expected.readings, readings);
}

#[test]
fn campaign_a_and_its_first_hook() {
    let robot = l2();
    let gauges = default_gauges(&robot);
    let setup = at_home(&robot, &HOOKS_M, gauges.clone());
    let a = judge(&robot, &setup, false, "A").unwrap();
    let deviations = [0.366, 0.187, 0.327, 0.217, 0.231, 0.147, 6.73, 4.85, 3.34];
    agrees(&a, &deviations, &[5.48, 0.0205, 14.9, 0.305, 6.13], 891);
    let hook = judge(
        &robot,
        &at_home(&robot, &HOOKS_M[..1], gauges),
        false,
        "hook 1",
    )
    .unwrap();
    let deviations = [0.638, 0.403, 1.188, 0.420, 1.200, 0.332, 11.6, 9.31, 5.79];
    agrees(&hook, &deviations, &[4.25, 0.0258, 8.58, 0.222, 3.27], 297);
    // A pull of 300 N in x comes nearer to the jump than a fifth.
    assert!(
        a.doubts.iter().any(|doubt| doubt.contains("cart 3")),
        "{:?}",
        a.doubts
    );
    // A pose of a quarter of an hour, nine straps of five minutes, 99 levels of 15 s.
    assert_eq!(a.minutes.to_string(), "1 h 25 min");
}

#[test]
fn the_f1_with_a_gauge_on_every_axis_and_on_its_carts_only() {
    let robot = RobotFile::builtin_f1().unwrap();
    let gauges = default_gauges(&robot);
    let setup = at_home(&robot, &HOOKS_M, gauges.clone());
    let all = judge(&robot, &setup, false, "F1").unwrap();
    let deviations = [
        0.347, 0.773, 0.608, 0.332, 0.419, 0.460, 0.152, 0.140, 0.125, 10.7, 12.0, 7.9,
    ];
    agrees(&all, &deviations, &[], 99 * 12);
    let on_carts = without_axes(gauges, 3);
    let carts = judge(&robot, &at_home(&robot, &HOOKS_M, on_carts), false, "F1").unwrap();
    for (found, expected) in sds(&carts).iter().skip(9).zip([19.2, 38.0, 13.4]) {
        close(*found, expected, "plate");
    }
}

/// `[T 4.2.9]`: at home, a strap in x, three gauges at one point, carts held by the compensation.
#[test]
fn the_thesis_sees_three_of_six_links() {
    let robot = l2();
    let at_block = [
        ("gx", Vector3::x()),
        ("gy", Vector3::y()),
        ("gz", Vector3::z()),
    ];
    let gauges = at_block.map(|(name, axis)| NamedGauge {
        name: Name::made(name),
        gauge: Gauge::Face {
            body: Body::Platform,
            point_m: Vector3::new(0.0, 0.0, 0.1),
            axis,
        },
    });
    let mut setup = at_home(&robot, &HOOKS_M[..1], gauges.to_vec());
    setup.plan.truncate(1);
    let held = judge(&robot, &setup, true, "thesis").unwrap();
    assert_eq!(
        (held.expected.seen, held.expected.lost.len()),
        ((3, LINKS), 3),
        "{held}"
    );
    let said = lost(&held.expected).unwrap();
    assert!(
        said.starts_with("3 of 6 directions cannot be seen: (link "),
        "{said}"
    );
    // Carts that are not held make it no better: three numbers, nine springs.
    let free = judge(&robot, &setup, false, "thesis").unwrap();
    assert_eq!(
        (free.expected.seen, free.expected.lost.len()),
        ((3, 9), 6),
        "{free}"
    );
    // Gauges on the carts show their springs, and no more of the links.
    setup
        .gauges
        .extend(without_platform(default_gauges(&robot)));
    setup.plan[0].gauges = setup
        .gauges
        .iter()
        .map(|gauge| gauge.name.clone())
        .collect();
    let gauged = judge(&robot, &setup, false, "thesis").unwrap();
    assert_eq!(gauged.expected.seen, (6, 9), "{gauged}");
    assert!(
        gauged
            .expected
            .lost
            .iter()
            .all(|direction| direction.components[0].0.starts_with("link")),
        "{gauged}"
    );
}

fn without_platform(gauges: Vec<NamedGauge>) -> Vec<NamedGauge> {
    gauges
        .into_iter()
        .filter(|gauge| matches!(gauge.gauge, Gauge::Axis { .. }))
        .collect()
}

#[test]
fn without_cart_gauges_link_11_and_cart_1_are_one_spring() {
    let robot = l2();
    let gauges = without_axes(default_gauges(&robot), 0);
    let found = judge(&robot, &at_home(&robot, &HOOKS_M, gauges), false, "A")
        .unwrap()
        .expected;
    assert_eq!(found.lost.len(), 1, "{found}");
    let components = &found.lost[0].components;
    let [cart, link] = ["cart 1", "link 11"].map(|name| {
        components
            .iter()
            .find(|(other, _)| other == name)
            .map_or(0.0, |(_, component)| *component)
    });
    let length = components
        .iter()
        .map(|(_, component)| component * component)
        .sum::<f64>()
        .sqrt();
    let cosine = (cart - 0.032 * link) / length / (1.0_f64 + 0.032 * 0.032).sqrt();
    assert!(cosine.abs() > 0.99, "{}", found.lost[0]);
    assert!((link / cart + 0.032).abs() < 0.003, "{}", found.lost[0]);
    let statuses = ["cart 1", "link 11"].map(|name| {
        let mut parameters = found.parameters.iter();
        parameters.find(|known| known.name == name).unwrap().status
    });
    assert_eq!(statuses, [Status::Lost, Status::Seen]);
}

fn rms_um(search: &Search<'_>, chosen: &[usize]) -> f64 {
    1e6 * (0.5 * search.cost(chosen)).exp()
}

#[test]
fn the_exchange_beats_the_limits_and_random_plans() {
    let robot = l2();
    let information = SpringInformation::new(&robot, springs(&robot).unwrap(), Noise::USUAL, false);
    let stands = stands(&robot);
    assert_eq!(stands.len(), 28);
    let gauges = default_gauges(&robot);
    let grid = Grid::new(&robot, &information, &stands[1..], &gauges, 300.0).unwrap();
    assert_eq!(grid.candidates.len(), 243);
    let goal = goal(&information, &stands[1..], 300.0, "l2").unwrap();
    // Specification: limit, and median of random plans, um.
    for (count, limit_um, random_um) in [(4, 0.76, 1.17), (6, 0.62, 0.89), (12, 0.435, 0.58)] {
        let search = Search::new(&grid.candidates, &goal, Criterion::I, count, count);
        let found = rms_um(&search, &search.best(4).unwrap());
        assert!(found <= limit_um, "{count}: {found}");
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let median = crate::fit::statistics::median(
            (0..101)
                .map(|_| rms_um(&search, &search.random(&mut random).unwrap()))
                .collect(),
        );
        // A median of a hundred plans, of a spread of some 20 %.
        assert!((median / random_um - 1.0).abs() < 0.1, "{count}: {median}");
    }
}

#[test]
fn a_plan_stays_within_its_limits() {
    let robot = l2();
    let options = SpringsOptions {
        series: 7,
        poses: 2,
        around_jump: true,
        ..SpringsOptions::default()
    };
    let setup = planned(&robot, &options, "plan.csv").unwrap();
    assert_eq!((setup.plan.len(), setup.poses.len()), (8, 2));
    let judged = judge(&robot, &setup, false, "plan").unwrap();
    assert!(
        judged.expected.is_complete() && judged.doubts.is_empty(),
        "{:?}",
        judged.doubts
    );
    for series in setup.plan.iter().filter(|series| series.name != *JUMP) {
        // The first level comes again at the end.
        assert_eq!(
            (
                series.levels_n.first(),
                series.levels_n[5],
                series.levels_n.last()
            ),
            (Some(&0.0), 300.0, Some(&0.0))
        );
    }
    // The series around the jump passes it with the least force, and stays within the largest.
    let jump = setup.plan.last().unwrap();
    let most = jump.levels_n.iter().copied().fold(0.0, f64::max);
    let information = SpringInformation::new(&robot, springs(&robot).unwrap(), Noise::USUAL, false);
    let preload = Preload::of(&robot, information.machine()).unwrap();
    let tool_m = setup
        .poses
        .iter()
        .find(|(name, _)| *name == jump.pose)
        .unwrap()
        .1
        .position_m;
    let stand = Stand {
        tool_m,
        q: robot.model.axes_at(&tool_m).unwrap(),
    };
    let strap = Strap {
        hook_m: jump.hook_m.into(),
        direction: jump.direction.into(),
    };
    let series = information
        .series(&stand, &strap, &[0.0, most], &[], &[])
        .unwrap();
    let share = preload.share_at_jump(series.cluster_n).unwrap();
    assert!(
        most < 300.0 && (0.8..0.95).contains(&share),
        "{share} {jump:?}"
    );
    // Poses in a row: gauges are moved once.
    assert!(
        setup
            .plan
            .windows(2)
            .filter(|pair| pair[0].pose != pair[1].pose)
            .count()
            <= 2
    );
}

#[test]
fn options_that_cannot_be_are_named() {
    let robot = l2();
    let usual = SpringsOptions::default();
    for (options, words) in [
        (
            SpringsOptions {
                poses: 0,
                ..usual.clone()
            },
            "--poses is 0; expected from 1 to 100",
        ),
        (
            SpringsOptions {
                poses: 1,
                series: 12,
                ..usual.clone()
            },
            "--poses 1 allows too few",
        ),
        (
            SpringsOptions {
                force_max_n: 10_000.0,
                ..usual.clone()
            },
            "lower --force-max",
        ),
        (
            SpringsOptions {
                force_max_n: 100.0,
                around_jump: true,
                ..usual.clone()
            },
            "--around-jump: forces to ",
        ),
    ] {
        let said = planned(&robot, &options, "plan.csv")
            .unwrap_err()
            .to_string();
        assert!(said.contains(words), "{said}");
    }
    let mut bare = robot;
    bare.compliances = None;
    let none = planned(&bare, &usual, "plan.csv").unwrap_err().to_string();
    assert!(none.contains("c_link is missing"), "{none}");
}

/// Options in which one has a value.
fn with_option(option: &str, value: f64) -> SpringsOptions {
    let mut options = SpringsOptions::default();
    match option {
        "--series" => options.series = value as usize,
        "--poses" => options.poses = value as usize,
        "--force-max" => options.force_max_n = value,
        "--noise-um" => options.noise.gauge_um = value,
        _ => options.noise.force_n = value,
    }
    options
}

#[test]
fn options_are_taken_up_to_their_limits() {
    for (option, ends, beyond) in [
        ("--series", [1.0, 200.0], [0.0, 201.0]),
        ("--poses", [1.0, 100.0], [0.0, 101.0]),
        ("--force-max", [10.0, 10_000.0], [9.9, 10_001.0]),
        ("--noise-um", [1e-3, 1e3], [0.9e-3, 1.001e3]),
        ("--noise-n", [1e-3, 1e3], [0.9e-3, 1.001e3]),
    ] {
        for value in ends {
            with_option(option, value).check().unwrap();
        }
        for value in beyond {
            let refused = with_option(option, value).check().unwrap_err();
            assert!(refused.to_string().starts_with(option), "{refused}");
        }
        // NaN counts are zero.
        assert!(with_option(option, f64::NAN).check().is_err(), "{option}");
    }
}

/// Reads the plan of a set-up as `experiment` does.
fn checked(setup: &Setup) -> Result<(), crate::measurements::FileError> {
    let path = std::path::Path::new("plan.toml");
    crate::measurements::plan::of(path, setup.clone(), &[1.0; 3]).map(|_| ())
}

type Change = fn(&mut SeriesEntry);

/// A diagonal strap has a length of 1, as the reader wants it.
#[test]
fn plans_of_others_are_read_strictly() {
    let robot = l2();
    let setup = at_home(&robot, &HOOKS_M[..1], default_gauges(&robot));
    checked(&setup).unwrap();
    let cases: [(Change, &str); 7] = [
        (
            |series| series.pose = Name::made("elsewhere"),
            "plan.toml: series.s2.pose: \"elsewhere\" is not in the set-up",
        ),
        (
            |series| series.direction = [1.0, 1.0, 0.0],
            "series.s2.direction: has length 1.41",
        ),
        (
            |series| series.direction = [1.0 + 1.1e-6, 0.0, 0.0],
            "series.s2.direction: has length 1.0000011",
        ),
        (
            |series| series.direction = [0.0, 1.0 - 1.1e-6, 0.0],
            "series.s2.direction: ",
        ),
        (
            |series| series.levels_n = vec![f64::NAN, 0.0],
            "levels_n: NaN",
        ),
        (|series| series.gauges.clear(), "gauges: is empty"),
        (|series| series.name = Name::made("s1"), "duplicate name"),
    ];
    for (change, words) in cases {
        let mut wrong = setup.clone();
        change(&mut wrong.plan[1]);
        let said = checked(&wrong).unwrap_err().to_string();
        assert!(said.contains(words), "{said}");
    }
    let mut diagonal = setup.clone();
    diagonal.plan[0].direction = [FRAC_1_SQRT_2, FRAC_1_SQRT_2, 0.0];
    checked(&diagonal).unwrap();
}

/// Six gauges on the tool, three on carts, nine straps: all eleven springs, the joints of the wrist
/// to 2 % or better.
#[test]
fn gauges_on_the_tool_see_the_wrist() {
    let mut robot = l2();
    robot.wrist = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        .map(|axis| WristJoint {
            axis,
            point_m: [0.0, 0.0, 0.15],
            c_rad_per_nm: 1e-5,
        })
        .to_vec();
    let on_tool = judge(
        &robot,
        &at_home(&robot, &HOOKS_M, default_gauges(&robot)),
        false,
        "wrist",
    )
    .unwrap()
    .expected;
    assert_eq!(on_tool.seen, (11, 11), "{on_tool}");
    let wrist = &on_tool.parameters[9..];
    assert!(
        wrist
            .iter()
            .all(|joint| joint.name.starts_with("wrist ") && joint.sd < 2.0),
        "{on_tool}"
    );
    // Gauges on the platform do not see what is behind it.
    let on_platform = default_gauges(&l2());
    let unseen = judge(
        &robot,
        &at_home(&robot, &HOOKS_M, on_platform),
        false,
        "wrist",
    )
    .unwrap()
    .expected;
    assert_eq!(unseen.seen, (9, 11), "{unseen}");
    assert!(
        unseen
            .lost
            .iter()
            .all(|lost| lost.components[0].0.starts_with("wrist")),
        "{unseen}"
    );
}
