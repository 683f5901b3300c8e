//! README shows the code that is compiled, and the other way round; docs/embedding.md states the
//! sizes that are.

use gantry_tau_core::control::endpoint::Endpoint;
use gantry_tau_core::control::session::BlackBox;
use gantry_tau_core::model::{f1, l2};

/// The line in README before the block that shows the example.
const MARKER: &str = "<!-- tests/examples/embed.rs -->";

#[test]
fn readme_shows_the_example_that_is_compiled() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/");
    let example = std::fs::read_to_string(format!("{folder}examples/embed.rs")).unwrap();
    let part = example.split("    // README\n").nth(1).unwrap();
    let part: String = (part.lines())
        .map(|line| line.strip_prefix("    ").unwrap().to_owned() + "\n")
        .collect();
    let readme = std::fs::read_to_string(format!("{folder}../README.md")).unwrap();
    let after = readme.split_once(MARKER).map(|(_, after)| after);
    let after = after.expect("README.md lacks the marker");
    let block = after
        .trim_start()
        .strip_prefix("```rust\n")
        .expect("no ```rust block follows the marker");
    let (block, _) = block.split_once("```").unwrap();
    assert_eq!(block, part, "README.md shows other code");
}

/// A number as the documents write it.
fn grouped(number: usize) -> String {
    let digits = number.to_string();
    let groups = digits.as_bytes().rchunks(3).rev();
    let groups: Vec<_> = groups.map(String::from_utf8_lossy).collect();
    groups.join(" ")
}

#[test]
fn embedding_states_the_sizes_of_the_objects() {
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/embedding.md");
    let page = std::fs::read_to_string(page).unwrap();
    let rows = [
        (size_of::<Endpoint<3>>(), size_of::<Endpoint<6>>()),
        (size_of::<BlackBox<3, 16>>(), size_of::<BlackBox<6, 16>>()),
        (size_of::<BlackBox<3, 64>>(), size_of::<BlackBox<6, 64>>()),
        (size_of::<l2::Compensator>(), size_of::<f1::Compensator>()),
    ];
    for (one, other) in rows {
        let cell = format!("| {}, {} |", grouped(one), grouped(other));
        assert!(page.contains(&cell), "docs/embedding.md lacks {cell}");
    }
}

/// Numbers of a text, with spaces between their groups of digits.
fn numbers(text: &str) -> impl Iterator<Item = i64> {
    text.split(|c: char| !c.is_ascii_digit() && c != ' ')
        .filter_map(|digits| digits.replace(' ', "").parse().ok())
}

/// The table of the firmware's page states what is recorded of its images.
#[test]
fn the_page_of_the_firmware_states_what_is_recorded() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/firmware/");
    let [sizes, page] = ["sizes.toml", "README.md"]
        .map(|name| std::fs::read_to_string(format!("{folder}{name}")).unwrap());
    let sizes: toml::Table = sizes.parse().unwrap();
    let images = sizes["measured"].as_table().unwrap().values();
    let recorded: Vec<i64> = images
        .flat_map(|image| image.as_table().unwrap().values())
        .filter_map(toml::Value::as_integer)
        .collect();
    let (_, section) = page.split_once("## Numbers").unwrap();
    let (section, _) = section.split_once("## Which build").unwrap();
    let mut stated = 0;
    for row in section.lines().filter(|line| line.starts_with("| ")) {
        let cells: Vec<&str> = row.split('|').collect();
        for number in cells[3..5].iter().flat_map(|cell| numbers(cell)) {
            // Smaller ones are no sizes.
            if number >= 1_000 {
                stated += 1;
                assert!(
                    recorded.contains(&number),
                    "{number} is not in sizes.toml: {row}"
                );
            }
        }
    }
    assert!(stated > 12, "{stated}");
}
