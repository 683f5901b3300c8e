//! Robot files, and requests to `solve`.

use serde_json::json;

use super::Seed;
use crate::oracle_vectors::machine;

fn replaced(robot: &str, from: &str, to: &str) -> String {
    assert!(
        robot.contains(from),
        "{from} is not in the robot file:\n{robot}"
    );
    robot.replacen(from, to, 1)
}

/// The repository's robot files, and one with each kind of mistake.
pub(crate) fn robots() -> Vec<Seed> {
    let l2 = include_str!("../../../../robots/l2.toml");
    let (first_half, _) = l2.split_at(l2.len() / 2);
    let all = [
        ("l2", l2.to_owned()),
        ("nothing", String::new()),
        ("cut_off", first_half.to_owned()),
        ("no_toml", "model = = \"l2\"\n".to_owned()),
        ("model_unknown", replaced(l2, "\"l2\"", "\"l3\"")),
        ("model_of_six_axes", replaced(l2, "\"l2\"", "\"f1\"")),
        ("key_unknown", replaced(l2, "cf = -1", "cf = -1\ncg = 1")),
        ("key_twice", replaced(l2, "cf = -1", "cf = -1\ncf = 1")),
        ("key_missing", replaced(l2, "cf = -1", "")),
        ("sign_of_zero", replaced(l2, "cf = -1", "cf = 0")),
        ("length_of_nan", replaced(l2, "L = [1.0", "L = [nan")),
        ("length_of_infinity", replaced(l2, "L = [1.0", "L = [inf")),
        ("length_of_text", replaced(l2, "L = [1.0", "L = [\"1\"")),
        ("two_lengths", replaced(l2, "L = [1.0, ", "L = [")),
        ("length_of_zero", replaced(l2, "L = [1.0", "L = [0.0")),
        (
            "guideway_that_leads_nowhere",
            replaced(l2, "[1.0, 0.0, 0.0],", "[0.0, 0.0, 0.0],"),
        ),
        (
            "travel_reversed",
            replaced(l2, "[[-0.5, 2.0]", "[[2.0, -0.5]"),
        ),
        (
            "joint_too_far_away",
            replaced(l2, "[ 0.10, -0.05, 1.28]", "[ 0.10, -0.05, 1.28e9]"),
        ),
        (
            "compliance_of_zero",
            replaced(l2, "c_link = [5.0e-7", "c_link = [0.0"),
        ),
        ("section_missing", replaced(l2, "[axes]\n", "[axis]\n")),
    ];
    let more = robots_of_six_axes()
        .into_iter()
        .chain(robots_with_drives())
        .chain(robots_that_measured());
    all.into_iter()
        .chain(more)
        .map(|(name, text)| (name.to_owned(), text.into_bytes()))
        .collect()
}

/// Robot files with drives of their own, that take positions and velocities.
fn robots_with_drives() -> Vec<(&'static str, String)> {
    let (l2, f1) = (
        include_str!("../../../../robots/l2.toml"),
        include_str!("../../../../robots/f1.toml"),
    );
    let drives =
        "[drives]\nbacklash_um = 20.0\nbias_permille = 200\npeak_seconds = 5.0\n\n[simulation]";
    let velocities = "[drives]\ninterface = \"velocity\"\nwatchdog_cycles = 5\n\n\
                      [position_loop]\nmax_m_per_s = 2.0\npath_m_per_s2 = 5.0\n\n[simulation]";
    let narrow = replaced(l2, "[simulation]", velocities);
    let ends = "machine_travel_m = [[-0.51, 2.01], [-2.01, 0.51], [-0.51, 2.01]]";
    vec![
        (
            "f1_drives",
            replaced(
                f1,
                "position_gain_per_s = 30.0",
                "backlash_um = 20.0\nbias_permille = 200\npeak_seconds = 5.0",
            ),
        ),
        ("section_twice", replaced(f1, "[simulation]", drives)),
        ("drives_of_no_pair", replaced(l2, "[simulation]", drives)),
        (
            "velocities",
            replaced(
                &narrow,
                ends,
                "machine_travel_m = [[-1.0, 3.0], [-3.0, 1.0], [-1.0, 3.0]]",
            ),
        ),
        ("velocities_without_room", narrow),
    ]
}

