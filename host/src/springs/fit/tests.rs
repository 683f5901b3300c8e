//! Campaigns of the simulated L2 and F1, of known springs: campaign A of nine straps at home, and B at three poses.

use super::*;
use crate::fit::statistics::NORMAL_95;
use crate::measurements::springs::{Noise, SetupNoise};
use crate::robot_file::RobotFile;
use crate::springs::campaigns::{Bench, FINE, HOME, HOOKS, campaign_a, never, seeded, straps};

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
        let off = (vector(&found.state.compliances) - vector(&truth)).component_div(&vector(&truth)).amax();
        assert!(off < 1e-5 && found.rounds <= 7, "{seed}: {off:e} after {}", found.rounds);
        assert!(found.rows.chi_squared() < 1e-6);
    }
}

/// `(error / sd)`: root mean square, mean, and how many intervals hold, per spring; and the mean of chi-squared per degree of freedom.
struct Coverage {
    squares: DVector<f64>,
    sums: DVector<f64>,
    held: DVector<f64>,
    reduced: f64,
}

fn coverage<const N: usize>(count: u32, setup: SetupNoise, planned: impl Fn() -> Bench<N>) -> Coverage {
    let zeros = DVector::zeros(LINKS + N);
    let mut coverage = Coverage { squares: zeros.clone(), sums: zeros.clone(), held: zeros, reduced: 0.0 };
    for seed in 0..count {
        let mut random = seeded(u64::from(seed));
        let mut bench = planned();
        bench.campaign.setup = setup;
        let truth = bench.true_springs(&mut random);
        bench.measure(&truth, &mut random, 0.0, never);
        let found = fitted(&bench);
        let covariance = found.seen.covariance();
        let off = vector(&found.state.compliances) - vector(&truth);
        for spring in 0..LINKS + N {
            let score = off[spring] / covariance[(spring, spring)].sqrt();
            coverage.squares[spring] += score * score / f64::from(count);
            coverage.sums[spring] += score / f64::from(count);
            coverage.held[spring] += f64::from(u8::from(score.abs() <= NORMAL_95));
        }
        coverage.reduced += found.rows.chi_squared() / float(found.degrees()) / f64::from(count);
    }
    coverage
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
    let found = fitted(&bench);
    let lost = found.seen.lost();
    let [direction] = lost.as_slice() else { panic!("{lost:?}") };
    let mut expected = DVector::zeros(9);
    (expected[6], expected[0]) = (1.0, -0.032);
    let cosine = direction.components.dot(&expected) / expected.norm();
    assert!(cosine.abs() >= 0.99, "{cosine}");
    assert_eq!(crate::fit::answer::Status::of(&found.seen, 6), crate::fit::answer::Status::Kept);
    let kept = found.state.compliances.cart_m_per_n()[0] / bench.file.cart_m_per_n()[0];
    assert!((kept - 1.0).abs() < 0.01, "the file's value stays: {kept}");
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
            crate::springs::gauge::Gauge::Platform { point_m: nalgebra::Vector3::new(0.0, 0.0, 0.1), axis };
    }
    for window in &mut bench.campaign.windows {
        window.readings_m[3..6].fill(None);
    }
    let question = bench.question();
    let lost = rounds(&question, &Choice::all(&bench.campaign), State::start(&question), 1).unwrap().seen.lost();
    let of_links = lost.iter().filter(|direction| direction.components.rows(0, 6).norm() > 0.9).count();
    assert_eq!(of_links, 3, "{lost:?}");
}
