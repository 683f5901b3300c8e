//! Campaigns of the simulated L2, of known springs: campaign A of nine straps at home, and B at three poses.

use gantry_tau_core::model::l2;
use nalgebra::Vector3;
use rand::Rng;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::fit::statistics::NORMAL_95;
use crate::measurements::springs::{NamedGauge, Noise, SetupNoise};
use crate::sim::fixture::Vectors;
use crate::springs::gauge::Gauge;

const N: usize = l2::AXES;

/// Hooks, from the tool centre point, m.
const HOOKS: [[f64; 3]; 3] = [[0.0, 0.0, -0.08], [0.15, 0.0, -0.08], [0.0, 0.15, -0.08]];

/// Six gauges on the platform, 3-2-1, and one on each cart.
fn gauges() -> Vec<NamedGauge> {
    let platform = [
        ([0.12, -0.06, 0.10], Vector3::z()),
        ([-0.12, -0.06, 0.10], Vector3::z()),
        ([0.0, 0.10, 0.10], Vector3::z()),
        ([0.10, 0.12, 0.05], Vector3::y()),
        ([-0.10, 0.12, 0.05], Vector3::y()),
        ([0.14, 0.0, 0.05], Vector3::x()),
    ];
    let platform = platform.into_iter().map(|(point, axis)| Gauge::Platform { point_m: Vector3::from(point), axis });
    let axes = (0..N).map(|axis| Gauge::Axis { axis, metres_per_q: 1.0 });
    let named = |(index, gauge): (usize, Gauge)| NamedGauge { name: format!("g{index}"), gauge };
    platform.chain(axes).enumerate().map(named).collect()
}

/// A campaign without measurements: straps of three directions, levels up and down.
fn planned(places: &[[f64; 3]], hooks: &[[f64; 3]], noise: Noise) -> Campaign<N> {
    let vectors = Vectors::l2();
    let kinematics = crate::robot_file::RobotFile::builtin_l2().unwrap().model;
    let mut windows = Vec::new();
    let mut series = Vec::new();
    for (pose, place) in places.iter().enumerate() {
        let q = kinematics.inverse_in_assembly(&Vector3::from(*place)).unwrap();
        for hook in hooks {
            for direction in [Vector3::x(), Vector3::y(), Vector3::z()] {
                let levels = [0.0, 60.0, 120.0, 180.0, 240.0, 300.0, 240.0, 180.0, 120.0, 60.0, 0.0];
                for (window, level) in levels.into_iter().enumerate() {
                    let force = direction * level;
                    let moment = Vector3::from(*hook).cross(&force);
                    windows.push(Window {
                        line: 0,
                        series: series.len(),
                        mounting: series.len(),
                        pose,
                        window: window.to_string(),
                        stroke: if window <= 5 { 1 } else { -1 },
                        q,
                        load: Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z),
                        pushes_n: SVector::zeros(),
                        readings_m: Vec::new(),
                        sds_m: vec![None; gauges().len()],
                        time_s: None,
                    });
                }
                series.push(series.len().to_string());
            }
        }
    }
    let poses =
        places.iter().map(|place| (String::new(), gantry_tau_core::model::kinematics::Pose::at(Vector3::from(*place))));
    assert_eq!(vectors.compliances.cart_m_per_n().len(), N);
    Campaign {
        table: String::new(),
        crc: 0,
        metres_per_q: [1.0; N],
        noise,
        setup: SetupNoise::default(),
        poses: poses.collect(),
        gauges: gauges(),
        mountings: series.clone(),
        series,
        windows,
        plan: Vec::new(),
    }
}

