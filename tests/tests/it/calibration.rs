//! `calibrate` from files: a simulated tracker, the machine that comes out, and files that are
//! wrong.

mod columns;
mod gross;
mod moved;

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use gantry_tau_core::model::f1::AXES as F1_AXES;
use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::l2::AXES;
use gantry_tau_identify::fit::frames::{apply, rigid};
use gantry_tau_identify::geometry::calibrate::{
    CalibrateError, CalibrateOptions, Calibration, FrameOption, GuidewaysOption, calibrate_f1,
    calibrate_l2,
};
use gantry_tau_machine::model::{F1, L2, MachineKind, pose_at};
use gantry_tau_machine::robot_file::edit::RobotText;
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile, text_of};
use gantry_tau_tests::client::Noise;
use nalgebra::{Isometry3, Matrix3, Quaternion, Translation3, UnitQuaternion, Vector3};

/// A folder of its own for a test.
fn folder(test: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("calibration")
        .join(test);
    fs::create_dir_all(&folder).unwrap();
    folder
}

/// Endless numbers from -1 to 1.
struct Draw(Noise);

impl Draw {
    fn next(&mut self) -> f64 {
        f64::from(u32::try_from(self.0.number() >> 32).unwrap()) / f64::from(u32::MAX) * 2.0 - 1.0
    }

    /// A normal variable, nearly: the sum of twelve uniform ones.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.next()).sum::<f64>() / 2.0
    }

    fn vector(&mut self, size: f64) -> Vector3<f64> {
        Vector3::new(self.next(), self.next(), self.next()) * size
    }
}

/// The machine that stands there: joints up to 4 mm, guideways 2 mrad, links 2 mm off the file.
fn true_machine(draw: &mut Draw) -> RobotFile<L2, AXES> {
    let file = RobotFile::builtin_l2().unwrap();
    let geometry = file.model.robot().geometry();
    let shifts = [(); 3].map(|()| draw.vector(4e-3));
    let carts: Vec<[f64; 3]> = (geometry.cart_joints_m.iter())
        .zip([0, 1, 1, 2, 2, 2])
        .map(|(joint, arm): (_, usize)| (joint + shifts[arm]).into())
        .collect();
    let guideways = geometry
        .guideways
        .map(|guideway| (guideway + draw.vector(2e-3)).into());
    let lengths = geometry.lengths_m.map(|length| length + draw.next() * 2e-3);
    let mut text = RobotText::new(&text_of("l2").unwrap(), "TRUE").unwrap();
    text.set_rows("A0", &carts);
    text.set_rows("V", &guideways);
    text.set_numbers("L", &lengths);
    l2("true", &text.text())
}

fn l2(name: &str, text: &str) -> RobotFile<L2, AXES> {
    let AnyRobotFile::L2(robot) = AnyRobotFile::parse(name, text).unwrap() else {
        panic!("not an L2")
    };
    *robot
}

/// Positions of the axes that put the tool of the file's machine anywhere in the middle of its
/// reach.
fn positions(draw: &mut Draw, count: usize) -> Vec<[f64; AXES]> {
    let file = RobotFile::builtin_l2().unwrap();
    let mut found = Vec::new();
    while found.len() < count {
        let place_m = Vector3::new(0.1, 0.3, 0.65)
            + draw
                .vector(1.0)
                .component_mul(&Vector3::new(0.9, 0.3, 0.25));
        if let Ok(q) = file.model.inverse_in_assembly(&place_m) {
            found.push(q);
        }
    }
    found
}

/// Takes a place of the robot's frame to the tracker's.
fn tracker() -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.4, -1.0, 2.0));
    Isometry3::from_parts(Translation3::new(2.0, -1.0, 0.5), turn)
}

/// Writes what a tracker with a noise of 50 um sees of the machine, and returns the set-up.
fn measure(
    folder: &Path,
    machine: &RobotFile<L2, AXES>,
    positions: &[[f64; AXES]],
    draw: &mut Draw,
) -> PathBuf {
    let tracker = tracker();
    let mut table = "pose,q_1,q_2,q_3,x_m,y_m,z_m\n".to_owned();
    for (index, q) in positions.iter().enumerate() {
        let place = apply(&tracker, &machine.model.forward(q).unwrap());
        let [x, y, z]: [f64; 3] = place
            .map(|coordinate| coordinate + 50e-6 * draw.normal())
            .into();
        writeln!(
            table,
            "p{index},{:?},{:?},{:?},{x:?},{y:?},{z:?}",
            q[0], q[1], q[2]
        )
        .unwrap();
    }
    fs::write(folder.join("poses.csv"), table).unwrap();
    let setup = folder.join("poses.toml");
    let text = "format = \"gantry-tau poses 1\"\nmodel = \"l2\"\nmeasurements = \"poses.csv\"\n\
                [noise]\nposition_um = [50.0, 50.0, 50.0]\n";
    fs::write(&setup, text).unwrap();
    setup
}

