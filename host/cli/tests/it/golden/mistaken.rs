//! Tables with one mistake each, and what is said of them.

use super::Walk;
use crate::identification::changed;

/// A change of a table: columns, and the value of a cell by its row (from 0) and what was there.
type Mistake = (&'static [&'static str], fn(usize, f64) -> f64);

const FORCES: &[&str] = &["force_x_n", "force_y_n", "force_z_n"];
const WRENCH: &[&str] = &[
    "force_x_n",
    "force_y_n",
    "force_z_n",
    "moment_x_n_m",
    "moment_y_n_m",
    "moment_z_n_m",
];

const WRENCH_OF_TOOL: &[&str] = &[
    "force_x_n",
    "force_y_n",
    "force_z_n",
    "moment_x_nm",
    "moment_y_nm",
    "moment_z_nm",
];

const OF_SPRINGS: [(&str, Mistake); 16] = [
    ("a gauge reversed", (&["pz2_um"], |_, um| -um)),
    ("a gauge in mm", (&["py1_um"], |_, um| 1e-3 * um)),
    (
        "a gauge stuck",
        (&["axis1_um"], |row, um| if row > 15 { 40.0 } else { um }),
    ),
    ("a gauge at its end", (&["pz1_um"], |_, um| um.min(60.0))),
    (
        "a gauge touched",
        (&["px1_um"], |row, um| if row > 20 { um + 30.0 } else { um }),
    ),
    (
        "one reading",
        (&["pz3_um"], |row, um| if row == 6 { um + 50.0 } else { um }),
    ),
    (
        "a gauge coarse",
        (&["pz3_um"], |_, um| (um / 20.0).round() * 20.0),
    ),
    ("a force reversed", (&["force_y_n"], |_, newtons| -newtons)),
    ("forces in kg", (FORCES, |_, newtons| newtons / 9.80665)),
    ("wrench in kg", (WRENCH, |_, value| value / 9.80665)),
    ("wrench reversed", (WRENCH, |_, value| -value)),
    (
        "moments in N mm",
        (
            &["moment_x_n_m", "moment_y_n_m", "moment_z_n_m"],
            |_, value| 1e3 * value,
        ),
    ),
    (
        "forces cut",
        (FORCES, |_, newtons| newtons.clamp(-120.0, 120.0)),
    ),
    ("a force constant", (&["force_x_n"], |_, _| 3.0)),
    (
        "an axis elsewhere",
        (&["q_2"], |row, q| if row > 10 { q + 1e-3 } else { q }),
    ),
    ("wrench half", (WRENCH, |_, value| 0.5 * value)),
];

const OF_PLACES: [(&str, Mistake); 9] = [
    ("x reversed", (&["x_m"], |_, m| -m)),
    ("places in mm", (&["x_m", "y_m", "z_m"], |_, m| 1e3 * m)),
    ("an axis in mm", (&["q_1"], |_, q| 1e3 * q)),
    ("an axis reversed", (&["q_3"], |_, q| -q)),
    (
        "a place elsewhere",
        (&["y_m"], |row, m| if row == 5 { m + 0.5 } else { m }),
    ),
    (
        "device moved",
        (&["z_m"], |row, m| if row > 9 { m + 1e-3 } else { m }),
    ),
    (
        "coarse places",
        (&["x_m", "y_m"], |_, m| (m * 1e2).round() / 1e2),
    ),
    ("constant", (&["z_m"], |_, _| 0.6)),
    (
        "noise",
        (&["x_m", "y_m", "z_m"], |row, m| {
            m + if row % 2 == 0 { 3e-4 } else { -3e-4 }
        }),
    ),
];

