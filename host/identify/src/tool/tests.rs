//! Tools whose truth is known.

use std::cell::RefCell;

use gantry_tau_core::model::linalg::rotation_from_vector;
use gantry_tau_core::model::sensor::{ForceSensor, LowPass, Reading, SensorConfig, Tool};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_test_support::seeds::Seeds;
use nalgebra::{DMatrix, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::fit::answer::Status;
use crate::fit::statistics::float;
use crate::measurements::tool::ReadingNoise;

const NOISE: ReadingNoise = ReadingNoise {
    force_n: 0.2,
    moment_nm: 0.01,
};
/// Turns of the platform, rad, within the travel of an F1 at home.
const TURNS: [[f64; 3]; 6] = [
    [0.0, 0.0, 0.0],
    [0.25, 0.0, 0.0],
    [-0.25, 0.0, 0.0],
    [0.0, 0.3, 0.0],
    [0.0, -0.3, 0.0],
    [0.1, -0.1, 0.2],
];
/// Weight, centre and bias.
const TRUTH: [f64; 12] = [
    0.5, -1.0, -49.0, 0.03, -0.02, -0.2, 3.0, -2.0, 40.0, 0.5, 0.1, -0.2,
];

fn mounting() -> Mounting {
    Mounting::from(&RobotFile::builtin_f1().unwrap().sensor)
}

fn rotations(turns: &[[f64; 3]]) -> Vec<Matrix3<f64>> {
    turns
        .iter()
        .map(|turn| rotation_from_vector(&Vector3::from(*turn)).unwrap())
        .collect()
}

/// Reading of an unloaded sensor, by transfer of moments in world axes.
fn reading(rotation: &Matrix3<f64>, truth: &[f64; 12]) -> Wrench {
    let mounting = mounting();
    let [weight_n, centre_m, bias_n, bias_nm] =
        [0, 3, 6, 9].map(|first| Vector3::from_column_slice(&truth[first..first + 3]));
    let lever_m = rotation * (centre_m - mounting.lever_m);
    let axes = (rotation * mounting.rotation).transpose();
    Wrench {
        force_n: axes * weight_n + bias_n,
        moment_nm: axes * lever_m.cross(&weight_n) + bias_nm,
    }
}

/// Readings with noise, in these standard deviations.
fn readings(rotations: &[Matrix3<f64>], deviations: f64, seed: u64) -> Vec<Turned> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    rotations
        .iter()
        .map(|rotation| {
            let mut raw = reading(rotation, &TRUTH);
            let [force_n, moment_nm] = [NOISE.force_n, NOISE.moment_nm].map(|sd| {
                Vector3::from_fn(|_, _| {
                    deviations * sd * Distribution::<f64>::sample(&StandardNormal, &mut random)
                })
            });
            raw.force_n += force_n;
            raw.moment_nm += moment_nm;
            Turned {
                rotation: *rotation,
                raw,
            }
        })
        .collect()
}

fn fitted(readings: &[Turned]) -> FittedTool {
    fit_tool(&mounting(), readings, NOISE, Tool::weightless()).unwrap()
}

#[test]
fn a_sensor_with_the_tool_sees_no_load_however_it_is_turned() {
    let found = fitted(&readings(&rotations(&TURNS), 0.0, 0));
    let Mounting {
        rotation, lever_m, ..
    } = mounting();
    // Nearly no filter, so that one sample is enough.
    let config = SensorConfig {
        rotation,
        lever_m,
        tool: found.tool,
        low_pass: LowPass::FirstOrder,
        cutoff_hz: 1e5,
        cycle_s: 10.0,
        tare_samples: 1,
    };
    let mut sensor = ForceSensor::new(config).unwrap();
    let [tared] = rotations(&[[0.2, -0.1, 0.3]])[..] else {
        panic!()
    };
    sensor.update(&reading(&tared, &TRUTH), &tared).unwrap();
    for turned in rotations(&[[0.0; 3], [-0.3, 0.2, 0.1], [1.0, 2.0, -0.5]]) {
        let Reading::Load(load) = sensor.update(&reading(&turned, &TRUTH), &turned).unwrap() else {
            panic!()
        };
        // A fit ends within a millionth of a standard deviation, of which the farther turns make
        // ten here.
        let off = load.force_n.amax().max(load.moment_nm.amax());
        assert!(off < 1e-5, "{off:e}");
    }
    let bias = found.bias.to_array().into_iter().zip(&TRUTH[6..]);
    assert!(
        bias.into_iter()
            .all(|(found, truth)| (found - truth).abs() < 1e-5),
        "{:?}",
        found.bias
    );
}