fn options(setup: &Path, robot: &str) -> CalibrateOptions {
    CalibrateOptions {
        poses: setup.to_owned(),
        robot: robot.to_owned(),
        frame: FrameOption::Nominal,
        guideways: GuidewaysOption::Free,
        target_m: None,
        tolerance_m: 1e-3,
    }
}

fn calibrate(setup: &Path) -> Result<Calibration, CalibrateError> {
    let options = options(setup, "l2");
    calibrate_l2(&RobotFile::builtin_l2().unwrap(), &options)
}

fn calibrate_guideways(setup: &Path, guideways: GuidewaysOption) -> Calibration {
    let options = CalibrateOptions {
        guideways,
        ..options(setup, "l2")
    };
    calibrate_l2(&RobotFile::builtin_l2().unwrap(), &options).unwrap()
}

/// Calibrates with these texts of the set-up and of the table beside it.
fn calibrate_texts(setup: &Path, setup_text: &str, table: &str) -> Result<(), String> {
    fs::write(setup, setup_text).unwrap();
    fs::write(setup.with_file_name("poses.csv"), table).unwrap();
    calibrate(setup)
        .map(|_| ())
        .map_err(|error| error.to_string())
}

/// Largest distance of the places of two machines, wherever they stand.
fn apart_m(
    one: &RobotFile<L2, AXES>,
    other: &RobotFile<L2, AXES>,
    positions: &[[f64; AXES]],
) -> f64 {
    let pairs: Vec<_> = positions
        .iter()
        .map(|q| {
            (
                one.model.forward(q).unwrap(),
                other.model.forward(q).unwrap(),
            )
        })
        .collect();
    let motion = rigid(&pairs).unwrap();
    pairs
        .iter()
        .map(|(from, to)| (to - apply(&motion, from)).norm())
        .fold(0.0, f64::max)
}

/// The walk of the documentation: error of places before and after.
#[test]
fn a_calibrated_machine_knows_where_it_is() {
    let mut draw = Draw(Noise::new(7));
    let machine = true_machine(&mut draw);
    let (seen, unseen) = (positions(&mut draw, 40), positions(&mut draw, 200));
    let folder = folder("l2");
    let calibration = calibrate(&measure(&folder, &machine, &seen, &mut draw)).unwrap();
    assert_eq!(calibration.doubts, [""; 0], "{}", calibration.summary);
    let calibrated = l2("calibrated", &calibration.robot_file);
    let file = RobotFile::builtin_l2().unwrap();
    let (before, after) = (
        apart_m(&file, &machine, &unseen),
        apart_m(&calibrated, &machine, &unseen),
    );
    assert!(before > 2e-3 && after < 0.2e-3, "{before:e} {after:e}");
    // Where the robot is stays as it was: home, travel, sensor.
    let home =
        |robot: &RobotFile<L2, AXES>| robot.model.inverse_in_assembly(&robot.home_m()).unwrap();
    let moved = home(&file)
        .iter()
        .zip(home(&calibrated))
        .map(|(one, other)| (one - other).abs())
        .fold(0.0, f64::max);
    assert!(moved < 0.02, "{moved}");
    // What the file says of where it comes from can be read again.
    let provenance = calibrated.calibrated.unwrap();
    assert_eq!(
        (provenance.poses, provenance.sd.len(), provenance.dof),
        (40, 21, 99)
    );
    let json: serde_json::Value = serde_json::from_str(&calibration.json).unwrap();
    assert_eq!(json["format"], "gantry-tau calibrated 1");
    assert_eq!(
        (
            json["observable"].as_u64(),
            json["parameters"].as_array().unwrap().len()
        ),
        (Some(21), 21)
    );
}

/// Largest distance of the places of two machines in one frame.
fn apart_in_frame_m(
    one: &RobotFile<L2, AXES>,
    place: impl Fn(&[f64; AXES]) -> Vector3<f64>,
    at: &[[f64; AXES]],
) -> f64 {
    at.iter()
        .map(|q| (one.model.forward(q).unwrap() - place(q)).norm())
        .fold(0.0, f64::max)
}

