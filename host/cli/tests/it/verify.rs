//! `verify`, from files to a page and an exit code.

use std::fmt::Write;

use gantry_tau_core::model::kinematics::Pose as CorePose;
use gantry_tau_core::model::robot::Compliances;
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::OffsetNm;
use gantry_tau_machine::elastic::backlash::Backlash;
use gantry_tau_machine::elastic::gauge::{Body, Gauge};
use gantry_tau_machine::elastic::loaded::Loaded;
use gantry_tau_machine::elastic::{ElasticMachine, Equilibrium, Pose};
use gantry_tau_machine::model::{CorrectedPose, L2, MachineKind, Wrist};
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile, text_of};
use nalgebra::{UnitQuaternion, Vector3, Vector6};
use serde_json::Value;

use crate::process::Folder;

/// The L2 as if identified, each spring to 1 %.
fn identified(folder: &Folder) -> RobotFile<L2, 3> {
    let text = text_of("l2").unwrap();
    let AnyRobotFile::L2(file) = AnyRobotFile::parse("l2", &text).unwrap() else {
        panic!("not an L2")
    };
    let springs = file.compliances.unwrap();
    let sd: Vec<f64> = springs
        .link_m_per_n()
        .iter()
        .chain(springs.cart_m_per_n())
        .map(|c| c * 0.01)
        .collect();
    let rows: Vec<Vec<f64>> = (0..9)
        .map(|row| {
            (0..9)
                .map(|column| if row == column { sd[row].powi(2) } else { 0.0 })
                .collect()
        })
        .collect();
    let section = format!(
        "\n[identified]\nmeasurements = \"springs.csv\"\ncrc = 0\nwindows = 99\nchi2 = 880.0\ndof = 880\nsd = {sd:?}\ncovariance = {rows:?}\n"
    );
    let text = text + &section;
    folder.write("my-l2.toml", &text);
    let AnyRobotFile::L2(file) = AnyRobotFile::parse("my-l2.toml", &text).unwrap() else {
        panic!("not an L2")
    };
    *file
}

/// Numbers of a window: positions of the axes, load, and what three gauges at the tool read.
fn numbers(
    machine: ElasticMachine<3>,
    began: &Equilibrium<3>,
    q: &[f64; 3],
    load: &Vector6<f64>,
) -> Vec<String> {
    let loaded = Loaded {
        machine,
        wrist: Wrist::default(),
        began: began.pose,
        now: machine.equilibrium(q, load, began).unwrap(),
        load: *load,
    };
    let read = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| {
        let gauge = Gauge::Face {
            body: Body::Platform,
            point_m: Vector3::zeros(),
            axis,
        };
        gauge.read(&loaded).length_m * 1e6
    });
    q.iter()
        .chain(load.iter())
        .chain(&read)
        .map(|number| format!("{number:?}"))
        .collect()
}

/// Measures a machine whose springs are `times` those of the file: three gauges at the tool, two
/// poses, two loads, compensation off and on.
fn measure(folder: &Folder, file: &RobotFile<L2, 3>, times: f64) {
    let springs = file.compliances.unwrap();
    let truth = Compliances::new(
        springs.link_m_per_n().map(|c| c * times),
        springs.cart_m_per_n().map(|c| c * times),
    );
    let machine = ElasticMachine::new(file.model.geometry(), truth.unwrap(), Backlash::NONE);
    let compensator = file.compensator([OffsetNm(2_000_000); 3]).unwrap();
    let mut setup =
        "format = \"gantry-tau springs 1\"\nmodel = \"l2\"\nmeasurements = \"verify.csv\"\n\
                     [noise]\ngauge_um = 0.5\nforce_n = 0.1\nmoment_nm = 0.01\n"
            .to_owned();
    let mut table = "series,mounting,pose,window,stroke,q_1,q_2,q_3,force_x_n,force_y_n,force_z_n,moment_x_nm,moment_y_nm,moment_z_nm,x_um,y_um,z_um\n".to_owned();
    for axis in ["x", "y", "z"] {
        let unit: Vec<f64> = ["x", "y", "z"]
            .map(|other| if other == axis { 1.0 } else { 0.0 })
            .into();
        writeln!(setup, "[[gauge]]\nname = \"{axis}\"\non = \"platform\"\npoint_m = [0.0, 0.0, 0.0]\naxis = {unit:?}")
            .unwrap();
    }
    for (pose, place) in [Vector3::new(0.0, 0.5, 0.65), Vector3::new(-0.3, 0.45, 0.6)]
        .into_iter()
        .enumerate()
    {
        writeln!(
            setup,
            "[[pose]]\nname = \"p{pose}\"\nT = {:?}",
            [place.x, place.y, place.z]
        )
        .unwrap();
        let off = file.model.axes_at(&place).unwrap();
        let start = Equilibrium::unloaded(Pose {
            translation_m: place,
            rotation: UnitQuaternion::identity(),
        });
        let began = machine
            .equilibrium(&off, &Vector6::zeros(), &start)
            .unwrap();
        let mut windows = vec![("start", off, Vector6::zeros())];
        for (name, force) in [("x", Vector3::x()), ("z", Vector3::z())] {
            let force: Vector3<f64> = force * 200.0;
            let load = Vector6::new(force.x, force.y, force.z, 0.0, 0.0, 0.0);
            let wrench = Wrench::from_array(load.into());
            let held = CorrectedPose::new(
                &*compensator,
                &[1.0; 3],
                &CorePose::at(place),
                &off,
                &wrench,
            )
            .unwrap();
            windows.push((name, held.nominal, load));
            windows.push((name, held.corrected, load));
        }
        for (window, q, load) in windows {
            let numbers = numbers(machine, &began, &q, &load).join(",");
            writeln!(table, "s{pose},m,p{pose},{window},0,{numbers}").unwrap();
        }
    }
    folder.write("verify.csv", &table);
    folder.write("verify.toml", &setup);
}

