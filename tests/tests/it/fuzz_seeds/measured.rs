//! Set-ups with their tables, plans, gauges and frames: one good file of each kind, and tables with
//! the columns that may be absent.

use std::fmt::Write;

use gantry_tau_tests::fuzzed::{BETWEEN, kinds_of_file};

use super::Seed;

const NOISE: &str = "[noise]\ngauge_um = 1.0\nforce_n = 1.0\nmoment_nm = 0.05\n";
const KNOWN: &str = "[setup]\ngauge_point_mm = 0.5\ngauge_axis_mrad = 2.0\nsensor_lever_mm = 1.0\n\
    sensor_axes_mrad = 1.0\nsensor_gain = 0.005\n";
const HOME: &str = "[[pose]]\nname = \"home\"\nT = [0.0, 0.5, 0.65]\n";
const TURNED: &str = "[[pose]]\nname = \"turned\"\nT = [0.1, 0.4, 0.7]\nR = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]\n";
const GAUGES: &str = "[[gauge]]\nname = \"pz\"\non = \"platform\"\npoint_m = [0.12, -0.06, 0.1]\naxis = [0.0, 0.0, 1.0]\n\
    [[gauge]]\nname = \"cart2\"\non = \"axis\"\naxis_number = 2\n";
const SERIES: &str = "[[series]]\nname = \"x\"\npose = \"home\"\nmounting = \"strap along x\"\nhook_m = [0.0, 0.0, -0.08]\n\
    direction = [1.0, 0.0, 0.0]\nlevels_n = [0.0, 60.0, 120.0, 0.0]\ngauges = [\"pz\", \"cart2\"]\n";
const PLACED: &str =
    "[noise]\nposition_um = [50.0, 50.0, 80.0]\nrotation_urad = [100.0, 100.0, 100.0]\n";
const FRAME: &str = "[[point]]\nname = \"a\"\nrobot_m = [0.0, 0.0, 0.0]\nmeasured_m = [3.0, 1.0, 0.0]\n\
    [[point]]\nname = \"b\"\nrobot_m = [2.0, 0.0, 0.0]\nmeasured_m = [3.0, 3.0, 0.0]\n\
    [[point]]\nname = \"c\"\nrobot_m = [0.0, 1.0, 0.5]\nmeasured_m = [2.0, 1.0, 0.5]\n";

fn head(kind: &str, model: &str) -> String {
    format!("format = \"gantry-tau {kind} 1\"\nmodel = \"{model}\"\nmeasurements = \"table.csv\"\n")
}

/// Columns of the axes, and so many zeros.
fn axes(model: &str) -> (String, String) {
    let count = if model == "l2" { 3 } else { 6 };
    let columns: Vec<String> = (1..=count).map(|axis| format!("q_{axis}")).collect();
    (columns.join(","), vec!["0.5"; count].join(","))
}

fn windows(model: &str, extra: &str, fields: &str) -> String {
    let (columns, q) = axes(model);
    let load = "force_x_n,force_y_n,force_z_n,moment_x_nm,moment_y_nm,moment_z_nm";
    let mut table =
        format!("series,mounting,pose,window,stroke,{columns},{load},pz_um,cart2_um{extra}\n");
    for (stroke, force) in [(0, "0"), (1, "60.5"), (-1, "3e1")] {
        writeln!(
            table,
            "s1,m1,home,w{stroke},{stroke},{q},{force},0,0,0,-4.8,0,3.5,-1{fields}"
        )
        .unwrap();
    }
    writeln!(table, "s2,m2,home,0,0,{q},0,0,0,0,0,0,,{fields}").unwrap();
    table
}

fn places(model: &str, is_turned: bool) -> String {
    let (columns, q) = axes(model);
    let (extra, fields) = if is_turned {
        (",rot_w,rot_x,rot_y,rot_z", ",0.6,0,0.8,0")
    } else {
        ("", "")
    };
    let mut table = format!("pose,{columns},x_m,y_m,z_m{extra}\n");
    for pose in 1..=3 {
        writeln!(table, "p{pose},{q},0.1,0.5,1.{pose}{fields}").unwrap();
    }
    table
}