#[test]
fn a_machine_can_be_written_in_the_frame_of_the_device_or_of_its_base() {
    let mut draw = Draw(Noise::new(17));
    let machine = true_machine(&mut draw);
    let (seen, unseen) = (positions(&mut draw, 40), positions(&mut draw, 100));
    let folder = folder("frames");
    let setup = measure(&folder, &machine, &seen, &mut draw);
    let file = RobotFile::builtin_l2().unwrap();

    let in_device = CalibrateOptions {
        frame: FrameOption::Measured,
        ..options(&setup, "l2")
    };
    let calibration = calibrate_l2(&file, &in_device).unwrap();
    let calibrated = l2("measured", &calibration.robot_file);
    let off = apart_in_frame_m(
        &calibrated,
        |q| apply(&tracker(), &machine.model.forward(q).unwrap()),
        &unseen,
    );
    assert!(off < 0.2e-3, "{off:e}");
    // Home, sensor and tool went along: weight and sensor's axes are those of the world that has
    // turned.
    let turn = tracker().rotation;
    let home_off = (calibrated.home_m() - apply(&tracker(), &file.home_m())).norm();
    assert!(home_off < 0.02, "{home_off}");
    let axes_off = calibrated.sensor.rotation_matrix()
        - turn.to_rotation_matrix().matrix() * file.sensor.rotation_matrix();
    let weight_off = Vector3::from(calibrated.sensor.tool.weight_n)
        - turn * Vector3::from(file.sensor.tool.weight_n);
    assert!(
        axes_off.amax() < 0.01 && weight_off.norm() < 0.2,
        "{axes_off} {weight_off}"
    );
    assert_eq!(calibrated.calibrated.unwrap().frame, "measured");

    // Four points of the base, seen with a few micrometres of noise.
    let mut points = "format = \"gantry-tau frame 1\"\n".to_owned();
    for (index, point) in [
        [0.0, 0.0, 0.0],
        [2.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.5, 0.5, 1.5],
    ]
    .into_iter()
    .enumerate()
    {
        let measured: [f64; 3] =
            (apply(&tracker(), &Vector3::from(point)) + draw.vector(5e-6)).into();
        writeln!(
            points,
            "[[point]]\nname = \"b{index}\"\nrobot_m = {point:?}\nmeasured_m = {measured:?}"
        )
        .unwrap();
    }
    let path = folder.join("base.toml");
    fs::write(&path, &points).unwrap();
    let in_base = CalibrateOptions {
        frame: FrameOption::Points(path.clone()),
        ..options(&setup, "l2")
    };
    let calibrated = l2("base", &calibrate_l2(&file, &in_base).unwrap().robot_file);
    let off = apart_in_frame_m(&calibrated, |q| machine.model.forward(q).unwrap(), &unseen);
    assert!(off < 0.2e-3, "{off:e}");

    for (from, to, expected) in [
        ("frame 1", "frame 2", "base.toml: format: is"),
        ("robot_m = [2.0", "robot_m = [2.1", "base.toml: point.b"),
        (
            "[[point]]\nname = \"b3\"",
            "[[pint]]\nname = \"b3\"",
            "base.toml:",
        ),
    ] {
        fs::write(&path, points.replace(from, to)).unwrap();
        let error = calibrate_l2(&file, &in_base).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
    let line = "format = \"gantry-tau frame 1\"\npoint = [\n\
        {name = \"a\", robot_m = [0, 0, 0.0], measured_m = [0, 0, 0.0]},\n\
        {name = \"b\", robot_m = [1, 0, 0.0], measured_m = [1, 0, 0.0]},\n\
        {name = \"c\", robot_m = [2, 0, 0.0], measured_m = [2, 0, 0.0]}]\n";
    fs::write(
        &path,
        line.replace("[0, 0, 0.0]", "[0.0, 0.0, 0.0]")
            .replace("[1, 0, 0.0]", "[1.0, 0.0, 0.0]")
            .replace("[2, 0, 0.0]", "[2.0, 0.0, 0.0]"),
    )
    .unwrap();
    assert!(
        calibrate_l2(&file, &in_base)
            .unwrap_err()
            .to_string()
            .contains("three that are not on a line")
    );
}

#[test]
fn a_target_beside_the_tool_centre_point_is_taken_off() {
    let mut draw = Draw(Noise::new(18));
    let machine = true_machine(&mut draw);
    let (seen, unseen) = (positions(&mut draw, 40), positions(&mut draw, 100));
    let target = Vector3::new(0.05, -0.02, 0.11);
    // The platform does not turn: a target beside the point is a machine elsewhere.
    let mut shifted = RobotText::new(&text_of("l2").unwrap(), "TRUE").unwrap();
    let geometry = machine.model.robot().geometry();
    let carts: Vec<[f64; 3]> = geometry
        .cart_joints_m
        .iter()
        .map(|joint| (joint + target).into())
        .collect();
    shifted.set_rows("A0", &carts);
    shifted.set_rows("V", &geometry.guideways.map(Into::into));
    shifted.set_numbers("L", &geometry.lengths_m);
    let folder = folder("target");
    let setup = measure(&folder, &l2("target", &shifted.text()), &seen, &mut draw);
    let file = RobotFile::builtin_l2().unwrap();
    let beside = CalibrateOptions {
        target_m: Some(target.into()),
        ..options(&setup, "l2")
    };
    let calibrated = l2(
        "calibrated",
        &calibrate_l2(&file, &beside).unwrap().robot_file,
    );
    assert!(apart_m(&calibrated, &machine, &unseen) < 0.2e-3);
    let json: serde_json::Value =
        serde_json::from_str(&calibrate_l2(&file, &beside).unwrap().json).unwrap();
    let found = Vector3::from_iterator(numbers(&json["robot_frame"]["translation_m"]));
    // As well as nominal places tell the frame of a machine that is millimetres off.
    assert!(
        (found - tracker().translation.vector).norm() < 0.02,
        "{found}"
    );
}

#[test]
fn parallel_guideways_are_asked_for_and_tested() {
    let mut draw = Draw(Noise::new(19));
    let skewed = true_machine(&mut draw);
    let seen = positions(&mut draw, 40);
    let folder = folder("parallel");
    let file = RobotFile::builtin_l2().unwrap();
    let setup = measure(&folder, &skewed, &seen, &mut draw);
    let refused = calibrate_guideways(&setup, GuidewaysOption::Parallel);
    assert!(
        refused
            .doubts
            .iter()
            .any(|doubt| doubt.contains("the guideways are not parallel")),
        "{:?}",
        refused.doubts
    );
    let setup = measure(&folder, &file, &seen, &mut draw);
    let parallel = calibrate_guideways(&setup, GuidewaysOption::Parallel);
    assert_eq!(parallel.doubts, [""; 0]);
    let json: serde_json::Value = serde_json::from_str(&parallel.json).unwrap();
    assert_eq!(
        (
            json["observable"].as_u64(),
            json["parameters"].as_array().unwrap().len()
        ),
        (Some(15), 15)
    );
    let setup = measure(&folder, &file, &seen, &mut draw);
    let free = calibrate_guideways(&setup, GuidewaysOption::Free);
    assert!(
        free.remarks
            .iter()
            .any(|remark| remark.contains("--guideways parallel")),
        "{:?}",
        free.remarks
    );
}

#[test]
fn wrong_files_are_refused_by_line_and_column() {
    let mut draw = Draw(Noise::new(8));
    let machine = true_machine(&mut draw);
    let seen = positions(&mut draw, 20);
    let folder = folder("wrong");
    let setup = measure(&folder, &machine, &seen, &mut draw);
    let (good_setup, good_table) = (
        fs::read_to_string(&setup).unwrap(),
        fs::read_to_string(folder.join("poses.csv")).unwrap(),
    );
    assert_eq!(calibrate_texts(&setup, &good_setup, &good_table), Ok(()));
    let tables: [(&str, &str, &str); 8] = [
        ("z_m", "z_mm", "poses.csv:1: z_mm: this column is unknown"),
        ("q_3,", "", "poses.csv:1: q_3: this column is missing"),
        ("q_2", "q_1", "poses.csv:1: q_1: duplicate column"),
        ("p3,", "p2,", "poses.csv:5: pose: duplicate name \"p2\""),
        ("p4,", "p4,x", "poses.csv:6: q_1: \"x"),
        ("p4,", "p4,1e4", "poses.csv:6: q_1: "),
        ("p5,", "p5,NaN,", "poses.csv:7: "),
        (
            "z_m",
            "z_m,rot_w",
            "poses.csv:1: rot_w: a quaternion has four columns",
        ),
    ];
    for (from, to, expected) in tables {
        let error =
            calibrate_texts(&setup, &good_setup, &good_table.replacen(from, to, 1)).unwrap_err();
        assert!(error.contains(expected), "{error:?}, expected {expected:?}");
        assert!(!error.contains('\n'), "{error:?}");
    }
    let setups = [
        (
            "poses 1",
            "poses 2",
            "poses.toml: format: is \"gantry-tau poses 2\"",
        ),
        (
            "\"l2\"",
            "\"f1\"",
            "poses.toml: model: is \"f1\", and the robot file's is \"l2\"",
        ),
        ("poses.csv", "nowhere.csv", "nowhere.csv: "),
        (
            "position_um",
            "position_mm",
            "poses.toml:5: unknown field `position_mm`",
        ),
        (
            "[50.0,",
            "[0.0,",
            "poses.toml: noise.position_um: 0 is not from",
        ),
        ("[50.0, 50.0, 50.0]", "[50.0, 50.0]", "poses.toml:5: "),
    ];
    for (from, to, expected) in setups {
        let error =
            calibrate_texts(&setup, &good_setup.replacen(from, to, 1), &good_table).unwrap_err();
        assert!(error.contains(expected), "{error:?}, expected {expected:?}");
    }
    let few: String = good_table
        .lines()
        .take(8)
        .map(|line| format!("{line}\n"))
        .collect();
    assert!(
        calibrate_texts(&setup, &good_setup, &few)
            .unwrap_err()
            .contains("7 poses are too few; 8 are needed")
    );
    let f1_setup = good_setup.replace("\"l2\"", "\"f1\"");
    let columns = ",q_4,q_5,q_6,x_m,y_m,z_m";
    let six: String = (good_table.lines().enumerate())
        .map(|(index, line)| if index == 0 { line.replace(",x_m,y_m,z_m", columns) } else { format!("{line},0,0,0") } + "\n")
        .collect();
    fs::write(&setup, f1_setup).unwrap();
    fs::write(folder.join("poses.csv"), six).unwrap();
    let options = options(&setup, "f1");
    let error = calibrate_f1(&RobotFile::builtin_f1().unwrap(), &options)
        .unwrap_err()
        .to_string();
    assert!(error.contains("rot_w: an F1 needs orientations"), "{error}");
}

/// Near the end of the reach the machine of the file cannot stand where the real one does.
#[test]
fn a_file_that_does_not_reach_each_position_is_calibrated_all_the_same() {
    let file = RobotFile::builtin_l2().unwrap();
    let mut refused = 0;
    for seed in 0..4 {
        let mut draw = Draw(Noise::new(100 + seed));
        let machine = true_machine(&mut draw);
        let mut seen = positions(&mut draw, 57);
        while seen.len() < 60 {
            let place_m = Vector3::new(0.1, 0.3, 0.65)
                + draw.vector(1.0).component_mul(&Vector3::new(1.6, 0.9, 0.8));
            let Ok(q) = machine.model.inverse_in_assembly(&place_m) else {
                continue;
            };
            // A pose is measured where a cart moves the tool by a few times its own way, not by
            // more.
            let is_firm = (0..AXES).all(|axis| {
                let mut beside = q;
                beside[axis] += 1e-4;
                machine
                    .model
                    .forward(&beside)
                    .is_ok_and(|moved_m| (moved_m - place_m).norm() < 2e-3)
            });
            seen.extend((is_firm && file.model.forward(&q).is_err()).then_some(q));
        }
        let folder = folder(&format!("reach-{seed}"));
        let setup = measure(&folder, &machine, &seen, &mut draw);
        let calibration = calibrate(&setup).unwrap();
        let off_m = apart_m(
            &l2("calibrated", &calibration.robot_file),
            &machine,
            &positions(&mut draw, 100),
        );
        assert!(off_m < 0.4e-3, "{seed}: {off_m}, {}", calibration.summary);
        // A machine with parallel guideways either stands there, and the doubt is said, or is
        // refused by name.
        let parallel = CalibrateOptions {
            guideways: GuidewaysOption::Parallel,
            ..options(&setup, "l2")
        };
        match calibrate_l2(&file, &parallel) {
            Ok(parallel) => assert!(
                parallel
                    .doubts
                    .iter()
                    .any(|doubt| doubt.contains("are not parallel"))
            ),
            Err(error) => {
                refused += 1;
                assert!(
                    error.to_string().contains(
                        "poses.csv: no machine with parallel guideways fits these poses: "
                    )
                );
            }
        }
    }
    assert!((1..4).contains(&refused), "{refused} of 4 refused");
}

/// Calibrates with 30 poses in a box of these half sides.
fn calibrate_region(
    region: &str,
    sides: [f64; 3],
    machine: &RobotFile<L2, AXES>,
    draw: &mut Draw,
) -> Result<Calibration, CalibrateError> {
    let file = RobotFile::builtin_l2().unwrap();
    let middle = Vector3::new(0.1, 0.3, 0.65);
    let positions: Vec<[f64; AXES]> = (0..30)
        .map(|_| -> Vector3<f64> { middle + draw.vector(1.0).component_mul(&Vector3::from(sides)) })
        .map(|place_m| file.model.inverse_in_assembly(&place_m).unwrap())
        .collect();
    calibrate(&measure(&folder(region), machine, &positions, draw))
}

/// Places on a line, in a plane or in a small cube do not show a machine.
#[test]
fn poses_that_cannot_show_the_machine_are_refused() {
    let mut draw = Draw(Noise::new(9));
    let machine = true_machine(&mut draw);
    for (region, sides, expected) in [
        ("line", [0.5, 0.0, 0.0], "the places lie on a line, within"),
        (
            "plane",
            [0.5, 0.25, 0.0],
            "mm: a mirror image of the machine fits them as well",
        ),
        (
            "sheet",
            [0.5, 0.25, 0.5e-3],
            "the places lie in a plane, within",
        ),
        (
            "slab",
            [0.5, 0.25, 2e-3],
            "of 21 combinations of parameters cannot be seen",
        ),
        ("cube", [0.025; 3], "mm of each other: "),
    ] {
        let error = calibrate_region(region, sides, &machine, &mut draw);
        let error = error.unwrap_err().to_string();
        assert!(
            error.contains("poses.csv: ") && error.contains(expected),
            "{region}: {error}"
        );
    }
    // All is seen 20 mm away from the plane, and the image does not fit; elsewhere it tells little.
    let thick = calibrate_region("thick", [0.5, 0.25, 20e-3], &machine, &mut draw).unwrap();
    assert!(
        thick.doubts.len() == 1 && thick.doubts[0].contains("over the workspace"),
        "{:?}",
        thick.doubts
    );
}

/// Writes what a tracker sees of a target on an F1 in `count` turned poses around home, with
/// `noise` times 50 um and 100 urad. Returns the set-up.
fn measure_f1(
    folder: &Path,
    robot: &RobotFile<F1, F1_AXES>,
    count: usize,
    target: &Isometry3<f64>,
    noise: f64,
    draw: &mut Draw,
) -> PathBuf {
    let tracker = tracker();
    let mut table = "pose,q_1,q_2,q_3,q_4,q_5,q_6,x_m,y_m,z_m,rot_w,rot_x,rot_y,rot_z\n".to_owned();
    let mut poses = 0;
    while poses < count {
        let turn =
            UnitQuaternion::from_scaled_axis(Vector3::new(0.0, draw.next(), draw.next()) * 0.25);
        let position_m = robot.home_m() + draw.vector(0.25);
        let pose = Pose {
            position_m,
            rotation: turn.to_rotation_matrix().into_inner(),
        };
        let Ok(found) = robot.model.inverse_in_assembly(&pose, None) else {
            continue;
        };
        poses += 1;
        let seen = tracker * Isometry3::from_parts(Translation3::from(position_m), turn) * target;
        let turned = Vector3::new(draw.normal(), draw.normal(), draw.normal()) * 1e-4 * noise;
        let rotation = (UnitQuaternion::from_scaled_axis(turned) * seen.rotation).into_inner();
        let place = seen
            .translation
            .vector
            .map(|coordinate| coordinate + 50e-6 * noise * draw.normal());
        let numbers: Vec<String> = (found.value.iter().chain(place.iter()))
            .chain(&[rotation.w, rotation.i, rotation.j, rotation.k])
            .map(|number| format!("{number:?}"))
            .collect();
        writeln!(table, "p{poses},{}", numbers.join(",")).unwrap();
    }
    fs::write(folder.join("poses.csv"), table).unwrap();
    let setup = folder.join("poses.toml");
    let noise =
        "[noise]\nposition_um = [50.0, 50.0, 50.0]\nrotation_urad = [100.0, 100.0, 100.0]\n";
    let text = format!(
        "format = \"gantry-tau poses 1\"\nmodel = \"f1\"\nmeasurements = \"poses.csv\"\n{noise}"
    );
    fs::write(&setup, text).unwrap();
    setup
}

fn f1(name: &str, text: &str) -> RobotFile<F1, F1_AXES> {
    let AnyRobotFile::F1(robot) = AnyRobotFile::parse(name, text).unwrap() else {
        panic!("not an F1")
    };
    *robot
}

/// Target on the platform of an F1.
fn f1_target() -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.1, -0.3, 1.2));
    Isometry3::from_parts(Translation3::new(0.03, -0.02, 0.08), turn)
}

