use gantry_tau_core::control::agitation::AgitationBudget;
use gantry_tau_core::model::presets;
use serde_json::Value;

use super::*;

#[track_caller]
fn assert_refused(text: &str, from: &str, to: &str, key: &str) {
    assert!(text.contains(from), "{from} is not in the file");
    let error = AnyRobotFile::parse("x.toml", &text.replacen(from, to, 1)).unwrap_err();
    assert_eq!(error.to_string().lines().count(), 1, "{error}");
    assert_eq!(
        (&*error.file, &*error.key),
        ("x.toml", key),
        "{from} -> {to}: {error}"
    );
}

#[test]
fn the_built_in_machines_are_the_presets() {
    let file = RobotFile::builtin_l2().unwrap();
    assert_eq!(*file.model.robot().geometry(), presets::l2());
    assert_eq!(file.compliances, Some(presets::l2_compliances()));
    assert_eq!(file.limits[0].limits.position.ramp(), 100);
    let file = RobotFile::builtin_f1().unwrap();
    assert_eq!(*file.model.robot().geometry(), presets::f1());
    assert_eq!(file.compliances, Some(presets::f1_compliances()));
    assert_eq!(
        file.metres_per_q.map(f64::to_bits),
        presets::F1_METRES_PER_Q.map(f64::to_bits)
    );
}

/// All keys agree, but for the rounding of the sums that some of the vectors come from.
#[test]
fn the_built_in_machines_are_the_vectors_machines() {
    fn numbers(value: &Value) -> Vec<f64> {
        value.as_array().map_or_else(
            || vec![value.as_f64().unwrap()],
            |list| list.iter().flat_map(numbers).collect(),
        )
    }
    let vectors: Value =
        serde_json::from_str(include_str!("../../../../tests/data/tau_vectors.json")).unwrap();
    for (model, text, names) in [
        ("l2", L2_TEXT, L2Keys::NAMES),
        ("f1", F1_TEXT, F1Keys::NAMES),
    ] {
        let file: Value = toml::from_str(text).unwrap();
        for name in names {
            let ours = numbers(&file[name]);
            let theirs = numbers(vectors[model].get(name).unwrap_or(&vectors[name]));
            assert_eq!(ours.len(), theirs.len(), "{model}: {name}");
            let rounding = if ["P", "c_act", "c_cart"].contains(name) {
                1e-15
            } else {
                0.0
            };
            for (ours, theirs) in ours.into_iter().zip(theirs) {
                let unit = if name.starts_with("c_") { ours } else { 1.0 };
                assert!(
                    (ours - theirs).abs() <= rounding * unit,
                    "{model}: {name}: {ours} {theirs}"
                );
            }
        }
    }
}

/// The files say in a comment where the axes are at home.
#[test]
fn home_is_where_the_files_say() {
    let file = RobotFile::builtin_l2().unwrap();
    let l2 = file.model.axes_at(&file.home_m()).unwrap();
    let file = RobotFile::builtin_f1().unwrap();
    let f1 = file.model.axes_at(&file.home_m()).unwrap();
    for (q, said) in l2.into_iter().zip([0.6245, -0.6964, 0.6690]) {
        assert!((q - said).abs() < 6e-5, "{q}");
    }
    for (q, said) in f1.into_iter().zip([1.530, 1.739, 1.573, 0.0, 0.0, 0.0]) {
        assert!((q - said).abs() < 6e-4, "{q}");
    }
}

/// Checksum of the built-in L2 with a text in place of another.
fn changed_checksum(from: &str, to: &str) -> u32 {
    let text = L2_TEXT.replace(from, to);
    RobotFile::read::<L2Keys>("x", &text).unwrap().checksum()
}

#[test]
fn the_checksum_sees_the_kinematics_and_nothing_else() {
    let ours = changed_checksum("", "");
    assert_eq!(ours, changed_checksum("gain = 1.0", "gain = 0.5"));
    assert_eq!(
        ours,
        changed_checksum("0.0, 0.0],\n    [1.0", "-0.0, 0.0],\n    [1.0")
    );
    assert_ne!(
        ours,
        changed_checksum("L = [1.0, 1.1", "L = [1.0, 1.1000000000000003")
    );
    assert_ne!(ours, changed_checksum("L = [1.0, 1.1", "L = [1.0, 1.2"));
    assert_ne!(
        ours,
        changed_checksum(
            "metres_per_q = [1.0, 1.0, 1.0]",
            "metres_per_q = [1.0, 1.0, 1.0000000000000002]"
        )
    );
}

