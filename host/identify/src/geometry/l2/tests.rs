//! Calibration of simulated machines whose truth is known: seeded campaigns, against the Cramer-Rao
//! bound.

use gantry_tau_core::model::linalg::cross_matrix;
use gantry_tau_core::model::presets;
use gantry_tau_system::output::Name;
use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::storage::Owned;
use nalgebra::{Dyn, Translation3, UnitQuaternion};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::fit::frames::rigid_trimmed;
use crate::fit::least_squares::{Fit, Observability};
use crate::fit::statistics::NORMAL_95;
use crate::fit::svd::Svd;
use crate::geometry::robust_fit::{agreeing_with, cost, fit_agreeing};

/// Noise of a device, m.
const SIGMA_M: f64 = 50e-6;

fn configuration() -> Configuration {
    presets::l2().configuration
}

/// A device somewhere, and a machine that is up to 5 mm and 5 mrad off the file's.
struct Campaign {
    random: ChaCha8Rng,
    /// In the frame of the device.
    truth: Nominal,
    file: Nominal,
}

impl Campaign {
    fn new(seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let file = Nominal::of(&presets::l2());
        let mut step = DVector::zeros(PARAMETERS);
        for (value, scale) in step.iter_mut().zip(&file.scales()) {
            *value = 0.5 * scale * random.random_range(-1.0..1.0_f64);
        }
        let turn = Vector3::from_fn(|_, _| random.random_range(-2.0..2.0_f64));
        let shift = Translation3::from(Vector3::from_fn(|_, _| random.random_range(-3.0..3.0_f64)));
        let device = Isometry3::from_parts(shift, UnitQuaternion::from_scaled_axis(turn));
        Self {
            random,
            truth: file.stepped(&step).moved(&device),
            file,
        }
    }

    /// Positions that put the machine of the file anywhere in its reach, away from singular poses.
    fn positions(&mut self, count: usize) -> Vec<[f64; ARMS]> {
        let kinematics = self.file.kinematics(configuration()).unwrap();
        let mut found = Vec::new();
        while found.len() < count {
            let place_m = Vector3::new(
                self.random.random_range(-1.0..1.2),
                self.random.random_range(-0.1..0.7),
                self.random.random_range(0.3..1.0),
            );
            let Ok(q) = kinematics.inverse_in_assembly(&place_m) else {
                continue;
            };
            if [&self.file, &self.truth]
                .into_iter()
                .all(|nominal| is_regular(nominal, &q))
            {
                found.push(q);
            }
        }
        found
    }

    /// Place that the device sees with the axes there.
    fn measured(
        &mut self,
        positions: &[[f64; ARMS]],
        sigma_m: Vector3<f64>,
    ) -> Vec<MeasuredPose<ARMS>> {
        let kinematics = self.truth.kinematics(configuration()).unwrap();
        positions
            .iter()
            .enumerate()
            .map(|(index, q)| {
                let noise = Vector3::from_fn(|_, _| StandardNormal.sample(&mut self.random));
                MeasuredPose {
                    name: Name::made(index),
                    q: *q,
                    position_m: kinematics.forward(q).unwrap() + sigma_m.component_mul(&noise),
                    rotation: None,
                }
            })
            .collect()
    }

    /// The machine of the file, where the device sees it.
    fn start(&self, poses: &[MeasuredPose<ARMS>]) -> Nominal {
        let kinematics = self.file.kinematics(configuration()).unwrap();
        let pairs: Vec<_> = poses
            .iter()
            .map(|pose| (kinematics.forward(&pose.q).unwrap(), pose.position_m))
            .collect();
        self.file.moved(&rigid_trimmed(&pairs).unwrap())
    }

    /// Root mean square distance of the model's places from the true ones.
    fn error_m(&self, nominal: &Nominal, at_q: &[[f64; ARMS]]) -> f64 {
        let [model, truth] =
            [nominal, &self.truth].map(|nominal| nominal.kinematics(configuration()).unwrap());
        let squares = at_q
            .iter()
            .map(|q| (model.forward(q).unwrap() - truth.forward(q).unwrap()).norm_squared());
        (squares.sum::<f64>() / float(at_q.len())).sqrt()
    }
}

fn place_m(nominal: &Nominal, q: &[f64; ARMS]) -> Vector3<f64> {
    let kinematics = nominal.kinematics(configuration()).unwrap();
    kinematics.forward(q).unwrap()
}

