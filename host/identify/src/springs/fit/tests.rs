//! Campaigns of the simulated L2 and F1, of known springs: campaign A of nine straps at home, and B
//! at three poses.

use gantry_tau_core::model::robot::LINKS;
use gantry_tau_machine::elastic::gauge::{Body, Gauge};
use gantry_tau_machine::elastic::springs::Springs;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_test_support::seeds::Seeds;

use super::*;
use crate::fit::answer::Status;
use crate::fit::held_directions::HeldDirections;
use crate::fit::statistics::NORMAL_95;
use crate::measurements::springs::{Noise, SetupNoise};
use crate::springs::decision::{uncertainty, unobservable};
use crate::springs::fixture::{
    FINE, HOME, HOOKS, TestBench, WRIST_M, campaign_a, l2_with_wrist, never, seeded, straps,
};

/// Noise that nothing is lost in, and that leaves a campaign solvable.
const NONE: Noise = Noise {
    gauge_um: 1e-6,
    force_n: 1e-6,
    moment_nm: 1e-6,
};

fn fitted<const N: usize>(bench: &TestBench<N>) -> Solution<N> {
    let problem = bench.problem();
    fit(
        &problem,
        &ActiveSet::all(&bench.campaign),
        FitState::start(&problem),
    )
    .unwrap()
}

/// Largest error of a compliance, in true values.
fn largest_error<const N: usize>(found: &Solution<N>, truth: &Springs<N>) -> f64 {
    (found.state.springs.vector() - truth.vector())
        .component_div(&truth.vector())
        .amax()
}

#[test]
fn a_campaign_without_noise_gives_the_springs() {
    for seed in 0..5 {
        let mut random = seeded(seed);
        let mut bench = campaign_a(NONE);
        let truth = bench.true_springs(&mut random);
        bench.measure(&truth, &mut random, 0.0, never);
        bench.campaign.noise = FINE;
        let found = fitted(&bench);
        let off = largest_error(&found, &truth);
        assert!(
            off < 1e-5 && found.rounds <= 7,
            "{seed}: {off:e} after {}",
            found.rounds
        );
        assert!(found.rows.chi_squared() < 1e-6);
    }
}

#[test]
fn a_compliance_that_is_not_the_files_by_far_is_no_result() {
    let mut random = seeded(3);
    let mut bench = campaign_a(FINE);
    let mut truth = bench.file.vector();
    truth[0] *= 150.0;
    let truth = bench.file.with(&truth);
    bench.measure(&truth, &mut random, 0.0, never);
    let problem = bench.problem();
    let found = fit(
        &problem,
        &ActiveSet::all(&bench.campaign),
        FitState::start(&problem),
    )
    .err();
    let Some(SpringsError::AtBound { name, factor }) = found else {
        panic!("{found:?}")
    };
    assert_eq!(name, bench.file.names()[0].0);
    assert!(
        (MAX_FACTOR..=1.1 * MAX_FACTOR).contains(&factor),
        "{factor}"
    );
}

/// `(error / sd)`: root mean square, mean, and how many intervals hold, per spring; and the mean of
/// chi-squared per degree of freedom.
struct Coverage {
    squares: DVector<f64>,
    sums: DVector<f64>,
    held: DVector<f64>,
    reduced: f64,
}

impl Coverage {
    fn assert_deviations_are_reached(&self, seeds: Seeds) {
        let limit = 1.0 + seeds.widened(0.2);
        assert!(
            self.squares.iter().all(|square| square.sqrt() <= limit),
            "{}",
            self.squares
        );
    }

    /// Asserts that the intervals of each spring hold in 95 %.
    fn assert_intervals_hold(&self, seeds: Seeds) {
        let shares = &self.held / f64::from(seeds.count);
        let [least, most] = [0.95 - seeds.widened(0.06), 0.95 + seeds.widened(0.045)];
        assert!(
            shares.iter().all(|share| (least..=most).contains(share)),
            "{shares}"
        );
    }

    /// Asserts that the intervals of all springs together hold in `least` to 97 %, or within three
    /// times the scatter of such a share.
    fn assert_pooled_intervals_hold(&self, seeds: Seeds, least: f64) {
        let count = f64::from(seeds.count);
        let pooled = self.held.mean() / count;
        let scatter = 3.0 * (0.05 * 0.95 / (count * float(self.held.len()))).sqrt();
        let holds = 0.95 - scatter.max(0.95 - least)..=0.95 + scatter.max(0.02);
        assert!(holds.contains(&pooled), "{pooled}: {}", self.held);
    }

    /// Asserts that chi-squared per degree of freedom is 1.
    fn assert_noise_is_the_stated(&self, seeds: Seeds) {
        assert!(
            (self.reduced - 1.0).abs() < seeds.widened(0.01),
            "{}",
            self.reduced
        );
    }
}