#[test]
fn a_second_checksum_sees_springs_and_masses() {
    let of = |from: &str, to: &str| {
        assert!(from.is_empty() || L2_TEXT.contains(from), "{from}");
        let text = L2_TEXT.replace(from, to);
        let file = RobotFile::read::<L2Keys>("x", &text).unwrap();
        (file.checksum(), file.springs_checksum())
    };
    let (kinematics, ours) = of("", "");
    assert_eq!(of("gain = 1.0", "gain = 0.5").1, ours);
    for (from, to) in [
        ("c_link = [5.0e-7", "c_link = [5.1e-7"),
        ("platform_kg = 12.0", "platform_kg = 12.5"),
        (
            "weight_n = [0.0, 0.0, -18.0]",
            "weight_n = [0.0, 0.0, -18.1]",
        ),
    ] {
        let (same, other) = of(from, to);
        assert_eq!(same, kinematics, "{from}");
        assert_ne!(other, ours, "{from}");
    }
    let longer = of("L = [1.0, 1.1", "L = [1.0, 1.2");
    assert!(longer.0 != kinematics && longer.1 == ours);
}

#[test]
fn every_error_names_its_key() {
    let l2 = [
        ("model = \"l2\"", "model = \"l3\"", "model"),
        ("model = \"l2\"", "model = \"f1\"", "A0"),
        ("model = \"l2\"", "", "model"),
        ("cf = -1", "cf = 0", "cf"),
        ("c = [1, -1, 1]", "c = [1, -1, 2]", "c[2]"),
        ("L = [1.0, 1.1", "L = [1.0, nan", "L[1]"),
        (
            "L = [1.0, 1.1, 1.0]",
            "L = [1.0, 1.1, 1.2, 1.0, 1.0, 1.0]",
            "L",
        ),
        ("L = [1.0, 1.1, 1.0]", "L = [1.0, 1.1]", "L"),
        ("L = [1.0, 1.1", "L = [1.0, -1.1", "L[1]"),
        ("c_link = [5.0e-7", "c_link = [-5.0e-7", "c_link[0]"),
        ("c_cart = [", "# c_cart = [", "c_cart"),
        ("[ 0.00,  0.08, 0.05]", "[ 0.00,  0.08, 0.06]", "A0"),
        ("gain = 1.0", "gain = 1.1", "client.gain"),
        ("gain = 1.0", "gain = nan", "client.gain"),
        ("gain = 1.0", "gian = 1.0", "client.gian"),
        ("gain = 1.0", "", "client.gain"),
        ("gain = 1.0", "gain = \"one\"", "client.gain"),
        ("gain = 1.0", "gain = ", "client.gain"),
        (
            "gain = 1.0",
            "gain = 1.0\nleave_on_oscillation = 1",
            "client.leave_on_oscillation",
        ),
        (
            "gain = 1.0",
            "gain = 1.0\nfeed_forward = \"masses\"",
            "client.feed_forward",
        ),
        (
            "gain = 1.0",
            "gain = 1.0\nfeed_forward = \"inertia_and_torque\"",
            "client.feed_forward",
        ),
        (
            "ramp_permille = ",
            "rated_n = [1000.0, 0.0, 1000.0]\nramp_permille = ",
            "axes.torque.rated_n[1]",
        ),
        (
            "ramp_permille = ",
            "rated_n = [1000.0]\nramp_permille = ",
            "axes.torque.rated_n",
        ),
        ("[simulation]", "[client]\n[simulation]", "client"),
        ("seed = 2013", "seed = -1", "simulation.seed"),
        (
            "spring_deviation = 0.03",
            "spring_deviation = 1.0",
            "simulation.spring_deviation",
        ),
        (
            "force_noise_n = 0.2",
            "force_noise_n = -0.2",
            "simulation.force_noise_n",
        ),
        (
            "gauge_resolution_m = 0.5e-6",
            "gauge_resolution_m = 0.0",
            "simulation.gauge_resolution_m",
        ),
        (
            "jump_force_n = 360.0",
            "jump_force_n = 0.0",
            "simulation.jump_force_n",
        ),
        (
            "jump_gap_m = 40.0e-6",
            "jump_gap_m = nan",
            "simulation.jump_gap_m",
        ),
        (
            "home_m = [0.0, 0.5, 0.65]",
            "home_m = [0.0, 9.5, 0.65]",
            "simulation.home_m",
        ),
        (
            "home_m = [0.0, 0.5, 0.65]",
            "home_m = [0.0, 0.5]",
            "simulation.home_m",
        ),
        (
            "metres_per_q = [1.0",
            "metres_per_q = [2.0",
            "axes.metres_per_q[0]",
        ),
        (
            "agitation_um_per_s = [100, 100,",
            "agitation_um_per_s = [100, 0,",
            "axes.position.agitation_um_per_s[1]",
        ),
        (
            "agitation_um_per_s = [100, 100, 100]",
            "agitation_um_per_s = [100, 100, 1_000_001]",
            "axes.position.agitation_um_per_s[2]",
        ),
        (
            "agitation_um_per_s = [100, 100, 100]",
            "agitation_um_per_s = [100, 100]",
            "axes.position.agitation_um_per_s",
        ),
        (
            "agitation_um_per_s = [100,",
            "agitation_um_per_s = [100.5,",
            "axes.position.agitation_um_per_s",
        ),
        (
            "ramp_um = [0.1",
            "ramp_um = [0.1005",
            "axes.position.ramp_um[0]",
        ),
        (
            "ramp_um = [0.1",
            "ramp_um = [0.0",
            "axes.position.ramp_um[0]",
        ),
        (
            "accel_um = [10.0",
            "accel_um = [5.05",
            "axes.position.accel_um[0]",
        ),
        (
            "max_um = [2000.0",
            "max_um = [1e300",
            "axes.position.max_um[0]",
        ),
        (
            "max_um = [2000.0",
            "max_um = [10001",
            "axes.nominal_travel_m[0]",
        ),
        (
            "[[-0.51, 2.01]",
            "[[2.01, -0.51]",
            "axes.machine_travel_m[0]",
        ),
        (
            "max_permille = [50",
            "max_permille = [-1",
            "axes.torque.max_permille[0]",
        ),
        (
            "max_permille = [50",
            "max_permille = [99999",
            "axes.torque.max_permille",
        ),
        (
            "axis_of_motor = [0, 1, 2]",
            "axis_of_motor = [0, 1, 1]",
            "motors.axis_of_motor",
        ),
        (
            "axis_of_motor = [0, 1, 2]",
            "axis_of_motor = [0, 1, 3]",
            "motors.axis_of_motor",
        ),
        ("[0.0, -1.0, 0.0]", "[0.0, 1.0, 0.0]", "sensor.rotation"),
        ("cutoff_hz = 6.0", "cutoff_hz = inf", "sensor.cutoff_hz"),
        ("cutoff_hz = 6.0", "cutoff_hz = 451.0", "sensor.cutoff_hz"),
        (
            "cutoff_hz = 6.0",
            "cutoff_hz = 451.0\nfilter = \"second_order\"",
            "sensor.cutoff_hz",
        ),
        (
            "cutoff_hz = 6.0",
            "cutoff_hz = 6.0\nnotches = 4",
            "sensor.notches",
        ),
        (
            "cutoff_hz = 6.0",
            "cutoff_hz = 6.0\nnotch_q = 0.0",
            "sensor.notch_q",
        ),
        (
            "[sensor.tool]",
            "[sensor.accelerometer]\nplace_m = [0.0, 0.0, 0.0]\naxes = 5\n[sensor.tool]",
            "sensor.accelerometer.axes",
        ),
        (
            "[sensor.tool]",
            "[sensor.accelerometer]\nplace_m = [0.0, nan, 0.0]\naxes = 3\n[sensor.tool]",
            "sensor.accelerometer.place_m[1]",
        ),
        (
            "[sensor.tool]",
            "[sensor.accelerometer]\nplace_m = [0.0, 0.0, 0.0]\naxes = 6\nshare = 1.1\n[sensor.tool]",
            "sensor.accelerometer.share",
        ),
        (
            "[sensor.tool]",
            "[sensor.accelerometer]\nplace_m = [0.0, 0.0, 0.0]\naxes = 6\nrotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]\n[sensor.tool]",
            "sensor.accelerometer.rotation",
        ),
    ];
    let f1 = [
        ("sigma4 = -1", "sigma4 = 0", "sigma4"),
        ("sigma5 = 1", "", "sigma5"),
        ("ax6 = [0.0, 1.0, 0.0]", "ax6 = [0.0, 0.0, 0.0]", "ax6[0]"),
        ("ax = [0.0, 0.0, 1.0]", "ax = [0.0, 0.0]", "ax"),
        ("L = [1.7, 1.7, 1.7, 1.7, 1.7, 1.7]", "L = [1.7, 1.7]", "L"),
        (
            "L = [1.7, 1.7, 1.7, 1.7, 1.7, 1.7]",
            "L = [1.7, 1.7, -1.0]",
            "L[3]",
        ),
        ("c_act = [4.2081e-6", "c_act = [-4.2081e-6", "c_act[0]"),
        ("c_act = [", "# c_act = [", "c_act"),
        ("c_act = [", "c_cart = [", "c_cart"),
        (
            "metres_per_q = [1.0",
            "metres_per_q = [1.1",
            "axes.metres_per_q[0]",
        ),
        ("0.1, 0.1, 0.1]", "0.1, 0.1, 0.0]", "axes.metres_per_q[5]"),
        ("max_um = [4000.0, ", "max_um = [", "axes.position.max_um"),
        (
            "step_um = [20.0, 20.0, 20.0, 20.0, 20.0, 20.0]",
            "step_um = [20.0, 20.0, 20.0, 20.0, 20.0, 50.0]",
            "axes.position.accel_um[5]",
        ),
        ("3, 4, 5]", "3, 4, 4]", "motors.axis_of_motor"),
        ("3, 4, 5]", "3, 4, 6]", "motors.axis_of_motor"),
        ("home_m = [0.1,", "home_m = [3.0,", "simulation.home_m"),
    ];
    for (text, cases) in [(L2_TEXT, &l2[..]), (F1_TEXT, &f1)] {
        for (from, to, key) in cases {
            assert_refused(text, from, to, key);
        }
    }
    let error = AnyRobotFile::load("no/such/robot.toml").unwrap_err();
    assert!(
        error.to_string().starts_with("no/such/robot.toml: "),
        "{error}"
    );
}

