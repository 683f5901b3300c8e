//! Rows that are grossly wrong: they are named and left out, and the machine is found from the
//! others.

use gantry_tau_test_support::seeds::Seeds;

use super::*;

/// Mistake of a row that is a copy where there is a second one.
const NOTHING: &str = "no reading at all, -999";

/// A mistake, and what it does.
type Mistake = (&'static str, fn(&mut [f64], usize));

/// Changes of a row of numbers: axes first, then the place.
const MISTAKES: [Mistake; 6] = [
    ("a coordinate 0.5 m off", |row, axes| row[axes] += 0.5),
    ("a coordinate 10 m off", |row, axes| row[axes + 1] -= 10.0),
    ("no reading, -999", |row, axes| row[axes + 2] = -999.0),
    (NOTHING, |row, axes| row[axes..axes + 3].fill(-999.0)),
    ("an axis 0.3 off", |row, _| row[1] += 0.3),
    ("centimetres", |row, axes| {
        row[axes..axes + 3]
            .iter_mut()
            .for_each(|value| *value *= 1e2)
    }),
];

/// Changes the rows of a table, by number, and returns the names of their poses.
fn spoil(setup: &Path, rows: &[usize], axes: usize, spoil: fn(&mut [f64], usize)) -> Vec<String> {
    let table = setup.with_file_name("poses.csv");
    let mut names = Vec::new();
    let text = fs::read_to_string(&table).unwrap();
    let lines = text.lines().enumerate().map(|(line, text)| {
        if !line.checked_sub(1).is_some_and(|row| rows.contains(&row)) {
            return text.to_owned();
        }
        let (name, numbers) = text.split_once(',').unwrap();
        let mut numbers: Vec<f64> = numbers
            .split(',')
            .map(|number| number.parse().unwrap())
            .collect();
        spoil(&mut numbers, axes);
        names.push(name.to_owned());
        format!(
            "{name},{}",
            numbers
                .iter()
                .map(|number| format!("{number:?}"))
                .collect::<Vec<_>>()
                .join(",")
        )
    });
    let lines: Vec<String> = lines.collect();
    fs::write(table, lines.join("\n") + "\n").unwrap();
    names
}

/// Names of the poses that were left out.
fn left_out(calibration: &Calibration) -> Vec<String> {
    let answer: serde_json::Value = serde_json::from_str(&calibration.json).unwrap();
    answer["outliers"]
        .as_array()
        .unwrap()
        .iter()
        .map(|outlier| outlier["pose"].as_str().unwrap().to_owned())
        .collect()
}

/// A number of rows of a table of `count`.
fn some_rows(draw: &mut Draw, count: u64, most: u64) -> Vec<usize> {
    let mut rows: Vec<usize> = (0..1 + draw.0.number() % most)
        .map(|_| usize::try_from(draw.0.number() % count).unwrap())
        .collect();
    rows.sort_unstable();
    rows.dedup();
    rows
}

#[test]
fn gross_rows_of_an_l2_are_named_and_left_out() {
    let folder = folder("gross");
    let mut draw = Draw(Noise::new(41));
    for trial in 0..24 {
        let (mistake, change) = MISTAKES[trial % MISTAKES.len()];
        let machine = true_machine(&mut draw);
        let positions = positions(&mut draw, 30);
        let setup = measure(&folder, &machine, &positions, &mut draw);
        let rows = some_rows(&mut draw, 30, if mistake == NOTHING { 1 } else { 3 });
        let names = spoil(&setup, &rows, AXES, change);
        let calibration = calibrate(&setup)
            .unwrap_or_else(|error| panic!("{trial}, {mistake}, {names:?}: {error}"));
        assert_eq!(left_out(&calibration), names, "{trial}: {mistake}");
        assert!(
            calibration.summary.contains(&names.join(", ")),
            "{}",
            calibration.summary
        );
        let away_m = apart_m(&l2("found", &calibration.robot_file), &machine, &positions);
        assert!(away_m < 0.5e-3, "{trial}, {mistake}: {away_m}");
    }
}

#[test]
fn gross_rows_of_an_f1_are_named_and_left_out() {
    let folder = folder("gross-f1");
    let mut draw = Draw(Noise::new(42));
    let robot = RobotFile::builtin_f1().unwrap();
    let seeds = Seeds::new(2, 6);
    for (trial, (mistake, change)) in seeds.spread(MISTAKES.into_iter().enumerate()) {
        let setup = measure_f1(&folder, &robot, 40, &f1_target(), 0.1, &mut draw);
        let rows = some_rows(&mut draw, 40, if mistake == NOTHING { 1 } else { 3 });
        let names = spoil(&setup, &rows, F1_AXES, change);
        let calibration = calibrate_f1(&robot, &options(&setup, "f1"))
            .unwrap_or_else(|error| panic!("{trial}, {mistake}, {names:?}: {error}"));
        assert_eq!(left_out(&calibration), names, "{trial}: {mistake}");
        assert!(
            calibration.summary.contains(&names.join(", ")),
            "{}",
            calibration.summary
        );
        // A tenth of the noise that is stated.
        assert!(
            calibration
                .doubts
                .iter()
                .any(|doubt| doubt.starts_with("the stated noise is ")),
            "{:?}",
            calibration.doubts
        );
    }
}
