//! Campaigns of the simulated L2 and F1, of known springs: campaign A of nine straps at home, and B at three poses.

use gantry_tau_core::model::robot::LINKS;

use super::*;
use crate::fit::answer::Status;
use crate::fit::held::Held;
use crate::fit::statistics::NORMAL_95;
use crate::measurements::springs::{Noise, SetupNoise};
use crate::robot_file::RobotFile;
use crate::springs::campaigns::{Bench, FINE, HOME, HOOKS, WRIST_M, campaign_a, l2_with_wrist, never, seeded, straps};
use crate::springs::decision::{uncertainty, unobservable};
use crate::springs::gauge::{Body, Gauge};

/// Noise that nothing is lost in, and that leaves a campaign solvable.
const NONE: Noise = Noise { gauge_um: 1e-6, force_n: 1e-6, moment_nm: 1e-6 };

fn fitted<const N: usize>(bench: &Bench<N>) -> Solved<N> {
    let question = bench.question();
    fit(&question, &Choice::all(&bench.campaign), State::start(&question)).unwrap()
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
        let off = (found.state.springs.vector() - truth.vector()).component_div(&truth.vector()).amax();
        assert!(off < 1e-5 && found.rounds <= 7, "{seed}: {off:e} after {}", found.rounds);
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
    let question = bench.question();
    let found = fit(&question, &Choice::all(&bench.campaign), State::start(&question)).err();
    let Some(SpringsError::AtBound { name, factor }) = found else { panic!("{found:?}") };
    assert_eq!(name, bench.file.names()[0].0);
    assert!((MOST_FACTOR..=1.1 * MOST_FACTOR).contains(&factor), "{factor}");
}

/// `(error / sd)`: root mean square, mean, and how many intervals hold, per spring; and the mean of chi-squared per degree of freedom.
struct Coverage {
    squares: DVector<f64>,
    sums: DVector<f64>,
    held: DVector<f64>,
    reduced: f64,
}