fn coverage<const N: usize>(
    seeds: Seeds,
    setup: SetupNoise,
    planned: impl Fn() -> TestBench<N>,
) -> Coverage {
    let zeros = DVector::zeros(planned().file.count());
    let mut coverage = Coverage {
        squares: zeros.clone(),
        sums: zeros.clone(),
        held: zeros,
        reduced: 0.0,
    };
    let count = seeds.count;
    for seed in seeds.iter() {
        let mut random = seeded(seed);
        let mut bench = planned();
        bench.campaign.setup = setup;
        let truth = bench.true_springs(&mut random);
        bench.measure(&truth, &mut random, 0.0, never);
        let found = fitted(&bench);
        let covariance = found.seen.covariance();
        let off = found.state.springs.vector() - truth.vector();
        for spring in 0..off.len() {
            let score = off[spring] / covariance[(spring, spring)].sqrt();
            coverage.squares[spring] += score * score / f64::from(count);
            coverage.sums[spring] += score / f64::from(count);
            coverage.held[spring] += f64::from(u8::from(score.abs() <= NORMAL_95));
        }
        coverage.reduced += found.rows.chi_squared() / float(found.degrees()) / f64::from(count);
    }
    coverage
}

/// Nine straps, six gauges on the tool, one on each cart: all springs and both joints of the wrist.
fn campaign_with_wrist(noise: Noise) -> TestBench<3> {
    TestBench::new(&l2_with_wrist(), &[HOME], &straps(1, &HOOKS), noise)
}

#[test]
fn a_wrist_is_identified_along_with_the_machine() {
    let seeds = Seeds::new(4, 200);
    let coverage = coverage(seeds, SetupNoise::default(), || campaign_with_wrist(FINE));
    assert_eq!(coverage.held.len(), LINKS + 3 + 2);
    coverage.assert_deviations_are_reached(seeds);
    coverage.assert_intervals_hold(seeds);
    coverage.assert_noise_is_the_stated(seeds);
}

/// The first joint turned by half a radian in every second series: with the angles the campaign
/// gives the springs, without them it does not.
#[test]
fn the_angles_of_the_wrist_are_those_of_the_series() {
    let mut random = seeded(1);
    let mut bench = campaign_with_wrist(NONE);
    let truth = bench.true_springs(&mut random);
    bench.turn_wrist(&[0.5, -0.2]);
    bench.measure(&truth, &mut random, 0.0, never);
    bench.campaign.noise = FINE;
    let known = largest_error(&fitted(&bench), &truth);
    bench.campaign.plan.clear();
    let unknown = largest_error(&fitted(&bench), &truth);
    assert!(known < 1e-5 && unknown > 0.05, "{known:e} {unknown:e}");
}

/// A joint is not seen by gauges at one point on its axis, and keeps the file's value.
#[test]
fn gauges_at_a_point_of_its_axis_do_not_see_a_joint() {
    // Pulls of 100 N: at 300 N the point moves by a third of a millimetre, and is off the axis.
    let mut straps = straps(1, &HOOKS);
    straps
        .iter_mut()
        .flat_map(|strap| &mut strap.levels)
        .for_each(|level| *level /= 3.0);
    let mut bench = TestBench::new(&l2_with_wrist(), &[HOME], &straps, FINE);
    for named in &mut bench.campaign.gauges {
        if let Gauge::Face { point_m, .. } = &mut named.gauge {
            *point_m = WRIST_M.into();
        }
    }
    let truth = bench.file.clone();
    bench.measure(&truth, &mut seeded(2), 0.0, never);
    let found = fitted(&bench);
    let named: f64 = found
        .seen
        .lost()
        .iter()
        .map(|lost| lost.components.rows(LINKS + 3, 2).norm_squared())
        .sum();
    assert!(named > 1.9, "{named}");
    let kept = found
        .state
        .springs
        .wrist
        .compliances()
        .zip(truth.wrist.compliances());
    assert!(
        kept.into_iter()
            .all(|(found, file)| (found / file - 1.0).abs() < 0.02)
    );
}

#[test]
fn campaign_a_reaches_its_deviations() {
    let seeds = Seeds::new(8, 200);
    let coverage = coverage(seeds, SetupNoise::default(), || campaign_a(FINE));
    coverage.assert_deviations_are_reached(seeds);
    coverage.assert_intervals_hold(seeds);
    coverage.assert_noise_is_the_stated(seeds);
}

/// Coarse forces: without the true loads as unknowns the springs would be off by 0.8 standard
/// deviations.
#[test]
fn campaign_b_is_not_biased() {
    let places = [HOME, [-0.4, 0.3, 0.5], [0.4, 0.55, 0.8]];
    let noise = Noise {
        gauge_um: 2.0,
        force_n: 3.0,
        moment_nm: 0.15,
    };
    let robot = RobotFile::builtin_l2().unwrap();
    let seeds = Seeds::new(8, 200);
    let coverage = coverage(seeds, SetupNoise::default(), || {
        TestBench::new(&robot, &places, &straps(3, &HOOKS[..1]), noise)
    });
    assert!(
        (coverage.sums.iter()).all(|mean| mean.abs() <= seeds.widened(0.3)),
        "{}",
        coverage.sums
    );
    coverage.assert_intervals_hold(seeds);
}