#[test]
fn an_agitation_budget_is_in_nanometres_per_tick_or_absent() {
    let budgets = |text: &str| match AnyRobotFile::parse("x.toml", text).unwrap() {
        AnyRobotFile::L2(robot) => robot.limits.map(|axis| axis.agitation).to_vec(),
        AnyRobotFile::F1(robot) => robot.limits.map(|axis| axis.agitation).to_vec(),
    };
    let key = "agitation_um_per_s = [100, 100, 100]\n";
    assert_eq!(budgets(L2_TEXT), [AgitationBudget::new(100); 3]);
    let given = L2_TEXT.replace(key, "agitation_um_per_s = [1, 60, 1_000_000]\n");
    assert_eq!(
        budgets(&given),
        [1, 60, 1_000_000].map(AgitationBudget::new)
    );
    assert_eq!(budgets(&L2_TEXT.replace(key, "")), [None; 3]);
    assert_eq!(budgets(F1_TEXT), [None; 6]);
}

/// Changes of a text, and the keys of all errors that they cause, in the order of the checks.
#[track_caller]
fn assert_all(text: &str, changes: &[(&str, &str)], keys: &[&str]) {
    let changed = changes.iter().fold(text.to_owned(), |text, (from, to)| {
        assert!(text.contains(from), "{from} is not in the file");
        text.replacen(from, to, 1)
    });
    let errors = AnyRobotFile::check("x.toml", &changed).unwrap_err();
    let found: Vec<&str> = errors.iter().map(|error| &*error.key).collect();
    assert_eq!(found, keys, "{errors:#?}");
    let first = AnyRobotFile::parse("x.toml", &changed).unwrap_err();
    assert_eq!(first, errors[0]);
}

