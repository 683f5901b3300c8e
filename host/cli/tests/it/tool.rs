//! `identify` of the tool, from files to a robot file and an exit code.

use std::fmt::Write;

use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::linalg::rotation_from_vector;
use gantry_tau_machine::model::{MachineKind, pose_at};
use gantry_tau_machine::robot_file::{AnyRobotFile, Sensor, text_of};
use nalgebra::{Matrix3, Vector3};
use serde_json::Value;

use crate::process::Folder;

const WEIGHT_N: [f64; 3] = [0.5, -1.0, -49.0];
const CENTRE_M: [f64; 3] = [0.03, -0.02, -0.2];
const BIAS: [[f64; 3]; 2] = [[3.0, -2.0, 40.0], [0.5, 0.1, -0.2]];
/// Turns of the platform, rad, within the travel of an F1 at home.
const TURNS: [[f64; 3]; 6] = [
    [0.0, 0.0, 0.0],
    [0.25, 0.0, 0.0],
    [-0.25, 0.0, 0.0],
    [0.0, 0.3, 0.0],
    [0.0, -0.3, 0.0],
    [0.1, -0.1, 0.2],
];
const OUTPUTS: [&str; 5] = ["-o", "new.toml", "--json", "new.json", "--overwrite"];

/// Standard deviations of force and moment, N, N m.
const NOISE: [f64; 2] = [0.2, 0.01];

/// Even noise of standard deviation 1, as fixed as a table's.
fn noise(number: f64) -> f64 {
    ((number + 1.0) * 12.9898)
        .sin()
        .mul_add(43_758.545_3, 0.0)
        .rem_euclid(1.0)
        .mul_add(2.0, -1.0)
        * 3.0_f64.sqrt()
}

/// Writes a set-up and a table: readings at positions of the axes, where the platform is turned.
fn measure<const N: usize>(
    folder: &Folder,
    model: &str,
    sensor: &Sensor,
    poses: &[([f64; N], Matrix3<f64>)],
) {
    let stated = format!(
        "[noise]\nforce_n = {}\nmoment_nm = {}\n",
        NOISE[0], NOISE[1]
    );
    let head = format!(
        "format = \"gantry-tau tool 1\"\nmodel = \"{model}\"\nmeasurements = \"tool.csv\"\n"
    );
    folder.write("tool.toml", &(head + &stated));
    let axes: Vec<String> = (1..=N).map(|axis| format!("q_{axis}")).collect();
    let mut table = format!(
        "pose,{},force_x_n,force_y_n,force_z_n,moment_x_nm,moment_y_nm,moment_z_nm\n",
        axes.join(",")
    );
    let [weight_n, centre_m, force_n, moment_nm] =
        [WEIGHT_N, CENTRE_M, BIAS[0], BIAS[1]].map(Vector3::from);
    for (index, (q, rotation)) in poses.iter().enumerate() {
        let axes = (rotation * sensor.rotation_matrix()).transpose();
        let lever_m = rotation * (centre_m - Vector3::from(sensor.lever_m));
        let force = axes * weight_n + force_n;
        let moment = axes * lever_m.cross(&weight_n) + moment_nm;
        write!(table, "p{index}").unwrap();
        for value in q {
            write!(table, ",{value:?}").unwrap();
        }
        for (component, value) in force.iter().chain(&moment).enumerate() {
            let number = f64::from(u32::try_from(index * 6 + component).unwrap());
            write!(table, ",{:?}", value + NOISE[component / 3] * noise(number)).unwrap();
        }
        table.push('\n');
    }
    folder.write("tool.csv", &table);
}

/// A set-up of an F1 in six orientations, and its table.
pub(crate) fn measure_f1(folder: &Folder) {
    let AnyRobotFile::F1(robot) = AnyRobotFile::named("f1").unwrap() else {
        panic!("not an F1")
    };
    let stands = TURNS.map(|turn| {
        let rotation = rotation_from_vector(&Vector3::from(turn)).unwrap();
        let position_m = robot.home_m();
        let pose = Pose {
            position_m,
            rotation,
        };
        let q = robot.model.axes_for(&pose).unwrap();
        (q, pose_at(&robot.model, &position_m, &q).unwrap().rotation)
    });
    measure(folder, "f1", &robot.sensor, &stands);
}

/// A set-up of an L2 at three places, and its table.
pub(crate) fn measure_l2(folder: &Folder) {
    let AnyRobotFile::L2(robot) = AnyRobotFile::named("l2").unwrap() else {
        panic!("not an L2")
    };
    let home_m = robot.home_m();
    let places = [0.0, 0.05, 0.1].map(|shift| home_m + Vector3::new(shift, 0.0, 0.0));
    let stands = places.map(|place| (robot.model.axes_at(&place).unwrap(), Matrix3::identity()));
    measure(folder, "l2", &robot.sensor, &stands);
}

