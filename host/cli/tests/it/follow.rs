//! `follow`: the position loop outside the drive against the one inside, and what it costs.

use serde_json::Value;

use crate::process::Folder;

const PAGE: &str = include_str!("../../../../docs/drives.md");

/// Numbers of a row of the JSON.
struct Row(Value);

impl Row {
    fn of(all: &Value, latency: Option<(u8, u8)>) -> Self {
        let wanted =
            latency.map(|(command, actual)| serde_json::json!({"command_cycles": command, "actual_cycles": actual}));
        let rows = all["loops"].as_array().unwrap();
        let found = rows
            .iter()
            .find(|row| row["latency"] == wanted.clone().unwrap_or(Value::Null));
        Self(
            found
                .unwrap_or_else(|| panic!("no row {latency:?}: {all}"))
                .clone(),
        )
    }

    fn get(&self, key: &str) -> f64 {
        self.0[key]
            .as_f64()
            .unwrap_or_else(|| panic!("{key}: {}", self.0))
    }
}

impl Row {
    /// Checks a number to 5 %.
    fn assert_near(&self, key: &str, expected: f64) {
        let found = self.get(key);
        assert!(
            (found / expected - 1.0).abs() < 0.05,
            "{key}: {found} instead of {expected}: {}",
            self.0
        );
    }
}

fn follow(folder: &Folder, more: &[&str]) -> (String, Value) {
    let arguments = [&["follow", "--json", "follow.json"], more].concat();
    let said = folder.run(&arguments).success();
    (
        said,
        serde_json::from_str(&folder.read("follow.json")).unwrap(),
    )
}

/// Writes the built-in file of a machine without its masses.
fn massless(folder: &Folder, robot: &str) -> String {
    let name = format!("massless-{robot}.toml");
    folder.write(&name, &crate::masses::massless(robot));
    name
}

/// Rows of the table.
fn rows_of(said: &str) -> Vec<&str> {
    let lines = said.lines().skip(2);
    lines.take_while(|line| !line.is_empty()).collect()
}

/// Lags and force steps of the specification's model, computed apart: µm, within 5 %.
#[test]
fn the_table_is_that_of_the_model() {
    let folder = Folder::new("follow");
    let (said, all) = follow(&folder, &["--robot", &massless(&folder, "l2")]);
    for (latency, gain, plain, misaligned, velocity, pushed) in [
        (None, 150.0, 3_333.0, None, 5.3, 19.5),
        (Some((0, 0)), 141.7, 3_529.0, Some(503.0), 5.6, 21.1),
        (Some((1, 0)), 102.5, 4_880.0, Some(1_003.0), 6.8, 25.3),
        (Some((1, 1)), 80.2, 6_231.0, Some(1_504.0), 7.7, 28.3),
        (Some((2, 2)), 56.0, 8_934.0, Some(2_504.0), 9.0, 32.2),
    ] {
        let row = Row::of(&all, latency);
        row.assert_near("gain_per_s", gain);
        row.assert_near("plain_um", plain);
        row.assert_near("velocity_um", velocity);
        row.assert_near("pushed_um", pushed);
        let Some(misaligned) = misaligned else {
            continue;
        };
        row.assert_near("misaligned_um", misaligned);
        assert!(row.get("velocity_um") <= row.get("plain_um") / 200.0);
        assert!(row.get("torque_um") <= row.get("velocity_um") / 2.0);
        assert!(row.get("wrong_mass_um") <= row.get("plain_um") / 1_000.0);
    }
    let (inside, outside) = (Row::of(&all, None), Row::of(&all, Some((1, 1))));
    assert!((1_400.0..1_600.0).contains(&outside.get("misaligned_um")));
    let softer = outside.get("pushed_um") / inside.get("pushed_um");
    assert!((1.3..1.6).contains(&softer), "{softer}");
    assert!(
        said.contains(&format!("moves a cart {softer:.2} times as far as")),
        "{said}"
    );
    let rows = rows_of(&said);
    assert_eq!(rows.len(), 7, "{said}");
    for row in rows {
        assert!(PAGE.contains(row.trim_end()), "docs/drives.md lacks {row}");
    }
    let page = folder.read("follow.html");
    assert_eq!(page.matches("<svg").count(), 5);
    assert!(page.contains("The price: a force step") && !page.contains("could not be drawn"));
}

/// At 2 m/s^2, which begins at once, so that everything swings to twice what it rests at: a cart of 25
/// kg with its part of arms and platform behind a spring of 0.06 um/N, and a tool that 5 m/s^2 moves by
/// 66 um ([docs/dynamics.md]).
#[test]
fn with_masses_carts_lag_behind_their_springs_and_the_tool_behind_them() {
    let folder = Folder::new("follow_masses");
    let (said, all) = follow(&folder, &[]);
    let inside = Row::of(&all, None);
    let (cart_um, tool_um) = (inside.get("velocity_um"), inside.get("tool_um"));
    let swing_um = 2.0 * 2.0 * (25.0 + 10.0) * 0.06;
    assert!((cart_um - 5.3 - swing_um).abs() < 3.0, "{said}");
    assert!((tool_um - 2.0 * 66.0 * 2.0 / 5.0).abs() < 10.0, "{said}");
    let without = follow(&folder, &["--robot", &massless(&folder, "l2")]);
    assert_eq!(Row::of(&without.1, None).0["tool_um"], Value::Null);
    assert!(!without.0.contains("tool") && without.0.contains("in the drive"));
    for row in rows_of(&said) {
        assert!(PAGE.contains(row.trim_end()), "docs/drives.md lacks {row}");
    }
}

#[test]
fn a_latency_of_its_own_is_a_row_and_the_six_axes_follow_too() {
    let folder = Folder::new("follow_f1");
    let (said, all) = follow(
        &folder,
        &[
            "--robot",
            &massless(&folder, "f1"),
            "--delay",
            "5,4",
            "--report",
            "f1.html",
        ],
    );
    let row = Row::of(&all, Some((5, 4)));
    assert!(
        row.get("velocity_um") <= row.get("plain_um") / 200.0,
        "{said}"
    );
    assert_eq!(all["shown"]["command_cycles"], 5);
    // The file's, not the usual 150.
    Row::of(&all, None).assert_near("gain_per_s", 30.0);
    assert!(folder.read("f1.html").contains("outside, 5 + 4"));
}

#[test]
fn what_cannot_be_compared_is_refused_by_name() {
    let folder = Folder::new("follow_refused");
    for delay in ["6,1", "5,5", "1", "1,x", "-1,0"] {
        let said = folder
            .run(&["follow", &format!("--delay={delay}")])
            .failure(2);
        assert!(said.contains("together at most 9"), "{delay}: {said}");
    }
    let l2 = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../robots/l2.toml"));
    folder.write(
        "narrow.toml",
        &l2.replace(
            "nominal_travel_m = [[-0.5, 2.0]",
            "nominal_travel_m = [[0.6, 0.7]",
        ),
    );
    let said = folder.run(&["follow", "--robot", "narrow.toml"]).failure(1);
    assert!(
        said.contains("narrow.toml: the carts have no room for a way of 250 mm"),
        "{said}"
    );
    let said = folder
        .run(&["follow", "--report", "no/such/folder.html"])
        .failure(1);
    assert!(said.contains("cannot write no/such/folder.html"), "{said}");
}