/// A covariance of places, or of places and rotations that depend on each other.
fn covariance(size: usize) -> String {
    let mut rows = vec![vec![0.0; size]; size];
    for (row, entries) in rows.iter_mut().enumerate() {
        for (column, entry) in entries.iter_mut().enumerate() {
            *entry = match row.abs_diff(column) {
                0 => 4e-9,
                3 => 1e-9,
                _ => 0.0,
            };
        }
    }
    format!("[noise]\ncovariance = {rows:?}\n")
}

/// Readings of a sensor that carries a tool, in two poses of an F1.
const TOOL: &str = "pose,q_1,q_2,q_3,q_4,q_5,q_6,force_x_n,force_y_n,force_z_n,moment_x_nm,moment_y_nm,moment_z_nm\n\
    a,1.5,1.7,1.6,0,0,0,0.1,-0.2,-18,0.1,0.2,0.3\nb,1.5,1.7,1.6,0.1,-0.1,0.05,0.3,0.4,-17.9,0.1,0.2,0.3\n";

fn with_table(setup: String, table: String) -> String {
    setup + &BETWEEN[1..] + &table
}

fn planned_pose(model: &str) -> String {
    let (_, q) = axes(model);
    format!("{PLACED}{TURNED}q = [{q}]\n")
}

fn springs(model: &str) -> String {
    head("springs", model) + NOISE + KNOWN + HOME + GAUGES
}

pub(crate) fn seeds() -> Vec<Seed> {
    let sds = (
        ",pz_sd_um,cart2_sd_um,push_2_n,time_s,samples",
        ",0.5,,1000,12.5,200",
    );
    let all = [
        ("springs", with_table(springs("l2"), windows("l2", "", ""))),
        (
            "springs_with_every_column",
            with_table(springs("l2"), windows("l2", sds.0, sds.1)),
        ),
        (
            "springs_of_six_axes",
            with_table(springs("f1") + TURNED, windows("f1", sds.0, sds.1)),
        ),
        (
            "springs_without_noise",
            with_table(head("springs", "l2") + HOME + GAUGES, windows("l2", "", "")),
        ),
        (
            "springs_quoted",
            with_table(
                springs("l2"),
                windows("l2", "", "").replace("s1", "\"s \"\"1\"\"\n\""),
            ),
        ),
        ("plan", springs("l2") + SERIES),
        ("plan_of_six_axes", springs("f1") + SERIES),
        (
            "plan_that_was_measured",
            with_table(springs("l2") + SERIES, windows("l2", "", "")),
        ),
        (
            "plan_of_a_wrist",
            springs("l2").replace("\"platform\"", "\"tool\"")
                + SERIES
                + "wrist_rad = [0.5, -0.2]\n",
        ),
        ("gauges", GAUGES.to_owned()),
        (
            "poses",
            with_table(
                head("poses", "l2") + "[noise]\nposition_um = [50.0, 50.0, 80.0]\n",
                places("l2", false),
            ),
        ),
        (
            "poses_of_six_axes",
            with_table(head("poses", "f1") + PLACED, places("f1", true)),
        ),
        (
            "poses_with_a_covariance",
            with_table(head("poses", "l2") + &covariance(3), places("l2", true)),
        ),
        (
            "poses_that_turn_as_they_move",
            with_table(head("poses", "f1") + &covariance(6), places("f1", true)),
        ),
        ("plan_of_poses", head("poses", "l2") + &planned_pose("l2")),
        (
            "plan_of_poses_of_six_axes",
            head("poses", "f1") + &planned_pose("f1"),
        ),
        (
            "tool",
            with_table(
                head("tool", "f1") + "[noise]\nforce_n = 0.2\nmoment_nm = 0.01\n",
                TOOL.to_owned(),
            ),
        ),
        ("frame", format!("format = \"gantry-tau frame 1\"\n{FRAME}")),
    ];
    all.into_iter()
        .chain(wrong())
        .map(|(name, text)| (name.to_owned(), text.into_bytes()))
        .collect()
}

