//! A wrist between platform and tool, from a robot file with a guess to one with its springs.

use gantry_tau_machine::robot_file::{AnyRobotFile, text_of};
use serde_json::Value;

use crate::process::Folder;

/// Two joints with a guessed compliance: those of an extension to five degrees of freedom.
const WRIST: &str = "\n[[wrist]]\naxis = [1.0, 0.0, 0.0]\npoint_m = [0.0, 0.0, 0.15]\n# ASSUMED.\nc_rad_per_nm = 1.0e-5\n\
                     \n[[wrist]]\naxis = [0.0, 1.0, 0.0]\npoint_m = [0.0, 0.0, 0.15]\n# ASSUMED.\nc_rad_per_nm = 1.0e-5\n";

/// The built-in L2 with a wrist, and no play; its true springs are up to 30 % off.
fn with_wrist(folder: &Folder) {
    let text = text_of("l2").unwrap();
    let text = text
        .replace("spring_deviation = 0.03", "spring_deviation = 0.3")
        .replace("jump_gap_m = 40.0e-6", "jump_gap_m = 0.0");
    folder.write("l2w.toml", &(text + WRIST));
}

/// Plan, experiment, identify: all eleven springs, with a client that knows them the tool stays
/// where it was.
#[test]
fn a_wrist_is_planned_for_measured_and_identified() {
    let folder = Folder::new("wrist");
    with_wrist(&folder);
    let plan = folder
        .run(&[
            "plan",
            "springs",
            "--robot",
            "l2w.toml",
            "-o",
            "springs.toml",
        ])
        .success();
    assert!(plan.contains("wrist 2"), "{plan}");
    assert_eq!(
        folder.read("springs.toml").matches("on = \"tool\"").count(),
        6
    );
    folder
        .run(&[
            "experiment",
            "springs.toml",
            "--robot",
            "l2w.toml",
            "--simulated",
            "3",
            "-o",
            "springs.csv",
        ])
        .success();
    let identify = [
        "identify",
        "springs.toml",
        "--robot",
        "l2w.toml",
        "-o",
        "mine.toml",
        "--json",
        "a.json",
    ];
    folder
        .run(&[identify.as_slice(), &["--report", "a.html"]].concat())
        .success();
    let json: Value = serde_json::from_str(&folder.read("a.json")).unwrap();
    let parameters = json["parameters"].as_array().unwrap();
    assert_eq!(parameters.len(), 11);
    let text = folder.read("mine.toml");
    let AnyRobotFile::L2(mine) = AnyRobotFile::parse("mine.toml", &text).unwrap() else {
        panic!("not an L2")
    };
    for (joint, parameter) in mine.wrist.iter().zip(&parameters[9..]) {
        assert_eq!(
            (parameter["status"].as_str(), parameter["unit"].as_str()),
            (Some("identified"), Some("rad/(N m)"))
        );
        assert_eq!(
            parameter["value"].as_f64().unwrap().to_bits(),
            joint.c_rad_per_nm.to_bits()
        );
        assert!(
            (joint.c_rad_per_nm / 1e-5 - 1.0).abs() > 0.01,
            "the guess: {}",
            joint.c_rad_per_nm
        );
    }
    assert_eq!(parameters[9]["name"], "c_wrist[0]");
    assert_eq!(mine.identified.unwrap().covariance.len(), 11);
    assert_eq!(
        text.matches("# IDENTIFIED with springs.csv (CRC-32 ")
            .count(),
        2
    );

    let verify = [
        "plan",
        "verify",
        "--robot",
        "mine.toml",
        "--series",
        "8",
        "--poses",
        "8",
        "-o",
        "verify.toml",
    ];
    let instruments = ["--noise-um", "0.5", "--noise-n", "0.3"];
    folder
        .run(&[verify.as_slice(), &instruments].concat())
        .success();
    let truth = [
        "experiment",
        "verify.toml",
        "--robot",
        "l2w.toml",
        "--client",
        "mine.toml",
        "--simulated",
        "3",
    ];
    folder
        .run(&[truth.as_slice(), &["-o", "verify.csv"]].concat())
        .success();
    let compare = [
        "verify",
        "verify.toml",
        "--robot",
        "mine.toml",
        "--json",
        "v.json",
    ];
    folder.run(&compare).success();
    let json: Value = serde_json::from_str(&folder.read("v.json")).unwrap();
    assert!(
        json["judged"]["before_rms_m"].as_f64().unwrap() > 300e-6,
        "{}",
        json["judged"]
    );
    assert!(
        json["judged"]["share"].as_f64().unwrap() < 0.01,
        "{}",
        json["judged"]
    );
}

/// The line in which an identification is refused.
fn refusal(folder: &Folder, robot: &str) -> String {
    let arguments = [
        "identify",
        "springs.toml",
        "--robot",
        robot,
        "-o",
        "mine.toml",
    ];
    let said = folder.run(&arguments).failure(1);
    assert!(!folder.path("mine.toml").exists());
    said
}

#[test]
fn what_cannot_be_is_refused_in_a_sentence() {
    let folder = Folder::new("wrist_refused");
    with_wrist(&folder);
    folder
        .run(&[
            "plan",
            "springs",
            "--robot",
            "l2w.toml",
            "-o",
            "springs.toml",
        ])
        .success();
    folder
        .run(&[
            "experiment",
            "springs.toml",
            "--robot",
            "l2w.toml",
            "--simulated",
            "3",
            "-o",
            "springs.csv",
        ])
        .success();
    folder.write(
        "rigid.toml",
        &folder
            .read("l2w.toml")
            .replace("c_rad_per_nm = 1.0e-5", "c_rad_per_nm = 0.0"),
    );
    let said = refusal(&folder, "rigid.toml");
    assert!(
        said.contains(
            "rigid.toml: wrist[0].c_rad_per_nm is 0; an identification begins with an estimate"
        ),
        "{said}"
    );
    let plan = folder.read("springs.toml");
    let measured = folder.read("springs.csv");
    folder.write(
        "springs.toml",
        &plan.replace("levels_n", "wrist_rad = [0.1, 0.2]\nlevels_n"),
    );
    folder.write("springs.csv", &measured.replace("\ns3,", "\nt3,"));
    let said = refusal(&folder, "l2w.toml");
    let unknown = "series: is not in the set-up, whose series have angles of the wrist (wrist_rad)";
    assert!(
        said.contains("springs.csv:") && said.contains(unknown),
        "{said}"
    );
    folder.write("springs.csv", &measured);
    folder.write(
        "springs.toml",
        &plan.replacen("levels_n", "wrist_rad = [0.1]\nlevels_n", 1),
    );
    let said = refusal(&folder, "l2w.toml");
    assert!(
        said.contains("wrist_rad: has 1 angles, and the robot file has 2 [[wrist]] joints"),
        "{said}"
    );
    let said = folder
        .run(&["plan", "check", "springs.toml", "--robot", "l2w.toml"])
        .failure(1);
    assert!(said.contains("wrist_rad: has 1 angles"), "{said}");
}