#[test]
fn all_errors_of_all_sections_are_found_at_once() {
    assert_all(
        L2_TEXT,
        &[
            ("L = [1.0, 1.1", "L = [1.0, -1.1"),
            ("[ 0.00,  0.08, 0.05]", "[ 0.00,  nan, 0.05]"),
            ("c = [1, -1, 1]", "c = [1, 0, 2]"),
            ("c_link = [5.0e-7", "c_link = [5.0"),
            ("ramp_um = [0.1", "ramp_um = [0.1005"),
            ("max_permille = [50", "max_permille = [-1"),
            ("axis_of_motor = [0, 1, 2]", "axis_of_motor = [0, 0, 0]"),
            ("cutoff_hz = 6.0", "cutoff_hz = inf"),
            ("gain = 1.0", "gain = 1.1"),
            ("spring_deviation = 0.03", "spring_deviation = 1.0"),
            ("jump_gap_m = 40.0e-6", "jump_gap_m = nan"),
        ],
        &[
            "c[1]",
            "c[2]",
            "A0[5]",
            "L[1]",
            "c_link[0]",
            "axes.position.ramp_um[0]",
            "axes.torque.max_permille[0]",
            "motors.axis_of_motor",
            "motors.axis_of_motor",
            "sensor.cutoff_hz",
            "client.gain",
            "simulation.spring_deviation",
            "simulation.jump_gap_m",
        ],
    );
}

