//! All that the commands of measuring print and write, against what they wrote when a person last
//! read it: campaigns with everything in them that can be there, weak ones, and mistaken ones. What
//! is right is judged elsewhere; here nothing changes unseen.
//!
//! `GANTRY_TAU_RECORD_GOLDEN=1 cargo test -p gantry-tau --test it golden` writes
//! `tests/data/golden` again. Read the difference.

mod compare;
mod mistaken;
mod page;

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use gantry_tau_machine::robot_file::text_of;

use crate::identification::changed;
use crate::process::Folder;
use crate::tool;

/// An L2 whose axes count in other units than metres, each in its own, whose sensor is turned, and
/// whose springs are unlike the file's.
const GEARED: [[&str; 2]; 4] = [
    [
        "V = [\n    [1.0, 0.0, 0.0],\n    [1.0, 0.0, 0.0],\n    [1.0, 0.0, 0.0],\n]",
        "V = [\n    [0.8, 0.0, 0.0],\n    [1.25, 0.0, 0.0],\n    [0.5, 0.0, 0.0],\n]",
    ],
    [
        "metres_per_q = [1.0, 1.0, 1.0]",
        "metres_per_q = [0.8, 1.25, 0.5]",
    ],
    [
        "[0.0, -1.0, 0.0],\n    [1.0,  0.0, 0.0],",
        "[0.6, -0.8, 0.0],\n    [0.8,  0.6, 0.0],",
    ],
    ["spring_deviation = 0.03", "spring_deviation = 0.2"],
];
/// Deviations of a set-up, of every kind.
const SETUP: &str = "\n[setup]\ngauge_point_mm = 0.3\ngauge_axis_mrad = 1.0\nsensor_lever_mm = 0.5\nsensor_axes_mrad = 2.0\n\
                     sensor_gain = 0.002\n";
/// Two joints of a wrist, unlike each other.
const WRIST: &str = "\n[[wrist]]\naxis = [1.0, 0.0, 0.0]\npoint_m = [0.0, 0.0, 0.15]\nc_rad_per_nm = 1.0e-5\n\
                     \n[[wrist]]\naxis = [0.0, 0.6, 0.8]\npoint_m = [0.02, 0.0, 0.12]\nc_rad_per_nm = 2.0e-5\n";

/// Commands in a folder, and what they leave there.
struct Walk {
    name: &'static str,
    folder: Folder,
    /// Files that are given, and not compared.
    given: Vec<String>,
    /// Output of each command.
    said: String,
}

impl Walk {
    fn new(name: &'static str) -> Self {
        Self {
            name,
            folder: Folder::new(name),
            given: Vec::new(),
            said: String::new(),
        }
    }

    /// Writes a file that the commands read.
    fn give(&mut self, name: &str, text: &str) {
        self.folder.write(name, text);
        self.given.push(name.to_owned());
    }

    /// Writes a built-in robot file with some of its words replaced.
    fn robot(&mut self, kind: &str, changes: &[[&str; 2]]) {
        let text = changes
            .iter()
            .fold(text_of(kind).unwrap().to_owned(), |text, [from, to]| {
                assert_eq!(text.matches(from).count(), 1, "{from}");
                text.replace(from, to)
            });
        self.give("robot.toml", &text);
    }

    /// Runs a command, with any exit code.
    fn run(&mut self, command: &str) {
        let ended = self.folder.run(&command.split(' ').collect::<Vec<_>>());
        let code = ended.code.unwrap();
        self.said += &format!(
            "$ gantry-tau {command}\n{}{}exit code {code}\n\n",
            ended.stdout, ended.stderr
        );
    }

    /// Compares everything with what was recorded.
    fn end(self) {
        let mut found = BTreeMap::from([("said.txt".to_owned(), self.said)]);
        for entry in fs::read_dir(self.folder.path(".")).unwrap() {
            let name = entry.unwrap().file_name().into_string().unwrap();
            let is_output =
                !self.given.contains(&name) && !["run.out", "run.err"].contains(&name.as_str());
            let Some(text) = is_output
                .then(|| fs::read_to_string(self.folder.path(&name)).ok())
                .flatten()
            else {
                continue;
            };
            match name.strip_suffix(".html") {
                Some(page) => found.insert(format!("{page}.page.txt"), page::text_of(&text)),
                None => found.insert(name, text),
            };
        }
        let folder = PathBuf::from(concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../tests/data/golden"
        ))
        .join(self.name);
        if std::env::var_os("GANTRY_TAU_RECORD_GOLDEN").is_some() {
            _ = fs::remove_dir_all(&folder);
            fs::create_dir_all(&folder).unwrap();
            found.iter().for_each(|(name, text)| {
                fs::write(folder.join(name), without_checksums(text)).unwrap()
            });
        }
        let kept = fs::read_dir(&folder).unwrap().count();
        assert_eq!(kept, found.len(), "{:?}", found.keys());
        for (name, text) in found {
            let expected = fs::read_to_string(folder.join(&name)).unwrap();
            let differs = compare::difference(&expected, &without_checksums(&text));
            assert_eq!(
                differs,
                None,
                "{}/{name}\n{}",
                self.name,
                differs.as_deref().unwrap_or_default()
            );
        }
    }
}