#[test]
fn the_covariance_is_that_of_all_twelve_at_once() {
    let rotations = rotations(&TURNS);
    let found = fitted(&readings(&rotations, 0.0, 0));
    let mut derivatives = DMatrix::zeros(6 * rotations.len(), 12);
    for (pose, rotation) in rotations.iter().enumerate() {
        for parameter in 0..12 {
            let [ahead, behind] = [1e-4, -1e-4].map(|step| {
                let mut truth = TRUTH;
                truth[parameter] += step;
                reading(rotation, &truth).to_array()
            });
            for (row, (ahead, behind)) in ahead.into_iter().zip(behind).enumerate() {
                let sd = if row < 3 {
                    NOISE.force_n
                } else {
                    NOISE.moment_nm
                };
                derivatives[(6 * pose + row, parameter)] = (ahead - behind) / 2e-4 / sd;
            }
        }
    }
    let expected = (derivatives.transpose() * &derivatives)
        .try_inverse()
        .unwrap();
    for (found, expected) in found
        .covariance
        .diagonal()
        .iter()
        .zip(expected.diagonal().iter())
    {
        // The model is bilinear: its differences are exact but for rounding.
        assert!((found / expected - 1.0).abs() < 1e-6, "{found} {expected}");
    }
    assert!((found.covariance - &expected).amax() < 1e-6 * expected.amax());
}

#[test]
fn intervals_hold_the_truth() {
    let rotations = rotations(&TURNS);
    let mut held = 0;
    let mut squares = [0.0; 3];
    let mut chi2 = 0.0;
    for seed in 0..200 {
        let found = fitted(&readings(&rotations, 1.0, seed));
        let answer = answer(&found, "f1");
        assert_eq!((answer.fit.dof, found.fit.seen.lost().len()), (24, 0));
        chi2 += answer.fit.chi2;
        for (parameter, truth) in answer.parameters.iter().zip(TRUTH) {
            let [low, high] = parameter.interval().unwrap();
            held += usize::from((low..=high).contains(&truth));
        }
        for (axis, square) in squares.iter_mut().enumerate() {
            *square += ((answer.parameters[axis].value - TRUTH[axis]) / answer.parameters[axis].sd)
                .powi(2);
        }
    }
    let share = float(held) / 2400.0;
    assert!((0.93..=0.97).contains(&share), "{share}");
    // A mean of 200 squares of standard normals is 1 +- 0.1; of chi-squared of 24 degrees 24 +-
    // 0.5. Four deviations.
    assert!(
        squares
            .iter()
            .all(|square| (square / 200.0 - 1.0).abs() < 0.4),
        "{squares:?}"
    );
    assert!((chi2 / 200.0 - 24.0).abs() < 2.0, "{chi2}");
}

#[test]
fn a_weight_along_the_only_axis_of_turning_stays_and_the_bias_takes_the_rest() {
    let rotations = rotations(&[[0.0; 3], [0.0, 0.0, 0.3], [0.0, 0.0, -0.3], [0.0, 0.0, 0.2]]);
    // The weight across, 1 N, hardly shows the centre: the file has the right one.
    let centre_m = Vector3::from_column_slice(&TRUTH[3..6]);
    let start = Tool {
        weight_n: Vector3::new(0.0, 0.0, -18.0),
        centre_m,
    };
    let found = fit_tool(&mounting(), &readings(&rotations, 0.0, 0), NOISE, start).unwrap();
    let unheld = Observability::new(&found.fit.rows, found.fit.seen.scales());
    let lost = Unobservable::list(&names()[..TOOL], &unheld.lost());
    assert!(
        lost.iter()
            .any(|direction| direction.to_string() == "weight_n[2] +1.000"),
        "{lost:?}"
    );
    let off = found.tool.weight_n - Vector3::new(TRUTH[0], TRUTH[1], -18.0);
    assert!(off.amax() < 1e-5, "{off}");
    // 49 N pull down, of which the file has 18; the sensor's z is the world's.
    assert!(
        (found.bias.force_n.z - (TRUTH[8] - 31.0)).abs() < 1e-5,
        "{:?}",
        found.bias
    );
    assert_eq!(
        [2, 8].map(|parameter| found.status(parameter)),
        [Status::Kept, Status::Depends]
    );
    assert_eq!(found.tool.weight_n.z.to_bits(), (-18.0_f64).to_bits());
    // The bias is known as well as the weight, whose deviation is taken to be 1 N.
    assert!((found.covariance[(8, 8)] - 1.0).abs() < 0.1 && found.covariance[(2, 2)] <= 0.0);
    // Turned by 0.3 rad, weights across are seen to 0.2 N / 0.3 or so.
    assert_ne!(found.status(0), Status::Kept);
}

