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

/// The usual gain of the drives takes the damping of an F1; that of its file does not.
#[test]
fn the_drives_of_an_f1_are_named() {
    let folder = Folder::new("stability_f1");
    let usual = ["stability", "--robot", "f1", "--json", "answer.json"];
    let usual = [&usual[..], &["--position-gain", "150"]].concat();
    let said = folder.run(&usual).failure(3);
    assert!(said.contains("margin, any phase is"), "{said}");
    let drives = answer(&folder)["drives"].clone();
    let limit_hz = drives["not_passive_below_hz"].as_f64().unwrap();
    assert!((limit_hz - 29.06).abs() < 0.01, "{drives}");
    let least = drives["least_damping_ratio"].as_f64().unwrap();
    assert!(least < 0.005, "{drives}");

    let said = folder.run(&usual[..5]).success();
    assert!(said.contains("stable, with the required margin"), "{said}");
    let least = &answer(&folder)["drives"]["least_damping_ratio"];
    assert!(least.as_f64().unwrap() > 0.015, "{least}");
}

/// The filters that were tried, and a page of its own with three charts, their maps and tables.
#[test]
fn a_filter_is_designed_and_a_page_is_written() {
    let folder = Folder::new("stability_design");
    let arguments = ["stability", "--robot", "l2", "--tool", "5", "--design"];
    let outputs = ["--json", "answer.json", "--page", "page.html"];
    let said = folder.run(&[&arguments[..], &outputs].concat()).success();
    let answer = answer(&folder);
    let tried = answer["design"]["tried"].as_array().unwrap();
    assert_eq!(tried.len(), 27);
    let fastest = &answer["design"]["fastest"];
    let suffices = |filter: &&Value| filter["suffices"].as_bool().unwrap();
    let settles_s = |filter: &Value| filter["settles_s"].as_f64().unwrap();
    let least = (tried.iter().filter(suffices).map(settles_s)).fold(f64::MAX, f64::min);
    assert!((settles_s(fastest) - least).abs() < 1e-9, "{fastest}");
    let named = "fastest with the required margins: second order, 6 Hz, 2 notches";
    assert!(said.contains(named), "{said}");
    // Heavier than the 5 kg of this judgement, whose margins suffice.
    let heaviest_kg = answer["heaviest_tool_kg"].as_f64().unwrap();
    assert!((5.0..10.0).contains(&heaviest_kg), "{heaviest_kg}");

    let page = folder.read("page.html");
    for heading in [
        "Tool and cut-off",
        "Workpiece and gain",
        "Margin over the travel",
        "Lowest mode over the travel",
    ] {
        assert!(page.contains(&format!("<h2>{heading}</h2>")), "{heading}");
    }
    assert_eq!(page.matches("<svg").count(), 8);
    assert_eq!(page.matches("<table").count(), 3);
    // A path that cannot be written is found before the survey.
    let said = folder
        .run(&["stability", "--robot", "l2", "--page", "no/such/page.html"])
        .failure(1);
    assert!(said.contains("no/such/page.html"), "{said}");
    // Nothing is loaded from elsewhere: the only address is the name of SVG.
    let own = page.replace("http://www.w3.org/2000/svg", "");
    assert!(!own.contains("://"), "{own}");
}

/// A stiffer machine takes a faster filter.
#[test]
fn a_stiff_machine_settles_sooner() {
    let folder = Folder::new("stability_stiff");
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../robots/l2-stiff.toml");
    let arguments = ["stability", "--robot", file, "--tool", "5"];
    let said = folder
        .run(&[&arguments[..], &["--json", "answer.json"]].concat())
        .success();
    assert!(said.contains("stable, with the required margin"), "{said}");
    assert!(answer(&folder)["settles_s"].as_f64().unwrap() < 0.04);
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