/// Text without the checksums of tables, which a last place changes.
fn without_checksums(text: &str) -> String {
    let mut parts = text.split("CRC-32 ");
    let first = parts.next().unwrap().to_owned();
    parts.fold(first, |text, part| {
        text + "CRC-32 ********" + part.get(8..).unwrap_or_default()
    })
}

/// Every kind of device that the emulation has.
#[cfg(all(feature = "ethercat", target_os = "linux"))]
#[test]
fn devices_of_a_bus() {
    let mut walk = Walk::new("bus");
    walk.run("bus scan emulated");
    walk.run("bus scan emulated --try-mapping");
    walk.run("bus scan emulated --json");
    walk.end();
}

/// Everything that `identify` can be asked for, over a play.
#[test]
fn springs_of_an_l2_beyond_its_jump() {
    let mut walk = Walk::new("springs-l2");
    walk.robot("l2", &GEARED);
    walk.run("plan springs --robot robot.toml --series 6 --around-jump --noise-um 0.7 --noise-n 1.5 -o springs.toml");
    walk.run("plan check springs.toml --robot robot.toml");
    walk.run("experiment springs.toml --robot robot.toml --simulated 7 --thesis live.html -o springs.csv");
    let identify = "identify springs.toml --robot robot.toml";
    walk.run(&format!(
        "{identify} -o first.toml --json first.json --report first.html --two-regimes --hysteresis --drift"
    ));
    let plan = walk.folder.read("springs.toml");
    walk.give(
        "uncertain.toml",
        &plan.replacen("\n[[pose]]", &format!("{SETUP}\n[[pose]]"), 1),
    );
    let identify = "identify uncertain.toml --robot robot.toml";
    walk.run(&format!(
        "{identify} -o second.toml --json second.json --report second.html --thesis thesis.html --scale"
    ));
    walk.end();
}

/// Campaigns that do not see everything, and the thesis' own.
#[test]
fn springs_that_are_not_seen() {
    let mut walk = Walk::new("springs-weak");
    let data = PathBuf::from(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../tests/data/identify"
    ));
    for name in ["kept-1x9-2", "thesis-follow-b4"] {
        for file in ["campaign.toml", "springs.csv"] {
            let text = fs::read_to_string(data.join(name).join(file)).unwrap();
            walk.give(file, &text);
        }
        let identify =
            format!("identify campaign.toml --robot l2 -o {name}.toml --json {name}.json");
        walk.run(&format!(
            "{identify} --report {name}.html --thesis {name}-thesis.html --no-robust"
        ));
    }
    // One of whose springs the best value would be negative.
    let plan = fs::read_to_string(data.join("kept-1x9-2/campaign.toml")).unwrap();
    walk.give(
        "strap.toml",
        &plan.replace(
            "measurements = \"springs.csv\"",
            "measurements = \"strap.csv\"",
        ),
    );
    walk.run("experiment strap.toml --robot l2 --simulated 20 -o strap.csv");
    walk.run("identify strap.toml --robot l2 -o negative.toml --json negative.json");
    walk.end();
}

#[test]
fn springs_of_an_f1() {
    let mut walk = Walk::new("springs-f1");
    walk.robot(
        "f1",
        &[["spring_deviation = 0.03", "spring_deviation = 0.2"]],
    );
    walk.run("plan springs --robot robot.toml --series 5 --poses 2 --criterion d --force-max 250 -o springs.toml");
    walk.run("experiment springs.toml --robot robot.toml --simulated 11 -o springs.csv");
    walk.run("identify springs.toml --robot robot.toml -o found.toml --json found.json --report found.html --thesis thesis.html");
    walk.end();
}