fn robots_of_six_axes() -> Vec<(&'static str, String)> {
    let f1 = include_str!("../../../../robots/f1.toml");
    let lengths = "L = [1.7, 1.7, 1.7, 1.7, 1.7, 1.7]";
    vec![
        ("f1", f1.to_owned()),
        (
            "f1_length_per_arm",
            replaced(f1, lengths, "L = [1.7, 1.7, 1.7]"),
        ),
        (
            "f1_four_lengths",
            replaced(f1, lengths, "L = [1.7, 1.7, 1.7, 1.7]"),
        ),
        (
            "f1_axis_of_zero",
            replaced(f1, "ax6 = [0.0, 1.0, 0.0]", "ax6 = [0.0, 0.0, 0.0]"),
        ),
        ("f1_sign_of_two", replaced(f1, "sigma4 = -1", "sigma4 = 2")),
        ("f1_motor_of_no_axis", replaced(f1, "3, 4, 5]", "3, 4, 6]")),
        (
            "f1_five_axes",
            replaced(f1, "max_um = [4000.0, ", "max_um = ["),
        ),
        (
            "f1_home_out_of_reach",
            replaced(f1, "home_m = [0.1,", "home_m = [9.1,"),
        ),
    ]
}

/// A robot file with identified springs, a play and a wrist.
fn learned(robot: &str, springs: usize) -> String {
    let identified = section("identified", "windows", &spread(springs, 1e-9));
    format!("{robot}\n{identified}\n{PLAY}\n{WRIST}")
}

/// Robot files with what measurements write into them: the geometry of an L2, and a joint of a
/// wrist, which is a spring more.
fn robots_that_measured() -> Vec<(&'static str, String)> {
    let l2 = include_str!("../../../../robots/l2.toml");
    let f1 = include_str!("../../../../robots/f1.toml");
    // The 64 parameters of an F1 would make a seed that takes its time.
    let calibrated = section(
        "calibrated",
        "poses",
        &format!("{PLACED}{}", spread(21, 1e-5)),
    );
    let (l2, f1) = (
        format!("{}\n{calibrated}", learned(l2, 10)),
        learned(f1, 13),
    );
    vec![
        ("chi2_of_nan", replaced(&l2, "chi2 = 90.5", "chi2 = nan")),
        (
            "frame_that_mirrors",
            replaced(
                &l2,
                "[0.0, 0.0, 1.0]]\ntranslation",
                "[0.0, 0.0, -1.0]]\ntranslation",
            ),
        ),
        (
            "gap_of_infinity",
            replaced(&l2, "gap_m = 2.0e-4", "gap_m = inf"),
        ),
        (
            "spread_below_zero",
            replaced(&l2, "sd = [1e-5", "sd = [-1e-5"),
        ),
        (
            "wrist_axis_of_two",
            replaced(&l2, "axis = [0.0, 0.0, 1.0]", "axis = [0.0, 0.0, 2.0]"),
        ),
        ("l2_learned", l2),
        ("f1_learned", f1),
    ]
}

const PLACED: &str = "predicted_rms_um = 42.0\nframe = \"measured\"\n\
    rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]\ntranslation_m = [3.0, -1.0, 0.5]\n";
const PLAY: &str = "[play]\ngap_m = 2.0e-4\nsd_m = 1.0e-5\npreload_rising_n = [330.0, 360.0]\n\
    preload_falling_n = [300.0, 330.0]\n";
const WRIST: &str =
    "[[wrist]]\naxis = [0.0, 0.0, 1.0]\npoint_m = [0.0, 0.0, 0.1]\nc_rad_per_nm = 1.0e-5\n";