/// True well away from singular poses.
fn is_regular(nominal: &Nominal, q: &[f64; ARMS]) -> bool {
    let Ok(place_m) = nominal.kinematics(configuration()).unwrap().forward(q) else {
        return false;
    };
    let directions = [0, 1, 2].map(|arm| {
        let cart_m = nominal.origins_m[arm] + nominal.guideways[arm] * q[arm];
        (cart_m - place_m) / nominal.lengths_m[arm]
    });
    let sides = (0..ARMS).all(|arm| directions[arm].dot(&nominal.guideways[arm]).abs() > 0.1);
    sides && Matrix3::from_columns(&directions).determinant().abs() > 0.1
}

fn places(poses: &[MeasuredPose<ARMS>], sigma_m: Vector3<f64>) -> Places<'_> {
    let whitening = Matrix3::from_diagonal(&sigma_m.map(|sigma| 1.0 / sigma));
    Places {
        poses,
        whitening,
        configuration: configuration(),
    }
}

#[test]
fn the_derivatives_are_those_of_the_forward_kinematics() {
    let mut campaign = Campaign::new(1);
    let step = 1e-6;
    for q in campaign.positions(20) {
        let derivative = campaign.truth.derivative(&q, &place_m(&campaign.truth, &q));
        for parameter in 0..PARAMETERS {
            let [ahead, behind] = [step, -step].map(|by| {
                let mut change = DVector::zeros(PARAMETERS);
                change[parameter] = by;
                place_m(&campaign.truth.stepped(&change), &q)
            });
            // Central differences: step^2 of truncation, and 1e-16 / step of rounding.
            let difference = (ahead - behind) / (2.0 * step);
            assert!(
                (difference - derivative.column(parameter)).amax() < 1e-7,
                "{parameter}"
            );
        }
    }
}

#[test]
fn places_without_noise_give_the_machine() {
    for seed in 0..20 {
        let mut campaign = Campaign::new(seed);
        let positions = campaign.positions(20);
        let poses = campaign.measured(&positions, Vector3::zeros());
        for start in [campaign.start(&poses), closed_form(&poses).unwrap()] {
            let found = fit_agreeing(&places(&poses, Vector3::repeat(SIGMA_M)), start).unwrap();
            let off = (found.fit.state.parameters() - campaign.truth.parameters()).amax();
            assert!(
                off < 1e-9 && found.outliers.is_empty() && found.fit.rounds <= 15,
                "{seed}: {off:e} {}",
                found.fit.rounds
            );
        }
    }
}