#[test]
fn pairs_are_judged_by_what_the_file_says_of_itself() {
    let folder = Folder::new("verify");
    let file = identified(&folder);
    measure(&folder, &file, 1.01);
    let all = [
        "verify",
        "verify.toml",
        "--robot",
        "my-l2.toml",
        "--report",
        "verify.html",
        "--json",
        "verify.json",
        "--cells",
        "8",
    ];
    let said = folder.run(&all).success();
    assert!(said.contains("pairs               4, z-scores"), "{said}");
    let json: Value = serde_json::from_str(&folder.read("verify.json")).unwrap();
    assert_eq!(
        (json["format"].as_str(), json["model"].as_str()),
        (Some("gantry-tau verified 1"), Some("l2"))
    );
    assert_eq!(json["pairs"].as_array().unwrap().len(), 4);
    assert!(json["judged"]["share"].as_f64().unwrap() < 0.02, "{json}");
    assert!(json["p"].as_f64().unwrap() > 0.01, "{json}");
    // The remainder by pair, three views of the measured places, four maps of three slices.
    assert_eq!(
        folder.read("verify.html").matches("<svg").count(),
        1 + 3 + 12
    );
    // Springs that are 30 % off.
    measure(&folder, &file, 1.3);
    let said = folder.run(&all).failure(3);
    assert!(
        said.contains("the readings are not those of this file's machine")
            && said.contains("um are tolerated"),
        "{said}"
    );
    assert!(
        folder
            .read("verify.html")
            .contains("Not to be trusted as it is")
    );
    // A file without a covariance takes its springs as exact.
    let said = folder
        .run(&["verify", "verify.toml", "--robot", "l2"])
        .failure(3);
    assert!(said.contains("p = "), "{said}");
}

#[test]
fn a_prediction_needs_no_measurements() {
    let folder = Folder::new("verify_predict");
    identified(&folder);
    let mut arguments = vec![
        "verify",
        "--predict",
        "--robot",
        "my-l2.toml",
        "--cells",
        "8",
    ];
    let said = folder.run(&arguments).success();
    assert!(
        said.contains("corrections exact") && said.contains("expected remainder"),
        "{said}"
    );
    arguments.extend([
        "--report",
        "predict.html",
        "--json",
        "predict.json",
        "--tolerance",
        "0.1",
        "--stiffness",
        "1e6",
    ]);
    let said = folder.run(&arguments).failure(3);
    assert!(said.contains("0.1 um are tolerated"), "{said}");
    let json: Value = serde_json::from_str(&folder.read("predict.json")).unwrap();
    assert_eq!(json["format"], "gantry-tau predicted 1");
    assert_eq!(json["directions"].as_array().unwrap().len(), 14);
    let places = u64::try_from(json["places"].as_array().unwrap().len()).unwrap();
    assert_eq!(json["summary"]["places"], places);
    assert_eq!(folder.read("predict.html").matches("<svg").count(), 12);
    let said = folder
        .run(&["verify", "--predict", "--robot", "l2"])
        .failure(1);
    assert!(
        said.contains("has no [identified]") && said.trim().lines().count() == 1,
        "{said}"
    );
    for option in ["--tolerance", "--stiffness", "--force-n"] {
        let said = folder
            .run(&["verify", "--predict", "--robot", "my-l2.toml", option, "0"])
            .failure(1);
        assert!(said.contains(option), "{said}");
    }
    folder.run(&["verify", "--robot", "l2"]).failure(2);
    folder
        .run(&["verify", "verify.toml", "--predict", "--robot", "l2"])
        .failure(2);
}