fn section(name: &str, rows: &str, rest: &str) -> String {
    format!(
        "[{name}]\nmeasurements = \"{name}.csv\"\ncrc = 7\n{rows} = 60\nchi2 = 90.5\ndof = 88\n{rest}"
    )
}

fn spread(parameters: usize, sd: f64) -> String {
    let mut covariance = vec![vec![0.0; parameters]; parameters];
    for (row, entries) in covariance.iter_mut().enumerate() {
        entries[row] = sd * sd;
    }
    format!(
        "sd = {:?}\ncovariance = {covariance:?}\n",
        vec![sd; parameters]
    )
}

/// Every operation on the first case of both machines of the oracle's vectors, and lines that are
/// not requests.
pub(crate) fn requests() -> Vec<Seed> {
    let mut seeds = Vec::new();
    for model in ["l2", "f1"] {
        let (robot, cases) = machine(model);
        let case = &cases[0];
        for op in [
            "ik",
            "fk",
            "jacobian",
            "statics",
            "compliance",
            "deflection",
            "compensate",
        ] {
            let mut request = json!({"id": op, "robot": robot, "op": op, "w": case["w"]});
            if op == "fk" {
                request["q"] = case["q"].clone();
            } else {
                request["T"] = case["T"].clone();
            }
            if model == "f1" && op != "fk" {
                request["R"] = case["R"].clone();
            }
            seeds.push((format!("{model}_{op}"), format!("{request}\n").into_bytes()));
        }
        let masses = json!({
            "platform_kg": 12.0, "platform_centre": [0.0, 0.0, 0.02], "platform_I": [0.12, 0.12, 0.18],
            "link_kg": [2.0, 2.0, 2.0, 2.0, 2.0, 2.0], "cart_kg": [25.0, 25.0, 25.0],
            "plate_I": [0.12, 0.12, 0.08], "tool_kg": 1.8, "tool_centre": [0.01, 0.0, -0.12],
            "tool_I": [[6e-3, 0.0, 0.0], [0.0, 6e-3, 0.0], [0.0, 0.0, 3e-3]],
        });
        for op in ["dynamics", "modes", "loop"] {
            let mut request = json!({"robot": robot, "op": op, "tcp_m": case["T"], "axes": case["q"], "masses": masses});
            if model == "f1" {
                request["rotation"] = case["R"].clone();
            }
            if op == "dynamics" {
                request["wrench"] = case["w"].clone();
            }
            if op == "loop" {
                request["filter"] = json!("butterworth2_6_notch_1_3_q0.7");
            }
            // Far beyond what a machine has, too.
            let mut far = request.clone();
            far["axes"] = json!(vec![1e300; case["q"].as_array().unwrap().len()]);
            seeds.push((
                format!("{model}_{op}"),
                format!("{request}\n{far}\n").into_bytes(),
            ));
        }
        let seeded = json!({"robot": robot, "op": "fk", "q": case["q"], "seed": {"T": case["T"], "R": case["R"]}});
        let far = json!({"robot": robot, "op": "ik", "T": [0.0, 9e9, 0.0]});
        let not_finite = format!("{far}").replace("9000000000.0", "1e999");
        seeds.push((
            format!("{model}_several"),
            format!("{seeded}\n{far}\n{not_finite}\n").into_bytes(),
        ));
    }
    let bad = "\n{}\n[1]\nnonsense\n{\"id\":1,\"op\":\"ik\"}\n{\"op\":7}\n{\"op\":\"ik\",\"robot\":7}\n{\"op\":\"ik\",\"robot\":{\"model\":\"l4\"}}";
    seeds.push(("no_requests".to_owned(), bad.into()));
    seeds.push(("no_utf_8".to_owned(), b"\xff\xfe\n{}\n".to_vec()));
    seeds
}

#[test]
fn a_robot_file_that_measured_is_read() {
    use gantry_tau_machine::robot_file::AnyRobotFile;
    for (name, text) in robots_that_measured() {
        let read = AnyRobotFile::parse(name, &text);
        assert_eq!(read.is_ok(), name.ends_with("_learned"), "{name}: {read:?}");
    }
}
