//! A device that was moved between two poses.

use super::*;

const POSES: usize = 40;

/// Shifts the places of a table from a row on; `first` is the column of x.
fn shift(folder: &Path, row: usize, first: usize, by_m: Vector3<f64>) {
    let path = folder.join("poses.csv");
    let table = fs::read_to_string(&path).unwrap();
    let shifted = table.lines().enumerate().map(|(line, text)| {
        let mut cells: Vec<String> = text.split(',').map(str::to_owned).collect();
        if line > row {
            for (cell, by_m) in cells[first..first + 3].iter_mut().zip(&by_m) {
                *cell = format!("{:?}", cell.parse::<f64>().unwrap() + by_m);
            }
        }
        cells.join(",") + "\n"
    });
    fs::write(path, shifted.collect::<String>()).unwrap();
}

fn told(calibration: &Calibration) -> Option<&String> {
    calibration
        .doubts
        .iter()
        .find(|doubt| doubt.contains("the device or the machine was moved"))
}

/// Motions of the size of a few deviations of the noise, 50 um, that leave all poses in the fit.
#[test]
fn a_device_that_was_moved_is_told_for_an_l2() {
    let mut found = 0;
    for seed in 0..20 {
        let folder = folder(&format!("moved-l2-{seed}"));
        let mut draw = Draw(Noise::new(300 + seed));
        let machine = true_machine(&mut draw);
        let setup = measure(&folder, &machine, &positions(&mut draw, POSES), &mut draw);
        assert_eq!(told(&calibrate(&setup).unwrap()), None, "seed {seed}");
        shift(&folder, 17, 4, Vector3::new(0.1e-3, -0.1e-3, 0.05e-3));
        let calibration = calibrate(&setup).unwrap();
        let near = (16..=20).any(|pose| {
            told(&calibration).is_some_and(|said| said.contains(&format!("from pose p{pose} on")))
        });
        found += u32::from(near);
    }
    assert!(found >= 19, "{found} of 20");
}

#[test]
fn a_device_that_was_moved_is_told_for_an_f1() {
    let (folder, robot) = (folder("moved-f1"), RobotFile::builtin_f1().unwrap());
    let setup = measure_f1(
        &folder,
        &robot,
        POSES,
        &f1_target(),
        1.0,
        &mut Draw(Noise::new(321)),
    );
    let options = options(&setup, "f1");
    assert_eq!(told(&calibrate_f1(&robot, &options).unwrap()), None);
    shift(&folder, 20, 7, Vector3::new(0.1e-3, -0.2e-3, 0.1e-3));
    let calibration = calibrate_f1(&robot, &options).unwrap();
    let said = told(&calibration).unwrap();
    assert!(
        (19..=23).any(|pose| said.contains(&format!("from pose p{pose} on"))),
        "{said}"
    );
}