/// Poses with a covariance of this size in which a text is replaced.
fn placed(size: usize, from: &str, to: &str) -> String {
    let covariance = covariance(size).replacen(from, to, 1);
    with_table(head("poses", "f1") + &covariance, places("f1", true))
}

/// Files that were read, or refused in two lines.
fn wrong() -> Vec<(&'static str, String)> {
    let springs = head("springs", "l2") + NOISE + HOME + GAUGES;
    vec![
        ("wrong_covariance_of_infinity", placed(3, "4e-9", "inf")),
        ("wrong_covariance_of_a_kilometre", placed(3, "4e-9", "1e6")),
        (
            "wrong_covariance_of_nan_between_place_and_rotation",
            placed(6, "1e-9", "nan"),
        ),
        (
            "wrong_gauge_with_two_lines_in_its_name",
            springs.replace("\"cart2\"\non = \"axis\"", "\"a\\nb\"\non = \"rail\""),
        ),
        (
            "wrong_gauge_twice_in_a_series",
            springs + &SERIES.replace("\"pz\", ", "\"pz\", \"pz\", "),
        ),
        (
            "wrong_wrist_of_nan",
            head("springs", "l2") + HOME + GAUGES + SERIES + "wrist_rad = [nan]\n",
        ),
        (
            "wrong_frame_at_infinity",
            format!(
                "format = \"gantry-tau frame 1\"\n{}",
                FRAME.replace("2.0", "1e300")
            ),
        ),
        (
            "wrong_table_with_two_lines_in_its_name",
            placed(3, "x", "x")
                .replace("table.csv", "a\\nb")
                .replace("rot_w", "rot_v"),
        ),
    ]
}

/// Another name in the place of one, wherever it stands in a set-up and its table.
fn renamed(text: &str, old: &str, new: &str) -> String {
    let (setup, table) = text.split_once(BETWEEN).unwrap_or((text, ""));
    let rows = table.lines().map(|row| {
        let cells = row.split(',').map(|cell| match cell.strip_prefix(old) {
            Some("") => new.to_owned(),
            Some(unit @ ("_um" | "_sd_um")) => format!("{new}{unit}"),
            _ => cell.to_owned(),
        });
        cells.collect::<Vec<_>>().join(",")
    });
    let rows: Vec<String> = rows.collect();
    setup.replace(&format!("\"{old}\""), &format!("\"{new}\"")) + BETWEEN + &rows.join("\n")
}

#[test]
fn a_name_that_is_none_is_refused_wherever_it_stands() {
    let mut places = 0;
    for (seed, bytes) in seeds()
        .into_iter()
        .filter(|(seed, _)| !seed.starts_with("wrong"))
    {
        let text = String::from_utf8(bytes).unwrap();
        let kinds = kinds_of_file(text.as_bytes());
        for name in [
            "home",
            "turned",
            "pz",
            "cart2",
            "x",
            "strap along x",
            "s1",
            "m1",
            "w0",
            "p1",
            "a",
        ] {
            let other = renamed(&text, name, "other name");
            if !other.contains("other name") {
                continue;
            }
            places += 1;
            assert_eq!(kinds_of_file(other.as_bytes()), kinds, "{seed}, {name:?}");
            for bad in ["=1+1", "-x", "tur\u{202e}ned", "", &"x".repeat(65)] {
                let kinds = kinds_of_file(renamed(&text, name, bad).as_bytes());
                // A table of windows is not looked at for a plan.
                let is_read = kinds
                    .iter()
                    .any(|kind| seed.starts_with(kind) && *kind != "plan");
                assert!(
                    !is_read,
                    "{seed}, {name:?}: {bad:?} is taken for a name, in {kinds:?}"
                );
            }
        }
    }
    assert!(places > 40, "{places} places of names");
}

#[test]
fn a_seed_is_the_kind_of_file_that_its_name_says() {
    for (name, bytes) in seeds() {
        let kinds = kinds_of_file(&bytes);
        let is_right = if name.starts_with("wrong") {
            kinds.is_empty()
        } else {
            kinds.iter().any(|kind| name.starts_with(kind))
        };
        assert!(is_right, "{name} is read as {kinds:?}");
    }
}
