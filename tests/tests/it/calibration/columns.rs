//! Columns of poses, points of its base and tables that are not what they should be: named, with
//! what to do.

use std::cell::RefCell;

use super::*;

/// Calibrates with a table whose rows are edited.
fn calibrate_edited(
    setup: &Path,
    table: &str,
    mut edit: impl FnMut(&mut [String]),
) -> Result<(), String> {
    let rows = table.lines().enumerate().map(|(row, line)| {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        if row > 0 {
            edit(&mut cells);
        }
        cells.join(",") + "\n"
    });
    let table: String = rows.collect();
    fs::write(setup.with_file_name("poses.csv"), table).unwrap();
    calibrate(setup)
        .map(|_| ())
        .map_err(|error| error.to_string())
}

fn negate(cell: &mut String) {
    *cell = (-cell.parse::<f64>().unwrap()).to_string();
}

/// A column with the wrong sign, two of them swapped, a left-handed frame, places a row late:
/// named, and how to mend it.
#[test]
fn columns_that_are_not_what_their_names_say_are_named() {
    let mut draw = Draw(Noise::new(11));
    let machine = true_machine(&mut draw);
    let seen = positions(&mut draw, 20);
    let folder = folder("columns");
    let setup = measure(&folder, &machine, &seen, &mut draw);
    let good = fs::read_to_string(folder.join("poses.csv")).unwrap();
    assert_eq!(calibrate_edited(&setup, &good, |_| ()), Ok(()));
    let expected = "poses.csv: column q_2: has the wrong sign; negate q_2";
    assert!(
        calibrate_edited(&setup, &good, |row| negate(&mut row[2]))
            .unwrap_err()
            .ends_with(expected)
    );
    let expected = "poses.csv: columns q_1, q_3: are in the place of each other; swap them";
    let swapped = calibrate_edited(&setup, &good, |row| row.swap(1, 3));
    assert!(swapped.unwrap_err().ends_with(expected));
    for mirrored in [
        calibrate_edited(&setup, &good, |row| negate(&mut row[5])),
        calibrate_edited(&setup, &good, |row| row.swap(4, 5)),
    ] {
        assert!(
            mirrored
                .unwrap_err()
                .contains("poses.csv: columns x_m, y_m, z_m: are in a left-handed frame")
        );
    }
    let mut last = ["1.0", "1.0", "1.0"].map(str::to_owned);
    let late = calibrate_edited(&setup, &good, |row| row[4..7].swap_with_slice(&mut last));
    let expected = "poses.csv: columns x_m, y_m, z_m: stand a row later than the others; move them up by a row";
    assert!(
        late.as_ref().is_err_and(|error| error.ends_with(expected)),
        "{late:?}"
    );
}

/// Error of a calibration of an F1 after a change of each row of its table.
fn refused(test: &str, change: &dyn Fn(&mut Vec<f64>)) -> Result<Calibration, String> {
    let folder = folder(test);
    let robot = RobotFile::builtin_f1().unwrap();
    let setup = measure_f1(
        &folder,
        &robot,
        30,
        &f1_target(),
        1.0,
        &mut Draw(Noise::new(51)),
    );
    let table = fs::read_to_string(folder.join("poses.csv")).unwrap();
    let (header, rows) = table.split_once('\n').unwrap();
    let changed = rows.lines().map(|line| {
        let (name, numbers) = line.split_once(',').unwrap();
        let mut numbers = numbers
            .split(',')
            .map(|number| number.parse().unwrap())
            .collect();
        change(&mut numbers);
        format!(
            "{name},{}\n",
            numbers
                .iter()
                .map(|number| format!("{number:?}"))
                .collect::<Vec<_>>()
                .join(",")
        )
    });
    fs::write(
        folder.join("poses.csv"),
        format!("{header}\n{}", changed.collect::<String>()),
    )
    .unwrap();
    calibrate_f1(&robot, &options(&setup, "f1")).map_err(|error| error.to_string())
}