/// Found by an independent examination: a weight that the poses hardly show took the value of the
/// forces alone, and was said to be kept.
#[test]
fn what_is_kept_is_the_files_to_the_bit_and_what_is_contradicted_is_not_kept() {
    let tilts = [
        [0.0; 3],
        [0.1, 0.0, 0.0],
        [-0.1, 0.0, 0.0],
        [0.0, 0.1, 0.0],
        [0.0, -0.1, 0.0],
        [0.07, 0.07, 0.1],
    ];
    let mut kept = 0;
    let mut contradicted = 0;
    for (seed, off_n) in (0..20).flat_map(|seed| [(seed, 0.5), (seed, 30.0)]) {
        let start = Tool {
            weight_n: Vector3::new(TRUTH[0], TRUTH[1], TRUTH[2] + off_n),
            centre_m: Vector3::from_column_slice(&TRUTH[3..6]),
        };
        let noise = ReadingNoise {
            force_n: 1.0,
            moment_nm: 0.05,
        };
        let found = fit_tool(
            &mounting(),
            &readings(&rotations(&tilts), 5.0, seed),
            noise,
            start,
        )
        .unwrap();
        let chi2 = goodness::too_large(found.fit.chi_squared(), found.fit.degrees());
        assert_eq!(chi2, None, "seed {seed}, {off_n} N off");
        if found.status(2) == Status::Kept {
            kept += 1;
            assert_eq!(
                found.tool.weight_n.z.to_bits(),
                start.weight_n.z.to_bits(),
                "seed {seed}, {off_n} N off"
            );
        } else {
            contradicted += u32::from(off_n > 1.0);
            let z = (found.tool.weight_n.z - TRUTH[2]) / found.covariance[(2, 2)].sqrt();
            assert!(z.abs() < 4.0, "seed {seed}, {off_n} N off: {z}");
        }
    }
    assert!(
        kept >= 10 && contradicted == 20,
        "{kept} kept, {contradicted} contradicted"
    );
}

/// Doubts about readings with noise that were then spoiled; `spoil` also has the reading without
/// noise.
fn spoiled(seed: u64, file: &Tool, spoil: impl Fn(&mut Wrench, &Wrench)) -> String {
    let mut turned = readings(&rotations(&TURNS), 1.0, seed);
    for reading in &mut turned {
        let without_noise = self::reading(&reading.rotation, &TRUTH);
        spoil(&mut reading.raw, &without_noise);
    }
    let found = fitted(&turned);
    let degrees: usize = found.parts().iter().map(|(_, degrees)| degrees).sum();
    assert_eq!(degrees, found.fit.degrees());
    doubts(&found, &answer(&found, "f1"), &mounting(), file).concat()
}

/// A tool that was changed may weigh anything; forces in kg are found by their noise alone.
#[test]
fn forces_or_moments_in_a_larger_unit_are_quieter_than_is_stated() {
    for ([force, moment], words, shares) in [
        // One in a hundred of three tests at a thousandth each, three deviations up.
        ([1.0, 1.0], "noise", 0.0..=0.02),
        (
            [1.0 / 9.80665, 1.0],
            "forces: the stated noise is ",
            0.95..=1.0,
        ),
        (
            [1.0, 1.0 / 9.80665],
            "moments: the stated noise is ",
            0.95..=1.0,
        ),
        ([1.0 / 9.80665; 2], "the stated noise is ", 0.95..=1.0),
    ] {
        let seeds = Seeds::new(40, 200);
        let said = seeds.iter().map(|seed| {
            spoiled(seed, &Tool::weightless(), |raw, _| {
                raw.force_n *= force;
                raw.moment_nm *= moment;
            })
        });
        let count = said.filter(|said| said.contains(words)).count();
        let share = float(count) / f64::from(seeds.count);
        assert!(shares.contains(&share), "{words}: {share}");
    }
}

/// Down is where the file's tool pulls, light as it may be; without one it is down in the world.
#[test]
fn a_tool_that_pulls_upwards_is_refused_by_the_direction_of_the_file() {
    let found = fitted(&readings(&rotations(&TURNS), 1.0, 0));
    for (file_n, expected) in [
        ([0.0; 3], false),
        ([0.0, 0.0, -0.5], false),
        ([0.0, 0.0, 0.5], true),
    ] {
        assert_eq!(
            pulls_upwards(&found, &file_n.into()),
            expected,
            "{file_n:?}"
        );
    }
}