/// A calibrated F1, whose links are not parallel, is calibrated again: its file has no pose without
/// a seed.
#[test]
fn a_calibrated_f1_can_be_calibrated_again() {
    let mut draw = Draw(Noise::new(10));
    let geometry = RobotFile::builtin_f1().unwrap().model.geometry();
    let mut text = RobotText::new(&text_of("f1").unwrap(), "CALIBRATED").unwrap();
    for (key, joints) in [
        ("b", geometry.platform_joints_m),
        ("P", geometry.plate_joints_m),
    ] {
        text.set_rows(key, &joints.map(|joint| (joint + draw.vector(1e-4)).into()));
    }
    let mut lengths = geometry.lengths_m;
    lengths[2] += 1e-4;
    text.set_numbers("L", &lengths);
    let folder = folder("f1");
    let file = folder.join("calibrated.toml");
    fs::write(&file, text.text()).unwrap();
    let robot = f1("calibrated", &text.text());
    let setup = measure_f1(&folder, &robot, 40, &Isometry3::identity(), 1.0, &mut draw);
    let calibration = calibrate_f1(&robot, &options(&setup, &file.display().to_string())).unwrap();
    // The machine is that of the file already, so the new file says nearly the same: within a
    // millimetre, where poses hold 50 um.
    let home = [&robot, &f1("again", &calibration.robot_file)].map(|file| file.home_q().unwrap());
    assert!(
        home[0]
            .iter()
            .zip(home[1])
            .all(|(one, other)| (one - other).abs() < 1e-3),
        "{home:?}"
    );
}

