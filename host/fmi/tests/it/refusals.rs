//! Mistakes of a master: one sentence each, and the unit goes on.

use gantry_tau_fmi::instance::{Access, Causality, Instance};
use gantry_tau_fmi::kind::Kind;
use gantry_tau_machine::robot_file::AnyRobotFile;

use crate::named::Named;

fn l2() -> AnyRobotFile {
    AnyRobotFile::named("l2").unwrap()
}

fn unit(kind: Kind) -> Instance {
    Instance::new(kind, l2()).unwrap()
}

fn refused<T>(result: Result<T, gantry_tau_fmi::instance::CallRefused>) -> String {
    match result {
        Err(refused) => refused.to_string(),
        Ok(_) => panic!("taken"),
    }
}

#[test]
fn calls_out_of_turn_are_refused() {
    for kind in Kind::ALL {
        let mut unit = unit(kind);
        refused(unit.exit_initialization());
        refused(unit.step(0.0, 1e-3));
        refused(unit.terminate());
        let text = refused(unit.get(0));
        assert!(text.contains("before its initialization"), "{text}");
        unit.setup_experiment(0.0, Some(1.0)).unwrap();
        unit.enter_initialization().unwrap();
        refused(unit.setup_experiment(0.0, None));
        refused(unit.enter_initialization());
        refused(unit.step(0.0, 1e-3));
        unit.get(0).unwrap();
        unit.exit_initialization().unwrap();
        refused(unit.exit_initialization());
        refused(unit.step(0.0, 1.001));
        unit.step(0.0, 1.0).unwrap();
        refused(unit.step(1.0, 1e-3));
        unit.terminate().unwrap();
        refused(unit.step(1.0, 1e-3));
        refused(unit.terminate());
        refused(unit.set(0, 0.0));
        unit.get(0).unwrap();
        unit.reset();
        unit.enter_initialization().unwrap();
    }
}

/// A unit has no samples of an accelerometer and takes no velocities.
#[test]
fn a_robot_file_for_velocities_is_for_the_compensator_alone() {
    let text = include_str!("../../../../robots/l2.toml")
        .replace(
            "nominal_step_um = [2000.0, 2000.0, 2000.0]",
            "nominal_step_um = [600.0, 600.0, 600.0]",
        )
        .replace(
            "[[-0.51, 2.01], [-2.01, 0.51], [-0.51, 2.01]]",
            "[[-0.53, 2.03], [-2.03, 0.53], [-0.53, 2.03]]",
        );
    let text = text.replacen(
        "[simulation]",
        "[drives]\ninterface = \"velocity\"\n[simulation]",
        1,
    );
    let robot = AnyRobotFile::parse("velocity.toml", &text).unwrap();
    for kind in Kind::ALL {
        let unit = Instance::new(kind, robot.clone());
        match kind {
            Kind::Compensator => drop(unit.unwrap()),
            _ => assert_eq!(
                refused(unit),
                "velocity.toml: drives.interface: is \"velocity\"; a unit takes \"position\""
            ),
        }
    }
}

#[test]
fn values_that_are_none_name_their_variable_and_change_nothing() {
    for (kind, name) in [
        (Kind::Server, "force[2]"),
        (Kind::Server, "nominal[3]"),
        (Kind::Machine, "load_moment[1]"),
        (Kind::Machine, "reference[1]"),
        (Kind::Compensator, "moment[3]"),
    ] {
        let mut unit = Named::begun(kind, &l2(), &[]);
        let reference = unit.reference(name);
        let before = unit.bits();
        for value in [f64::NAN, f64::INFINITY, -f64::INFINITY, 1e30] {
            let text = refused(unit.instance.set(reference, value));
            assert!(text.starts_with(&format!("{name}: is {value}")), "{text}");
            // None of several.
            let pairs = [(0, 0.25), (reference, value)];
            refused(unit.instance.set_all(&pairs));
        }
        assert_eq!(unit.bits(), before);
        unit.step(1);
    }
}

#[test]
fn unknown_and_other_variables_are_refused() {
    let mut server = unit(Kind::Server);
    let count = server.variables().len() as u32;
    for reference in [count, u32::MAX] {
        let text = refused(server.set(reference, 0.0));
        assert!(
            text.contains(&format!("value reference {reference}")),
            "{text}"
        );
        refused(server.get(reference));
        refused(server.variable(reference, Access::Real));
    }
    let phase = server.reference_of("phase").unwrap();
    let text = refused(server.variable(phase, Access::Real));
    assert_eq!(text, "phase: is an Integer, not a Real");
    assert_eq!(refused(server.set(phase, 0.0)), "phase: is an output");
    let parameter = server.reference_of("accept_unstable").unwrap();
    server.set(parameter, 1.0).unwrap();
    server.enter_initialization().unwrap();
    server.exit_initialization().unwrap();
    let text = refused(server.set(parameter, 0.0));
    assert!(
        text.starts_with("accept_unstable: is a parameter"),
        "{text}"
    );
}

#[test]
fn robot_files_that_give_no_unit_are_refused_by_their_key() {
    let mut without = l2();
    if let AnyRobotFile::L2(robot) = &mut without {
        robot.compliances = None;
    }
    for kind in Kind::ALL {
        let text = refused(Instance::new(kind, without.clone()));
        assert!(text.contains("l2.toml"), "{kind}: {text}");
        assert!(
            text.contains("compliances") || text.contains("c_link"),
            "{text}"
        );
    }
}

#[test]
fn a_filter_without_a_margin_does_not_obtain_unless_it_is_accepted() {
    let text = gantry_tau_machine::robot_file::text_of("l2").unwrap();
    let text = text.replace(
        "cutoff_hz = 6.0",
        "filter = \"first_order\"\ncutoff_hz = 20.0",
    );
    let robot = AnyRobotFile::parse("mine.toml", &text).unwrap();
    let mut server = Instance::new(Kind::Server, robot).unwrap();
    server.enter_initialization().unwrap();
    let text = refused(server.exit_initialization());
    assert!(text.contains("accept_unstable"), "{text}");
    let accept = server.reference_of("accept_unstable").unwrap();
    server.set(accept, 1.0).unwrap();
    server.exit_initialization().unwrap();
}

#[test]
fn every_variable_has_a_name_a_description_and_a_start_within_its_range() {
    for robot in ["l2", "f1"] {
        for kind in Kind::ALL {
            let unit = Instance::new(kind, AnyRobotFile::named(robot).unwrap()).unwrap();
            let mut names = Vec::new();
            for variable in unit.variables() {
                let [lower, upper] = variable.range;
                assert!((lower..=upper).contains(&variable.start), "{variable:?}");
                assert!(!variable.description.is_empty());
                names.push(variable.name.clone());
            }
            let is_output = |causality| causality == Causality::Output;
            assert!(unit.variables().iter().any(|v| is_output(v.causality)));
            names.sort();
            names.dedup();
            assert_eq!(names.len(), unit.variables().len());
        }
    }
}