/// Keys that are unknown, missing, or of another type, several in one section too; the ranges of
/// the other sections are judged as well.
#[test]
fn what_cannot_be_read_hides_no_other_error() {
    assert_all(
        L2_TEXT,
        &[
            ("model = \"l2\"", "model = \"l2\"\ncolour = \"red\""),
            ("cf = -1", ""),
            ("L = [1.0, 1.1, 1.0]", "L = [1.0]"),
            ("gain = 1.0", "gian = 1.0"),
            ("cutoff_hz = 6.0", "cutoff_hz = \"low\""),
            ("tare_samples = 1000", "tare_samples = -3"),
            ("seed = 2013", ""),
            ("max_um = [2000.0", "max_um = [\"far\""),
            ("spring_deviation = 0.03", "spring_deviation = 1.0"),
            ("axis_of_motor = [0, 1, 2]", "axis_of_motor = [0, 1, 1]"),
        ],
        &[
            "colour",
            "L",
            "cf",
            "axes.position.max_um",
            "sensor.cutoff_hz",
            "sensor.tare_samples",
            "client.gian",
            "client.gain",
            "simulation.seed",
            "motors.axis_of_motor",
        ],
    );
    assert_all(
        L2_TEXT,
        &[("[client]", "[clients]"), ("[motors]", "[motor]")],
        &["clients", "motor", "motors", "client"],
    );
    // Grammar comes first.
    assert_all(
        L2_TEXT,
        &[
            ("gain = 1.0", "gain = "),
            ("seed = 2013", "seed == 2013"),
            ("cf = -1", "cf = 7"),
        ],
        &["client.gain", "simulation.seed"],
    );
}

/// An element of a list of tables is named by its index, and an error in it by its own section.
#[test]
fn keys_in_lists_of_tables_have_their_index() {
    let wrist =
        "\n[[wrist]]\naxis = [1.0, 0.0, 0.0]\npoint_m = [0.0, 0.0, 0.1]\nc_rad_per_nm = 1.0e-5\n";
    let text = L2_TEXT.to_owned() + wrist + wrist;
    assert!(AnyRobotFile::parse("x.toml", &text).is_ok());
    let second = text.rfind("c_rad_per_nm").unwrap();
    let stiff = text[..second].to_owned() + "c_rad_per_nm = \"stiff\"\n";
    assert_all(&stiff, &[], &["wrist[1].c_rad_per_nm"]);
    assert_all(
        &text[..second],
        &[("gain = 1.0", "gain = 2.0")],
        &["wrist[1].c_rad_per_nm", "client.gain"],
    );
}

/// One error is one error: nothing that follows from it is reported.
#[test]
fn one_error_is_reported_once() {
    for (from, to) in [
        ("gain = 1.0", "gain = \"one\""),
        ("home_m = [0.0, 0.5, 0.65]", "home_m = [0.0, 0.5]"),
        ("home_m = [0.0, 0.5, 0.65]", "home_m = [0.0, 9.5, 0.65]"),
        ("metres_per_q = [1.0", "metres_per_q = [2.0"),
        ("max_um = [2000.0", "max_um = [1e300"),
        ("[[-0.51, 2.01]", "[[2.01, -0.51]"),
        ("c_cart = [", "# c_cart = ["),
        ("cf = -1", "cf = 0"),
        ("axis_of_motor = [0, 1, 2]", "axis_of_motor = 3"),
        ("[0.0, -1.0, 0.0]", "[0.0, 1.0, 0.0]"),
    ] {
        assert!(L2_TEXT.contains(from), "{from}");
        let errors = AnyRobotFile::check("x.toml", &L2_TEXT.replacen(from, to, 1)).unwrap_err();
        assert_eq!(errors.len(), 1, "{from} -> {to}: {errors:#?}");
    }
}

