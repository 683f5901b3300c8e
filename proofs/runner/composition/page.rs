//! The page `composition.md`: its axioms are rows of the manifest, at the stated number of axes; its
//! lists of axioms and theorems are written by `table`.

use std::collections::{BTreeMap, BTreeSet};

use super::axioms::Axiom;
use super::record::Record;
use crate::manifest::Manifest;
use crate::page::item;

/// Lines between which `table` writes.
const BEGIN: &str = "<!-- written by `table` -->";
const END: &str = "<!-- end of what `table` writes -->";

/// Axioms that the manifest does not have, or has at another number of axes; rows that the text
/// names and the manifest does not have. `sources` has the other names of the text.
pub(super) fn disagreements(page: &str, manifest: &Manifest, sources: &str) -> Vec<String> {
    // A definition, or a field of a record.
    let is_of_sources = |name: &str| {
        ["Theorem", "Definition", "Axiom", "Inductive", "Fixpoint"]
            .iter()
            .any(|word| sources.contains(&format!("{word} {name} ")))
            || sources.contains(&format!(" {name} : "))
    };
    let mut wrong = Vec::new();
    for line in page.lines() {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let at = match cells.as_slice() {
            ["", axiom, _, at, _, ""] if axiom.starts_with('A') => Some(*at),
            _ => None,
        };
        // Names of rows, and not those of files.
        let names = line
            .split('`')
            .skip(1)
            .step_by(2)
            .filter(|name| name.contains('_') && !name.contains(['.', ' ']));
        for name in names {
            match manifest.row(name) {
                None if is_of_sources(name) => {}
                None => wrong.push(format!(
                    "proofs/composition.md: {name} is not a row of the manifest"
                )),
                Some(row) if at.is_some_and(|at| !row.domain.starts_with(at)) => {
                    wrong.push(format!(
                        "proofs/composition.md: {name} is of {}, not of {}",
                        row.domain,
                        at.unwrap_or_default()
                    ));
                }
                Some(_) => {}
            }
        }
    }
    wrong
}

/// Page without what `table` writes.
pub(super) fn by_hand(page: &str) -> String {
    let before = page.split(BEGIN).next().unwrap_or_default();
    let after = page.split(END).nth(1).unwrap_or_default();
    format!("{before}{after}")
}

/// Page with the lists of axioms and theorems. `runs` is the text of `Runs.v`, which has a sentence
/// for each theorem.
pub(super) fn with_lists(
    page: &str,
    axioms: &[Axiom],
    manifest: &Manifest,
    record: &Record,
    runs: &str,
) -> String {
    let Some((before, rest)) = page.split_once(BEGIN) else {
        return page.to_owned();
    };
    let Some((_, after)) = rest.split_once(END) else {
        return page.to_owned();
    };
    let mut text = format!("{before}{BEGIN}\n\n");
    text.push_str("Axioms, and the values for which their rows are proved:\n\n");
    for axiom in axioms {
        let domain = match manifest.row(&axiom.name) {
            Some(row) if row.assumes.is_empty() => row.domain.clone(),
            Some(row) => format!("{}; where {}", row.domain, row.assumes.join(", and ")),
            None if axiom.is_of_type() => {
                "no row: an invariant of a type, which its constructor checks".to_owned()
            }
            None => "no row: read from the source".to_owned(),
        };
        item(&mut text, &format!("`{}`: {domain}.", axiom.name));
    }
    let all: Vec<BTreeSet<&String>> = (record.theorems.values())
        .map(|rows| rows.iter().collect())
        .collect();
    let base: BTreeSet<&String> = (all.iter().cloned())
        .reduce(|one, other| &one & &other)
        .unwrap_or_default();
    text.push_str("\nEvery theorem rests on these, the base:\n\n");
    item(&mut text, &names(base.iter().copied()));
    text.push_str("\nTheorems, and what each rests on in addition:\n\n");
    let said = sentences(runs);
    for (theorem, rows) in &record.theorems {
        let more = rows.iter().filter(|row| !base.contains(row));
        let more = names(more);
        let more = if more.is_empty() {
            "the base alone"
        } else {
            &more
        };
        let sentence = said.get(theorem.as_str()).map_or("", String::as_str);
        item(&mut text, &format!("`{theorem}`: {sentence} (On {more}.)"));
    }
    text + "\n" + END + after
}

/// Names in code, separated by commas.
fn names<'a>(all: impl Iterator<Item = &'a String>) -> String {
    let all: Vec<String> = all.map(|name| format!("`{name}`")).collect();
    all.join(", ")
}

/// Comments before the theorems of a source, in one line each.
fn sentences(source: &str) -> BTreeMap<&str, String> {
    let mut found = BTreeMap::new();
    let mut comment = String::new();
    for line in source.lines() {
        if let Some(begins) = line.strip_prefix("(** ") {
            comment = begins.to_owned();
        } else if let Some(rest) = line.strip_prefix("Theorem ") {
            let name = rest.split([' ', ':']).next().unwrap_or_default();
            let mut said = (comment.split("*)").next().unwrap_or_default().trim()).to_owned();
            if rest.contains(" : N = 3%nat -> ") {
                said.push_str(" At three axes only.");
            }
            found.insert(name, said);
            comment.clear();
        } else if !comment.is_empty() && !comment.contains("*)") {
            comment.push(' ');
            comment.push_str(line.trim());
        } else {
            comment.clear();
        }
    }
    found
}
