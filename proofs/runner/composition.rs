//! The composition: theorems about runs, checked by Coq, whose axioms are rows of the manifest.

mod axioms;
mod coq;
mod page;
mod record;

use std::path::Path;

use crate::manifest::Manifest;
use crate::prove::Job;
use crate::results::{Standing, Standings};
use crate::{files, read};

pub(crate) use self::coq::{check, prove};
use self::record::Record;

/// Folder of the sources, from the repository's root.
const FOLDER: &str = "proofs/composition";
/// Page for readers.
const PAGE: &str = "proofs/composition.md";
/// Sources, in the order in which they are compiled.
const SOURCES: [&str; 5] = ["Rows", "Runs", "Witness", "Covers", "Assumptions"];
/// Words that would take something for proved.
const FORBIDDEN: [&str; 4] = ["Admitted", "admit", "give_up", "Unset"];

/// Path of a source.
fn source(root: &Path, name: &str) -> std::path::PathBuf {
    root.join(FOLDER).join(format!("{name}.v"))
}

/// Everything that disagrees: an axiom says no more than its row.
pub(crate) fn disagreements(root: &Path, manifest: &Manifest) -> Result<Vec<String>, String> {
    let page = read(&root.join(PAGE))?;
    let (rows, runs) = (read(&source(root, "Rows"))?, read(&source(root, "Runs"))?);
    let axioms = axioms::axioms(&rows);
    let mut wrong = Vec::new();
    for mutant in coq::mutants_of(root)? {
        if rows.matches(&mutant.old).count() != 1 {
            wrong.push(format!(
                "{FOLDER}/mutants.toml: {}: its text does not stand once in Rows.v",
                mutant.name
            ));
        }
    }
    wrong.extend(page::disagreements(&page, manifest, &(rows + &runs)));
    let mut properties = String::new();
    for path in files(&root.join("proofs/src/properties"))? {
        properties.push_str(&read(&path)?);
    }
    let witness = read(&source(root, "Witness"))?;
    for axiom in axioms {
        wrong.extend(axiom.disagreements(manifest, &properties));
        if axiom.is_read() && !page::by_hand(&page).contains(&axiom.name) {
            wrong.push(format!(
                "{PAGE}: does not say that {} is taken for granted",
                axiom.name
            ));
        }
        let has_proof = ["Lemma", "Definition"].iter().any(|word| {
            witness
                .split(&format!("{word} {}", axiom.name))
                .skip(1)
                .any(|rest| rest.starts_with([' ', '\n']))
        });
        if !has_proof {
            wrong.push(format!("{FOLDER}/Witness.v: does not prove {}", axiom.name));
        }
    }
    if written(root, manifest)? != page {
        wrong.push(format!("{PAGE}: differs from its sources; run `table`"));
    }
    for name in SOURCES {
        wrong.extend(taken_for_proved(name, &read(&source(root, name))?));
    }
    Ok(wrong)
}

/// Words of a source that take something for proved, outside the rows.
fn taken_for_proved(name: &str, text: &str) -> Vec<String> {
    let text = axioms::without_comments(text);
    let words = text.split(|letter: char| !(letter.is_alphanumeric() || letter == '_'));
    let mut is_type = false;
    let mut wrong = Vec::new();
    for word in words {
        // The witness is of any number of axes, which is its argument.
        let is_argument = name == "Witness" && word == "Parameter";
        is_type |= name == "Rows" && word == "FUNCTIONS";
        match word {
            "Axiom" | "Axioms" | "Parameter" | "Parameters" | "Conjecture"
                if !(is_type || is_argument) =>
            {
                wrong.push(format!("{FOLDER}/{name}.v: {word} outside the rows"));
            }
            _ if FORBIDDEN.contains(&word) => {
                wrong.push(format!("{FOLDER}/{name}.v: {word}"));
            }
            _ => {}
        }
    }
    wrong
}

/// Theorems (`T21`) of the composition that a row without a current result, or a stale composition,
/// leaves open; and sentences about them.
pub(crate) fn open(
    root: &Path,
    standings: &Standings<'_>,
) -> Result<(Vec<String>, Vec<String>), String> {
    let (mut said, mut open) = (Vec::new(), Vec::new());
    let (mut unstated, axioms) = (Vec::new(), axioms::axioms(&read(&source(root, "Rows"))?));
    for axiom in &axioms {
        let sentences = axiom.unstated(standings);
        if !sentences.is_empty() {
            unstated.push(&axiom.name);
        }
        said.extend(sentences);
    }
    let record = Record::load(root)?;
    let is_stale = record.sources != record::hash(root)?;
    if is_stale {
        said.push("STALE: composition (Coq has not checked these sources)".to_owned());
    }
    let untried = coq::mutants_of(root)?
        .len()
        .saturating_sub(record.mutants.len());
    if untried > 0 {
        said.push(format!(
            "STALE: composition ({untried} of its mutants have not run on these sources)"
        ));
    }
    for (theorem, rows) in &record.theorems {
        let row = rows.iter().find(|name| {
            let is_open = |(job, standing): &(Job<'_>, Standing<'_>)| {
                job.name() == *name && !matches!(standing, Standing::Current(_))
            };
            unstated.contains(name) || standings.iter().any(is_open)
        });
        if let Some(row) = row {
            said.push(format!(
                "STALE: {theorem} (rests on {row}, which has no result on this source)"
            ));
        }
        if is_stale || row.is_some() {
            open.extend(numbers(theorem));
        }
    }
    Ok((said, open))
}

/// Numbers in the name of a theorem: T1, T2 and T3 of `T1_T2_T3_no_offset_jumps`.
fn numbers(theorem: &str) -> Vec<String> {
    let parts = theorem.split('_');
    let is_number = |part: &&str| {
        part.strip_prefix('T').is_some_and(|number| {
            !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit())
        })
    };
    parts.filter(is_number).map(str::to_owned).collect()
}

/// Page with its lists as the sources have them.
fn written(root: &Path, manifest: &Manifest) -> Result<String, String> {
    let axioms = axioms::axioms(&read(&source(root, "Rows"))?);
    let (page, runs) = (read(&root.join(PAGE))?, read(&source(root, "Runs"))?);
    let record = Record::load(root)?;
    Ok(page::with_lists(&page, &axioms, manifest, &record, &runs))
}

/// Writes the lists of the page.
pub(crate) fn write(root: &Path, manifest: &Manifest) -> Result<(), String> {
    let path = root.join(PAGE);
    std::fs::write(&path, written(root, manifest)?).map_err(crate::at(&path))
}