fn identify(robot: &str) -> Vec<&str> {
    [&["identify", "tool.toml", "--robot", robot], &OUTPUTS[..]].concat()
}

fn sensor(file: AnyRobotFile) -> Sensor {
    match file {
        AnyRobotFile::L2(file) => file.sensor,
        AnyRobotFile::F1(file) => file.sensor,
    }
}

#[test]
fn turned_poses_of_an_f1_give_its_tool() {
    let folder = Folder::new("tool_f1");
    measure_f1(&folder);
    // A file without a tool, too, and so without masses: one is added.
    let builtin = text_of("f1").unwrap();
    let masses = builtin.find("[masses]").unwrap();
    let next = masses + builtin[masses..].find("\n[simulation]").unwrap();
    let builtin = builtin[..masses].to_owned() + &builtin[next..];
    let table = builtin.find("[sensor.tool]").unwrap();
    let end = table + builtin[table..].find("\n[client]").unwrap();
    folder.write(
        "bare.toml",
        &(builtin[..table].to_owned() + &builtin[end..]),
    );
    for robot in ["f1", "bare.toml"] {
        let said = folder.run(&identify(robot)).success();
        assert!(
            said.starts_with("new.toml: 6 of 6 parameters of the tool seen; weight (0.49 +- "),
            "{said}"
        );
        let text = folder.read("new.toml");
        assert!(text.contains("IDENTIFIED with tool.csv (CRC-32 "), "{text}");
        assert!(
            text.find("[sensor.tool]").unwrap() < text.find("[client]").unwrap(),
            "{text}"
        );
        let tool = sensor(AnyRobotFile::parse("new.toml", &text).unwrap()).tool;
        let answer: Value = serde_json::from_str(&folder.read("new.json")).unwrap();
        let sds = answer["parameters"]
            .as_array()
            .unwrap()
            .iter()
            .map(|parameter| parameter["sd"].as_f64().unwrap());
        let truth = WEIGHT_N.iter().chain(&CENTRE_M);
        for ((found, truth), sd) in tool
            .weight_n
            .iter()
            .chain(&tool.centre_m)
            .zip(truth)
            .zip(sds)
        {
            assert!((found - truth).abs() < 3.0 * sd, "{tool:?}");
        }
        assert_eq!(answer["format"], "gantry-tau tool identified 1");
        assert_eq!(
            (
                &answer["dof"],
                answer["parameters"].as_array().unwrap().len()
            ),
            (&24.into(), 12)
        );
        assert_eq!(answer["parameters"][8]["name"], "bias_force_n[2]");
        let bias = &answer["parameters"][8];
        let off = bias["value"].as_f64().unwrap() - 40.0;
        assert!(off.abs() < 3.0 * bias["sd"].as_f64().unwrap(), "{answer}");
    }
    // A moment a hundred times the noise off.
    let table = folder.read("tool.csv");
    let mut rows: Vec<String> = table.lines().map(str::to_owned).collect();
    let (head, last) = rows[4].rsplit_once(',').unwrap();
    rows[4] = format!("{head},{:?}", last.parse::<f64>().unwrap() + 1.0);
    folder.write("tool.csv", &rows.join("\n"));
    let line = folder.run(&identify("f1")).failure(3);
    assert!(
        line.contains("the model or the stated noise is wrong: chi2/dof is "),
        "{line}"
    );
    assert!(
        line.contains("(line 5): this reading does not agree with the others"),
        "{line}"
    );
    // Noise that is stated twice too large.
    measure_f1(&folder);
    let setup = folder
        .read("tool.toml")
        .replace("force_n = 0.2", "force_n = 0.4")
        .replace("moment_nm = 0.01", "moment_nm = 0.02");
    folder.write("tool.toml", &setup);
    let line = folder.run(&identify("f1")).failure(3);
    assert!(
        line.contains("the stated noise is ") && line.contains(" times too large"),
        "{line}"
    );
}

/// A row whose last six cells have the other sign.
fn with_negated_wrench(row: &str) -> String {
    let cells: Vec<&str> = row.split(',').collect();
    let (front, wrench) = cells.split_at(cells.len() - 6);
    let wrench = wrench
        .iter()
        .map(|cell| format!("{:?}", -cell.parse::<f64>().unwrap()));
    front
        .iter()
        .map(|cell| (*cell).to_owned())
        .chain(wrench)
        .collect::<Vec<_>>()
        .join(",")
}

