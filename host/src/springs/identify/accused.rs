//! Mistakes that people make with a campaign are refused or named, and campaigns without one are accused of nothing.

use gantry_tau_core::model::linalg::cross_matrix;
use nalgebra::{Matrix6, Rotation3, Vector3};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::response::first_quiet;
use super::weak::{GAP_M, KINDS, OPENS_AT_N, measured, on_home, options, seeds, strap};
use super::*;
use crate::fit::answer::Parameter;
use crate::measurements::mistaken_columns::MistakenColumns;
use crate::measurements::springs::{Noise, Window};
use crate::measurements::wrench_columns::{WrenchColumns, WrenchMap};
use crate::robot_file::RobotFile;
use crate::springs::campaigns::{Bench, FINE, HOOKS, Strap, campaign_a, never, normal, seeded, straps};

/// Spoils a campaign; returns the gauge that an error should name, if it should name one.
type Spoil<const N: usize> = fn(&mut Bench<N>, &mut ChaCha8Rng) -> Option<usize>;

/// A mistake, and the words that an error should have.
struct Mistake<const N: usize>(&'static str, &'static str, Spoil<N>);

/// Verdict over a campaign.
#[derive(Debug, PartialEq)]
enum Verdict {
    /// Refused, with the error.
    Refused(String),
    /// Exit code 3, with what is said beside springs that are not seen.
    Doubted(Vec<String>),
    /// Springs are not seen, which is exit code 3 too.
    Unseen,
    /// Exit code 0, and the largest deviation of a spring beyond three of its standard deviations, in true values.
    Written(f64),
}

fn verdict<const N: usize>(bench: &Bench<N>, truth: &[f64]) -> Verdict {
    let found = match examined(&bench.question(), &options()) {
        Err(error) => return Verdict::Refused(error.to_string()),
        Ok(found) => found,
    };
    let answer = found.answer("l2");
    let all = found.doubts(&answer);
    let is_of_springs = |doubt: &String| doubt.contains("not observable") || doubt.contains("does not measure it");
    let (unseen, doubts): (Vec<String>, Vec<String>) = all.into_iter().partition(is_of_springs);
    let off = |(index, truth): (usize, &f64)| {
        let Parameter { value, sd, .. } = answer.parameters[index];
        if (value - truth).abs() > 3.0 * sd { (value / truth - 1.0).abs() } else { 0.0 }
    };
    match (doubts.is_empty(), unseen.is_empty()) {
        (false, _) => Verdict::Doubted(doubts),
        (true, false) => Verdict::Unseen,
        (true, true) => Verdict::Written(truth.iter().enumerate().map(off).fold(0.0, f64::max)),
    }
}

/// A campaign without a mistake, and the true springs.
fn good<const N: usize>(mut bench: Bench<N>, seed: u64) -> (Bench<N>, Vec<f64>) {
    let mut random = seeded(seed);
    let truth = bench.true_springs(&mut random);
    bench.measure(&truth, &mut random, 0.0, never);
    (bench, truth.vector().as_slice().to_vec())
}

fn gauge_name<const N: usize>(bench: &Bench<N>, gauge: usize) -> String {
    bench.campaign.gauges[gauge].name.to_string()
}

fn scaled<const N: usize>(bench: &mut Bench<N>, columns: &[usize], factor: f64) -> Option<usize> {
    for window in &mut bench.campaign.windows {
        columns.iter().for_each(|column| window.load[*column] *= factor);
    }
    None
}

fn swapped<const N: usize>(bench: &mut Bench<N>, one: usize, other: usize) -> Option<usize> {
    bench.campaign.windows.iter_mut().for_each(|window| window.load.swap_rows(one, other));
    None
}

/// A gauge that shows one number from a row on, in a table of this resolution, m.
fn stuck<const N: usize>(bench: &mut Bench<N>, random: &mut ChaCha8Rng, resolution_m: f64) -> Option<usize> {
    let gauge = random.random_range(0..bench.campaign.gauges.len());
    let rows = bench.campaign.windows.len();
    let from = random.random_range(rows / 5..rows * 4 / 5);
    let round = |value: f64| if resolution_m > 0.0 { (value / resolution_m).round() * resolution_m } else { value };
    let stuck = bench.campaign.windows[from].readings_m[gauge];
    for (row, window) in bench.campaign.windows.iter_mut().enumerate() {
        if row > from {
            window.readings_m[gauge] = stuck;
        }
        window.readings_m.iter_mut().for_each(|reading| *reading = reading.map(round));
    }
    Some(gauge)
}

