//! Time, stack and size of the firmware over the ways to build it: a table, and
//! `docs/cost-firmware.svg`.
//!
//! Not a test of anything but bits, so it is run only when asked for:
//! `GANTRY_TAU_DRAW_FRONTIER=1 cargo test -p gantry-tau-tests --test tools firmware::frontier -- --nocapture`.

use std::fs;
use std::path::{Path, PathBuf};

use gantry_tau_report::plots::{Curve, Plot};

use super::budget::{self, Measured};
use super::emulator::{self, Build};
use super::{image, replay, traffic};

/// One way to build, for the Cortex-M7.
struct Variant {
    name: &'static str,
    /// Settings of cargo's profile `release`, beyond those of the firmware's manifest.
    settings: &'static [&'static str],
    /// Attributes of functions that are taken out of core.
    without: &'static [&'static str],
}

const fn with(name: &'static str, settings: &'static [&'static str]) -> Variant {
    Variant {
        name,
        settings,
        without: &[],
    }
}

const VARIANTS: [Variant; 7] = [
    with("1", &["opt-level=1"]),
    with("2", &[]),
    with("3", &["opt-level=3"]),
    with("s", &["opt-level='s'"]),
    with("z", &["opt-level='z'"]),
    with(
        "z, core 2",
        &["opt-level='z'", "package.gantry-tau-core.opt-level=2"],
    ),
    Variant {
        name: "2, core without attributes",
        settings: &[],
        without: &["#[cold]", "#[inline(never)]"],
    },
];

/// True if the frontier is asked for.
pub(crate) fn is_asked_for() -> bool {
    std::env::var_os("GANTRY_TAU_DRAW_FRONTIER").is_some_and(|value| value == "1")
}

/// Builds and measures every variant.
pub(crate) fn draw() {
    let tree = copy_of_the_tree();
    let mut curves: Vec<Curve> = VARIANTS
        .iter()
        .map(|variant| curve(variant.name, &measure(&tree, variant)))
        .collect();
    curves.push(goals());
    let plot = Plot::new(
        "Cost of the firmware by the way it is built",
        "code of the whole core with both machines, KiB",
        "worst tick, 1000 instructions: L2 (low), F1 (high)",
        curves,
    );
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs");
    fs::write(docs.join("cost-firmware.svg"), plot.svg().as_str()).unwrap();
}

/// Returns the line from the L2's worst tick to the F1's.
fn curve(name: &str, measured: &Measured) -> Curve {
    let ends = ["l2_tick_worst", "f1_tick_worst"]
        .map(|tick| point(measured["text_whole"], measured[tick]));
    Curve::line(name, ends.to_vec()).with_dots()
}

/// Returns the corner of the goals: the line of a build that reached all three begins below it and
/// ends inside, or below.
fn goals() -> Curve {
    let text = budget::goal("m7_small_whole", "text");
    // The goals are those of hostile traffic as well.
    let l2 = budget::goal("m7_hostile", "l2_tick_worst");
    let f1 = budget::goal("m7_hostile", "f1_tick_worst");
    let left = text - text / 8;
    Curve::line(
        "goals",
        vec![
            point(left, f1),
            point(text, f1),
            point(text, l2),
            point(left, l2),
        ],
    )
}

/// Returns a point of the plot: KiB, 1000 instructions.
fn point(bytes: i64, instructions: i64) -> (f64, f64) {
    (bytes as f64 / 1024.0, instructions as f64 / 1000.0)
}

/// Builds a variant and plays all recordings; each has to be bit-equal to the host.
fn measure(tree: &Path, variant: &Variant) -> Measured {
    for part in COPIED {
        // The firmware's own attributes are not about speed: it measures its stack.
        let without = if part == "core" { variant.without } else { &[] };
        copy(&root().join(part), &tree.join(part), without);
    }
    let settings: Vec<String> = variant
        .settings
        .iter()
        .map(|setting| format!("--config=profile.release.{setting}"))
        .collect();
    let settings: Vec<&str> = settings.iter().map(String::as_str).collect();
    let images = emulator::images_of(&tree.join("tests/firmware"), Build::M7, &settings);
    let mut measured = Measured::new();
    for recording in traffic::all() {
        for (what, value) in replay::measure(Build::M7, &images, recording) {
            let worst = measured.entry(what).or_insert(value);
            *worst = value.max(*worst);
        }
    }
    for name in ["whole", "session_only"] {
        measured.insert(format!("text_{name}"), image::text(&images.join(name)));
    }
    let panics = image::panics(&images.join("whole")).len();
    measured.insert("panics".to_owned(), i64::try_from(panics).unwrap());
    let columns = [
        "text_whole",
        "text_session_only",
        "l2_tick_worst",
        "f1_tick_worst",
        "stack_ticks",
        "panics",
    ];
    let row = columns.map(|column| format!("{column}={}", measured[column]));
    println!("build=\"{}\" {}", variant.name, row.join(" "));
    measured
}

/// Parts of the tree that the firmware is built from.
const COPIED: [&str; 4] = ["Cargo.toml", "core", "host/labcomm", "tests/firmware"];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Returns a folder for a copy, so that the tree itself keeps its attributes and its images.
fn copy_of_the_tree() -> PathBuf {
    let tree = emulator::place("frontier-tree");
    for part in COPIED {
        fs::create_dir_all(tree.join(part).parent().unwrap()).unwrap();
    }
    tree
}

/// Copies a file or a folder, without what was built, and without lines that are one of `without`.
fn copy(from: &Path, to: &Path, without: &[&str]) {
    if from.is_dir() {
        fs::create_dir_all(to).unwrap();
        for entry in fs::read_dir(from).unwrap() {
            let name = entry.unwrap().file_name();
            if name != "target" {
                copy(&from.join(&name), &to.join(&name), without);
            }
        }
    } else if from.extension().is_some_and(|extension| extension == "rs") {
        let text = fs::read_to_string(from).unwrap();
        let kept = text.lines().filter(|line| !without.contains(&line.trim()));
        fs::write(to, kept.map(|line| format!("{line}\n")).collect::<String>()).unwrap();
    } else {
        fs::copy(from, to).unwrap();
    }
}