fn coverage<const N: usize>(count: u32, setup: SetupNoise, planned: impl Fn() -> Bench<N>) -> Coverage {
    let zeros = DVector::zeros(planned().file.count());
    let mut coverage = Coverage { squares: zeros.clone(), sums: zeros.clone(), held: zeros, reduced: 0.0 };
    for seed in 0..count {
        let mut random = seeded(u64::from(seed));
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
fn campaign_with_wrist(noise: Noise) -> Bench<3> {
    Bench::new(&l2_with_wrist(), &[HOME], &straps(1, &HOOKS), noise)
}

#[test]
fn a_wrist_is_identified_along_with_the_machine() {
    let coverage = coverage(200, SetupNoise::default(), || campaign_with_wrist(FINE));
    assert_eq!(coverage.held.len(), LINKS + 3 + 2);
    assert!(coverage.squares.iter().all(|square| square.sqrt() <= 1.2), "{}", coverage.squares);
    assert!(coverage.held.iter().all(|held| (178.0..=199.0).contains(held)), "{}", coverage.held);
    assert!((0.99..1.01).contains(&coverage.reduced), "{}", coverage.reduced);
}

/// The first joint turned by half a radian in every second series: with the angles the campaign gives the springs, without them it does not.
#[test]
fn the_angles_of_the_wrist_are_those_of_the_series() {
    let mut random = seeded(1);
    let mut bench = campaign_with_wrist(NONE);
    let truth = bench.true_springs(&mut random);
    bench.turn_wrist(&[0.5, -0.2]);
    bench.measure(&truth, &mut random, 0.0, never);
    bench.campaign.noise = FINE;
    let off = |bench: &Bench<3>| {
        let found = fitted(bench).state.springs.vector();
        (found - truth.vector()).component_div(&truth.vector()).amax()
    };
    let known = off(&bench);
    bench.campaign.plan.clear();
    let unknown = off(&bench);
    assert!(known < 1e-5 && unknown > 0.05, "{known:e} {unknown:e}");
}

/// A joint is not seen by gauges at one point on its axis, and keeps the file's value.
#[test]
fn gauges_at_a_point_of_its_axis_do_not_see_a_joint() {
    // Pulls of 100 N: at 300 N the point moves by a third of a millimetre, and is off the axis.
    let mut straps = straps(1, &HOOKS);
    straps.iter_mut().flat_map(|strap| &mut strap.levels).for_each(|level| *level /= 3.0);
    let mut bench = Bench::new(&l2_with_wrist(), &[HOME], &straps, FINE);
    for named in &mut bench.campaign.gauges {
        if let Gauge::Face { point_m, .. } = &mut named.gauge {
            *point_m = WRIST_M.into();
        }
    }
    let truth = bench.file.clone();
    bench.measure(&truth, &mut seeded(2), 0.0, never);
    let found = fitted(&bench);
    let named: f64 = found.seen.lost().iter().map(|lost| lost.components.rows(LINKS + 3, 2).norm_squared()).sum();
    assert!(named > 1.9, "{named}");
    let kept = found.state.springs.wrist.compliances().zip(truth.wrist.compliances());
    assert!(kept.into_iter().all(|(found, file)| (found / file - 1.0).abs() < 0.02));
}

#[test]
fn campaign_a_reaches_its_deviations() {
    let coverage = coverage(200, SetupNoise::default(), || campaign_a(FINE));
    assert!(coverage.squares.iter().all(|square| square.sqrt() <= 1.2), "{}", coverage.squares);
    assert!(coverage.held.iter().all(|held| (178.0..=199.0).contains(held)), "{}", coverage.held);
    assert!((0.99..1.01).contains(&coverage.reduced), "{}", coverage.reduced);
}

/// Coarse forces: without the true loads as unknowns the springs would be off by 0.8 standard deviations.
#[test]
fn campaign_b_is_not_biased() {
    let places = [HOME, [-0.4, 0.3, 0.5], [0.4, 0.55, 0.8]];
    let noise = Noise { gauge_um: 2.0, force_n: 3.0, moment_nm: 0.15 };
    let robot = RobotFile::builtin_l2().unwrap();
    let planned = || Bench::new(&robot, &places, &straps(3, &HOOKS[..1]), noise);
    let coverage = coverage(200, SetupNoise::default(), planned);
    assert!(coverage.sums.iter().all(|mean| mean.abs() <= 0.3), "{}", coverage.sums);
    assert!(coverage.held.iter().all(|held| (178.0..=199.0).contains(held)), "{}", coverage.held);
}

/// Half a millimetre and two milliradians: taken as exact, intervals would hold in a sixth of the campaigns.
const ABOUT: SetupNoise = SetupNoise {
    gauge_point_mm: Some(0.5),
    gauge_axis_mrad: Some(2.0),
    sensor_lever_mm: Some(0.5),
    sensor_axes_mrad: Some(2.0),
    sensor_gain: Some(0.005),
};

#[test]
fn a_set_up_that_is_known_about_widens_the_intervals_as_much_as_it_must() {
    let coverage = coverage(200, ABOUT, || campaign_a(FINE));
    let pooled = coverage.held.mean() / 200.0;
    assert!((0.92..=0.97).contains(&pooled), "{pooled}: {}", coverage.held);
    assert!((0.99..1.01).contains(&coverage.reduced), "{}", coverage.reduced);
}

#[test]
fn an_f1_with_gauges_on_every_axis_and_a_set_up_that_is_known_about() {
    let robot = RobotFile::builtin_f1().unwrap();
    let home = robot.home_m().into();
    let coverage = coverage(200, ABOUT, || Bench::new(&robot, &[home], &straps(1, &HOOKS), FINE));
    let pooled = coverage.held.mean() / 200.0;
    assert!((0.93..=0.97).contains(&pooled), "{pooled}: {}", coverage.held);
    assert!((0.99..1.01).contains(&coverage.reduced), "{}", coverage.reduced);
}

/// Without gauges on the carts, link 11 and cart 1 are one spring at one pose: `c_11 + c_1 (s_11 . v_1)^2`.
#[test]
fn cart_1_cannot_be_told_from_link_11_without_its_gauge() {
    let mut random = seeded(1);
    let mut bench = campaign_a(FINE);
    let truth = bench.true_springs(&mut random);
    bench.measure(&truth, &mut random, 0.0, never);
    for window in &mut bench.campaign.windows {
        window.readings_m[6..].fill(None);
    }
    let question = bench.question();
    let held = Held::of(&fitted(&bench).seen.lost_directions());
    let choice = Choice { held: Some(held), ..Choice::all(&bench.campaign) };
    let found = fit(&question, &choice, State::start(&question)).unwrap();
    let [lost, _] = unobservable(&question, &choice, &found);
    let [direction] = lost.as_slice() else { panic!("{lost:?}") };
    let mut expected = DVector::zeros(9);
    (expected[6], expected[0]) = (1.0, -0.032);
    let cosine = direction.components.dot(&expected) / expected.norm();
    assert!(cosine.abs() >= 0.99, "{cosine}");
    let uncertainty = uncertainty(&question, &choice, &found);
    assert_eq!(uncertainty.status(6), Status::Kept);
    assert_eq!(uncertainty.status(0), Status::Depends);
    assert!((1..6).all(|link| uncertainty.status(link) == Status::Identified));
    let [kept, file] = [found.state.springs, bench.file.clone()].map(|springs| springs.machine.axes[0]);
    assert_eq!(kept.to_bits(), file.to_bits(), "the file's value stays");
    // All of cart 1 by the file is three hundredths of link 11.
    let sd = uncertainty.covariance()[(0, 0)].sqrt() / bench.file.machine.links_m_per_n[0];
    assert!((sd - 0.032).abs() < 0.005, "{sd}");
}

/// `[T 4.2.9]`: home, one strap in x, three gauges at one point; the carts are measured besides. Three numbers, not six springs.
#[test]
fn the_measurement_of_the_thesis_gives_three_of_six_links() {
    let robot = RobotFile::builtin_l2().unwrap();
    let mut bench = Bench::new(&robot, &[HOME], &straps(1, &HOOKS[..1])[..1], FINE);
    for (gauge, axis) in
        [nalgebra::Vector3::x(), nalgebra::Vector3::y(), nalgebra::Vector3::z()].into_iter().enumerate()
    {
        bench.campaign.gauges[gauge].gauge =
            Gauge::Face { body: Body::Platform, point_m: nalgebra::Vector3::new(0.0, 0.0, 0.1), axis };
    }
    for window in &mut bench.campaign.windows {
        window.readings_m[3..6].fill(None);
    }
    let question = bench.question();
    let lost = rounds(&question, &Choice::all(&bench.campaign), State::start(&question), 1).unwrap().seen.lost();
    let of_links = lost.iter().filter(|direction| direction.components.rows(0, 6).norm() > 0.9).count();
    assert_eq!(of_links, 3, "{lost:?}");
}