/// A gauge that shows a third of its noise, and nothing else, from a row on.
fn still<const N: usize>(bench: &mut Bench<N>, random: &mut ChaCha8Rng, from: usize) -> Option<usize> {
    let gauge = random.random_range(0..bench.campaign.gauges.len());
    let noise_m = 0.3e-6 * bench.campaign.noise.gauge_um;
    let stuck = bench.campaign.windows[from].readings_m[gauge];
    for window in bench.campaign.windows.iter_mut().skip(from) {
        window.readings_m[gauge] = stuck.map(|reading| reading + noise_m * normal(random));
    }
    Some(gauge)
}

/// Readings of a gauge are cut at a share of the way to their largest.
fn cut_gauge<const N: usize>(bench: &mut Bench<N>, random: &mut ChaCha8Rng) -> Option<usize> {
    let gauge = random.random_range(0..bench.campaign.gauges.len());
    let readings: Vec<f64> = bench.campaign.windows.iter().filter_map(|window| window.readings_m[gauge]).collect();
    let mut sorted = readings;
    sorted.sort_by(f64::total_cmp);
    let most = sorted[sorted.len() * 3 / 4];
    for window in &mut bench.campaign.windows {
        window.readings_m[gauge] = window.readings_m[gauge].map(|reading| reading.min(most));
    }
    Some(gauge)
}

/// A component of the load is cut at half of its largest magnitude.
fn cut_load<const N: usize>(bench: &mut Bench<N>, component: usize) -> Option<usize> {
    let largest = bench.campaign.windows.iter().map(|window| window.load[component].abs()).fold(0.0, f64::max);
    for window in &mut bench.campaign.windows {
        window.load[component] = window.load[component].clamp(-0.5 * largest, 0.5 * largest);
    }
    None
}

/// Readings of one row stand in the next.
fn late<const N: usize>(bench: &mut Bench<N>) -> Option<usize> {
    let readings: Vec<_> = bench.campaign.windows.iter().map(|window| window.readings_m.clone()).collect();
    for (window, earlier) in bench.campaign.windows.iter_mut().skip(1).zip(readings) {
        window.readings_m = earlier;
    }
    None
}

/// Spoils the readings of a gauge on a cart of an L2, or on a plate of an F1, series by series: displacements from the first reading there, and the largest of them.
fn of_axis<const N: usize>(
    bench: &mut Bench<N>,
    random: &mut ChaCha8Rng,
    spoil: impl Fn(f64, f64, f64, i8) -> f64,
) -> Option<usize> {
    let gauge = random.random_range(bench.campaign.gauges.len() - 3..bench.campaign.gauges.len());
    let noise_m = 1e-6 * bench.campaign.noise.gauge_um;
    let of_series = |windows: &[Window<N>]| {
        let readings: Vec<f64> = windows.iter().filter_map(|window| window.readings_m[gauge]).collect();
        let displacements = readings.iter().map(|reading| reading - readings[0]);
        displacements.fold(0.0, |most: f64, one| if one.abs() > most.abs() { one } else { most })
    };
    let series = bench.campaign.windows.chunk_by(|one, other| one.series == other.series);
    let largest = series.map(of_series).fold(0.0, |most: f64, one| if one.abs() > most.abs() { one } else { most });
    for windows in bench.campaign.windows.chunk_by_mut(|one, other| one.series == other.series) {
        let (first, way) = (windows[0].readings_m[gauge]?, of_series(windows).signum());
        for window in windows {
            let noise = noise_m * normal(random);
            let stroke = window.stroke * if way < 0.0 { -1 } else { 1 };
            window.readings_m[gauge] =
                window.readings_m[gauge].map(|reading| first + spoil(reading - first, largest, noise, stroke));
        }
    }
    Some(gauge)
}