#[test]
fn lengths_may_be_given_per_arm() {
    let text = F1_TEXT.replace("L = [1.7, 1.7, 1.7, 1.7, 1.7, 1.7]", "L = [1.6, 1.7, 1.8]");
    let file = RobotFile::read::<F1Keys>("x", &text).unwrap();
    let expected = [1.6, 1.7, 1.7, 1.8, 1.8, 1.8].map(f64::to_bits);
    assert_eq!(file.model.geometry().lengths_m.map(f64::to_bits), expected);
    // Of an L2 per link as well, where a cluster's are equal.
    let per_link = L2_TEXT.replace("L = [1.0, 1.1, 1.0]", "L = [1.0, 1.1, 1.1, 1.0, 1.0, 1.0]");
    assert_ne!(per_link, L2_TEXT);
    assert_eq!(
        RobotFile::read::<L2Keys>("x", &per_link).unwrap().model,
        RobotFile::builtin_l2().unwrap().model
    );
}

#[test]
fn a_machine_has_a_name_or_a_path() {
    assert!(matches!(AnyRobotFile::named("l2"), Ok(AnyRobotFile::L2(_))));
    assert!(matches!(AnyRobotFile::named("f1"), Ok(AnyRobotFile::F1(_))));
    assert_eq!(AnyRobotFile::named("L2"), AnyRobotFile::named("l2"));
    assert_eq!(text_of("F1").unwrap(), F1_TEXT);
    let error = AnyRobotFile::named("l5").unwrap_err();
    assert_eq!(error.file, "l5");
    assert!(
        error
            .reason
            .ends_with("; the built-in machines are l2 and f1"),
        "{error}"
    );
}

/// Found by reading: `solve` with the path of an endless device never came back.
#[cfg(unix)]
#[test]
fn an_endless_file_is_refused() {
    let error = AnyRobotFile::load("/dev/zero").unwrap_err();
    assert!(error.to_string().contains("longer than"), "{error}");
    let error = AnyRobotFile::load("/").unwrap_err();
    assert_eq!(error.file, "/");
}

/// A section with as many numbers as its own length says is not yet one of this machine's.
/// A robot file with a calibration of so many parameters.
fn calibrated(text: &str, count: usize, columns: usize) -> String {
    let rows = vec![vec![0.0; columns]; count];
    format!(
        "{text}\n[calibrated]\nmeasurements = \"p.csv\"\ncrc = 0\nposes = 20\nchi2 = 1.0\ndof = 3\npredicted_rms_um = 50.0\n\
         frame = \"nominal\"\nrotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]\n\
         translation_m = [0.0, 0.0, 0.0]\nsd = {:?}\ncovariance = {rows:?}\n",
        vec![1e-5; count]
    )
}

#[test]
fn a_calibration_has_the_parameters_of_its_machine() {
    for (text, parameters) in [(L2_TEXT, 21), (F1_TEXT, 64)] {
        let good = calibrated(text, parameters, parameters);
        assert!(AnyRobotFile::parse("x.toml", &good).is_ok());
        for (count, columns, key) in [
            (parameters - 1, parameters - 1, "calibrated.sd"),
            (85 - parameters, 85 - parameters, "calibrated.sd"),
            (parameters, parameters + 1, "calibrated.covariance"),
        ] {
            let text = calibrated(text, count, columns);
            let error = AnyRobotFile::parse("x.toml", &text).unwrap_err();
            assert_eq!(error.key, key, "{error}");
            assert!(error.reason.contains(&parameters.to_string()), "{error}");
        }
    }
}

/// Deviations that are relative to nothing.
/// A robot file with deviations of zero, and a line behind them.
fn identified(zeros: &str, relative_to: &str) -> Result<AnyRobotFile, RobotFileError> {
    let rows = format!("[{}]", [zeros; 9].join(", "));
    let section = format!(
        "[identified]\nmeasurements = \"springs.csv\"\ncrc = 1\nwindows = 9\nchi2 = 1.0\ndof = 9\nsd = {zeros}\ncovariance = {rows}\n"
    );
    let text = format!("{}\n{section}{relative_to}", text_of("l2").unwrap());
    AnyRobotFile::parse("mine.toml", &text)
}

