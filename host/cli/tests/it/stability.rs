//! `stability`.

use gantry_tau_machine::robot_file::text_of;
use serde_json::Value;

use crate::process::Folder;

fn answer(folder: &Folder) -> Value {
    serde_json::from_str(&folder.read("answer.json")).unwrap()
}

/// The filter of the file swings, the one with notches does not; every number that is printed is in
/// the answer.
#[test]
fn the_filter_decides_on_an_l2() {
    let folder = Folder::new("stability");
    let first = [
        "stability",
        "--robot",
        "l2",
        "--tool",
        "5",
        "--filter",
        "first-order",
        "--cutoff",
        "20",
        "--json",
        "answer.json",
    ];
    let run = folder.run(&first);
    let said = run.failure(3);
    assert!(said.contains("it swings in free air"), "{said}");
    let refused = answer(&folder);
    assert_eq!(refused["format"], "gantry-tau stability 1");
    assert!(
        refused["margin_any_phase"]["value"].as_f64().unwrap() < 0.2,
        "{refused}"
    );
    assert!(
        refused["growth"]["per_s"].as_f64().unwrap() > 1.0,
        "{refused}"
    );
    assert_eq!(refused["faults"].as_array().unwrap().len(), 4);

    // That of the file.
    let auto = [&first[..5], &first[9..]].concat();
    let said = folder.run(&auto).success();
    assert!(said.contains("stable, with the required margin"), "{said}");
    let stable = answer(&folder);
    let margin = stable["margin_any_phase"]["value"].as_f64().unwrap();
    assert!(
        margin > 9.0 && said.contains(&format!("{margin:.2}")),
        "{said}"
    );
    for key in [
        "margin_modes_wrong",
        "margin_phase_per_axis",
        "growth",
        "contact",
        "drives",
        "places",
    ] {
        assert!(stable[key].is_object(), "{key} of {stable}");
    }
    for direction in ["x", "y", "z", "xz"] {
        let growths = stable["contact"][direction].as_array().unwrap();
        assert_eq!(growths.len(), 11);
        assert!(
            growths
                .iter()
                .all(|growth| growth["per_s"].as_f64().unwrap() < 0.0)
        );
    }
    assert!(stable["faults"].as_array().unwrap().is_empty());
}

#[test]
fn the_drives_of_an_f1_are_named() {
    let folder = Folder::new("stability_f1");
    let said = folder
        .run(&["stability", "--robot", "f1", "--json", "answer.json"])
        .failure(3);
    assert!(said.contains("margin, any phase is"), "{said}");
    let drives = &answer(&folder)["drives"];
    let limit_hz = drives["not_passive_below_hz"].as_f64().unwrap();
    assert!((limit_hz - 29.06).abs() < 0.01, "{drives}");
    assert!(
        drives["least_damping_ratio"].as_f64().unwrap() < 0.005,
        "{drives}"
    );
}

#[test]
fn a_machine_without_masses_and_a_wrong_option_are_named() {
    let folder = Folder::new("stability_bad");
    let text = text_of("l2").unwrap();
    let (before, rest) = text.split_once("[masses]").unwrap();
    let (_, after) = rest.split_once("\n[simulation]").unwrap();
    folder.write("massless.toml", &format!("{before}\n[simulation]{after}"));
    let said = folder
        .run(&["stability", "--robot", "massless.toml"])
        .failure(2);
    assert!(said.contains("massless.toml: masses: is missing"), "{said}");
    for (option, value) in [
        ("--tool", "0"),
        ("--tool", "heavy"),
        ("--damping", "1"),
        ("--cutoff", "NaN"),
        ("--latency", "2"),
        ("--position-gain", "500"),
        ("--filter", "third-order"),
    ] {
        let said = folder
            .run(&["stability", "--robot", "l2", option, value])
            .failure(2);
        assert!(said.contains(option) && said.contains(value), "{said}");
    }
}