/// Found from outside: the forces that the sensor exerts, and not those on it, gave a tool that
/// pulls upwards, and exit code 0.
#[test]
fn a_tool_that_pulls_upwards_is_refused() {
    let folder = Folder::new("tool_up");
    measure_f1(&folder);
    let table = folder.read("tool.csv");
    let rows = table.lines().enumerate().map(|(row, line)| {
        if row == 0 {
            line.to_owned()
        } else {
            with_negated_wrench(line)
        }
    });
    folder.write("tool.csv", &rows.collect::<Vec<_>>().join("\n"));
    let said = folder.run(&identify("f1")).failure(1);
    assert!(
        said.contains("tool.csv:2: force_x_n: the tool would pull upwards, (")
            && said.contains("negate"),
        "{said}"
    );
    assert!(!folder.path("new.toml").exists());
}

#[test]
fn an_l2_keeps_the_tool_of_its_file_and_finds_the_bias_with_it() {
    let folder = Folder::new("tool_l2");
    measure_l2(&folder);
    let line = folder.start("l2", &identify("l2")).end().failure(3);
    let said = folder.read("l2.out");
    assert!(
        said.contains(
            "0 of 6 parameters of the tool seen; weight (0.00 kept, 0.00 kept, -18.00 kept) N"
        ),
        "{said}"
    );
    assert!(
        line.contains("not told from the bias in these poses, kept at the file's values: "),
        "{line}"
    );
    for name in ["weight_n", "centre_m"] {
        for axis in 0..3 {
            assert!(line.contains(&format!("{name}[{axis}] +1.000")), "{line}");
        }
    }
    assert_eq!(folder.read("new.toml"), text_of("l2").unwrap());
    let answer: Value = serde_json::from_str(&folder.read("new.json")).unwrap();
    let parameters = answer["parameters"].as_array().unwrap();
    let states: Vec<&str> = parameters
        .iter()
        .map(|parameter| parameter["status"].as_str().unwrap())
        .collect();
    assert_eq!(states, [["kept"; 6], ["depends"; 6]].concat(), "{answer}");
    // 49 N pull down, of which the file has 18. Three readings of 0.2 N, and a weight that is taken
    // to be 1 N off.
    let off = parameters[8]["value"].as_f64().unwrap() - (40.0 - 31.0);
    assert!(off.abs() < 3.0 * NOISE[0] / 3.0_f64.sqrt(), "{answer}");
    assert!(
        (parameters[8]["sd"].as_f64().unwrap() - (0.04 / 3.0 + 1.0_f64).sqrt()).abs() < 1e-9,
        "{answer}"
    );
}

#[test]
fn wrong_files_are_named_by_line_and_column_and_nothing_is_written() {
    let folder = Folder::new("tool_wrong");
    measure_f1(&folder);
    let (setup, table) = (folder.read("tool.toml"), folder.read("tool.csv"));
    let one = table.lines().take(2).collect::<Vec<_>>().join("\n");
    for (from, to, words) in [
        (
            "model = \"f1\"",
            "model = \"l2\"",
            "tool.toml: model: is \"l2\", and the robot file's is \"f1\"",
        ),
        (
            "force_n = 0.2",
            "force_n = 0.0",
            "tool.toml: noise.force_n: 0 is not from 1e-6 to 1e6",
        ),
        (
            "force_n = 0.2",
            "gauge_um = 0.2",
            "tool.toml:5: unknown field `gauge_um`",
        ),
        (
            "[noise]\n",
            "[[gauge]]\n",
            "tool.toml:4: unknown field `gauge`",
        ),
        ("tool.csv", "none.csv", "none.csv: No such file"),
    ] {
        assert!(setup.contains(from), "{from}");
        folder.write("tool.toml", &setup.replace(from, to));
        let line = folder.run(&identify("f1")).failure(1);
        assert!(line.contains(words), "{line}");
    }
    folder.write("tool.toml", &setup);
    for (from, to, words) in [
        ("q_6,", "q_7,", "tool.csv:1: q_7: this column is unknown"),
        ("\np2,", "\np1,", "tool.csv:4: pose: duplicate name \"p1\""),
        ("\np2,", "\np2,much", "tool.csv:4: q_1: \"much"),
        ("\np2,", "\np2,9", "tool.csv:4: q_1: "),
        (
            table.as_str(),
            one.as_str(),
            "tool.csv: has one reading; two are needed",
        ),
    ] {
        assert!(table.contains(from), "{from}");
        folder.write("tool.csv", &table.replace(from, to));
        let line = folder.run(&identify("f1")).failure(1);
        assert!(line.contains(words), "{line}");
    }
    folder.write("tool.csv", &table);
    let line = folder
        .run(&[&identify("f1")[..], &["--drift"]].concat())
        .failure(1);
    assert!(
        line.contains("--drift and --no-robust are for springs"),
        "{line}"
    );
    assert!(!folder.path("new.toml").exists() && !folder.path("new.json").exists());
    folder.run(&identify("f1")).success();
}
