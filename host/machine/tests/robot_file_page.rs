//! `docs/robot-file.md` against the parser: every section has the keys that the parser takes.
#![allow(clippy::unwrap_used, clippy::panic, reason = "tests fail by panicking")]

use std::collections::BTreeSet;

use gantry_tau_machine::robot_file::{AnyRobotFile, text_of};

const PAGE: &str = include_str!("../../../docs/robot-file.md");
/// A key that no section has.
const UNKNOWN: &str = "unknown_key";

/// Text below a heading, up to the next one of its level or above.
fn below(heading: &str) -> &'static str {
    let (_, rest) = PAGE
        .split_once(&format!(
            "
{heading}
"
        ))
        .unwrap();
    let section = rest
        .split(
            "
## ",
        )
        .next()
        .unwrap();
    let is_lower = heading.starts_with("### ");
    if is_lower {
        section
            .split(
                "
### ",
            )
            .next()
            .unwrap()
    } else {
        section
    }
}

/// Keys in the first column of the tables.
fn keys(text: &str) -> BTreeSet<String> {
    let first_cells = text
        .lines()
        .filter_map(|line| line.strip_prefix("| ")?.split(" |").next());
    let quoted = first_cells.flat_map(|cell| cell.split('`').skip(1).step_by(2));
    quoted.map(str::to_owned).collect()
}

/// The example of the page.
fn minimal() -> &'static str {
    let (_, block) = below("## A minimal file")
        .split_once("```toml my.toml\n")
        .unwrap();
    block.split("```").next().unwrap()
}

/// Puts an unknown key into a section, which is appended if the text has none.
fn with_unknown_key(text: &str, section: &str) -> String {
    let key = format!("{UNKNOWN} = 1\n");
    match text.split_once(&format!("\n{section}\n")) {
        _ if section.is_empty() => key + text,
        Some((before, after)) => format!("{before}\n{section}\n{key}{after}"),
        None => format!("{text}\n{section}\n{key}"),
    }
}

/// Keys that the parser names when it refuses an unknown one.
fn accepted(text: &str) -> BTreeSet<String> {
    let error = AnyRobotFile::parse("page.toml", text).unwrap_err().reason;
    let (_, list) = error
        .split_once(&format!("unknown field `{UNKNOWN}`, expected "))
        .unwrap_or_else(|| panic!("{error}"));
    list.split('`')
        .skip(1)
        .step_by(2)
        .map(str::to_owned)
        .collect()
}

#[test]
fn the_example_is_a_robot_file() {
    AnyRobotFile::parse("minimal.toml", minimal()).unwrap();
}

#[test]
fn every_section_has_the_keys_of_the_parser() {
    let headings: Vec<&str> = PAGE
        .lines()
        .filter_map(|line| line.strip_prefix("## ["))
        .collect();
    assert!(headings.len() > 10, "{headings:?}");
    for heading in &headings {
        let section = format!("[{heading}");
        let name = heading.trim_matches(|c| c == '[' || c == ']');
        let mut documented = keys(below(&format!("## {section}")));
        // Tables within have headings of their own.
        let tables = headings.iter().filter_map(|other| {
            let other = other.trim_matches(|c| c == '[' || c == ']');
            other.strip_prefix(name)?.strip_prefix('.')
        });
        documented.extend(tables.map(str::to_owned));
        assert_eq!(
            documented,
            accepted(&with_unknown_key(minimal(), &section)),
            "{section}"
        );
    }
}

#[test]
fn every_kind_of_machine_has_the_keys_of_the_parser() {
    let common = keys(below("## Top level").split("\n### ").next().unwrap());
    for kind in ["l2", "f1"] {
        let accepted = accepted(&with_unknown_key(&text_of(kind).unwrap(), ""));
        let own = keys(below(&format!("### With `model = \"{kind}\"`")));
        let (sections, keys): (BTreeSet<String>, BTreeSet<String>) =
            accepted.into_iter().partition(|key| {
                PAGE.contains(&format!("\n## [{key}]\n"))
                    || PAGE.contains(&format!("\n## [[{key}]]\n"))
            });
        assert!(sections.len() > 10, "{sections:?}");
        assert_eq!(
            common.union(&own).cloned().collect::<BTreeSet<_>>(),
            keys,
            "{kind}"
        );
    }
}