const ALL: [usize; 6] = [0, 1, 2, 3, 4, 5];

fn gauge_scaled<const N: usize>(bench: &mut Bench<N>, random: &mut ChaCha8Rng, factor: f64) -> Option<usize> {
    let gauge = random.random_range(0..bench.campaign.gauges.len());
    for window in &mut bench.campaign.windows {
        window.readings_m[gauge] = window.readings_m[gauge].map(|reading| reading * factor);
    }
    Some(gauge)
}

/// Adds copies of ten rows, under other names.
fn copied<const N: usize>(bench: &mut Bench<N>, random: &mut ChaCha8Rng) -> Option<usize> {
    let rows = bench.campaign.windows.len();
    for number in 0..10 {
        let mut copy = bench.campaign.windows[random.random_range(0..rows)].clone();
        copy.window = crate::output::Name::made(100 + number);
        bench.campaign.windows.push(copy);
    }
    None
}

const fn mistakes<const N: usize>() -> [Mistake<N>; 31] {
    [
        Mistake("load negated", "force_x_n, force_y_n", |bench, _| scaled(bench, &ALL, -1.0)),
        Mistake("forces negated", "force_x_n, force_y_n", |bench, _| scaled(bench, &ALL[..3], -1.0)),
        Mistake("moments negated", "moment_x_n_m, moment_y_n_m", |bench, _| scaled(bench, &ALL[3..], -1.0)),
        Mistake("force_z negated", "force_z_n", |bench, _| scaled(bench, &[2], -1.0)),
        Mistake("moment_y negated", "moment_y_n_m", |bench, _| scaled(bench, &[4], -1.0)),
        Mistake("a gauge negated", "", |bench, random| gauge_scaled(bench, random, -1.0)),
        Mistake("a gauge in mm", "", |bench, random| gauge_scaled(bench, random, 1e-3)),
        Mistake("forces in kg", "force_x_n, force_y_n", |bench, _| scaled(bench, &ALL[..3], 1.0 / 9.806_65)),
        Mistake("forces in kN", "", |bench, _| scaled(bench, &ALL[..3], 1e-3)),
        Mistake("moments in N mm", "moment_x_n_m, moment_y_n_m", |bench, _| scaled(bench, &ALL[3..], 1e3)),
        Mistake("all in kgf", "kgf is 9.81 N", |bench, _| scaled(bench, &ALL, 1.0 / 9.806_65)),
        Mistake("all in lbf", "lbf is 4.45 N", |bench, _| scaled(bench, &ALL, 1.0 / 4.448_22)),
        Mistake("all in daN", "daN is 10.00 N", |bench, _| scaled(bench, &ALL, 0.1)),
        Mistake("force_x and force_y swapped", "", |bench, _| swapped(bench, 0, 1)),
        Mistake("moment_x and moment_y swapped", "", |bench, _| swapped(bench, 3, 4)),
        Mistake("axes of forces in turn", "write force_z_n, force_x_n, force_y_n in their place", |bench, _| {
            swapped(bench, 0, 1).or_else(|| swapped(bench, 1, 2))
        }),
        Mistake("a left-handed sensor", "write force_y_n, force_x_n, moment_y_n_m, moment_x_n_m", |bench, _| {
            swapped(bench, 0, 1).or_else(|| swapped(bench, 3, 4))
        }),
        Mistake("a sensor turned about z", "write -force_y_n, force_x_n, -moment_y_n_m, moment_x_n_m", |bench, _| {
            swapped(bench, 0, 1).or_else(|| swapped(bench, 3, 4));
            scaled(bench, &[1, 4], -1.0)
        }),
        Mistake("a sensor upside down", "write -force_y_n, -force_z_n, -moment_y_n_m, -moment_z_n_m", |bench, _| {
            scaled(bench, &[1, 2, 4, 5], -1.0)
        }),
        Mistake("two gauges swapped", "", |bench, random| {
            let count = bench.campaign.gauges.len();
            let (one, by) = (random.random_range(0..count), random.random_range(1..count));
            bench.campaign.windows.iter_mut().for_each(|window| window.readings_m.swap(one, (one + by) % count));
            None
        }),
        Mistake("readings a row late", "these columns stand a row later than the others", |bench, _| late(bench)),
        Mistake("a gauge stuck", "stands still", |bench, random| stuck(bench, random, 0.0)),
        Mistake("a gauge stuck, 0.1 um", "measure them again", |bench, random| stuck(bench, random, 1e-7)),
        Mistake("a gauge stuck, 0.5 um", "", |bench, random| stuck(bench, random, 5e-7)),
        Mistake("a gauge without contact", "", |bench, random| still(bench, random, 0)),
        Mistake("a gauge that comes loose", "", |bench, random| {
            let rows = bench.campaign.windows.len();
            let from = random.random_range(rows / 5..rows * 4 / 5);
            still(bench, random, from)
        }),
        Mistake("a gauge cut", "end of the instrument's range", cut_gauge),
        Mistake("a moment cut", "end of the instrument's range", |bench, random| {
            cut_load(bench, random.random_range(3..5))
        }),
        Mistake("a force cut", "end of the instrument's range", |bench, random| {
            cut_load(bench, random.random_range(0..3))
        }),
        Mistake("rows copied", "window", copied),
        Mistake("noise three times too large", "the stated noise is", |bench, _| {
            bench.campaign.noise.gauge_um *= 3.0;
            bench.campaign.noise.force_n *= 3.0;
            bench.campaign.noise.moment_nm *= 3.0;
            None
        }),
    ]
}