const OF_TOOLS: [(&str, Mistake); 9] = [
    ("a force reversed", (&["force_y_n"], |_, newtons| -newtons)),
    ("wrench reversed", (WRENCH_OF_TOOL, |_, value| -value)),
    (
        "moments in N mm",
        (
            &["moment_x_nm", "moment_y_nm", "moment_z_nm"],
            |_, value| 1e3 * value,
        ),
    ),
    ("forces in kg", (FORCES, |_, newtons| newtons / 9.80665)),
    (
        "a force stuck",
        (
            &["force_x_n"],
            |row, newtons| if row > 1 { 7.0 } else { newtons },
        ),
    ),
    ("a moment constant", (&["moment_x_nm"], |_, _| 0.0)),
    (
        "one reading",
        (&["force_z_n"], |row, newtons| {
            if row == 3 { newtons + 40.0 } else { newtons }
        }),
    ),
    (
        "an axis elsewhere",
        (&["q_4"], |row, q| if row == 3 { 0.0 } else { q }),
    ),
    (
        "noise",
        (WRENCH_OF_TOOL, |row, value| {
            value + if row % 2 == 0 { 1.5 } else { -1.5 }
        }),
    ),
];

fn mistaken(table: &str, (columns, change): &Mistake) -> String {
    columns.iter().fold(table.to_owned(), |table, column| {
        changed(&table, column, change)
    })
}

/// Makes each of the mistakes in a table, and runs a command that replaces its output.
fn walk_over(walk: &mut Walk, table: &str, mistakes: &[(&str, Mistake)], command: &str) {
    let right = walk.folder.read(table);
    for (name, mistake) in mistakes {
        walk.said += &format!("{name}\n");
        walk.give(table, &mistaken(&right, mistake));
        walk.run(command);
    }
}

#[test]
fn springs_of_an_l2() {
    let mut walk = Walk::new("mistaken-springs-l2");
    walk.robot("l2", &super::GEARED);
    walk.run("plan springs --robot robot.toml --series 4 --poses 2 -o springs.toml");
    walk.run("experiment springs.toml --robot robot.toml --simulated 8 -o springs.csv");
    let identify = "identify springs.toml --robot robot.toml -o found.toml --overwrite";
    walk_over(&mut walk, "springs.csv", &OF_SPRINGS, identify);
    walk.end();
}

#[test]
fn springs_of_an_f1() {
    let mut walk = Walk::new("mistaken-springs-f1");
    walk.run("plan springs --robot f1 --series 6 --poses 1 -o springs.toml");
    walk.run("experiment springs.toml --robot f1 --simulated 8 -o springs.csv");
    let identify = "identify springs.toml --robot f1 -o found.toml --overwrite";
    walk_over(&mut walk, "springs.csv", &OF_SPRINGS, identify);
    walk.end();
}

#[test]
fn places_of_an_l2() {
    let mut walk = Walk::new("mistaken-places-l2");
    walk.robot("l2", &super::GEARED);
    walk.run("plan geometry --robot robot.toml --poses 16 -o places.toml");
    walk.run("experiment places.toml --robot robot.toml --simulated 5 -o places.csv");
    walk_over(
        &mut walk,
        "places.csv",
        &OF_PLACES,
        "calibrate places.toml --robot robot.toml -o found.toml --overwrite",
    );
    walk.end();
}

#[test]
fn tool_of_an_f1() {
    let mut walk = Walk::new("mistaken-tool-f1");
    crate::tool::measure_f1(&walk.folder);
    walk.given.push("tool.toml".to_owned());
    walk_over(
        &mut walk,
        "tool.csv",
        &OF_TOOLS,
        "identify tool.toml --robot f1 -o found.toml --overwrite",
    );
    walk.end();
}

#[test]
fn places_of_an_f1() {
    let mut walk = Walk::new("mistaken-places-f1");
    walk.run("plan geometry --robot f1 --poses 18 -o places.toml");
    walk.run("experiment places.toml --robot f1 --simulated 5 -o places.csv");
    // Contradictory poses take long.
    let quick: Vec<_> = OF_PLACES
        .into_iter()
        .filter(|(name, _)| !["coarse places", "constant", "noise"].contains(name))
        .collect();
    walk_over(
        &mut walk,
        "places.csv",
        &quick,
        "calibrate places.toml --robot f1 -o found.toml --overwrite",
    );
    walk.end();
}
