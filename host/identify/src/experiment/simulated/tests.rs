//! Campaign A on the simulated L2.

use gantry_tau_machine::model::L2;
use gantry_tau_system::output::Name;

use super::*;
use crate::experiment::fixture::{Folder, LEVELS, SETUP, campaign_a, plan_in};
use crate::experiment::table::WindowTable;
use crate::measurements::springs;
use crate::springs::identify::{IdentifyOptions, identify};

/// The built-in L2 with springs 30 % off and no play.
fn robot(seed: u64) -> RobotFile<L2, 3> {
    let mut robot = RobotFile::builtin_l2().unwrap();
    robot.simulation.seed = seed;
    robot.simulation.spring_deviation = 0.3;
    robot.simulation.jump_gap_m = 0.0;
    robot
}

fn written(folder: &Folder, plan: &Plan<3>, rows: &[WindowRow<3>]) -> Vec<u8> {
    let path = folder.path("springs.csv");
    let _ = std::fs::remove_file(&path);
    let mut table = WindowTable::open(&path, plan, false).unwrap();
    for row in rows {
        table.write(plan, row).unwrap();
    }
    std::fs::read(path).unwrap()
}

#[test]
fn what_is_written_is_read_back() {
    let folder = Folder::new("back");
    let plan = plan_in(&folder, &campaign_a(SETUP, &LEVELS));
    let rows = simulate(&robot(1), &robot(1), &plan).unwrap().rows;
    written(&folder, &plan, &rows);
    let campaign = springs::read(&folder.path("plan.toml"), "l2", &[1.0; 3]).unwrap();
    assert_eq!((campaign.windows.len(), campaign.series.len()), (99, 9));
    assert_eq!(campaign.plan.len(), 9);
    for (window, row) in campaign.windows.iter().zip(&rows) {
        assert_eq!(
            (window.q, window.load, window.time_s),
            (row.q, row.load, Some(row.time_s))
        );
        for (read, row) in window.readings_m.iter().zip(&row.readings_m) {
            // A micrometre and back: one rounding.
            assert!((read.unwrap() - row.unwrap()).abs() < 1e-18);
        }
        assert_eq!(window.window, Name::made(row.level + 1));
        assert_eq!(
            window.stroke,
            [0, 1, 1, 1, 1, 1, -1, -1, -1, -1, -1][row.level]
        );
    }
}

#[test]
fn the_seed_decides_every_byte() {
    let folder = Folder::new("seed");
    let plan = plan_in(&folder, &campaign_a(SETUP, &LEVELS));
    let [bytes, again, others] = [5, 5, 6].map(|seed| {
        let rows = simulate(&robot(seed), &robot(seed), &plan).unwrap().rows;
        written(&folder, &plan, &rows)
    });
    assert_eq!(bytes, again);
    assert_ne!(bytes, others);
}

/// Difference of a gauge along x, with the strap along x, from level 3 (345 N, rising) to level 5
/// (345 N, falling), m.
fn loop_m(robot: &RobotFile<L2, 3>, plan: &Plan<3>) -> f64 {
    let rows = simulate(robot, robot, plan).unwrap().rows;
    let [falling, rising] = [4, 2].map(|level| {
        let row = rows
            .iter()
            .find(|row| (row.series, row.level) == (0, level));
        row.unwrap().readings_m[5].unwrap()
    });
    falling - rising
}

/// Mean and standard deviation of some values.
fn spread(values: &[f64]) -> (f64, f64) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let squares = values.iter().map(|value| (value - mean).powi(2));
    (
        mean,
        (squares.sum::<f64>() / (values.len() - 1) as f64).sqrt(),
    )
}

/// The thesis' jump: without a gap, hysteresis or drift nothing of them is left.
#[test]
fn play_and_drift_act_only_where_they_are_stated() {
    let folder = Folder::new("play");
    let plan = plan_in(&folder, &campaign_a("", &[0, 300, 345, 420, 345, 300, 0]));
    let quiet = Plan {
        noise: springs::Noise {
            gauge_um: 1e-6,
            force_n: 1e-6,
            moment_nm: 1e-6,
        },
        ..plan
    };
    let straight = robot(3);
    assert!(loop_m(&straight, &quiet).abs() < 1e-10);
    let mut jumping = straight.clone();
    jumping.simulation.jump_gap_m = 40e-6;
    assert!(
        loop_m(&jumping, &quiet).abs() < 1e-9,
        "without hysteresis the way back is the way there"
    );
    jumping.simulation.jump_hysteresis_n = 30.0;
    let loop_m = loop_m(&jumping, &quiet);
    assert!(loop_m > 5e-6, "{loop_m:e}");
    let mut drifting = straight.clone();
    drifting.simulation.drift_um_per_min = 2.0;
    // Six levels of 15 s: the drift of each gauge of each series has a deviation of 3 um.
    let rows = simulate(&drifting, &drifting, &quiet).unwrap().rows;
    let back = rows
        .iter()
        .filter(|row| row.level == 6)
        .zip(rows.iter().filter(|row| row.level == 0));
    let drifts: Vec<f64> = back
        .flat_map(|(last, first)| {
            (0..9).map(|g| last.readings_m[g].unwrap() - first.readings_m[g].unwrap())
        })
        .collect();
    let rms = (drifts.iter().map(|drift| drift * drift).sum::<f64>() / drifts.len() as f64).sqrt();
    // 81 draws: the deviation of their rms is 8 %.
    assert!((rms / 3e-6 - 1.0).abs() < 0.3, "{rms:e}");
}