/// Errors of a gauge on an axis that the readings show by their form alone.
const fn mistakes_of_instruments<const N: usize>() -> [Mistake<N>; 3] {
    [
        Mistake("a gauge that lags", "", |bench, random| {
            of_axis(bench, random, |moved, largest, _, stroke| moved - f64::from(stroke) * 0.25 * largest.abs())
        }),
        Mistake("a gauge with play", "", |bench, random| {
            of_axis(bench, random, |moved, largest, noise, _| {
                let play = 0.35 * largest.abs();
                if moved.abs() > play { moved - play.copysign(moved) } else { noise }
            })
        }),
        Mistake("a gauge that runs onto its end", "", |bench, random| {
            of_axis(bench, random, |moved, largest, noise, _| {
                let is_beyond = moved * largest > 0.0 && moved.abs() > 0.4 * largest.abs();
                if is_beyond { 0.4 * largest + noise } else { moved }
            })
        }),
    ]
}

fn f1() -> Bench<6> {
    f1_with(FINE)
}

/// Nine straps at home, each of seven windows.
fn f1_with(noise: Noise) -> Bench<6> {
    let robot = RobotFile::builtin_f1().unwrap();
    let straps: Vec<Strap> = straps(1, &HOOKS)
        .into_iter()
        .map(|full| Strap { hook: full.hook, ..strap(full.direction, 300.0, 3) })
        .collect();
    Bench::new(&robot, &[robot.home_m().into()], &straps, noise)
}

#[test]
fn mistakes_with_an_l2_are_refused_or_named() {
    assert_named(mistakes(), || campaign_a(FINE));
}

/// Found by an independent examination: springs of stiff axes that were half as soft as they are, with exit code 0. A cart of an L2 moves by a few
/// micrometres, a plate of an F1 by less: of a gauge with a noise of one micrometre it is half a matter of luck, and fine gauges show their errors.
#[test]
fn errors_of_instruments_are_refused_or_named() {
    let fine = |gauge_um: f64| Noise { gauge_um, ..FINE };
    let [lag, play, end] = mistakes_of_instruments();
    assert_named([lag, play], || campaign_a(fine(0.2)));
    let [lag, play, _] = mistakes_of_instruments();
    assert_named([lag, play], || f1_with(fine(0.1)));
    // Readings that are cut are few, and left out: named or not, the springs are right.
    let Mistake(.., spoil) = end;
    let wrong = (0..seeds(1)).filter(|seed| {
        let (mut bench, truth) = good(campaign_a(fine(0.2)), *seed);
        spoil(&mut bench, &mut seeded(1_000 + seed));
        matches!(verdict(&bench, &truth), Verdict::Written(off) if off > 0.0)
    });
    let wrong = wrong.count();
    assert!(20 * wrong <= usize::try_from(seeds(1)).unwrap(), "{wrong} of {}", seeds(1));
}