/// Planned, measured and identified springs of a wrist, and what remains with them: measured, and
/// predicted.
#[test]
fn springs_of_a_wrist_and_their_verification() {
    let mut walk = Walk::new("verify-wrist");
    walk.robot(
        "l2",
        &[
            GEARED[0],
            GEARED[1],
            GEARED[3],
            ["jump_gap_m = 40.0e-6", "jump_gap_m = 0.0"],
        ],
    );
    walk.give("robot.toml", &(walk.folder.read("robot.toml") + WRIST));
    walk.run("plan springs --robot robot.toml --series 6 --poses 2 -o springs.toml");
    walk.run("experiment springs.toml --robot robot.toml --simulated 3 -o springs.csv");
    walk.run("identify springs.toml --robot robot.toml -o found.toml --json found.json --report found.html");
    walk.run("plan verify --robot found.toml --series 4 --poses 3 -o verify.toml");
    walk.run(
        "experiment verify.toml --robot robot.toml --client found.toml --simulated 3 -o verify.csv",
    );
    walk.run("verify verify.toml --robot found.toml --report remainder.html --json remainder.json --stiffness 2e7");
    walk.run("verify verify.toml --robot robot.toml --tolerance 0.1");
    walk.run("verify --predict --robot found.toml --cells 4 --force-n 400 --report predict.html --json predict.json");
    walk.end();
}

#[test]
fn geometry_of_an_l2() {
    let mut walk = Walk::new("geometry-l2");
    walk.robot(
        "l2",
        &[
            GEARED[0],
            GEARED[1],
            ["geometry_mm = 2.0", "geometry_mm = 0.4"],
        ],
    );
    walk.run("plan geometry --robot robot.toml --poses 16 --noise-um 40 -o places.toml");
    walk.run("plan check places.toml --robot robot.toml");
    walk.run("experiment places.toml --robot robot.toml --simulated 4 -o places.csv");
    let calibrate = "calibrate places.toml --robot robot.toml";
    walk.run(&format!(
        "{calibrate} -o nominal.toml --json nominal.json --report nominal.html"
    ));
    walk.run(&format!("{calibrate} -o measured.toml --json measured.json --frame measured --target 0.01,-0.02,0.03"));
    walk.run(&format!(
        "{calibrate} -o parallel.toml --json parallel.json --guideways parallel --tolerance 0.05"
    ));
    let frame = frame_of(&walk.folder.read("nominal.json"));
    walk.give("frame.toml", &frame);
    walk.run(&format!(
        "{calibrate} -o framed.toml --json framed.json --frame frame.toml"
    ));
    // Two rows that disagree, one of them by metres.
    let table = changed(&walk.folder.read("places.csv"), "y_m", |row, m| match row {
        3 => m + 1e-3,
        8 => m - 10.0,
        _ => m,
    });
    walk.give("places.csv", &table);
    walk.run(&format!(
        "{calibrate} -o disturbed.toml --json disturbed.json --report disturbed.html"
    ));
    walk.end();
}

/// Starts of the guideways in a frame, and another point of the first.
fn base_points(frame: &serde_json::Value) -> Vec<Vec<f64>> {
    let [joints, guideways] = ["A_s", "V"]
        .map(|key| serde_json::from_value::<Vec<Vec<f64>>>(frame[key].clone()).unwrap());
    let along = joints[0]
        .iter()
        .zip(&guideways[0])
        .map(|(start, way)| start + way)
        .collect();
    joints.into_iter().chain([along]).collect()
}

/// Points of the base where a calibration found them in the device's frame, the last one a little
/// off.
fn frame_of(calibrated: &str) -> String {
    let found: serde_json::Value = serde_json::from_str(calibrated).unwrap();
    let [robot, mut measured] =
        ["robot_frame", "measured_frame"].map(|frame| base_points(&found[frame]));
    measured[3][2] += 2e-4;
    let both = robot.into_iter().zip(measured).enumerate();
    both.fold("format = \"gantry-tau frame 1\"\n".to_owned(), |text, (hole, (robot, measured))| {
        text + &format!("[[point]]\nname = \"hole {hole}\"\nrobot_m = {robot:?}\nmeasured_m = {measured:?}\n")
    })
}

#[test]
fn tools() {
    let mut walk = Walk::new("tools");
    walk.given
        .extend(["tool.toml", "tool.csv"].map(str::to_owned));
    tool::measure_f1(&walk.folder);
    walk.run("identify tool.toml --robot f1 -o f1.toml --json f1.json");
    tool::measure_l2(&walk.folder);
    walk.run("identify tool.toml --robot l2 -o l2.toml --json l2.json");
    walk.end();
}

#[test]
fn geometry_of_an_f1() {
    let mut walk = Walk::new("geometry-f1");
    walk.run("plan geometry --robot f1 --poses 24 --criterion d -o places.toml");
    walk.run("experiment places.toml --robot f1 --simulated 2 -o places.csv");
    walk.run(
        "calibrate places.toml --robot f1 -o found.toml --json found.json --report found.html",
    );
    walk.end();
}