/// Noise of windows without a load: mean over many of them, and deviation, as `[noise]` states.
#[test]
fn noise_has_the_stated_spread() {
    let folder = Folder::new("noise");
    let plan = plan_in(&folder, &campaign_a("", &[0; 60]));
    let rows = simulate(&robot(8), &robot(8), &plan).unwrap().rows;

    // 540 windows: the deviation of a spread is 3 %, of a mean 4 % of the spread.
    for component in 0..6 {
        let (mean, sd) = spread(
            &rows
                .iter()
                .map(|row| row.load[component])
                .collect::<Vec<f64>>(),
        );
        let expected = if component < 3 { 1.0 } else { 0.05 };
        assert!(
            (sd / expected - 1.0).abs() < 0.12 && mean.abs() < 0.16 * expected,
            "{component}: {mean} {sd}"
        );
    }
    // A gauge has a zero in each series, and noise about it.
    let spreads = (0..9).map(|series| {
        let of_series = rows.iter().filter(|row| row.series == series);
        let readings: Vec<f64> = of_series.map(|row| row.readings_m[0].unwrap()).collect();
        spread(&readings)
    });
    let (zeros, sds): (Vec<f64>, Vec<f64>) = spreads.unzip();
    let pooled = (sds.iter().map(|sd| sd * sd).sum::<f64>() / 9.0).sqrt();
    assert!((pooled / 1e-6 - 1.0).abs() < 0.12, "{pooled:e}");
    assert!(spread(&zeros).1 > 20e-6, "{zeros:?}");
}

/// The whole chain, in which the moment is about the tool centre point where it is and the sensor
/// turns: a fit that knows neither must find the springs within its intervals, with a chi-squared
/// of one per degree of freedom.
#[test]
fn the_springs_are_found_within_their_intervals() {
    let folder = Folder::new("fit");
    let plan = plan_in(&folder, &campaign_a("", &LEVELS));
    let mut held = 0;
    let mut reduced = 0.0;
    let seeds = 20;
    for seed in 0..seeds {
        let robot = robot(seed);
        let simulated = simulate(&robot, &robot, &plan).unwrap();
        written(&folder, &plan, &simulated.rows);
        let answer = identified(&folder, &robot);
        let truth = simulated.truth.vector();
        for (parameter, truth) in answer["parameters"].as_array().unwrap().iter().zip(&truth) {
            let [low, high] = ["low95", "high95"].map(|key| parameter[key].as_f64().unwrap());
            held += usize::from((low..=high).contains(truth));
        }
        reduced += reduced_chi_squared(&answer) / f64::from(u32::try_from(seeds).unwrap());
    }
    // 180 intervals of 95 %, partly correlated: 171 expected, deviation about 3 to 4.
    assert!(held >= 158, "{held} of 180");
    // 20 times 801 degrees of freedom: the deviation of the mean is 1.1 %.
    assert!((reduced - 1.0).abs() < 0.04, "{reduced}");
}

/// Answer of an identification of `plan.toml` and its table.
fn identified(folder: &Folder, robot: &RobotFile<L2, 3>) -> serde_json::Value {
    let options = IdentifyOptions::new(folder.path("plan.toml"), "l2");
    serde_json::from_str(&identify(robot, &options).unwrap().json).unwrap()
}

fn reduced_chi_squared(answer: &serde_json::Value) -> f64 {
    answer["chi2"].as_f64().unwrap() / answer["dof"].as_f64().unwrap()
}

/// Set-up errors are in the data where they are stated: a fit that takes the set-up as exact then
/// does not describe them, and one that knows it about does.
#[test]
fn setup_errors_are_drawn() {
    let folder = Folder::new("setup");
    let plan = plan_in(&folder, &campaign_a(SETUP, &LEVELS));
    let mut robot = robot(4);
    robot.simulation.gauge_point_mm = 0.5;
    robot.simulation.gauge_axis_mrad = 2.0;
    written(
        &folder,
        &plan,
        &simulate(&robot, &robot, &plan).unwrap().rows,
    );
    // The deviation of a clean campaign is 0.05.
    let known_about = reduced_chi_squared(&identified(&folder, &robot));
    assert!((known_about - 1.0).abs() < 0.2, "{known_about}");
    let text = std::fs::read_to_string(folder.path("plan.toml")).unwrap();
    std::fs::write(folder.path("plan.toml"), text.replace(SETUP, "")).unwrap();
    let exact = reduced_chi_squared(&identified(&folder, &robot));
    assert!(exact > 1.3, "{exact}");
}