#[test]
fn compliances_that_deviations_are_relative_to_are_positive() {
    let zeros = format!("[{}]", ["0.0"; 9].join(", "));
    let positive = zeros.replace("0.0", "1e-7");
    assert!(identified(&zeros, "").is_ok());
    assert!(identified(&zeros, &format!("relative_to = {positive}\n")).is_ok());
    for wrong in [
        zeros.clone(),
        "[1e-7]".to_owned(),
        zeros.replace("0.0", "nan"),
        zeros.replace("0.0", "-1e-7"),
    ] {
        let error = identified(&zeros, &format!("relative_to = {wrong}\n"))
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("identified.relative_to: must have 9 entries, all positive"),
            "{error}"
        );
    }
}

/// [T Table 5.2] as it is printed, and half a metre per newton.
#[test]
fn compliances_that_no_spring_has_are_reported() {
    for value in ["-0.6351", "0.5"] {
        let text = L2_TEXT.replace("c_link = [5.0e-7", &format!("c_link = [{value}"));
        let said = RobotFile::read::<L2Keys>("x", &text)
            .unwrap_err()
            .to_string();
        assert!(
            said.contains("c_link[0]: is ")
                && said.contains("a compliance is positive, in m/N, from 1e-13"),
            "{said}"
        );
    }
}

#[test]
fn masses_that_no_machine_has_are_refused_by_key() {
    for (from, to, key) in [
        (
            "platform_kg = 12.0",
            "platform_kg = 0.0",
            "masses.platform_kg",
        ),
        (
            "platform_kg = 12.0",
            "platform_kg = nan",
            "masses.platform_kg",
        ),
        (
            "platform_inertia_kgm2 = [0.12, 0.12, 0.18]",
            "platform_inertia_kgm2 = [0.12, 0.12, 0.25]",
            "masses.platform_inertia_kgm2",
        ),
        (
            "platform_inertia_kgm2 = [0.12, 0.12, 0.18]",
            "platform_inertia_kgm2 = [[0.12, 0.01, 0.0], [0.0, 0.12, 0.0], [0.0, 0.0, 0.18]]",
            "masses.platform_inertia_kgm2",
        ),
        (
            "platform_inertia_kgm2 = [0.12, 0.12, 0.18]",
            "platform_inertia_kgm2 = 0.12",
            "masses.platform_inertia_kgm2",
        ),
        (
            "tool_inertia_kgm2 = [6.0e-3, 6.0e-3, 3.0e-3]",
            "tool_inertia_kgm2 = [6.0e-3, 0.0, 3.0e-3]",
            "masses.tool_inertia_kgm2",
        ),
        (
            "link_kg = [2.0, 2.0, 2.0, 2.0, 2.0, 2.0]",
            "link_kg = [2.0, 2.0, -2.0, 2.0, 2.0, 2.0]",
            "masses.link_kg[2]",
        ),
        (
            "cart_kg = [25.0, 25.0,",
            "cart_kg = [25.0, 0.0,",
            "masses.cart_kg[1]",
        ),
        (
            "motor_kg = [20.0, 20.0, 20.0]",
            "motor_kg = [20.0, 20.0]",
            "masses.motor_kg",
        ),
        (
            "motor_kg = [20.0, 20.0, 20.0]",
            "motor_kg = [20.0, 20.0, 0.5]",
            "masses.motor_kg[2]",
        ),
        (
            "motor_kg = [20.0, 20.0, 20.0]",
            "plate_inertia_kgm2 = [0.1, 0.1, 0.1]",
            "masses.plate_inertia_kgm2",
        ),
        (
            "damping_ratio = 0.02",
            "damping_ratio = 0.0",
            "masses.damping_ratio",
        ),
        (
            "damping_ratio = 0.02",
            "damping_ratio = 1.0",
            "masses.damping_ratio",
        ),
        ("gravity = true", "gravity = 9.81", "masses.gravity"),
        (
            "weight_n = [0.0, 0.0, -18.0]",
            "weight_n = [0.0, 0.0, 0.0]",
            "masses",
        ),
    ] {
        assert_refused(L2_TEXT, from, to, key);
    }
    assert_refused(
        F1_TEXT,
        "plate_inertia_kgm2 = [0.12, 0.12, 0.08]\n",
        "",
        "masses.plate_inertia_kgm2",
    );
    assert_refused(
        F1_TEXT,
        "plate_inertia_kgm2 = [0.12, 0.12, 0.08]",
        "plate_inertia_kgm2 = [0.12, 0.0, 0.08]",
        "masses.plate_inertia_kgm2[1]",
    );
}