#[test]
fn quaternions_and_plates_that_are_not_what_their_names_say_are_named() {
    type Change = (fn(&mut Vec<f64>), &'static str);
    let changes: [Change; 4] = [
        (|row| row[9..13].rotate_left(1), "hold x, y, z, w"),
        (
            |row| row[10..13].iter_mut().for_each(|part| *part = -*part),
            "are the inverse rotations; negate rot_x",
        ),
        (
            |row| row.swap(3, 4),
            "columns q_4, q_5: are in the place of each other",
        ),
        (
            |row| row.swap(4, 5),
            "columns q_5, q_6: are in the place of each other",
        ),
    ];
    for (change, words) in changes {
        let said = refused("f1-columns", &change).unwrap_err();
        assert!(said.contains(words), "{said}");
    }
    let last = RefCell::new(None);
    let said = refused("f1-columns", &|row| {
        let own = row.split_off(6);
        let first = [[1.0; 3].as_slice(), &own[3..]].concat();
        row.extend(last.replace(Some(own)).unwrap_or(first));
    })
    .unwrap_err();
    assert!(
        said.ends_with(
            "columns x_m, y_m, z_m: stand a row later than the others; move them up by a row"
        ),
        "{said}"
    );
    refused("f1-columns", &|row| {
        for part in &mut row[9..13] {
            *part = (*part * 1e4).round() / 1e4;
        }
    })
    .unwrap();
    let said = refused("f1-columns", &|row| row[9] *= 1.1).unwrap_err();
    assert!(
        said.contains("rot_w: the quaternion has length 1.0"),
        "{said}"
    );
}

/// Calibrates with three holes of the base, seen in this order.
fn calibrate_by_points(setup: &Path, order: [usize; 3]) -> Result<Calibration, CalibrateError> {
    let holes = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.8, 0.0]].map(Vector3::from);
    let mut text = "format = \"gantry-tau frame 1\"\n".to_owned();
    for (index, hole) in order.into_iter().enumerate() {
        let robot: [f64; 3] = holes[index].into();
        let seen: [f64; 3] = apply(&tracker(), &holes[hole]).into();
        text += &format!(
            "[[point]]\nname = \"hole {index}\"\nrobot_m = {robot:?}\nmeasured_m = {seen:?}\n"
        );
    }
    let path = setup.with_file_name("frame.toml");
    fs::write(&path, text).unwrap();
    let options = CalibrateOptions {
        frame: FrameOption::Points(path),
        ..options(setup, "l2")
    };
    calibrate_l2(&RobotFile::builtin_l2().unwrap(), &options)
}

/// Found from outside: two holes of the base in the place of each other turned the machine over,
/// with exit code 0.
#[test]
fn points_of_the_base_in_the_place_of_each_other_are_named() {
    let mut draw = Draw(Noise::new(52));
    let machine = true_machine(&mut draw);
    let folder = folder("swapped-points");
    let positions = positions(&mut draw, 30);
    let setup = measure(&folder, &machine, &positions, &mut draw);
    calibrate_by_points(&setup, [0, 1, 2]).unwrap();
    let said = calibrate_by_points(&setup, [1, 0, 2]).unwrap_err();
    let said = said.to_string();
    assert!(
        said.contains("frame.toml: point: the points put the robot's frame")
            && said.contains("180 degrees"),
        "{said}"
    );
}

#[test]
fn tables_with_other_separators_are_told() {
    let folder = folder("separators");
    let mut draw = Draw(Noise::new(53));
    let positions = positions(&mut draw, 10);
    let setup = measure(&folder, &true_machine(&mut draw), &positions, &mut draw);
    let table = fs::read_to_string(folder.join("poses.csv")).unwrap();
    for (separator, shown) in [(";", "';'"), ("\t", "'\\t'")] {
        fs::write(folder.join("poses.csv"), table.replace(',', separator)).unwrap();
        let said = calibrate(&setup).unwrap_err().to_string();
        assert!(
            said.contains(&format!(
                "poses.csv:1: columns are separated by {shown}; expected ','"
            )),
            "{said}"
        );
    }
    fs::remove_file(folder.join("poses.csv")).unwrap();
    assert!(
        calibrate(&setup)
            .unwrap_err()
            .to_string()
            .ends_with("poses.csv: No such file or directory")
    );
}