/// Measures a campaign on a machine: gauges with zeros and noise, loads with noise. Returns the true loads too.
fn measure(campaign: &mut Campaign<N>, truth: &Compliances<N>, random: &mut ChaCha8Rng, is_noisy: bool) {
    let vectors = Vectors::l2();
    let machine = ElasticMachine::new(vectors.geometry, *truth, Backlash::NONE);
    let mut normal = |sd: f64| if is_noisy { sd * Distribution::<f64>::sample(&StandardNormal, random) } else { 0.0 };
    let zeros: Vec<Vec<f64>> =
        campaign.series.iter().map(|_| campaign.gauges.iter().map(|_| normal(1e-3)).collect()).collect();
    let noise = campaign.noise;
    for index in 0..campaign.windows.len() {
        let window = &campaign.windows[index];
        let began = unloaded(&machine, campaign, window).unwrap();
        let now = machine.equilibrium(&window.q, &window.load, &began).unwrap();
        let read = |gauge: &NamedGauge| gauge.gauge.read(&machine, &began.pose, &now).length_m;
        let exact: Vec<f64> = campaign.gauges.iter().map(read).collect();
        let zeros = &zeros[window.series];
        let readings =
            exact.iter().zip(zeros).map(|(reading, zero)| Some(reading + zero + normal(noise.gauge_um * 1e-6)));
        let readings = readings.collect();
        let window = &mut campaign.windows[index];
        window.readings_m = readings;
        for component in 0..6 {
            window.load[component] += normal(if component < 3 { noise.force_n } else { noise.moment_nm });
        }
    }
}

/// The file's compliances, each up to 30 % off.
fn true_springs(random: &mut ChaCha8Rng) -> Compliances<N> {
    let file = vector(&Vectors::l2().compliances);
    compliances_of(&file.map(|value| value * (1.0 + random.random_range(-0.3..0.3)))).unwrap()
}

const HOME: [f64; 3] = [0.0, 0.5, 0.65];
const FINE: Noise = Noise { gauge_um: 1.0, force_n: 1.0, moment_nm: 0.05 };

#[test]
fn a_campaign_without_noise_gives_the_springs() {
    let vectors = Vectors::l2();
    for seed in 0..5 {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let truth = true_springs(&mut random);
        let mut campaign = planned(&[HOME], &HOOKS, FINE);
        measure(&mut campaign, &truth, &mut random, false);
        let found = fit_springs(&vectors.geometry, &vectors.compliances, &campaign).unwrap();
        let off = (vector(&found.compliances) - vector(&truth)).component_div(&vector(&truth)).amax();
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

fn campaigns(count: u32, places: &[[f64; 3]], hooks: &[[f64; 3]], noise: Noise) -> Coverage {
    let vectors = Vectors::l2();
    let zeros = DVector::zeros(LINKS + N);
    let mut coverage = Coverage { squares: zeros.clone(), sums: zeros.clone(), held: zeros, reduced: 0.0 };
    for seed in 0..count {
        let mut random = ChaCha8Rng::seed_from_u64(u64::from(seed));
        let truth = true_springs(&mut random);
        let mut campaign = planned(places, hooks, noise);
        measure(&mut campaign, &truth, &mut random, true);
        let found = fit_springs(&vectors.geometry, &vectors.compliances, &campaign).unwrap();
        let covariance = found.seen.covariance();
        let off = vector(&found.compliances) - vector(&truth);
        for spring in 0..LINKS + N {
            let score = off[spring] / covariance[(spring, spring)].sqrt();
            coverage.squares[spring] += score * score / f64::from(count);
            coverage.sums[spring] += score / f64::from(count);
            coverage.held[spring] += f64::from(u8::from(score.abs() <= NORMAL_95));
        }
        let degrees = crate::fit::statistics::float(found.rows.degrees - found.seen.kept());
        coverage.reduced += found.rows.chi_squared() / degrees / f64::from(count);
    }
    coverage
}

#[test]
fn campaign_a_reaches_its_deviations() {
    let coverage = campaigns(200, &[HOME], &HOOKS, FINE);
    assert!(coverage.squares.iter().all(|square| square.sqrt() <= 1.2), "{}", coverage.squares);
    assert!(coverage.held.iter().all(|held| (178.0..=199.0).contains(held)), "{}", coverage.held);
    assert!((0.99..1.01).contains(&coverage.reduced), "{}", coverage.reduced);
}

/// Coarse forces: without the true loads as unknowns the springs would be off by 0.8 standard deviations.
#[test]
fn campaign_b_is_not_biased() {
    let places = [HOME, [-0.4, 0.3, 0.5], [0.4, 0.55, 0.8]];
    let noise = Noise { gauge_um: 2.0, force_n: 3.0, moment_nm: 0.15 };
    let coverage = campaigns(200, &places, &HOOKS[..1], noise);
    assert!(coverage.sums.iter().all(|mean| mean.abs() <= 0.3), "{}", coverage.sums);
    assert!(coverage.held.iter().all(|held| (178.0..=199.0).contains(held)), "{}", coverage.held);
}