#[test]
fn masses_come_from_their_section_the_tool_and_the_motors() {
    let masses = RobotFile::builtin_f1().unwrap().masses.unwrap();
    assert!((masses.tool.mass_kg - 18.0 / 9.80665).abs() < 1e-12);
    assert_eq!(masses.tool.centre_m, Vector3::new(0.01, 0.0, -0.12));
    // Two motors on each cart.
    let expected = [40.0, 40.0, 40.0, 20.0, 20.0, 20.0];
    assert_eq!(
        masses.motors_kg.map(f64::to_bits),
        expected.map(f64::to_bits)
    );
    let expected = [0.12, 0.12, 0.08];
    assert_eq!(
        masses.plates_kgm2.map(f64::to_bits),
        expected.map(f64::to_bits)
    );
    let usual = L2_TEXT
        .replace("motor_kg = [20.0, 20.0, 20.0]\n", "")
        .replace("platform_centre_m = [0.0, 0.0, 0.02]\n", "")
        .replace("tool_inertia_kgm2 = [6.0e-3, 6.0e-3, 3.0e-3]\n", "")
        .replace("damping_ratio = 0.02\ngravity = true\n", "")
        .replace(
            "platform_inertia_kgm2 = [0.12, 0.12, 0.18]",
            "platform_inertia_kgm2 = [[0.12, 0.01, 0], [0.01, 0.12, 0], [0, 0, 0.18]]",
        );
    let AnyRobotFile::L2(file) = AnyRobotFile::parse("x.toml", &usual).unwrap() else {
        panic!("not an L2");
    };
    let masses = file.masses.unwrap();
    assert_eq!(masses.motors_kg.map(f64::to_bits), [20.0_f64.to_bits(); 3]);
    assert_eq!(masses.platform.centre_m, Vector3::zeros());
    let crossed = Matrix3::new(0.12, 0.01, 0.0, 0.01, 0.12, 0.0, 0.0, 0.0, 0.18);
    assert_eq!(masses.platform.inertia_kgm2, crossed);
    assert_eq!(masses.tool.inertia_kgm2, Matrix3::zeros());
    assert_eq!(masses.damping_ratio.to_bits(), 0.02_f64.to_bits());
    assert!(masses.has_weight);
}

#[test]
fn the_limit_of_the_nominal_acceleration() {
    let keys = "nominal_accel_um = [20.0, 20.0, 20.0]";
    let parsed = |keys_now: &str| {
        let text = L2_TEXT.replace(keys, keys_now);
        AnyRobotFile::parse("x.toml", &text).map(|file| match file {
            AnyRobotFile::L2(file) => file.limits[1].nominal_accel,
            AnyRobotFile::F1(_) => panic!("the file is of an L2"),
        })
    };
    for (keys_now, expected) in [
        ("", None),
        (keys, Some((20_000, false))),
        (
            "nominal_accel_um = [20.0, 0.001, 20.0]\nnominal_accel_is_fault = true",
            Some((1, true)),
        ),
    ] {
        let found = parsed(keys_now).unwrap();
        let found = found.map(|limit| (limit.nm.get(), limit.is_fault));
        assert_eq!(found, expected, "{keys_now}");
    }
    for (keys_now, key, reason) in [
        (
            "nominal_accel_um = [20.0, 0.0, 20.0]",
            "axes.nominal_accel_um[1]",
            "must be positive",
        ),
        (
            "nominal_accel_um = [20.0, -1.0, 20.0]",
            "axes.nominal_accel_um[1]",
            "must be positive",
        ),
        (
            "nominal_accel_um = [20.0, 0.0005, 20.0]",
            "axes.nominal_accel_um[1]",
            "whole number",
        ),
        (
            "nominal_accel_um = [20.0, 20.0]",
            "axes.nominal_accel_um",
            "3 axes",
        ),
        (
            "nominal_accel_is_fault = true",
            "axes.nominal_accel_is_fault",
            "needs nominal_accel_um",
        ),
    ] {
        let error = parsed(keys_now).unwrap_err();
        assert_eq!(error.key, key, "{error}");
        assert!(error.reason.contains(reason), "{error}");
    }
}