/// Rows of a table of poses of an F1: positions of the axes and the measured pose.
fn f1_rows(table: &str) -> Vec<([f64; F1_AXES], Isometry3<f64>)> {
    let rows = table.lines().skip(1).map(|line| {
        let n: Vec<f64> = line
            .split(',')
            .skip(1)
            .map(|number| number.parse().unwrap())
            .collect();
        let rotation = UnitQuaternion::new_normalize(Quaternion::new(n[9], n[10], n[11], n[12]));
        let pose = Isometry3::from_parts(Translation3::new(n[6], n[7], n[8]), rotation);
        (<[f64; F1_AXES]>::try_from(&n[..6]).unwrap(), pose)
    });
    rows.collect()
}

fn numbers(value: &serde_json::Value) -> Vec<f64> {
    value
        .as_array()
        .unwrap()
        .iter()
        .map(|number| number.as_f64().unwrap())
        .collect()
}

/// A motion from the rows of its rotation and its translation in an answer.
fn motion(answer: &serde_json::Value, rotation: &str, translation: &str) -> Isometry3<f64> {
    let rows: Vec<f64> = answer[rotation]
        .as_array()
        .unwrap()
        .iter()
        .flat_map(numbers)
        .collect();
    let turn = UnitQuaternion::from_matrix(&Matrix3::from_row_slice(&rows));
    let shift = numbers(&answer[translation]);
    Isometry3::from_parts(Translation3::new(shift[0], shift[1], shift[2]), turn)
}