#[test]
fn mistakes_with_an_f1_are_refused_or_named() {
    assert_named(mistakes(), f1);
}

/// A table of ticks has what the sensor shows about its own origin, along its own axes.
#[test]
fn columns_of_a_sensor_are_named_along_its_axes() {
    let turn = Rotation3::from_scaled_axis(Vector3::new(0.4, -0.7, 0.3)).into_inner();
    let mut load_of_columns = Matrix6::zeros();
    load_of_columns.fixed_view_mut::<3, 3>(0, 0).copy_from(&turn);
    load_of_columns.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn);
    load_of_columns.fixed_view_mut::<3, 3>(3, 0).copy_from(&(cross_matrix(&Vector3::new(0.02, 0.01, 0.12)) * turn));
    let map = WrenchMap { load_of_columns, columns_of_load: load_of_columns.try_inverse().unwrap() };
    let names = ["sensor_x", "sensor_y", "sensor_z", "sensor_mx", "sensor_my", "sensor_mz"];
    let mistakes =
        MistakenColumns::all(names).filter(|mistake| mistake.columns.len() <= 3 && mistake.mended.amax() < 100.0);
    let mut count = 0;
    for mistake in mistakes {
        let (mut bench, truth) = good(campaign_a(FINE), 5);
        bench.campaign.wrench = WrenchColumns { names, maps: vec![map] };
        let spoiled = mistake.mended.try_inverse().unwrap();
        bench.campaign.windows.iter_mut().for_each(|window| window.load = map.mended(&spoiled, &window.load));
        let Verdict::Refused(said) = verdict(&bench, &truth) else { panic!("{mistake:?}") };
        assert!(said.contains(&format!("{}: {}", mistake.list(&names), mistake.reason)), "{mistake:?}: {said}");
        count += 1;
    }
    assert_eq!(count, 20);
}