/// Half a millimetre and two milliradians: taken as exact, intervals would hold in a sixth of the
/// campaigns.
const ABOUT: SetupNoise = SetupNoise {
    gauge_point_mm: Some(0.5),
    gauge_axis_mrad: Some(2.0),
    sensor_lever_mm: Some(0.5),
    sensor_axes_mrad: Some(2.0),
    sensor_gain: Some(0.005),
};

#[test]
fn a_set_up_that_is_known_about_widens_the_intervals_as_much_as_it_must() {
    let seeds = Seeds::new(10, 200);
    let coverage = coverage(seeds, ABOUT, || campaign_a(FINE));
    coverage.assert_pooled_intervals_hold(seeds, 0.92);
    coverage.assert_noise_is_the_stated(seeds);
}

#[test]
fn an_f1_with_gauges_on_every_axis_and_a_set_up_that_is_known_about() {
    let robot = RobotFile::builtin_f1().unwrap();
    let home = robot.home_m().into();
    let seeds = Seeds::new(10, 200);
    let coverage = coverage(seeds, ABOUT, || {
        TestBench::new(&robot, &[home], &straps(1, &HOOKS), FINE)
    });
    coverage.assert_pooled_intervals_hold(seeds, 0.93);
    coverage.assert_noise_is_the_stated(seeds);
}

/// Without gauges on the carts, link 11 and cart 1 are one spring at one pose:
/// `c_11 + c_1 (s_11 . v_1)^2`.
#[test]
fn cart_1_and_link_11_are_collinear_without_the_gauge_of_the_cart() {
    let mut random = seeded(1);
    let mut bench = campaign_a(FINE);
    let truth = bench.true_springs(&mut random);
    bench.measure(&truth, &mut random, 0.0, never);
    for window in &mut bench.campaign.windows {
        window.readings_m[6..].fill(None);
    }
    let problem = bench.problem();
    let held = HeldDirections::of(&fitted(&bench).seen.lost_directions());
    let active = ActiveSet {
        held: Some(held),
        ..ActiveSet::all(&bench.campaign)
    };
    let found = fit(&problem, &active, FitState::start(&problem)).unwrap();
    let [lost, _] = unobservable(&problem, &active, &found);
    let [direction] = lost.as_slice() else {
        panic!("{lost:?}")
    };
    let mut expected = DVector::zeros(9);
    (expected[6], expected[0]) = (1.0, -0.032);
    let cosine = direction.components.dot(&expected) / expected.norm();
    assert!(cosine.abs() >= 0.99, "{cosine}");
    let uncertainty = uncertainty(&problem, &active, &found);
    assert_eq!(uncertainty.status(6), Status::Kept);
    assert_eq!(uncertainty.status(0), Status::Depends);
    assert!((1..6).all(|link| uncertainty.status(link) == Status::Identified));
    let [kept, file] =
        [found.state.springs, bench.file.clone()].map(|springs| springs.machine.axes[0]);
    assert_eq!(kept.to_bits(), file.to_bits(), "the file's value stays");
    // All of cart 1 by the file is three hundredths of link 11.
    let sd = uncertainty.covariance()[(0, 0)].sqrt() / bench.file.machine.links_m_per_n[0];
    assert!((sd - 0.032).abs() < 0.005, "{sd}");
}

/// `[T 4.2.9]`: home, one strap in x, three gauges at one point; the carts are measured too.
/// Three numbers, not six springs.
#[test]
fn the_measurement_of_the_thesis_gives_three_of_six_links() {
    let robot = RobotFile::builtin_l2().unwrap();
    let mut bench = TestBench::new(&robot, &[HOME], &straps(1, &HOOKS[..1])[..1], FINE);
    for (gauge, axis) in [
        nalgebra::Vector3::x(),
        nalgebra::Vector3::y(),
        nalgebra::Vector3::z(),
    ]
    .into_iter()
    .enumerate()
    {
        bench.campaign.gauges[gauge].gauge = Gauge::Face {
            body: Body::Platform,
            point_m: nalgebra::Vector3::new(0.0, 0.0, 0.1),
            axis,
        };
    }
    for window in &mut bench.campaign.windows {
        window.readings_m[3..6].fill(None);
    }
    let problem = bench.problem();
    let lost = rounds(
        &problem,
        &ActiveSet::all(&bench.campaign),
        FitState::start(&problem),
        1,
    )
    .unwrap()
    .seen
    .lost();
    let of_links = lost
        .iter()
        .filter(|direction| direction.components.rows(0, 6).norm() > 0.9)
        .count();
    assert_eq!(of_links, 3, "{lost:?}");
}