/// Vectors of a file in the axes of its platform or world.
fn vectors(file: &RobotFile<F1, F1_AXES>) -> [Vector3<f64>; 5] {
    let (sensor, wrist) = (&file.sensor, &file.wrist[0]);
    [
        sensor.lever_m,
        sensor.tool.weight_n,
        sensor.tool.centre_m,
        wrist.axis,
        wrist.point_m,
    ]
    .map(Vector3::from)
}

/// Measured without noise, the written machine predicts the poses: `device FK target`.
#[test]
fn an_f1_can_be_written_in_the_frame_of_the_device_or_of_its_base() {
    let mut draw = Draw(Noise::new(20));
    let wrist =
        "[[wrist]]\naxis = [0.0, 1.0, 0.0]\npoint_m = [0.0, 0.0, 0.15]\nc_rad_per_nm = 1.0e-5\n";
    let text = text_of("f1").unwrap() + wrist;
    let folder = folder("f1-frames");
    let path = folder.join("wrist.toml");
    fs::write(&path, &text).unwrap();
    let file = f1("wrist", &text);
    let setup = measure_f1(&folder, &file, 30, &f1_target(), 0.0, &mut draw);
    let mut points = "format = \"gantry-tau frame 1\"\n".to_owned();
    for (index, point) in [
        [0.0, 0.0, 0.0],
        [2.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.5, 0.5, 1.5],
    ]
    .into_iter()
    .enumerate()
    {
        let measured: [f64; 3] = apply(&tracker(), &Vector3::from(point)).into();
        writeln!(
            points,
            "[[point]]\nname = \"b{index}\"\nrobot_m = {point:?}\nmeasured_m = {measured:?}"
        )
        .unwrap();
    }
    let base = folder.join("base.toml");
    fs::write(&base, &points).unwrap();

    let target_m: [f64; 3] = f1_target().translation.vector.into();
    let frames = [
        FrameOption::Nominal,
        FrameOption::Measured,
        FrameOption::Points(base),
    ];
    for (frame, target_m) in frames
        .into_iter()
        .flat_map(|frame| [(frame.clone(), None), (frame, Some(target_m))])
    {
        let options = CalibrateOptions {
            frame,
            target_m,
            ..options(&setup, &path.display().to_string())
        };
        let calibration = calibrate_f1(&file, &options).unwrap();
        let calibrated = f1("written", &calibration.robot_file);
        let answer: serde_json::Value = serde_json::from_str(&calibration.json).unwrap();
        let device = motion(&answer["robot_frame"], "rotation", "translation_m");
        let target = motion(
            &answer["robot_frame"],
            "rotation_target",
            "translation_target_m",
        );
        let in_device_frame = options.frame == FrameOption::Measured;
        let expected = if in_device_frame {
            Isometry3::identity()
        } else {
            tracker()
        };
        assert!(
            (device.to_homogeneous() - expected.to_homogeneous()).amax() < 1e-9,
            "{:?}: {device}",
            options.frame
        );
        // In the device's frame the platform's axes have turned along with the world's, and the
        // target in them.
        let turn = if in_device_frame {
            tracker().rotation
        } else {
            UnitQuaternion::identity()
        };
        assert!(
            (target.translation.vector - turn * Vector3::from(f1_target().translation.vector))
                .norm()
                < 1e-9
        );
        for (q, measured) in f1_rows(&fs::read_to_string(folder.join("poses.csv")).unwrap()) {
            let pose =
                pose_at(&calibrated.model.without_travel(), &calibrated.home_m(), &q).unwrap();
            let rotation = UnitQuaternion::from_matrix(&pose.rotation);
            let predicted = device
                * Isometry3::from_parts(Translation3::from(pose.position_m), rotation)
                * target;
            // A billionth of a link's length is what the kinematics end at.
            let off = (predicted.to_homogeneous() - measured.to_homogeneous()).amax();
            assert!(off < 1e-8, "{:?}: {off:e}", options.frame);
        }
        // The same positions of the axes are home, and all that is constant in the frame went
        // along.
        let home = [&file, &calibrated].map(|file| file.home_q().unwrap());
        assert!(
            home[0]
                .iter()
                .zip(home[1])
                .all(|(one, other)| (one - other).abs() < 1e-8),
            "{home:?}"
        );
        let off = calibrated.sensor.rotation_matrix()
            - turn.to_rotation_matrix().matrix() * file.sensor.rotation_matrix();
        assert!(off.amax() < 1e-9, "{off}");
        for (from, to) in vectors(&file).into_iter().zip(vectors(&calibrated)) {
            assert!((turn * from - to).norm() < 1e-8, "{from} {to}");
        }
        assert_eq!(calibrated.calibrated.unwrap().sd.len(), 64);
    }
}