/// Found by an independent examination: channels that show nothing gave a tool at the origin of the
/// sensor, or one without a weight, and a sensor that was mounted otherwise a weight that pulls
/// sideways; all with exit code 0.
#[test]
fn channels_without_a_signal_and_a_sensor_that_is_tilted_are_doubted() {
    let file = Tool {
        weight_n: Vector3::new(0.0, 0.0, -18.0),
        centre_m: Vector3::new(0.0, 0.0, -0.1),
    };
    let seeds = Seeds::new(20, 100);
    let mut right = seeds.iter().map(|seed| spoiled(seed, &file, |_, _| ()));
    assert!(right.all(|said| !said.contains("look at")));
    let without_moments = seeds.iter().filter(|seed| {
        let said = spoiled(*seed, &file, |raw, right| raw.moment_nm -= right.moment_nm);
        said.contains("look at the channels of the moments")
    });
    assert!(100 * without_moments.count() >= 99 * seeds.iter().count());
    let without_forces: Vec<String> = seeds
        .iter()
        .map(|seed| spoiled(seed, &file, |raw, right| raw.force_n -= right.force_n))
        .collect();
    assert!(without_forces.iter().all(|said| !said.is_empty()));
    assert!(
        without_forces
            .iter()
            .any(|said| said.contains("look at the channels of the forces"))
    );
    // A sensor that is mounted otherwise than the file has it sees the weight elsewhere; most turns
    // contradict that as well.
    let leaning = Tool {
        weight_n: Vector3::new(6.0, 0.0, -18.0),
        ..file
    };
    let said = spoiled(0, &leaning, |_, _| ());
    assert!(
        said.starts_with("the weight is 18 degrees off the direction that the robot file has"),
        "{said}"
    );
}

/// Sentence about readings whose wrenches were spoiled by a matrix.
fn checked(spoil: impl Fn(usize, &mut Wrench)) -> Option<String> {
    let rotations = rotations(&[&TURNS[..], &[[-0.1, 0.2, -0.2], [0.2, 0.2, 0.1]]].concat());
    let mut turned = readings(&rotations, 1.0, 3);
    turned
        .iter_mut()
        .enumerate()
        .for_each(|(index, reading)| spoil(index, &mut reading.raw));
    let rows = turned
        .iter()
        .enumerate()
        .map(|(index, reading)| tool::ToolReading {
            line: 2 + index as u64,
            name: gantry_tau_system::output::Name::made(index),
            q: [0.0; 6],
            raw: reading.raw,
        });
    let measured = ToolReadings {
        table: "tool.csv".to_owned(),
        crc: 0,
        noise: NOISE,
        readings: rows.collect(),
    };
    let mounting = mounting();
    let start = Tool {
        weight_n: Vector3::new(0.0, 0.0, -18.0),
        ..Tool::weightless()
    };
    let fitted = fit_tool(&mounting, &turned, NOISE, start);
    let problem = mistakes::ToolProblem {
        measured: &measured,
        mounting: &mounting,
        readings: &turned,
        start,
    };
    problem
        .check(fitted.as_ref().ok())
        .unwrap_or_else(|error| Some(error.to_string()))
}

#[test]
fn columns_that_are_mistaken_and_a_reading_unlike_the_others_are_named() {
    let moments = "tool.csv:2: moment_x_n_m, moment_y_n_m, moment_z_n_m: the moments ";
    assert_eq!(checked(|_, _| ()), None);
    for (words, spoil) in [
        (
            &*format!("{moments}are in N mm"),
            (|_, raw| raw.moment_nm *= 1e3) as fn(usize, &mut Wrench),
        ),
        (
            "tool.csv:2: force_z_n: this column has the wrong sign",
            |_, raw| raw.force_n.z *= -1.0,
        ),
        (
            "tool.csv:2: force_x_n, force_y_n: these two columns are swapped",
            |_, raw| raw.force_n.swap_rows(0, 1),
        ),
        (
            "pose 4 (line 6): this reading does not agree with the others",
            |index, raw| {
                raw.force_n.y += if index == 4 { 5.0 } else { 0.0 };
            },
        ),
    ] {
        let said = checked(spoil).expect(words);
        assert!(said.starts_with(words), "{said}");
    }
    // Each reading stands in the row of the next one.
    let last = RefCell::new(Wrench::from_array([0.0; 6]));
    let said = checked(|_, raw| *raw = last.replace(*raw));
    let words = "these columns stand a row later than the others; move them up by a row";
    assert!(
        said.as_ref().is_some_and(|said| said.ends_with(words)),
        "{said:?}"
    );
}