fn assert_named<const N: usize, const M: usize>(mistakes: [Mistake<N>; M], planned: impl Fn() -> Bench<N>) {
    let mut failures = Vec::new();
    for Mistake(name, words, spoil) in mistakes {
        let (mut rightly, mut count) = (0, 0);
        let mut example = String::new();
        for seed in 0..seeds(1) {
            let (mut bench, truth) = good(planned(), seed);
            let gauge = spoil(&mut bench, &mut seeded(1_000 + seed)).map(|gauge| gauge_name(&bench, gauge));
            let verdict = verdict(&bench, &truth);
            let said = match &verdict {
                Verdict::Refused(said) => said.clone(),
                Verdict::Doubted(doubts) => doubts.join("; "),
                Verdict::Unseen => String::new(),
                Verdict::Written(off) => {
                    if *off > 0.2 {
                        failures.push(format!("{name}, seed {seed}: written, {:.0} % off", off * 100.0));
                    }
                    String::new()
                }
            };
            count += 1;
            let is_right =
                !said.is_empty() && said.contains(words) && gauge.as_ref().is_none_or(|gauge| said.contains(gauge));
            rightly += u32::from(is_right);
            if example.is_empty() || !is_right {
                example = format!("seed {seed}: {said}");
            }
        }
        if f64::from(rightly) < 0.95 * f64::from(count) {
            failures.push(format!("{name}: {rightly} of {count} rightly; {example}"));
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// Asserts that at most one of a hundred campaigns is accused.
fn assert_accused_of_nothing<const N: usize>(name: &str, campaign: impl Fn(u64) -> (Bench<N>, Vec<f64>)) {
    let count = seeds(6);
    let accused = (0..count).filter_map(|seed| {
        let (bench, truth) = campaign(seed);
        match verdict(&bench, &truth) {
            Verdict::Refused(said) => Some(format!("seed {seed}: {said}")),
            Verdict::Doubted(doubts) => Some(format!("seed {seed}: {}", doubts.join("; "))),
            Verdict::Unseen | Verdict::Written(_) => None,
        }
    });
    let accused: Vec<String> = accused.collect();
    let is_few = 100 * accused.len() <= usize::try_from(count).unwrap().max(100);
    assert!(is_few, "{name}: {} of {count}: {}", accused.len(), accused.join("\n"));
}

#[test]
fn campaigns_without_a_mistake_are_accused_of_nothing() {
    assert_accused_of_nothing("nine straps", |seed| good(campaign_a(FINE), seed));
    assert_accused_of_nothing("nine straps, F1", |seed| good(f1(), seed));
    for kind in &KINDS {
        assert_accused_of_nothing(kind.name, |seed| measured(kind, &mut seeded(seed)));
    }
    // A tare at the beginning of a series reads zero, and so does what was typed at its end.
    assert_accused_of_nothing("series that begin and end with a load of zero", |seed| {
        let (mut bench, truth) = good(campaign_a(FINE), seed);
        for series in bench.campaign.windows.chunk_by_mut(|one, other| one.series == other.series) {
            for end in [0, series.len() - 1] {
                series[end].load.fill(0.0);
            }
        }
        (bench, truth)
    });
    // Readings and loads as coarse instruments show them.
    for resolution_um in [0.1_f64, 0.5, 1.0] {
        assert_accused_of_nothing(&format!("a resolution of {resolution_um} um"), |seed| {
            let (mut bench, truth) = good(campaign_a(FINE), seed);
            let step = resolution_um * 1e-6;
            bench.campaign.noise.gauge_um = (1.0_f64 + resolution_um.powi(2) / 12.0).sqrt();
            for window in &mut bench.campaign.windows {
                for reading in &mut window.readings_m {
                    *reading = reading.map(|reading| (reading / step).round() * step);
                }
                window.load = window.load.map(|value| (value * 50.0).round() / 50.0);
            }
            (bench, truth)
        });
    }
}

/// Further campaigns, whose stiff axes hardly move.
#[test]
fn a_gauge_that_has_nothing_to_show_is_not_stuck() {
    let straps = [strap(Vector3::y(), 100.0, 5), strap(Vector3::z(), 100.0, 5)];
    for seed in 0..seeds(6) {
        let mut random = seeded(seed);
        let mut bench = on_home(&straps);
        let truth = bench.true_springs(&mut random);
        bench.measure(&truth, &mut random, 0.0, never);
        let verdict = verdict(&bench, truth.vector().as_slice());
        assert!(!matches!(verdict, Verdict::Refused(_)), "{verdict:?}");
    }
}

/// A play that opens at less than half of the expected preload is doubted; one where it is expected is not.
#[test]
fn a_play_needs_forces_beyond_half_of_the_expected_preload() {
    let robot = RobotFile::builtin_l2().unwrap();
    for (opens_at_n, is_doubted) in [(OPENS_AT_N, false), (0.3 * OPENS_AT_N, true)] {
        let mut bench = on_home(&[Vector3::x(), Vector3::y(), Vector3::z()].map(|along| strap(along, 480.0, 12)));
        let mut random = seeded(5);
        let truth = bench.true_springs(&mut random);
        bench.measure(&truth, &mut random, GAP_M, |cluster_3_n, _| f64::from(u8::from(cluster_3_n < opens_at_n)));
        let found = examined(&bench.question(), &options()).unwrap();
        assert!(found.play.is_some(), "opens at {opens_at_n} N");
        let doubt = found.unexpected_play(&robot);
        assert_eq!(doubt.is_some(), is_doubted, "{doubt:?}");
        assert!(doubt.is_none_or(|doubt| doubt.starts_with("a play is found that opens at a preload of ")));
    }
}

/// Sentences about gauges and springs, each check by itself, of an F1 whose readings of one gauge were changed.
fn told(gauge: usize, change: impl Fn(usize, f64, &mut ChaCha8Rng) -> f64) -> [Vec<String>; 4] {
    let ((mut bench, _), mut random) = (good(f1(), 0), seeded(9));
    for (row, window) in bench.campaign.windows.iter_mut().enumerate() {
        window.readings_m[gauge] = window.readings_m[gauge].map(|reading| change(row, reading, &mut random));
    }
    let found = find(bench.question(), &options()).unwrap();
    [found.uneven(), found.quiet(), found.far_off(), found.mostly_left_out().collect()]
}

/// Each check finds its own, whether or not another one does; gauge 11 is that of the last plate.
#[test]
fn checks_of_gauges_and_springs_find_their_own() {
    assert_eq!(told(11, |_, reading, _| reading).concat(), [""; 0]);
    let [_, quiet, ..] = told(11, |_, _, random| 0.2e-6 * normal(random));
    assert!(quiet.concat().contains("axis6 scatters from series 0 on by 0.2"), "{quiet:?}");
    let [uneven, ..] = told(11, |_, reading, _| -reading);
    assert!(uneven.concat().contains("gauge axis6 shows "), "{uneven:?}");
    let [.., left_out] =
        told(0, |row, reading, random| reading + if row % 3 == 0 { 40e-6 * normal(random) } else { 0.0 });
    assert!(left_out.concat().contains(" readings of gauge pz1 do not agree"), "{left_out:?}");
}

/// Each form of an error of a gauge is named by what it is.
#[test]
fn errors_of_a_gauge_are_named_by_their_form() {
    let told = |spoil: fn(f64, f64, f64, i8) -> f64| {
        let (mut bench, _) = good(campaign_a(Noise { gauge_um: 0.3, ..FINE }), 4);
        of_axis(&mut bench, &mut seeded(5), spoil);
        let found = find(bench.question(), &options()).unwrap();
        found.instrument_errors().into_iter().chain(found.often_shifted()).collect::<Vec<_>>()
    };
    assert_eq!(told(|moved, _, _, _| moved), [""; 0]);
    let lagging = told(|moved, largest, _, stroke| moved - f64::from(stroke) * 0.25 * largest.abs());
    assert!(lagging.concat().contains(" lags behind the load"), "{lagging:?}");
    let ended = told(|moved, largest, noise, _| if moved / largest > 0.4 { 0.4 * largest + noise } else { moved });
    assert!(ended.len() == 1 && ended[0].contains("does not respond to large and small loads alike"), "{ended:?}");
    let (mut bench, _) = good(campaign_a(FINE), 4);
    let windows_of_series = 11;
    for (row, window) in bench.campaign.windows.iter_mut().enumerate() {
        let minutes = f64::from(u32::try_from(row % windows_of_series).unwrap());
        window.time_s = Some(60.0 * minutes);
        window.readings_m[7] = window.readings_m[7].map(|reading| reading + 0.5e-6 * minutes);
    }
    let drifting = find(bench.question(), &options()).unwrap().instrument_errors();
    assert!(drifting.len() == 1 && drifting[0].contains("gauge axis2 drifts with the time"), "{drifting:?}");
}

/// Found by an independent examination: links 20 % too soft, of a sensor whose gain falls with the force.
#[test]
fn a_force_sensor_that_is_not_linear_is_named() {
    let (mut bench, _) = good(campaign_a(FINE), 4);
    for window in &mut bench.campaign.windows {
        window.load *= 1.0 - 0.1 * window.load.fixed_rows::<3>(0).norm() / 300.0;
    }
    let told = find(bench.question(), &options()).unwrap().instrument_errors();
    assert!(told.len() == 1 && told[0].contains("do not rise in proportion to the loads"), "{told:?}");
}

/// Without a stated noise the residuals are their own measure, and without repeats nothing else is.
#[test]
fn large_residuals_without_noise_and_repeats_are_not_believed() {
    for (noise_um, is_doubted) in [(1.0, false), (4.0, true)] {
        let (mut bench, _) = good(campaign_a(Noise { gauge_um: noise_um, ..FINE }), 4);
        bench.campaign.windows.retain(|window| window.stroke > 0);
        (bench.campaign.noise, bench.campaign.is_noise_stated) = (FINE, false);
        let found = find(bench.question(), &options()).unwrap();
        let doubt = found.lack_of_fit(true);
        assert_eq!(doubt.is_some(), is_doubted, "{noise_um} um: {doubt:?}");
        assert!(doubt.is_none_or(|doubt| doubt.contains("no level was measured twice")));
    }
}

#[test]
fn more_than_a_tenth_of_the_readings_left_out_is_a_doubt() {
    for (every, is_doubt) in [(12, false), (8, true)] {
        let (mut bench, _) = good(campaign_a(FINE), 4);
        let readings = bench.campaign.windows.iter_mut().flat_map(|window| &mut window.readings_m).flatten();
        for (index, reading) in readings.skip(3).step_by(every).enumerate() {
            *reading += if index % 2 == 0 { 40e-6 } else { -40e-6 };
        }
        let found = find(bench.question(), &options()).unwrap();
        let answer = found.answer("l2");
        let said = found.doubts(&answer).iter().any(|doubt| doubt.contains("of 891 readings do not agree"));
        assert_eq!(said, is_doubt, "one in {every}: {}", answer.outliers.len());
    }
}

/// A plate's gauge that is reversed makes its spring negative, and one that comes loose may keep the fit from an end: both are named.
#[test]
fn a_fit_that_fails_names_the_gauge() {
    let refused = |words: &str, gauge: usize, spoil: &dyn Fn(&mut Bench<6>)| {
        let (mut bench, truth) = good(f1(), 53);
        spoil(&mut bench);
        let Verdict::Refused(said) = verdict(&bench, &truth) else { panic!("not refused") };
        assert!(said.contains(words) && said.contains(&gauge_name(&bench, gauge)), "{said}");
    };
    refused("would be negative", 10, &|bench| {
        for window in &mut bench.campaign.windows {
            window.readings_m[10] = window.readings_m[10].map(|reading| -reading);
        }
    });
    let (mut bench, _) = good(f1(), 53);
    assert!(first_quiet(&bench.campaign).is_none());
    still(&mut bench, &mut seeded(1), 30);
    let said = first_quiet(&bench.campaign).map(|error| error.to_string());
    assert!(said.is_some_and(|said| said.contains(" of its noise: it is stuck")));
    bench.campaign.is_noise_stated = false;
    assert!(first_quiet(&bench.campaign).is_none(), "no noise is stated");
}

/// A part that is softer than its file by far, and no other.
#[test]
fn a_spring_that_is_far_from_the_files_is_told() {
    let (mut bench, mut random) = (f1(), seeded(1));
    let mut springs = bench.file.vector();
    springs[11] *= 4.0;
    let truth = bench.file.with(&springs);
    bench.measure(&truth, &mut random, 0.0, never);
    let found = find(bench.question(), &options()).unwrap();
    let told = found.far_off();
    assert!(told.len() == 1 && told.concat().starts_with("c_act[5] is "), "{told:?}");
    assert_eq!([found.uneven(), found.quiet()].concat(), [""; 0]);
}

/// The advice of `[T 6.1]` is about gauges on carts: not about those on the platform, nor on plates.
#[test]
fn another_place_is_advised_for_gauges_on_carts() {
    let (bench, _) = good(f1(), 0);
    let found = find(bench.question(), &options()).unwrap();
    let advised = (0..bench.campaign.gauges.len()).filter(|gauge| !found.another_place(&[*gauge]).is_empty());
    let names: Vec<String> = advised.map(|gauge| gauge_name(&bench, gauge)).collect();
    assert_eq!(names, ["axis1", "axis2", "axis3"]);
}

/// The readings from there on were left out one by one, 14 of 756, and nothing was said: the springs are right, and the gauge wants mending.
#[test]
fn a_gauge_that_comes_loose_near_the_end_is_named() {
    for seed in [4, 57] {
        let (mut bench, truth) = good(f1(), seed);
        // As the mistake of this seed: gauge pz3 or pz2 from row 49 of 63 on.
        let mut random = seeded(1_000 + seed);
        let from = random.random_range(12..50);
        let gauge = still(&mut bench, &mut random, from).unwrap();
        let Verdict::Doubted(doubts) = verdict(&bench, &truth) else { panic!("seed {seed}") };
        let name = gauge_name(&bench, gauge);
        assert!(
            doubts.iter().any(|doubt| doubt.starts_with(&format!("gauge {name} scatters from series"))),
            "{doubts:?}"
        );
    }
}