/// Wrong poses, the first among them, whose target is turned by half a turn: frames of all poses
/// begin far off.
#[test]
fn an_f1_is_found_from_another_start() {
    let mut draw = Draw(Noise::new(21));
    let file = RobotFile::builtin_f1().unwrap();
    let folder = folder("f1-starts");
    let setup = measure_f1(&folder, &file, 40, &f1_target(), 1.0, &mut draw);
    let path = folder.join("poses.csv");
    let table = fs::read_to_string(&path).unwrap();
    let mut changed = String::new();
    for (index, line) in table.lines().enumerate() {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        if [1, 2, 15].contains(&index) {
            // Half a turn about x: (w, x, y, z) -> (-x, w, -z, y).
            let [w, x, y, z] = [10, 11, 12, 13].map(|cell| cells[cell].parse::<f64>().unwrap());
            let turned = [-x, w, -z, y];
            cells.splice(10..14, turned.map(|part| format!("{part:?}")));
        }
        changed += &(cells.join(",") + "\n");
    }
    fs::write(&path, changed).unwrap();
    let calibration = calibrate_f1(&file, &options(&setup, "f1")).unwrap();
    let answer: serde_json::Value = serde_json::from_str(&calibration.json).unwrap();
    let outliers: Vec<&str> = answer["outliers"]
        .as_array()
        .unwrap()
        .iter()
        .map(|outlier| outlier["pose"].as_str().unwrap())
        .collect();
    assert_eq!(outliers, ["p1", "p2", "p15"], "{}", calibration.summary);
    assert!(
        answer["p"].as_f64().unwrap() > 1e-3,
        "{}",
        calibration.summary
    );
    assert!(
        calibration
            .remarks
            .iter()
            .any(|remark| remark.contains("axes and screws")),
        "{:?}",
        calibration.remarks
    );
    assert!(calibration.report.contains("gain of screw 6"));
    // What no pose shows is named, without a deviation, and the file's values of it are kept.
    let unobservable = answer["unobservable"].as_array().unwrap();
    let lost = unobservable
        .iter()
        .filter(|direction| direction["relative_sd"].is_null())
        .count();
    assert_eq!(lost, 4, "{unobservable:?}");
    let parameters = answer["parameters"].as_array().unwrap().iter();
    let kept: Vec<_> = parameters
        .filter(|parameter| parameter["status"] == "kept")
        .map(|kept| &kept["name"])
        .collect();
    assert_eq!(kept, ["P[0].x", "P[0].y", "P[0].z"]);
}