/// A place that is left out costs what it would if it just agreed: 4.5 standard deviations.
#[test]
fn what_is_left_out_costs_as_much_as_the_limit() {
    let mut campaign = Campaign::new(3);
    let positions = campaign.positions(20);
    let poses = campaign.measured(&positions, Vector3::repeat(SIGMA_M));
    let mut found = fit_agreeing(
        &places(&poses, Vector3::repeat(SIGMA_M)),
        campaign.start(&poses),
    )
    .unwrap();
    found.outliers.clear();
    assert!((cost::<Places<'_>>(&found) - found.fit.chi_squared()).abs() < 1e-12);
    found.outliers = vec![4, 7, 9];
    assert!((cost::<Places<'_>>(&found) - found.fit.chi_squared() - 3.0 * 4.5 * 4.5).abs() < 1e-6);
}

/// Share of the bound that the error reaches over campaigns, and how often each interval holds the
/// truth.
fn campaigns(count: u64, sigma_m: Vector3<f64>) -> (f64, [u32; PARAMETERS]) {
    let mut squares = 0.0;
    let mut bounds = 0.0;
    let mut held = [0; PARAMETERS];
    for seed in 0..count {
        let mut campaign = Campaign::new(1_000 + seed);
        let positions = campaign.positions(60);
        let unseen = campaign.positions(200);
        let poses = campaign.measured(&positions, sigma_m);
        let places = places(&poses, sigma_m);
        let found = fit_agreeing(&places, campaign.start(&poses)).unwrap();
        squares += campaign.error_m(&found.fit.state, &unseen).powi(2);
        let all: Vec<usize> = (0..poses.len()).collect();
        let at_truth = Observability::new(
            &places.rows(&campaign.truth, &all).unwrap(),
            &campaign.truth.scales(),
        )
        .covariance();
        bounds += predicted_rms_m(&campaign.truth, configuration(), &at_truth, &unseen).powi(2);
        let covariance = found.fit.seen.covariance();
        let off = found.fit.state.parameters() - campaign.truth.parameters();
        for (parameter, held) in held.iter_mut().enumerate() {
            *held += u32::from(
                off[parameter].abs() <= NORMAL_95 * covariance[(parameter, parameter)].sqrt(),
            );
        }
    }
    ((squares / bounds).sqrt(), held)
}

#[test]
fn the_error_reaches_the_bound_and_the_intervals_hold() {
    for sigma_m in [Vector3::repeat(SIGMA_M), Vector3::new(30e-6, 30e-6, 90e-6)] {
        let (share, held) = campaigns(200, sigma_m);
        assert!(share < 1.1, "{share}");
        // 95 % of 200, and 99.9 % of what such counts do.
        assert!(
            held.iter().all(|held| (178..=199).contains(held)),
            "{held:?}"
        );
    }
}

/// The frame is fitted along: what is left are the errors that the tool sees.
#[test]
fn in_the_frame_of_the_file_the_file_comes_back() {
    for seed in 0..10 {
        let mut campaign = Campaign::new(9_000 + seed);
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.4, -2.0, 1.0));
        let device = Isometry3::from_parts(Translation3::new(1.0, -2.0, 0.5), turn);
        campaign.truth = campaign.file.moved(&device);
        let positions = campaign.positions(30);
        let exact = campaign.measured(&positions, Vector3::zeros());
        let places = places(&exact, Vector3::repeat(SIGMA_M));
        let found = fit_agreeing(&places, campaign.start(&exact)).unwrap();
        let found = found
            .in_frame_of(&campaign.file, &places, &found.fit.seen.covariance())
            .unwrap();
        assert!((found.nominal.parameters() - campaign.file.parameters()).amax() < 1e-9);
        assert!((found.motion.to_homogeneous() - device.to_homogeneous()).amax() < 1e-9);
        let values = Svd::new(found.covariance.clone()).values;
        assert!(
            values[14] > 1e-12 && values[15] < 1e-9 * values[14],
            "rank 15: {values}"
        );
    }
}

/// `(x - truth) / sd` of what the frame leaves, for the lengths, which no motion changes, and for
/// places.
#[test]
fn the_covariance_in_the_frame_of_the_file_is_right() {
    let mut squares = 0.0;
    let mut expected = 0.0;
    for seed in 0..100 {
        let mut campaign = Campaign::new(7_000 + seed);
        let positions = campaign.positions(40);
        let unseen = campaign.positions(50);
        let noise = Vector3::repeat(SIGMA_M);
        let poses = campaign.measured(&positions, noise);
        let places = places(&poses, noise);
        let calibrated = fit_agreeing(&places, campaign.start(&poses)).unwrap();
        let covariance = calibrated.fit.seen.covariance();
        let found = calibrated
            .in_frame_of(&campaign.file, &places, &covariance)
            .unwrap();
        // The same frame of the truth: without noise.
        let truth = Calibrated {
            fit: Fit {
                state: campaign.truth,
                ..calibrated.fit.clone()
            },
            ..calibrated.clone()
        };
        let truth = truth
            .in_frame_of(&campaign.file, &places, &covariance)
            .unwrap()
            .nominal;
        campaign.truth = truth;
        squares += campaign.error_m(&found.nominal, &unseen).powi(2);
        expected += predicted_rms_m(&truth, configuration(), &found.covariance, &unseen).powi(2);
    }
    let ratio = (squares / expected).sqrt();
    assert!((0.9..1.1).contains(&ratio), "{ratio}");
}

#[test]
fn wrong_places_are_found_and_left_out() {
    let mut found = 0;
    let mut accused = 0;
    for seed in 0..50 {
        let mut campaign = Campaign::new(5_000 + seed);
        let positions = campaign.positions(40);
        let mut poses = campaign.measured(&positions, Vector3::repeat(SIGMA_M));
        poses[7].position_m.y += 1e-3;
        poses[23].position_m.z -= 0.4e-3;
        let calibrated = fit_agreeing(
            &places(&poses, Vector3::repeat(SIGMA_M)),
            campaign.start(&poses),
        )
        .unwrap();
        found += calibrated
            .outliers
            .iter()
            .filter(|index| [7, 23].contains(index))
            .count();
        accused += calibrated
            .outliers
            .iter()
            .filter(|index| ![7, 23].contains(index))
            .count();
    }
    assert!(
        found >= 95 && accused <= 5,
        "{found} of 100 found, {accused} of 1900 accused wrongly"
    );
}

/// A right place that is left out comes back: with few places about it is predicted several
/// standard deviations off.
#[test]
fn a_place_that_was_left_out_is_judged_by_what_is_known_of_it() {
    let mut far = 0;
    let mut lost = 0;
    for seed in 0..20 {
        let mut campaign = Campaign::new(6_000 + seed);
        let positions = campaign.positions(12);
        let poses = campaign.measured(&positions, Vector3::repeat(SIGMA_M));
        let places = places(&poses, Vector3::repeat(SIGMA_M));
        let start = campaign.start(&poses);
        for left_out in 0..poses.len() {
            let used: Vec<usize> = (0..poses.len())
                .filter(|index| *index != left_out)
                .collect();
            let fit = crate::fit::least_squares::fit(
                start,
                &start.scales(),
                |state| places.rows(state, &used),
                Places::stepped,
            );
            let Ok(fit) = fit else { continue };
            far += u32::from(places.length_sd(&fit.state, left_out) > 4.5);
            lost += u32::from(!agreeing_with(&places, &fit, &used).contains(&left_out));
        }
    }
    assert!(
        far >= 20 && lost <= 3,
        "{far} of 140 are far off, {lost} of them for good"
    );
}

/// The same sum of squares for MINPACK's algorithm, in scaled parameters from `origin`.
struct Minpack<'a> {
    places: Places<'a>,
    origin: Nominal,
    steps: DVector<f64>,
}

impl Minpack<'_> {
    fn machine(&self) -> Nominal {
        self.origin
            .stepped(&self.steps.component_mul(&self.origin.scales()))
    }

    fn rows(&self) -> Option<Rows> {
        let all: Vec<usize> = (0..self.places.count()).collect();
        self.places.rows(&self.machine(), &all).ok()
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Minpack<'_> {
    type ParameterStorage = Owned<f64, Dyn>;
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;

    fn set_params(&mut self, steps: &DVector<f64>) {
        self.steps.copy_from(steps);
    }

    fn params(&self) -> DVector<f64> {
        self.steps.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        Some(-self.rows()?.residuals)
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        Some(self.rows()?.derivatives * DMatrix::from_diagonal(&self.origin.scales()))
    }
}

/// `levenberg-marquardt`, a port of MINPACK, from the same start.
#[test]
fn another_program_finds_the_same_minimum() {
    for seed in 0..5 {
        let mut campaign = Campaign::new(6_000 + seed);
        let positions = campaign.positions(40);
        let poses = campaign.measured(&positions, Vector3::repeat(SIGMA_M));
        let places = places(&poses, Vector3::repeat(SIGMA_M));
        let start = campaign.start(&poses);
        let found = fit_agreeing(&places, start).unwrap();
        assert!(found.outliers.is_empty(), "{seed}");
        let problem = Minpack {
            places,
            origin: start,
            steps: DVector::zeros(PARAMETERS),
        };
        let (problem, report) = LevenbergMarquardt::new().with_tol(1e-15).minimize(problem);
        let off = (problem.machine().parameters() - found.fit.state.parameters()).amax();
        let chi_squared = 2.0 * report.objective_function;
        // A last step below 1e-6 standard deviations of a millimetre or less.
        assert!(off < 1e-9, "{seed}: {off:e} m, {:?}", report.termination);
        assert!(
            (chi_squared / found.fit.chi_squared() - 1.0).abs() < 1e-9,
            "{seed}: {chi_squared}"
        );
    }
}

/// Nine combinations of machine, frame and target are seen by no place, with any target and device.
#[test]
fn frame_and_target_leave_a_rank_of_21() {
    let mut campaign = Campaign::new(4);
    let positions = campaign.positions(60);
    let kinematics = campaign.truth.kinematics(configuration()).unwrap();
    // Place in the device's frame: a small motion of the frame moves it as a whole, and an offset
    // of the target as the platform's axes lie.
    let device = UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -0.8, 1.1))
        .to_rotation_matrix()
        .into_inner();
    let mut whole = DMatrix::zeros(3 * positions.len(), PARAMETERS + 9);
    for (row, q) in positions.iter().enumerate() {
        let place_m = kinematics.forward(q).unwrap();
        whole
            .view_mut((3 * row, 0), (3, PARAMETERS))
            .copy_from(&campaign.truth.derivative(q, &place_m));
        whole
            .view_mut((3 * row, PARAMETERS), (3, 3))
            .fill_with_identity();
        whole
            .view_mut((3 * row, PARAMETERS + 3), (3, 3))
            .copy_from(&-cross_matrix(&place_m));
        whole
            .view_mut((3 * row, PARAMETERS + 6), (3, 3))
            .copy_from(&device);
    }
    for unknowns in [PARAMETERS, PARAMETERS + 6, PARAMETERS + 9] {
        let values = Svd::new(whole.columns(0, unknowns).into_owned()).values;
        assert!(
            values[PARAMETERS - 1] > 1e-5 * values[0],
            "{unknowns}: {values}"
        );
        assert!(
            values
                .iter()
                .skip(PARAMETERS)
                .all(|value| *value < 1e-12 * values[0]),
            "{unknowns}: {values}"
        );
    }
}
